"""Accidents as users say them or as they are drawn."""

import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.robot.accidents import (
    BODY_KINDS,
    WORLD_KINDS,
    draw_damage,
    parse_accident,
)
from selfheal.robot.actions import load_published_body

BODY = load_published_body()
ANATOMY = BODY.anatomy


@pytest.mark.parametrize(
    "said",
    [
        *(
            "",
            ",",
            "right_lower",
            "right_lower:9",
            "right_lower:x",
            "right_lower:.1:.2",
        ),
        *("jam:left_hip:nan", "weak:left_hip:.5:.5", "loss:left_upper:3", "slope:"),
        *("random:x", "random:1,dead:clearance", "loss:left_upper, loss:left_upper"),
    ],
)
def test_what_makes_no_sense_is_refused(said):
    with pytest.raises(InputError):
        parse_accident(said, ANATOMY)


def test_random_damage_is_of_the_kinds_asked_for_and_repeats():
    assert parse_accident("random:3", ANATOMY) == parse_accident("random:3", ANATOMY)
    for kinds in (BODY_KINDS, WORLD_KINDS):
        drawn = {
            draw_damage(ANATOMY, np.random.default_rng(k), kinds).kind
            for k in range(60)
        }
        assert drawn == set(kinds)
