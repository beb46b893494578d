"""Facts of an identification that its page states."""

import numpy as np
import pytest

from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.report import facts
from tests.support.made_up_run import change_last_cycle, make_anatomy, make_run


def test_rivals_are_those_that_the_data_do_not_rule_out():
    run = make_run(rivals=4)
    best = run.cycles[-1].genomes[:1]
    genomes = best[np.zeros(4, int)]
    genomes.placement[1, 2] = (best.placement[0, 2] + 0.5) % 1
    genomes.length[2, 2] += 0.01
    losses = 4 * np.array([1.0, 1.05, 1.4, 1.6])  # of four actions
    found = facts.list_rivals(change_last_cycle(run, genomes=genomes, losses=losses))
    assert [r.rank for r in found] == [1, 2, 3]
    side = facts.SIDES[genomes.side[1, 2]]
    assert [r.differs for r in found] == [
        (),
        (f"part_2 on the {side} side",),
        ("part_2 +10 mm long",),
    ]
    assert found[0].away == found[0].apart == 0 and found[1].away > 1


def test_the_side_of_a_body_is_that_of_its_genome():
    anatomy = make_anatomy(8)
    genomes = draw_genomes(anatomy, 200, np.random.default_rng(0), False)
    np.testing.assert_array_equal(
        facts.find_true_side(build_bodies(anatomy, genomes)), genomes.side
    )


@pytest.mark.parametrize(
    "count, said",
    [
        (0, "0"),
        (999, "999"),
        (1000, "1k"),
        (16_375, "16.4k"),
        (999_499, "999k"),
        (999_500, "1M"),
        (1_250_000, "1.25M"),
    ],
)
def test_numbers_on_an_axis_are_short(count, said):
    assert facts.format_thousands(count) == said
