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
from tests.support.recorded_robots import ROBOTS, Robot, bench


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


def _nest(*names: str) -> str:
    """Bodies with a hinge each, one on the other."""
    inner = _nest(*names[1:]) if len(names) > 1 else ""
    joint = f'<joint name="{names[0]}" axis="0 1 0" damping="0.1"/>'
    geom = '<geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01"/>'
    return f'<body pos="0 0 -.1">{joint}{geom}{inner}</body>'


def test_a_cable_runs_over_joints_that_are_near(tmp_path):
    branches = _nest("a", "b", "c", "d", "e") + _nest("x", "y")
    signals = {j: ("joint_position", j, "rad") for j in "abcdexy"}
    robot = Robot(
        f"<mujoco><worldbody>{branches}</worldbody></mujoco>",
        signals,
        lambda t, rng: np.zeros((len(t), 0)),
        lambda rng: (rng.normal(size=7), np.zeros(7)),
    )
    b = bench(robot, tmp_path, episodes=1, seconds=0.5)
    terms = find_effect("joint_coupling").propose_terms(b.robot)
    pairs = {t.targets[0][-1] + t.finding_fields["other"][-1] for t in terms}
    assert {"ab", "ad", "be", "xy", "ax"} <= pairs  # a chain, and side by side
    assert not pairs & {"ae", "bx", "ay", "ey"}
