"""How a base moved that no sensor of poses reads: by its IMU and its legs."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from selfheal.diagnosis.data.base_motion import find_orientation, integrate_turns
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.recording import Episode, Recording, Signal

LEGS = ("front", "left", "right")
PLACES = {"front": "0.15 0 0", "left": "-0.1 0.12 0", "right": "-0.1 -0.12 0"}
LEG = """<body name="{0}" pos="{1}"><joint name="{0}" axis="0 1 0" armature="0.02"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/></body>"""
ROBOT = f"""<mujoco><option timestep="0.002" integrator="implicitfast"/>
  <default><geom contype="1" conaffinity="0" friction="1 0.005 0.0001"/></default>
  <worldbody><geom name="floor" type="plane" size="0 0 1" contype="0" conaffinity="1"/>
    <body name="base" pos="0 0 0.22"><freejoint/>
      <geom type="box" size="0.15 0.1 0.03" mass="2"/>
      <site name="imu" pos="0.05 0 0.02" euler="0 0 90"/>
      {"".join(LEG.format(name, PLACES[name]) for name in LEGS)}
    </body></worldbody>
  <actuator>{
    "".join(f'<position name="{n}" joint="{n}" kp="60" kv="2"/>' for n in LEGS)
}</actuator>
  <sensor><gyro name="gyro" site="imu"/>
    <accelerometer name="force" site="imu"/></sensor>
