"""Gaits that are searched: repeatable, better than standing still."""

import numpy as np
import pytest

from selfheal.engine.plant import build_rated_plant
from selfheal.gait.synthesis import (
    Effort,
    Gait,
    GaitTask,
    LikelyPlants,
    evaluate_gait,
    project_on_heading,
    synthesize_gaits,
    walk_gait,
)
from selfheal.robot.actions import load_published_body

PLANT = build_rated_plant(load_published_body())
LIKELY = LikelyPlants([PLANT])
SHORT = Effort(((2, 3, 2.0), (1, 6, 2.0)), drawn=12)


def test_heading_turns_the_way():
    along, across = project_on_heading(np.array([[0.0, 2.0]]), np.pi / 2)
    assert along == pytest.approx(2.0)
    assert across == pytest.approx(0.0)


def test_synthesis_repeats_and_beats_standing_still():
    (first,), (again,) = (
        synthesize_gaits(LIKELY, GaitTask(seed=5), SHORT) for _ in range(2)
    )
    assert np.array_equal(first.genes, again.genes)
    assert first.predicted == again.predicted
    assert first.low <= first.predicted <= first.high
    assert first.predicted > 0.02
    assert first.simulations == 12 + (2 * 3 + 6) * 14 + 16


def test_each_search_that_is_left_gives_a_gait():
    effort = Effort(((3, 1, 2.0), (2, 1, 2.0)), drawn=12)
    gaits = synthesize_gaits(LIKELY, GaitTask(seed=5), effort)
    assert len(gaits) == 2
    assert not np.array_equal(gaits[0].genes, gaits[1].genes)
    assert {gait.simulations for gait in gaits} == {12 + (3 + 2) * 14 + 16}


@pytest.mark.slow
def test_a_search_from_a_good_gait_keeps_it():
    good = max(
        (synthesize_gaits(LIKELY, GaitTask(seed=s), SHORT)[0] for s in (5, 6)),
        key=lambda g: g.predicted,
    )
    (again,) = synthesize_gaits(LIKELY, GaitTask(seed=9), SHORT, start=good)
    assert again.predicted > 0.5 * good.predicted


def test_the_judge_knows_that_standing_still_goes_nowhere():
    still = Gait("waves", np.zeros(25), 0.0, 9.0, 9.0, 9.0, 0, 0)
    assert evaluate_gait(LIKELY, still, 0).predicted == pytest.approx(0.0, abs=0.03)
    assert walk_gait([PLANT], still, 2.0).energy[0] < 0.5
