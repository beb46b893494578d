"""Steps of second order: damping of a mean velocity, and velocities of whole steps."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.simulation.batch import center_damping
from selfheal.diagnosis.simulation.model_variants import compute_inverse_inertias
from tests.support.recorded_robots import ROBOTS, bench

# links in line, so that all joints together move next to no mass in some directions
CHAIN = """<mujoco><option integrator="implicitfast"/><worldbody>{bodies}</worldbody>
<actuator>{servos}</actuator></mujoco>"""
LINK = """<body pos="0 0 -0.3"><joint name="j{i}" axis="0 1 0" damping="{damping}"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>{more}</body>"""


def _chain(joints: int, damping: float, kv: float) -> mujoco.MjModel:
    bodies = ""
    for i in reversed(range(joints)):
        bodies = LINK.format(i=i, damping=damping, more=bodies)
    servos = "".join(
        f'<position joint="j{i}" kp="10" kv="{kv}"/>' for i in range(joints)
    )
    return mujoco.MjModel.from_xml_string(CHAIN.format(bodies=bodies, servos=servos))


@pytest.mark.parametrize(("damping", "kv"), [(1e-3, 0.0), (20.0, 0.0), (0.1, 50.0)])
def test_half_of_the_inertia_of_every_motion_stays(damping, kv):
    model = _chain(4, damping, kv)
    before = compute_inverse_inertias(model)
    center_damping(model, 0.002, before)
    for old, new in zip(before, compute_inverse_inertias(model), strict=True):
        share = np.linalg.eigvals(np.linalg.inv(new) @ old).real
        assert share.min() >= 0.5 - 1e-9


def test_small_damping_is_centered_in_full():
    model = _chain(4, 1e-3, 1e-3)
    center_damping(model, 0.002, compute_inverse_inertias(model))
    assert model.dof_armature == pytest.approx(-0.002 / 2 * 2e-3)


def test_velocities_read_as_commands_change_are_of_second_order(tmp_path):
    robot = ROBOTS["arm"]
    signals = {n: ("joint_velocity", n, "rad/s") for n in ("shoulder", "elbow")}
    b = bench(replace(robot, signals=signals), tmp_path, episodes=2, seconds=1.0)
    simulator, segments = b.simulator, cut_segments(b.simulator.episodes, 100)
    predicted = []
    for _ in range(5):
        none = np.zeros((1, 0))
        predicted.append(simulator.leapfrog.simulate((), none, segments)[0])
        simulator = simulator.with_half_step
        segments = segments.with_finer_steps(2)
    coarse, fine = (
        np.sqrt(np.mean((x - predicted[-1]) ** 2, axis=0)) for x in predicted[1:3]
    )
    assert (coarse > 3 * fine).all()
