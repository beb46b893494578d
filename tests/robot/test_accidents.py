"""Accidents as users say them or as they are drawn."""

from collections import Counter

import numpy as np
import pytest

from selfheal.damage.apply import list_gone_targets
from selfheal.errors import InputError
from selfheal.robot.accidents import (
    BODY_KINDS,
    WORLD_KINDS,
    draw_damage,
    draw_strikes,
    parse_accident,
)
from selfheal.robot.actions import load_published_body

BODY = load_published_body()
ANATOMY = BODY.anatomy


@pytest.mark.parametrize(
    "said",
    [
        *("", ",", "slope:", "right_lower", "right_lower:9", "right_lower:x"),
        *("right_lower:.1:.2", "jam:left_hip:nan", "weak:left_hip:.5:.5"),
        *("loss:left_upper:3", "loss:left_upper, loss:left_upper"),
        *("random:x", "random:1,dead:clearance"),
    ],
)
def test_what_makes_no_sense_is_refused(said):
    with pytest.raises(InputError):
        parse_accident(said, ANATOMY)


def test_random_damage_is_of_the_kinds_asked_for_and_repeats():
    assert parse_accident("random:3", ANATOMY) == parse_accident("random:3", ANATOMY)
    for kinds in (BODY_KINDS, WORLD_KINDS):
        drawn = [
            draw_damage(ANATOMY, np.random.default_rng(k), kinds) for k in range(60)
        ]
        assert {damage.kind for damage in drawn} == set(kinds)


def _draw(seed, seconds=3600.0, rest=70.0):
    return draw_strikes(BODY, seconds, rest, np.random.default_rng(seed))


def test_damages_of_an_hour_repeat_and_leave_time_between():
    assert _draw(3) == _draw(3) != _draw(4)
    for seed in range(40):
        times = [0.0, *(strike.time for strike in _draw(seed))]
        assert min(np.diff([*times, times[-1] + 70])) >= 70 - 1e-3
        assert times[-1] < 3600


def test_all_kinds_of_the_body_and_its_sensors_are_drawn_about_six_an_hour():
    drawn = [_draw(seed) for seed in range(200)]
    kinds = {strike.damage.kind for strikes in drawn for strike in strikes}
    assert kinds == {*BODY_KINDS, "weak_sensor"}
    mean = np.mean([len(strikes) for strikes in drawn])
    assert mean == pytest.approx(6, abs=3 * np.sqrt(6 / 200) + 0.5)


def test_nothing_breaks_that_is_gone():
    for seed in range(40):
        before = []
        for strike in _draw(seed, 40_000.0):
            assert strike.damage.target not in list_gone_targets(BODY, before)
            before.append(strike.damage)


def test_what_grows_comes_back_in_equal_steps():
    drawn = [_draw(seed, 9000.0) for seed in range(40)]
    growing = [Counter(strike.damage for strike in strikes) for strikes in drawn]
    steps = [(d, n) for found in growing for d, n in found.items() if n > 1]
    assert steps
    assert all(d.kind in ("part_scale", "weak_motor") and n <= 3 for d, n in steps)
