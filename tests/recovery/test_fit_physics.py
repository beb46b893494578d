"""A model's numbers fitted to how the whole robot walked."""

from dataclasses import fields

import numpy as np

from selfheal.damage.apply import build_damaged_plants
from selfheal.engine.reflex import (
    STEPS_PER_SAMPLE,
    build_intact_plants,
    scale_physics,
    simulate_controllers,
)
from selfheal.recovery.fit_physics import fit_physics
from tests.support.short_recover import (
    BUILT,
    JAM,
    LOST,
    QUADRUPED,
    ignore_progress,
    walk_before,
)


def test_a_model_that_is_right_stays_as_it_is(walker):
    rng = np.random.default_rng(0)
    found = fit_physics(QUADRUPED, walker, walk_before(walker), rng, ignore_progress)
    np.testing.assert_array_equal(found, BUILT)
    plants = build_damaged_plants(QUADRUPED, [(LOST,), (JAM,)])
    same = scale_physics(plants, found)
    for f in fields(plants)[1:]:
        np.testing.assert_array_equal(getattr(plants, f.name), getattr(same, f.name))


def test_a_model_is_fitted_to_how_the_whole_robot_walked(walker, mismatched):
    _, before, found = mismatched
    assert len(found) > 1
    both = np.vstack([BUILT, found[:1]])
    plants = scale_physics(build_intact_plants(QUADRUPED, 2), both)
    sensed = simulate_controllers(plants, np.tile(walker, (2, 1)), 60).sensors
    built, fitted = ((sensed - before[: 60 // STEPS_PER_SAMPLE]) ** 2).mean(axis=(1, 2))
    assert fitted < built / 2
