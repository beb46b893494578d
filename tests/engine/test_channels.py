"""Any mix of sensors has the same channels in every engine."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.engine.arrays import plan_race
from selfheal.engine.channels import list_channels, parse_sensor
from selfheal.engine.mujoco import MuJoCo
from selfheal.engine.statics import Statics
from selfheal.errors import InputError
from tests.support.stick_robot import anatomy

PARTS = anatomy().parts
TORQUE, TOUCH, POSITION = (
    [f"{kind}:{part}" for part in PARTS] for kind in ("torque", "touch", "position")
)
BOLTED = replace(
    anatomy(),
    fixed=True,
    hinges=(0, 3, 2, 4),
    bends=(0.0, 0.4, 0.0, -0.7),
    sensors=(*TORQUE, f"gravity:{PARTS[3]}", *POSITION),
)
LYING = replace(
    anatomy(),
    bends=(0.0, 0.0, 0.5, 0.0),
    sensors=("clearance", *TOUCH, "tilt", f"gravity:{PARTS[0]}", POSITION[2]),
)


def _draw(known, count=6):
    genomes = draw_genomes(known, count, np.random.default_rng(2), False)
    targets = np.random.default_rng(3).uniform(-0.6, 0.6, (count, known.size))
    return build_bodies(known, genomes), targets


@pytest.mark.parametrize("ordered", [True, False])
def test_a_bolted_robot_is_sensed_as_mujoco_does(ordered):
    bodies, targets = _draw(replace(BOLTED, ordered=ordered))
    static = Statics().simulate(bodies, targets).channels
    dynamic = MuJoCo().simulate(bodies, targets).channels
    scale = list_channels(BOLTED).loss.weight
    assert static.shape == (6, 4 + 3 + 12)
    assert (np.abs(static - dynamic) * scale).max() < 1.0  # servos sag


def test_torques_are_those_that_hold_the_parts():
    import mujoco

    from selfheal.body.mjcf import build_spec

    bodies, targets = _draw(replace(BOLTED, ordered=False))
    seen = Statics().simulate(bodies, targets).channels[:, :4]
    for row, target in enumerate(targets):
        model = build_spec(bodies, row).compile()
        data = mujoco.MjData(model)
        for joint, angle in zip(BOLTED.joints, target, strict=True):
            data.joint(joint).qpos[0] = angle
        mujoco.mj_forward(model, data)
        held = [data.joint(joint).qfrc_bias[0] for joint in BOLTED.joints]
        np.testing.assert_allclose(seen[row], held, atol=1e-9)


def test_a_robot_on_the_floor_is_sensed_as_mujoco_does():
    bodies, targets = _draw(LYING, 12)
    static = Statics(20).simulate(bodies, targets).channels
    dynamic = MuJoCo().simulate(bodies, targets).channels
    scale = list_channels(LYING).loss.weight
    apart = (np.abs(static - dynamic) * scale).max(axis=1)
    assert (apart < 4).mean() > 0.7  # others rest elsewhere, as bodies may


def test_a_race_hears_every_sensor():
    bodies, targets = _draw(LYING, 3)
    felt = Statics().simulate(bodies, targets).channels
    loss, race = list_channels(LYING).loss, plan_race(3, np.arange(3), np.inf)
    each = Statics().race(bodies, (targets, felt), loss, race)
    rows = np.repeat(np.arange(3), 3)
    seen = Statics().simulate(bodies[rows], np.tile(targets, (3, 1))).channels
    expected = loss(seen, np.tile(felt, (3, 1))).reshape(3, 3)
    np.testing.assert_allclose(each, expected)
    np.testing.assert_allclose(np.diag(each), 0, atol=1e-9)


@pytest.mark.parametrize(
    "sensor, said",
    [("smell", "sensor"), ("touch:head", "head"), ("tilt:part_1", "torso's")],
)
def test_a_sensor_that_there_is_not_is_refused(sensor, said):
    with pytest.raises(InputError, match=said):
        parse_sensor(sensor, PARTS)


def test_torques_of_a_robot_on_the_floor_are_refused_and_touch_of_a_bolted_one():
    with pytest.raises(InputError, match="stands on forces"):
        list_channels(replace(LYING, sensors=(f"torque:{PARTS[0]}",)))
    with pytest.raises(InputError, match="says nothing"):
        list_channels(replace(BOLTED, sensors=("clearance",)))
