"""Effects of actuators: integral action, lag, weak motors."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.places import ActuatorPlace
from tests.support.effect_robots import (
    compile_patched,
    make_effect_bench,
    make_pendulum,
)
from tests.support.recorded_robots import ROBOTS


def test_a_servo_that_had_settled_goes_on_holding_its_load(tmp_path):
    pose = 0.8
    robot = replace(
        ROBOTS["pendulum"],
        command=lambda t, rng: np.full((len(t), 1), pose),
        begin=lambda rng: (np.array([pose]), np.zeros(1)),
    )
    b = make_effect_bench(robot, tmp_path)
    fresh, settled = find_effect("integral_action").propose_terms(b.robot)
    assert settled.is_negligible(0.1 * settled.scale)  # no more than a torque
    kp = b.robot.model.actuator_gainprm[0, 0]

    def sag(term, most):
        predicted = b.simulator.simulate((term,), np.array([[kp, most]]), b.segments)[0]
        return np.abs(predicted - pose).max()

    assert sag(settled, 10.0) < 1e-3 and sag(fresh, 10.0) > 20e-3
    assert sag(settled, 1e-3) == pytest.approx(sag(fresh, 1e-3), rel=0.1)


def test_a_servo_lets_go_as_soon_as_its_error_turns():
    """The sum is clipped as that of MuJoCo's pid: what exceeds it is forgotten."""
    ki, imax, step = 2.0, 0.5, 0.01
    values = np.array([[ki, imax]])
    place = ActuatorPlace(
        actuator=0, controls=(0,), goal=0, gear=1.0, output=0, qpos=0, dof=0
    )
    sums = {0: np.zeros(1)}

    def torque(error, steps):
        for _ in range(steps):
            now = SimpleNamespace(
                ctrl=np.array([[error]]),
                qpos=np.zeros((1, 1)),
                applied_force=np.zeros((1, 1)),
                integral_errors=sums,
                timestep=step,
            )
            find_effect("integral_action").apply_forces(now, place, values)
        return now.applied_force[0, 0]

    assert torque(1.0, 1000) == pytest.approx(imax)
    turned = round(2 * imax / ki / step)
    assert torque(-1.0, turned // 2 + 1) == pytest.approx(0.0, abs=1e-9)
    assert torque(-1.0, 1000) == pytest.approx(-imax)


def test_a_lag_keeps_the_range_that_a_servo_inherited(tmp_path):
    b = make_pendulum(
        tmp_path,
        **{
            'armature="0.002"': 'armature="0.002" range="-40 40"',
            'kv="0.1"': 'kv="0.1" inheritrange="1"',
        },
    )
    terms = find_effect("actuator_lag").propose_terms(b.robot)
    model = compile_patched(b, terms, [0.05])
    assert model.actuator_ctrllimited.all()
    np.testing.assert_allclose(model.actuator_ctrlrange, np.deg2rad([[-40, 40]]))
