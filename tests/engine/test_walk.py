"""Walks go on from where they stopped; what diverges is counted."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.mjcf import Physics
from selfheal.engine.plant import build_rated_plant
from selfheal.engine.walk import simulate_walks
from selfheal.gait.pattern import find_pattern
from selfheal.robot.actions import load_published_body

PLANT = build_rated_plant(load_published_body())


def test_a_walk_goes_on_from_where_it_stopped():
    rng = np.random.default_rng(4)
    gaits = 0.4 * rng.normal(size=(2, 25))
    commands = find_pattern("waves").compute_commands(gaits, 8, 2.0)
    whole = simulate_walks([PLANT] * 2, commands)
    first = simulate_walks([PLANT] * 2, commands[:, :100])
    start = first.state, first.set_point
    rest = simulate_walks([PLANT] * 2, commands[:, 100:], start)
    assert rest.position[:, -1] == pytest.approx(whole.position[:, -1], abs=1e-3)


def test_every_joint_goes_where_its_own_command_sends_it():
    targets = np.radians(np.arange(-20.0, 20.0, 5.0))
    walks = simulate_walks([PLANT], np.tile(targets, (1, 200, 1)))
    assert walks.angles[0, -1] == pytest.approx(targets, abs=0.06)
    # at rest motors do no work
    still = simulate_walks([PLANT], np.zeros((1, 200, 8)))
    assert 0 <= still.energy[0] < 0.02 < walks.energy[0] < 3


def test_nonsense_diverges_and_is_counted():
    wild = replace(PLANT, physics=Physics(timestep=0.01, kp=1e7, kv=0.0, damping=0.0))
    wild = replace(wild, torque=wild.torque * 1e6)
    walks = simulate_walks([wild], np.full((1, 100, 8), 0.5))
    assert walks.failed[0]
    assert np.isnan(walks.position[0]).all()