</mujoco>"""
RATE, SECONDS = 200, 4.0
NOISE = {"gyro": 5e-3, "force": 5e-2}  # [rad/s], [m/s^2]


@pytest.fixture(scope="module")
def walk() -> tuple[Recording, np.ndarray, np.ndarray]:
    """A recording of encoders and IMU, and the true states (T, nq), (T, nv)."""
    model, rng = mujoco.MjModel.from_xml_string(ROBOT), np.random.default_rng(0)
    # finer: MuJoCo's accelerometer does not know what implicit damping takes
    model.opt.timestep /= 8
    data, time = mujoco.MjData(model), np.arange(round(RATE * SECONDS)) / RATE
    for _ in range(4000):
        mujoco.mj_step(model, data)
    # the base sways, and tilts a little
    goals = 0.2 * np.sin(np.outer(time, 3 * [4.0]))
    goals += 0.05 * np.sin(np.outer(time, [2.0, 3.0, 5.0]))
    qpos, qvel = np.empty((len(time), model.nq)), np.empty((len(time), model.nv))
    imu = np.empty((len(time), 6))
    for k, goal in enumerate(goals):
        mujoco.mj_forward(model, data)
        qpos[k], qvel[k], imu[k] = data.qpos, data.qvel, data.sensordata
        data.ctrl[:] = goal
        mujoco.mj_step(model, data, nstep=round(1 / RATE / model.opt.timestep))
    signals = {
        name: Signal(
            qpos[:, 7 + i] + 1e-4 * rng.normal(size=len(time)),
            "joint_position", name, "rad",
        )
        for i, name in enumerate(LEGS)
    }  # fmt: skip
    for name, values, unit in (
        ("gyro", imu[:, :3], "rad/s"), ("force", imu[:, 3:], "m/s^2")
    ):  # fmt: skip
        noisy = values + NOISE[name] * rng.normal(size=values.shape)
        signals[name] = Signal(noisy, "sensor", name, unit)
    episode = Episode(time, goals, LEGS, signals)
    return Recording({"walk": episode}, file="walk.h5"), qpos, qvel


def _simulator(folder, recording, xml=ROBOT):
    path = folder / "model.xml"
    path.write_text(xml)
    return build_simulator(ModelCompiler(str(path)), [recording])


def _up(quaternion: np.ndarray) -> np.ndarray:
    """The vertical (T, 3) in the frames of quaternions (T, 4)."""
    return Rotation.from_quat(quaternion, scalar_first=True).inv().apply([0, 0, 1])


def test_an_imu_and_the_legs_tell_how_the_base_moved(walk, tmp_path):
    recording, qpos, qvel = walk
    simulator = _simulator(tmp_path, recording)
    at = simulator.episodes[0].sample_steps
    state = simulator.complete_state(0, at)
    assert state.is_known.all()
    tilt = np.linalg.norm(_up(state.qpos[:, 3:7]) - _up(qpos[:, 3:7]), axis=1)
    assert np.sqrt(np.mean(tilt**2)) < 0.02
    assert np.abs(state.qpos[:, 2] - qpos[:, 2]).mean() < 0.003
    # speeds along the base's own axes, for its heading is not known
    found, true = (
        Rotation.from_quat(q[:, 3:7], scalar_first=True).inv().apply(v[:, :3])
        for q, v in ((state.qpos, state.qvel), (qpos, qvel))
    )
    error = np.sqrt(np.mean((found - true) ** 2, axis=0))
    assert (error < 0.5 * true.std(axis=0).max()).all()
    assert (error < 3 * state.std[0, simulator.compiler.nominal.nv :][:3]).all()
    assert np.abs(state.qvel[:, 3:6] - qvel[:, 3:6]).std() < 2 * NOISE["gyro"]


def test_an_episode_of_a_walking_robot_is_cut_into_segments(walk, tmp_path):
    recording, *_ = walk
    simulator = _simulator(tmp_path, recording)
    assert len(cut_readable_segments(simulator, 0.5)) == round(SECONDS / 0.5)


@pytest.mark.parametrize("lost", ["gyro", "force", "left"])
def test_without_all_readings_the_base_stays_unknown(walk, tmp_path, lost):
    recording, *_ = walk
    episode = recording.episodes["walk"]
    signals = {k: s for k, s in episode.signals.items() if k != lost}
    less = replace(recording, episodes={"walk": replace(episode, signals=signals)})
    assert _simulator(tmp_path, less).episodes[0].base is None


@pytest.mark.parametrize(
    ("given", "other"),
    [
        ('type="plane"', 'type="plane" euler="0 5 0"'),
        ('contype="0" conaffinity="1"', 'contype="0" conaffinity="2"'),
        ("<option", '<option gravity="0 0 0"'),
    ],
    ids=["slope", "nothing to stand on", "weightless"],
)
def test_where_legs_tell_nothing_the_base_stays_unknown(walk, tmp_path, given, other):
    xml = ROBOT.replace(given, other)
    assert _simulator(tmp_path, walk[0], xml).episodes[0].base is None


def test_an_orientation_that_was_read_is_kept(walk, tmp_path):
    recording, qpos, _ = walk
    episode = recording.episodes["walk"]
    read = Signal(qpos[:, 3:7], "body_orientation", "base", "quaternion")
    signals = {k: s for k, s in episode.signals.items() if k != "force"}
    more = replace(episode, signals=signals | {"pose": read})
    recording = replace(recording, episodes={"walk": more})
    simulator = _simulator(tmp_path, recording)
    state = simulator.complete_state(0, simulator.episodes[0].sample_steps)
    assert np.abs(_up(state.qpos[:, 3:7]) - _up(qpos[:, 3:7])).max() < 1e-3
    assert np.abs(state.qpos[:, 2] - qpos[:, 2]).mean() < 0.003


def test_an_imu_may_have_been_read_at_other_times(walk, tmp_path):
    recording, qpos, _ = walk
    episode = recording.episodes["walk"]
    signals = dict(episode.signals)
    for name in NOISE:
        values = signals[name].values.copy()
        values[1::2] = np.nan
        signals[name] = replace(signals[name], values=values)
    less = replace(recording, episodes={"walk": replace(episode, signals=signals)})
    simulator = _simulator(tmp_path, less)
    state = simulator.complete_state(0, simulator.episodes[0].sample_steps)
    tilt = np.linalg.norm(_up(state.qpos[:, 3:7]) - _up(qpos[:, 3:7]), axis=1)
    assert state.is_known.all() and np.sqrt(np.mean(tilt**2)) < 0.02


def test_where_nothing_carries_the_robot_no_segment_begins(walk, tmp_path):
    recording, *_ = walk
    episode = recording.episodes["walk"]
    force = episode.signals["force"]
    values = force.values.copy()
    values[:RATE] = 0.1  # the first second of the episode
    signals = dict(episode.signals) | {"force": replace(force, values=values)}
    falling = replace(recording, episodes={"walk": replace(episode, signals=signals)})
    segments = cut_readable_segments(_simulator(tmp_path, falling), 0.5)
    assert segments.first_step.min() >= 0.9 / 0.002


def test_a_drift_of_the_gyroscope_tilts_nothing():
    time = np.arange(0, 5, 0.01)
    rate = np.full((len(time), 3), 0.02)  # [rad/s] of what does not turn
    force = np.tile([0, 0, 9.81], (len(time), 1))
    turned = integrate_turns(rate, time)
    found = find_orientation(turned, force, np.zeros_like(force), time)
    assert np.abs(found.apply([0, 0, 1]) - [0, 0, 1]).max() < 0.02
