"""Batches of legged robots with controllers: as plain MuJoCo, and damaged."""

import numpy as np
import pytest

from selfheal.body.damage import Damage
from selfheal.body.legged import LEGGED, load_legged_robot
from selfheal.engine import reflex
from selfheal.engine.reflex import (
    STEPS_PER_SAMPLE,
    build_damaged_plants,
    build_intact_plants,
    simulate_controllers,
)
from selfheal.gait.genetic import start_population
from tests.support.short_recover import DEAF, JAM, LOST, QUADRUPED, draw_weights


def test_a_batch_does_what_plain_mujoco_and_a_plain_network_do(walker):
    """The reference that speed is measured against, once as a parity test."""
    from benchmarks.recover.reference import walk_plain

    steps = 200
    ours = simulate_controllers(
        build_intact_plants(QUADRUPED, 3), np.tile(walker, (3, 1)), steps
    )
    assert ours.displacement == pytest.approx(
        walk_plain(QUADRUPED, walker, steps), abs=1e-9
    )


@pytest.mark.parametrize("name", LEGGED)
def test_what_is_nothing_changes_nothing(name):
    robot = load_legged_robot(name)
    weights = draw_weights(2, robot)
    kinds = [
        Damage("weak_motor", f"actuator:{robot.motors[0]}", 1.0),
        Damage("weak_sensor", f"sensor:{robot.sensors[0]}", 1.0),
        Damage("slope", value=0.0),
        Damage("wind", value=0.0),
        Damage("ground_friction", value=1.0),
    ]
    before = simulate_controllers(build_intact_plants(robot, 2), weights, 100)
    after = simulate_controllers(build_damaged_plants(robot, [kinds] * 2), weights, 100)
    np.testing.assert_array_equal(before.path, after.path)
    assert not before.failed.any()


def test_damage_does_what_it_says(walker):
    neuron, wind = Damage("neuron_dead", "neuron:0"), Damage("wind", value=10.0)
    said = [(), (LOST,), (JAM,), (DEAF,), (neuron,), (wind,)]
    drives = simulate_controllers(
        build_damaged_plants(QUADRUPED, said), np.tile(walker, (len(said), 1))
    )
    touch, hip = (
        QUADRUPED.sensors.index(s)
        for s in ("left_front_lower_touch", "right_back_hip_position")
    )
    assert (drives.sensors[1, :, touch] == -1).all()  # nothing there to touch with
    assert np.abs(drives.sensors[2, :, hip]).max() < 0.02
    dead = QUADRUPED.sensors.index("left_back_lower_touch")
    assert (drives.sensors[3, :, dead] == 0).all()
    assert drives.displacement[5] > drives.displacement[0]
    assert len(np.unique(np.round(drives.displacement, 6))) == len(said)


def test_a_run_that_fails_never_wins(walker, monkeypatch):
    monkeypatch.setattr(reflex, "FASTEST", 1e-6)  # whatever moves has diverged
    drives = simulate_controllers(
        build_intact_plants(QUADRUPED, 2), np.tile(walker, (2, 1)), 50
    )
    assert drives.failed.all() and (drives.displacement == -np.inf).all()
    assert np.isnan(drives.sensors).all()
    monkeypatch.undo()
    rng = np.random.default_rng(0)
    pool = start_population(3, lambda g: np.where(g[:, 0] > 0, np.nan, g[:, 0]), rng)
    assert pool.genomes[0, 0] <= 0 and np.isfinite(pool.scores[0])


def test_samples_are_whole_steps_of_the_models():
    assert reflex.STEPS % STEPS_PER_SAMPLE == 0
    assert {load_legged_robot(name).model.opt.timestep for name in LEGGED} == {
        reflex.STEP
    }
