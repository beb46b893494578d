"""Recordings on a grid: means of commands, parabolas, windows, states, signs."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from selfheal.diagnosis.data.episodes import (
    _average_over_steps,
    _find_quantum,
    _remove_sign_jumps,
    build_channels,
    sample_episode,
)
from selfheal.diagnosis.data.local_polynomial import fit_polynomials
from selfheal.diagnosis.data.segments import Segments, cut_segments
from selfheal.diagnosis.data.state_estimate import estimate_initial_state
from selfheal.diagnosis.simulation.build import reorder_commands
from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from selfheal.recording import Episode, Recording, Signal
from tests.support.recorded_robots import ROBOTS, bench, record

STEP = 0.002


def _times(rng, count=80) -> np.ndarray:
    return np.cumsum(rng.uniform(0.003, 0.02, count))


def _recording(time, **columns) -> Recording:
    """One episode of hinges whose positions were read."""
    signals = {
        name: Signal(values, "joint_position", name, "rad")
        for name, values in columns.items()
    }
    episode = Episode(time, np.zeros((time.size, 0)), (), signals)
    return Recording({"only": episode})


def _log(recording: Recording):
    found = build_channels([recording])
    (episode,) = recording.episodes.values()
    return sample_episode("only", episode, found, STEP), found


# commands


@pytest.mark.parametrize("seed", range(5))
def test_means_of_held_commands_keep_their_integral(seed):
    rng = np.random.default_rng(seed)
    time = _times(rng)
    at, ctrl = (time - time[0]) / STEP, rng.normal(size=(time.size, 2))
    total = np.cumsum(_average_over_steps(at, ctrl), axis=0)
    for end in range(1, int(at[-1])):
        np.testing.assert_allclose(
            total[end - 1], _held_until(at, ctrl, end), atol=1e-10
        )


def _held_until(at, ctrl, end) -> np.ndarray:
    """Integral [steps] of held commands from the first sample to a grid point."""
    ends = np.minimum(np.append(at[1:], np.inf), end)
    return np.sum(ctrl * np.maximum(ends - at, 0)[:, None], axis=0)


def test_commands_on_the_grid_stay_as_they_are():
    ctrl = np.random.default_rng(0).normal(size=(20, 3))
    at = 4.0 * np.arange(20)
    means = _average_over_steps(at, ctrl)
    np.testing.assert_allclose(means, np.repeat(ctrl, 4, axis=0)[: len(means)])
    assert len(means) > at[-1]


def test_commands_follow_the_models_order():
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    (episode,) = record(ROBOTS["arm"], episodes=1, seconds=0.2).episodes.values()
    turned = replace(
        episode, ctrl=episode.ctrl[:, ::-1], ctrl_names=episode.ctrl_names[::-1]
    )
    back = reorder_commands(turned, model)
    assert back.ctrl_names == ("shoulder_servo", "elbow_servo")
    np.testing.assert_array_equal(back.ctrl, episode.ctrl)


# parabolas


@pytest.mark.parametrize("seed", range(3))
def test_a_parabola_tells_value_and_slope_of_a_quadratic_exactly(seed):
    rng = np.random.default_rng(seed)
    time, (a, b, c) = _times(rng), rng.normal(size=3)
    episode, _ = _log(_recording(time, knee=a + b * time + c * time**2))
    at = rng.uniform(0, episode.sample_steps[-1], 50)
    value, slope = episode.interpolate(at, STEP)
    t = time[0] + at * STEP
    np.testing.assert_allclose(value[:, 0], a + b * t + c * t**2, atol=1e-6)
    np.testing.assert_allclose(slope[:, 0], b + 2 * c * t, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_a_body_that_turns_fast_and_evenly_is_told_exactly(seed):
    rng = np.random.default_rng(seed)
    time = np.arange(60) * 0.005
    rate = 15 * rng.normal(size=3)  # [rad/s], of the body's own frame
    start = Rotation.random(random_state=seed)

    def turned(at) -> np.ndarray:
        turns = start * Rotation.from_rotvec(rate * at[:, None])
        return turns.as_quat(scalar_first=True)

    exact = turned(time)
    signal = Signal(exact, "body_orientation", "b", "quaternion")
    episode = Episode(time, np.zeros((60, 0)), (), {"turn": signal})
    found = build_channels([Recording({"only": episode})])
    value, slope = sample_episode("only", episode, found, STEP).interpolate(
        time / STEP, STEP
    )
    sign = np.sign((value * exact).sum(axis=1))[:, None]
    assert np.abs(sign * value - exact).max() < 1e-9
    # the ends too, where no reading is on the other side
    rates = (turned(time + 1e-5) - turned(time - 1e-5)) / 2e-5
    assert np.abs(sign * slope - rates).max() < 1e-4 * np.linalg.norm(rate)


def test_missing_samples_do_not_speak():
    rng = np.random.default_rng(0)
    time = np.arange(100) * 0.005
    values = 1 + time + time**2
    lost = rng.permutation(100)[:30]
    values[lost] = np.nan
    episode, found = _log(_recording(time, knee=values))
    value, slope = episode.interpolate(np.arange(0, 240.0), STEP)
    t = np.arange(240) * STEP
    known = np.isfinite(value[:, 0])
    assert known.mean() > 0.5
    np.testing.assert_allclose(value[known, 0], (1 + t + t**2)[known], atol=1e-5)
    np.testing.assert_allclose(slope[known, 0], (1 + 2 * t)[known], atol=1e-3)
    assert np.isfinite(found[0].spread) and found[0].noise < 1e-6


def test_noise_is_told_from_motion():
    rng = np.random.default_rng(1)
    time = np.arange(400) * 0.005
    clean = np.sin(3 * time)
    near = fit_polynomials(time, (clean + 0.01 * rng.normal(size=400))[:, None])
    assert np.sqrt(np.mean(near.scatter**2)) == pytest.approx(0.01, rel=0.15)
    _, found = _log(_recording(time, knee=clean + 0.01 * rng.normal(size=400)))
    assert found[0].noise == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize("rate", [100, 250, 1000])
def test_a_robot_let_go_at_its_first_sample_is_told_to_be_at_rest(rate):
    rng = np.random.default_rng(1)
    time = np.arange(2 * rate) / rate
    swing = np.cos(60 * time) + np.sin(60 * time) * 8 / 60  # its rate is 0 at 0
    angle = 0.3 * np.exp(-8 * time) * swing + 3e-4 * rng.normal(size=len(time))
    episode, found = _log(_recording(time, knee=angle))
    given = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='knee'/><geom size='1'/></body>"
        "</worldbody></mujoco>"
    )
    world = SimpleNamespace(
        episodes=[episode],
        channels=found,
        timestep=STEP,
        compiler=SimpleNamespace(nominal=given),
    )
    _, qvel, std = estimate_initial_state(world, 0, np.zeros(1, int), {})
    assert abs(qvel[0, 0]) < 4 * std[0, 1]
    if rate > 100:  # of its five samples in 50 ms none can be spared
        told = fit_polynomials(time, episode.readings).coefficients[0, 0, 1]
        assert abs(qvel[0, 0]) < 0.5 * abs(told)


@pytest.mark.parametrize("step", [0.004, 0.02])
def test_a_lattice_is_seen_and_noise_is_none(step):
    rng = np.random.default_rng(2)
    smooth = np.sin(np.arange(2000) / 100)
    assert _find_quantum(step * np.round(smooth / step)) == pytest.approx(step)
    assert _find_quantum(smooth + 1e-3 * rng.normal(size=2000)) == 0


def test_a_signal_that_was_never_read_is_no_channel_unless_asked_for():
    time = np.arange(20) * 0.01
    recording = _recording(time, knee=np.full(20, np.nan), hip=np.sin(time))
    assert [c.name for c in build_channels([recording])] == ["hip"]
    assert [c.name for c in build_channels([recording], empty=True)] == ["hip", "knee"]


# signs


def test_quaternions_become_continuous_and_stay_the_same_orientation():
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 12, 200)
    turn = np.stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle], axis=1)
    flipped = turn * rng.choice([-1.0, 1.0], 200)[:, None]
    flipped[50:60] = np.nan
    out = _remove_sign_jumps(flipped)
    assert np.isnan(out[50:60]).all()
    known = np.isfinite(out).all(axis=1)
    assert (np.sum(out[known][1:] * out[known][:-1], axis=1) > 0).all()
    np.testing.assert_allclose(np.abs(out[known]), np.abs(turn[known]), atol=1e-12)


# windows


def _three_logs():
    rng = np.random.default_rng(5)
    logs = []
    for n in range(3):
        time = _times(rng, 60 + 20 * n)
        values = rng.normal(size=time.size)
        values[rng.permutation(time.size)[:5]] = np.nan
        logs.append(_log(_recording(time, knee=values))[0])
    return logs


@pytest.mark.parametrize("steps", [None, 25, 100, 10000])
def test_windows_cover_every_reading_once(steps):
    logs = _three_logs()
    found = cut_segments(logs, steps)
    read = np.sort(np.concatenate([x.readings for x in logs]).ravel())
    np.testing.assert_array_equal(
        np.sort(found.readings.ravel()), read[np.isfinite(read)]
    )
    assert (found.sample_steps >= 0).all()
    assert (found.sample_steps <= found.lengths[found.segment_of_sample]).all()
    assert (np.diff(found.segment_of_sample) >= 0).all()
    for w, log_of, start in zip(
        range(len(found)), found.episode, found.first_step, strict=True
    ):
        rows = found.segment_of_sample == w
        at = logs[log_of].sample_steps
        back = np.interp(found.sample_steps[rows] + start, at, np.arange(len(at)))
        np.testing.assert_allclose(back, np.round(back), atol=1e-6)


def test_windows_of_every_sample_are_asked_for_with_empty():
    logs = _three_logs()
    found = cut_segments(logs, None, empty=True)
    assert len(found.sample_steps) == sum(len(x.sample_steps) for x in logs)


def test_windows_that_are_taken_keep_their_samples_in_the_order_asked_for():
    found = cut_segments(_three_logs(), 50)
    chosen = np.array([4, 1, 7])
    few = found.select(chosen)
    np.testing.assert_array_equal(
        few.readings, found.readings[found.find_sample_rows(chosen)]
    )
    for new, old in enumerate(chosen):
        np.testing.assert_array_equal(
            few.sample_steps[few.segment_of_sample == new],
            found.sample_steps[found.segment_of_sample == old],
        )


def test_joined_windows_are_those_of_all():
    logs = _three_logs()
    apart = Segments.concatenate([cut_segments(logs, 40, only=i) for i in range(3)])
    whole = cut_segments(logs, 40)
    for field in (
        "episode",
        "first_step",
        "lengths",
        "segment_of_sample",
        "sample_steps",
        "readings",
    ):
        np.testing.assert_array_equal(getattr(apart, field), getattr(whole, field))


# states


def test_a_given_state_is_taken_as_it_is(tmp_path):
    b = bench("arm", tmp_path, episodes=1, seconds=0.5)
    (episode,) = b.recording.episodes.values()
    qpos, qvel, std = estimate_initial_state(b.simulator, 0, np.array([0, 60]), {})
    np.testing.assert_array_equal(qpos[0], episode.qpos0)
    np.testing.assert_array_equal(qvel[0], episode.qvel0)
    assert std[0].max() <= 1e-6 < std[1].min()


def test_a_state_is_read_as_well_as_it_says(tmp_path):
    """Errors are about as large as the standard deviations that are stated."""
    exact = record(ROBOTS["arm"], episodes=4, seconds=1.0, noise=0.0)
    b = bench("arm", tmp_path, episodes=4, seconds=1.0, states=False)
    apart = []
    for i, name in enumerate(exact.episodes):
        signals = exact.episodes[name].signals
        at = np.arange(100, 400, 10)
        qpos, qvel, std = estimate_initial_state(b.simulator, i, at, {})
        for j, joint in enumerate(("shoulder", "elbow")):
            true = signals[joint].values[at // 5]
            apart.append((qpos[:, j] - true) / std[:, j])
    size = np.sqrt(np.mean(np.square(apart)))
    assert 0.5 < size < 2.5


@pytest.mark.parametrize("seed", range(3))
def test_pieces_begin_where_the_state_is_told_though_readings_are_missing(
    tmp_path, seed
):
    """Never at a made-up rest that passes for exact."""
    exact = record(ROBOTS["arm"], episodes=1, seconds=6.0, noise=0.0)
    b = bench("arm", tmp_path, episodes=1, seconds=6.0, states=False)
    rng = np.random.default_rng(seed)
    (episode,), (true,) = b.recording.episodes.values(), exact.episodes.values()
    signals = {}
    for name, signal in episode.signals.items():
        values = signal.values.copy()
        values[rng.random(len(values)) < 0.2] = np.nan
        values[300 + 10 * seed : 350] = np.nan  # a pause
        signals[name] = replace(signal, values=values)
    lossy = sample_episode(
        "only", replace(episode, signals=signals), b.simulator.channels, STEP
    )
    world = replace(b.simulator, episodes=(lossy,))
    pieces = cut_readable_segments(world, 0.1)
    assert len(pieces) > 40
    qpos, _, std = estimate_initial_state(world, 0, pieces.first_step, {})
    for j, joint in enumerate(("shoulder", "elbow")):
        at = np.arange(len(true.signals[joint].values)) * 5
        apart = qpos[:, j] - np.interp(
            pieces.first_step, at, true.signals[joint].values
        )
        assert np.abs(apart / std[:, j]).max() < 10


def test_the_state_of_a_free_body_is_read_from_its_pose(tmp_path):
    b = bench("box", tmp_path, episodes=2, seconds=0.3, noise=1e-5, states=False)
    given = record(ROBOTS["box"], episodes=2, seconds=0.3, noise=1e-5)
    model = b.robot.model
    data = mujoco.MjData(model)
    for i, episode in enumerate(given.episodes.values()):
        data.qpos[:], data.qvel[:] = episode.qpos0, episode.qvel0
        for _ in range(25):
            mujoco.mj_step(model, data)
        qpos, qvel, _ = estimate_initial_state(b.simulator, i, np.array([25]), {})
        sign = np.sign(qpos[0, 3:] @ data.qpos[3:])
        assert np.abs(qpos[0, :3] - data.qpos[:3]).max() < 1e-3
        assert np.abs(sign * qpos[0, 3:] - data.qpos[3:]).max() < 2e-3
        assert np.abs(qvel[0, :3] - data.qvel[:3]).max() < 0.03
        assert np.abs(qvel[0, 3:] - data.qvel[3:]).max() < 0.2


def test_the_state_of_a_ball_joint_is_read_from_its_bodys_pose(tmp_path):
    how = {"episodes": 1, "seconds": 0.5, "noise": 1e-5, "finer": 1}
    b = bench("wrist", tmp_path, states=False, **how)
    (given,) = record(ROBOTS["wrist"], **how).episodes.values()
    data = mujoco.MjData(b.robot.model)
    data.qpos[:], data.qvel[:] = given.qpos0, given.qvel0
    for _ in range(100):
        mujoco.mj_step(b.robot.model, data)
    qpos, qvel, _ = estimate_initial_state(b.simulator, 0, np.array([100]), {})
    np.testing.assert_allclose(qpos[0], np.sign(qpos[0] @ data.qpos) * data.qpos,
                               atol=2e-3)  # fmt: skip
    np.testing.assert_allclose(qvel[0], data.qvel, atol=0.3)
    assert len(cut_readable_segments(b.simulator, 0.1)) > 3


@pytest.mark.parametrize("states", [True, False])
def test_an_integrators_command_goes_on_where_a_piece_begins(states, tmp_path):
    """From 0 where a state is given, from where the joint is where none is."""
    servo = '<position name="servo" joint="hinge" kp="3" kv="0.1"/>'
    speed = '<intvelocity name="servo" joint="hinge" kp="3" actrange="-0.4 0.4"/>'
    robot = replace(
        ROBOTS["pendulum"], xml=ROBOTS["pendulum"].xml.replace(servo, speed),
        begin=lambda rng: (np.zeros(1), np.zeros(1)),
    )  # fmt: skip
    how = {"episodes": 1, "seconds": 3.0, "noise": 1e-6, "finer": 1}
    b = bench(robot, tmp_path, states=states, **how)
    pieces = cut_readable_segments(b.simulator, 0.5)
    told = b.simulator.simulate([], np.zeros((1, 0)), pieces, centered=False)[0]
    assert np.ptp(pieces.readings) > 0.3
    np.testing.assert_allclose(told, pieces.readings, atol=5e-3)


def test_a_sensor_with_bias_gain_and_delay_is_read_through(tmp_path):
    time = np.arange(200) * 0.005
    b = bench("pendulum", tmp_path, episodes=1, seconds=1.0, states=False)
    true = 0.3 * np.sin(4 * time)
    said = {"bias": 0.2, "gain": 1.5, "delay": 0.01}
    read = 1.5 * 0.3 * np.sin(4 * (time - 0.01)) + 0.2
    signal = Signal(read, "joint_position", "hinge", "rad")
    episode = Episode(time, np.zeros((200, 1)), ("servo",), {"angle": signal})
    found = build_channels([Recording({"only": episode})])
    world = SimpleNamespace(
        compiler=b.simulator.compiler, channels=found, timestep=STEP,
        episodes=(sample_episode("only", episode, found, STEP),),
    )  # fmt: skip
    at = np.arange(50, 450, 20)
    qpos, qvel, _ = estimate_initial_state(world, 0, at, {"angle": said})
    np.testing.assert_allclose(qpos[:, 0], 0.3 * np.sin(4 * at * STEP), atol=1e-4)
    np.testing.assert_allclose(qvel[:, 0], 1.2 * np.cos(4 * at * STEP), atol=5e-3)
    assert np.abs(qpos[0, 0] - np.interp(at[0] * STEP, time, true)) < 1e-4
