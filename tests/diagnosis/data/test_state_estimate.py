"""Initial states: as given, or read as well as their errors say."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.data.episodes import build_channels, sample_episode
from selfheal.diagnosis.data.local_polynomial import fit_polynomials
from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from selfheal.diagnosis.simulation.system import RecordedSystem
from selfheal.recording import Episode, Recording, Signal
from tests.support.hinge_recordings import STEP, make_hinge_recording, sample_recording
from tests.support.recorded_robots import ROBOTS, bench, record


@pytest.mark.parametrize("rate", [100, 250, 1000])
def test_a_robot_released_at_its_first_sample_is_estimated_at_rest(rate):
    rng = np.random.default_rng(1)
    time = np.arange(2 * rate) / rate
    swing = np.cos(60 * time) + np.sin(60 * time) * 8 / 60  # its rate is 0 at 0
    angle = 0.3 * np.exp(-8 * time) * swing + 3e-4 * rng.normal(size=len(time))
    episode, found = sample_recording(make_hinge_recording(time, knee=angle))
    given = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='knee'/><geom size='1'/></body>"
        "</worldbody></mujoco>"
    )
    simulator = RecordedSystem(
        episodes=(episode,),
        channels=found,
        timestep=STEP,
        compiler=SimpleNamespace(nominal=given),
    )
    state = simulator.complete_state(0, np.zeros(1, int))
    qvel, std = state.qvel, state.std
    assert abs(qvel[0, 0]) < 4 * std[0, 1]
    if rate > 100:  # of its five samples in 50 ms none can be spared
        predicted = fit_polynomials(time, episode.readings).coefficients[0, 0, 1]
        assert abs(qvel[0, 0]) < 0.5 * abs(predicted)


def test_a_given_state_is_taken_as_it_is(tmp_path):
    b = bench("arm", tmp_path, episodes=1, seconds=0.5)
    (episode,) = b.recording.episodes.values()
    state = b.simulator.complete_state(0, np.array([0, 60]))
    qpos, qvel, std = state.qpos, state.qvel, state.std
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
        state = b.simulator.complete_state(i, at)
        qpos, std = state.qpos, state.std
        for j, joint in enumerate(("shoulder", "elbow")):
            true = signals[joint].values[at // 5]
            apart.append((qpos[:, j] - true) / std[:, j])
    size = np.sqrt(np.mean(np.square(apart)))
    assert 0.5 < size < 2.5


@pytest.mark.parametrize("seed", range(3))
def test_segments_begin_where_the_state_is_read_though_readings_are_missing(
    tmp_path, seed
):
    """No initial state is a made-up rest that passes for exact."""
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
    simulator = replace(b.simulator, episodes=(lossy,))
    segments = cut_readable_segments(simulator, 0.1)
    assert len(segments) > 40
    state = simulator.complete_state(0, segments.first_step)
    qpos, std = state.qpos, state.std
    for j, joint in enumerate(("shoulder", "elbow")):
        at = np.arange(len(true.signals[joint].values)) * 5
        apart = qpos[:, j] - np.interp(
            segments.first_step, at, true.signals[joint].values
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
        state = b.simulator.complete_state(i, np.array([25]))
        qpos, qvel = state.qpos, state.qvel
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
    state = b.simulator.complete_state(0, np.array([100]))
    qpos, qvel = state.qpos, state.qvel
    np.testing.assert_allclose(qpos[0], np.sign(qpos[0] @ data.qpos) * data.qpos,
                               atol=2e-3)  # fmt: skip
    np.testing.assert_allclose(qvel[0], data.qvel, atol=0.3)
    assert len(cut_readable_segments(b.simulator, 0.1)) > 3


def test_a_sensor_with_bias_gain_and_delay_is_read_through(tmp_path):
    time = np.arange(200) * 0.005
    b = bench("pendulum", tmp_path, episodes=1, seconds=1.0, states=False)
    true = 0.3 * np.sin(4 * time)
    said = {"bias": 0.2, "gain": 1.5, "delay": 0.01}
    read = 1.5 * 0.3 * np.sin(4 * (time - 0.01)) + 0.2
    signal = Signal(read, "joint_position", "hinge", "rad")
    episode = Episode(time, np.zeros((200, 1)), ("servo",), {"angle": signal})
    found = build_channels([Recording({"only": episode})])
    simulator = RecordedSystem(
        compiler=b.simulator.compiler, channels=found, timestep=STEP,
        episodes=(sample_episode("only", episode, found, STEP),),
    )  # fmt: skip
    at = np.arange(50, 450, 20)
    state = simulator.complete_state(0, at, {"angle": said})
    qpos, qvel = state.qpos, state.qvel
    np.testing.assert_allclose(qpos[:, 0], 0.3 * np.sin(4 * at * STEP), atol=1e-4)
    np.testing.assert_allclose(qvel[:, 0], 1.2 * np.cos(4 * at * STEP), atol=5e-3)
    assert np.abs(qpos[0, 0] - np.interp(at[0] * STEP, time, true)) < 1e-4


SIZE = 1e-3


def test_autocorrelated_noise_makes_an_initial_state_less_certain(noiseless_arm):
    def errors(memory):
        signals = tuple(
            replace(c, noise=np.full(c.width, SIZE), ar1=np.full(c.width, memory))
            for c in noiseless_arm.simulator.channels
        )
        simulator = noiseless_arm.simulator.with_channels(signals)
        return simulator.complete_state(0, np.array([200.0])).std

    assert (errors(0.8) > 1.2 * errors(0.0)).all()
