"""Joints that no sensor reads: where loops, springs and commands put them."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.data.loop_closure import LoopClosure
from selfheal.diagnosis.data.settling import settle_unread_joints
from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from tests.support.recorded_robots import ROBOTS, Robot, bench

LINKAGE = """<mujoco><option timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="crank" pos="0 0.04 1"><joint name="crank" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.06 0 0" size="0.008" mass="0.1"/>
      <body name="rod" pos="0.06 0 0"><joint name="rod" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.006" mass="0.12"/></body>
    </body>
    <body name="shank" pos="0 0 0.7"><joint name="knee" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.6"/></body>
  </worldbody>
  <equality>
    <connect body1="rod" body2="shank" anchor="0 0 -0.3" solref="0.004 1"/>
  </equality>
  <actuator><position name="motor" joint="crank" kp="40" kv="1.5"/></actuator>
</mujoco>"""
READ = {"angle": ("joint_position", "crank", "rad")}


def _swing(t, rng):
    return 0.6 * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t)[:, None]


ROBOT = Robot(LINKAGE, READ, _swing, lambda rng: (np.zeros(3), np.zeros(3)))


def _states(seconds: float = 1.0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions and velocities of the linkage, ten a second, as it is driven."""
    model = mujoco.MjModel.from_xml_string(LINKAGE)
    data, found = mujoco.MjData(model), []
    for k in range(round(seconds / model.opt.timestep)):
        data.ctrl[0] = 0.6 * np.sin(0.02 * k)
        mujoco.mj_step(model, data)
        if k % 50 == 0:
            found.append((data.qpos.copy(), data.qvel.copy()))
    return found


def test_a_loop_places_the_joints_that_nothing_reads():
    loops = LoopClosure(mujoco.MjModel.from_xml_string(LINKAGE))
    for qpos, qvel in _states()[1:]:
        unread = np.array([False, True, True])
        state = loops.close(
            np.where(unread, np.nan, qpos), np.where(unread, np.nan, qvel)
        )
        assert state.is_known.all()
        np.testing.assert_allclose(state.qpos, qpos, atol=3e-3)  # of a soft constraint
        np.testing.assert_allclose(state.qvel, qvel, atol=0.1)


def test_positions_follow_each_other_as_the_loop_does():
    loops = LoopClosure(mujoco.MjModel.from_xml_string(LINKAGE))
    size, at = 1e-4, [np.array([x, np.nan, np.nan]) for x in (0.3, 0.3 + 1e-4)]
    before, after = (loops.close(q, np.zeros(3)) for q in at)
    step = (after.qpos - before.qpos) / size
    np.testing.assert_allclose(before.response[:, 0], step, atol=1e-3)
    # alone, what the loop places moves nothing else
    np.testing.assert_array_equal(before.response[:, 1:], np.eye(3)[:, 1:])


def test_what_a_loop_leaves_free_is_not_known():
    model = mujoco.MjModel.from_xml_string(LINKAGE)
    state = LoopClosure(model).close(np.full(3, np.nan), np.full(3, np.nan))
    assert not state.is_known.any()
    np.testing.assert_allclose(state.qpos, model.qpos0, atol=1e-9)


def test_an_episode_whose_loops_tell_all_joints_is_cut(tmp_path):
    b = bench(ROBOT, tmp_path, episodes=2, seconds=2.0, states=False)
    segments = cut_readable_segments(b.simulator, 0.5)
    assert len(segments) == 8
    state = b.simulator.complete_state(0, segments.first_step[:4])
    data = mujoco.MjData(b.robot.model)
    for qpos in state.qpos:
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(b.robot.model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-6
    assert [j.measured for j in b.robot.joints] == [True, False, False]


def test_an_error_of_what_was_read_does_not_open_a_loop(tmp_path):
    b = bench(ROBOT, tmp_path, episodes=1, seconds=2.0, states=False)
    segments = cut_readable_segments(b.simulator, 0.5)
    offset = np.zeros((1, len(segments), 6))
    offset[..., 0] = 0.02
    none = np.zeros((1, 0))
    moved = b.simulator.simulate((), none, segments, initial_state_offset=offset)
    plain = b.simulator.simulate((), none, segments)
    first = segments.sample_steps == segments.sample_steps.min()
    np.testing.assert_allclose((moved - plain)[0, first], 0.02, atol=2e-3)


def test_a_joint_that_nothing_reads_begins_where_its_servo_holds_it(tmp_path):
    robot = replace(
        ROBOTS["half_seen_arm"], command=lambda t, rng: np.full((t.size, 2), 0.4)
    )
    b = bench(robot, tmp_path, episodes=1, seconds=0.5, states=False)
    state = b.simulator.complete_state(0, np.array([0, 50]))
    assert 0.3 < state.qpos[0, 1] <= 0.4 + 0.1 and state.qpos[1, 1] == 0
    assert not state.is_known[:, 1].any()


@pytest.mark.parametrize(("torque", "rests"), [(0.0, True), (50.0, False)])
def test_what_never_rests_is_not_placed(torque, rests):
    model = mujoco.MjModel.from_xml_string(
        ROBOTS["pendulum"].xml.replace('<position name="servo" joint="hinge" kp="3" '
                                       'kv="0.1"/>', '<motor joint="hinge"/>')
    )  # fmt: skip
    rest = settle_unread_joints(
        model, np.array([0.5]), np.zeros(1, bool), np.array([torque])
    )
    assert (rest is not None) == rests
    if rest is not None:
        assert abs(rest[0]) < 0.02
