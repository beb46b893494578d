"""Stops, play and compliance between a motor and its joint."""

import re
from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from tests.support.effect_robots import (
    largest_change,
    make_effect_bench,
)
from tests.support.recorded_robots import ROBOTS


def test_the_stiffer_a_compliant_drive_the_less_it_shows(benches):
    b = benches["arm"]
    for term in find_effect("compliance").propose_terms(b.robot):
        k, d = term.scale
        moved = [
            largest_change(b, (term,), (s * k, s**0.5 * d)) for s in (0.3, 1, 3, 10)
        ]
        assert np.all(np.diff(moved) < 0)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_light_rotor_does_not_diverge(integrator, tmp_path):
    xml = re.sub(' armature="[^"]*"', "", ROBOTS["arm"].xml)
    b = make_effect_bench(
        replace(ROBOTS["arm"], xml=xml.replace("implicitfast", integrator)), tmp_path
    )
    for name in ("backlash", "compliance", "limb_loss"):
        for term in find_effect(name).propose_terms(b.robot):
            for values in (*term.initial_values, term.low, term.high):
                assert np.isfinite(largest_change(b, (term,), values)), (
                    term.label,
                    values,
                )


def test_so_stiff_a_drive_as_a_search_may_try_hardly_shows(benches):
    b = benches["arm"]
    for term in find_effect("compliance").propose_terms(b.robot):
        assert largest_change(b, (term,), (term.high[0], term.scale[1])) < 0.01
