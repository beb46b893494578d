"""Small robots for tests of the diagnosis, and recordings of what they hide."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from selfheal.mujoco_files import silence_mujoco
from selfheal.recording import Episode, Recording, Signal, list_controls

if TYPE_CHECKING:
    from selfheal.diagnosis.data.robot_summary import RobotSummary
    from selfheal.diagnosis.simulation.simulator import Simulator

PENDULUM = """<mujoco model="pendulum">
  <!-- a weight on a rod, turned by a servo -->
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="rod" pos="0 0 1">
      <joint name="hinge" type="hinge" axis="0 1 0" damping="0.03" armature="0.002"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.05"/>
      <geom name="weight" type="sphere" pos="0 0 -0.2" size="0.03" mass="0.3"/>
    </body>
  </worldbody>
  <actuator>
    <position name="servo" joint="hinge" kp="3" kv="0.1"/>
  </actuator>
</mujoco>
"""
ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.05" armature="0.01"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4"/>
      <body name="lower" pos="0.2 0 0">
        <joint name="elbow" type="hinge" axis="0 1 0" damping="0.03" armature="0.005"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"
          mass="0.2"/>
        <site name="tip" pos="0.2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder_servo" joint="shoulder" kp="20" kv="0.8"/>
    <position name="elbow_servo" joint="elbow" kp="10" kv="0.4"/>
  </actuator>
  <sensor>
    <jointpos name="elbow_angle" joint="elbow"/>
  </sensor>
</mujoco>
"""
# the same arm, bolted to a stand
STAND = '<body name="stand" pos="0 0 1"><geom type="box" size="0.05 0.05 0.02"/>'
STANDING_ARM = (
    ARM.replace('<body name="upper" pos="0 0 1">', f'{STAND}<body name="upper">')
    .replace("</worldbody>", "</body></worldbody>")
    .replace('<geom name="', '<geom contype="0" name="')
)
CART_POLE = """<mujoco model="cart_pole">
  <option timestep="0.002" integrator="implicitfast" density="1.2"/>
  <worldbody>
    <body name="cart" pos="0 0 0.5">
      <joint name="rail" type="slide" axis="1 0 0" damping="0.5"/>
      <geom name="cart" type="box" size="0.08 0.05 0.03" mass="0.5"/>
      <body name="pole">
        <joint name="pivot" type="hinge" axis="0 1 0" damping="0.002"/>
        <geom name="pole" type="box" size="0.012 0.008 0.15" pos="0 0 -0.15"
          mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="push" joint="rail"/>
  </actuator>
</mujoco>
"""
BOX = """<mujoco model="box">
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1" friction="0.6 0.005 0.0001"/>
    <body name="box" pos="0 0 0.3">
      <freejoint name="float"/>
      <geom name="box" type="box" size="0.06 0.05 0.04" mass="0.4"
        friction="0.6 0.005 0.0001"/>
    </body>
  </worldbody>
</mujoco>
"""
GIMBAL = """<mujoco model="gimbal">
  <option timestep="0.004"/>
  <default><joint armature="1"/></default>
  <worldbody>
    <body name="ring" pos="0 0 1"><joint name="yaw" axis="0 0 1" stiffness="20"/>
      <geom size="0.01" mass="0.001"/>
      <body name="head" pos="0.3 0 0"><joint name="pitch" axis="0 1 0" stiffness="30"/>
        <geom size="0.01" pos="0.2 0 0" mass="0.001"/><site name="imu" pos="0.1 0 0"/>
      </body>
    </body>
  </worldbody>
  <sensor><gyro name="gyro" site="imu"/><accelerometer name="pull" site="imu"/></sensor>
</mujoco>
"""
WRIST = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="stand" pos="0 0 1" euler="0 30 0"><geom size="0.01"/>
    <body name="palm" euler="20 0 10"><joint name="wrist" type="ball" damping="0.02"
      stiffness="0.5"/><geom type="box" size="0.05 0.02 0.03" pos="0.01 0 -0.1"/></body>
  </body></worldbody></mujoco>"""
NO_COMMAND = lambda t, rng: np.zeros((t.size, 0))  # noqa: E731


@dataclass(frozen=True)
class Robot:
    """A model and how it is recorded.

    Attributes:
        xml: the model as a user has it.
        signals: name: kind, target, unit.
        command: commands (T, nu) at times (T) [s], drawn anew for each episode.
        begin: position and velocity at the start, drawn anew too.
        noise: standard deviation of every reading [its unit].
    """

    xml: str
    signals: Mapping[str, tuple[str, str, str]]
    command: Callable
    begin: Callable
    noise: float = 1e-3


def _wave(*reaches: float) -> Callable:
    """Commands: two slow sines and steps at each actuator, of some reach."""

    def command(t, rng):
        columns = []
        for reach in reaches:
            f, p = rng.uniform(0.3, 1.5, 2), rng.uniform(0, 6, 3)
            smooth = 0.4 * np.sin(2 * np.pi * f[0] * t + p[0])
            smooth += 0.3 * np.sin(2 * np.pi * f[1] * t + p[1])
            columns.append(reach * (smooth + 0.3 * np.sign(np.sin(4 * t + p[2]))))
        return np.stack(columns, axis=1)

    return command


def _rest(nq: int, spread: float = 0.3) -> Callable:
    return lambda rng: (spread * rng.normal(size=nq), np.zeros(nq))


def _turned(rng):
    turn = rng.normal(size=4)
    return turn / np.linalg.norm(turn), rng.normal(size=3)


def _toss(rng):
    turn = rng.normal(size=4)
    qpos = np.concatenate([[0, 0, 0.25], turn / np.linalg.norm(turn)])
    return qpos, np.concatenate([rng.normal(size=2), [0.5], 3 * rng.normal(size=3)])


ROBOTS = {
    "pendulum": Robot(
        PENDULUM, {"angle": ("joint_position", "hinge", "rad")}, _wave(1.2), _rest(1)
    ),
    "arm": Robot(
        ARM,
        {
            "shoulder": ("joint_position", "shoulder", "rad"),
            "elbow": ("joint_position", "elbow", "rad"),
            "elbow_torque": ("joint_torque", "elbow_servo", "N m"),
            "tip": ("body_position", "lower", "m"),
            "coarse": ("sensor", "elbow_angle", "rad"),
        },
        _wave(0.8, 1.0), _rest(2),
    ),
    "half_seen_arm": Robot(
        STANDING_ARM, {"shoulder": ("joint_position", "shoulder", "rad")},
        _wave(0.8, 1.0), _rest(2),
    ),
    "cart_pole": Robot(
        CART_POLE,
        {
            "cart": ("joint_position", "rail", "m"),
            "pole": ("joint_position", "pivot", "rad"),
        },
        _wave(2.0), _rest(2),
    ),
    "gimbal": Robot(
        GIMBAL,
        {
            "yaw": ("joint_position", "yaw", "rad"),
            "pitch": ("joint_position", "pitch", "rad"),
            "gyro": ("sensor", "gyro", "rad/s"),
            "pull": ("sensor", "pull", "m/s^2"),
            "speed": ("body_linear_velocity", "head", "m/s"),
        },
        NO_COMMAND, lambda rng: (np.zeros(2), 5 * rng.uniform(0.8, 1.2, 2)),
    ),
    "wrist": Robot(
        WRIST, {"turn": ("body_orientation", "palm", "quaternion")}, NO_COMMAND, _turned
    ),
    "box": Robot(
        BOX,
        {
            "place": ("body_position", "box", "m"),
            "turn": ("body_orientation", "box", "quaternion"),
        },
        NO_COMMAND, _toss,
    ),
}  # fmt: skip


def nothing(*_) -> None:
    """Change nothing: the robot is as its model says."""


def record(
    robot: Robot,
    *,
    episodes: int = 3,
    seconds: float = 2.0,
    rate: float = 100.0,
    seed: int = 0,
    change: Callable = nothing,
    torque: Callable = nothing,
    states: bool = True,
    noise: float | None = None,
    finer: int = 4,
) -> Recording:
    """Record the real robot: a finer time step, and noise on every reading.

    Args:
        seconds: of each.
        rate: of samples [Hz].
        seed: of commands, initial states and noise.
        change: makes the compiled model the true one.
        torque: writes `data.qfrc_applied` at each step.
        states: whether episodes have qpos0 and qvel0.
        finer: steps of the truth in one of the model's.
    """
    silence_mujoco()
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(robot.xml)
    model.opt.timestep /= finer
    change(model)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    size = robot.noise if noise is None else noise
    found = {
        f"{i:03d}": _episode(robot, model, seconds, rate, rng, torque, size, states)
        for i in range(episodes)
    }
    return Recording(found, "toy", "made up", "toy.h5")


def change_readings(
    recording: Recording,
    change: Callable[[np.ndarray], np.ndarray],
    *,
    episodes: Iterable[str] | None = None,
    signals: Iterable[str] | None = None,
) -> Recording:
    """The recording with other values of signals.

    Args:
        episodes: ids of those that change; None: all.
        signals: names of those that change; None: all.
    """
    changed = dict(recording.episodes)
    for key in changed if episodes is None else episodes:
        own = dict(changed[key].signals)
        for name in own if signals is None else signals:
            own[name] = replace(own[name], values=change(own[name].values))
        changed[key] = replace(changed[key], signals=own)
    return replace(recording, episodes=changed)


def _episode(robot, model, seconds, rate, rng, torque, noise, states) -> Episode:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = begin = robot.begin(rng)
    time = np.arange(0, seconds, 1 / rate)
    ctrl = robot.command(time, rng)
    every = round(1 / rate / model.opt.timestep)
    told: dict[str, list] = {name: [] for name in robot.signals}
    for u in ctrl:
        data.ctrl[:] = u
        mujoco.mj_forward(model, data)
        for name, (kind, target, _) in robot.signals.items():
            told[name].append(read_one(model, data, kind, target))
        for _ in range(every):
            torque(data)
            mujoco.mj_step(model, data)
    signals = {}
    for name, (kind, target, unit) in robot.signals.items():
        values = np.array(told[name])
        values = values + noise * rng.normal(size=values.shape)
        if kind == "body_orientation":
            values /= np.linalg.norm(values, axis=1, keepdims=True)
        if name == "coarse":
            values = 0.05 * np.round(values / 0.05)
        signals[name] = Signal(values, kind, target, unit)
    names = tuple(c.actuator for c in list_controls(model))
    state = (begin[0].copy(), begin[1].copy()) if states else (None, None)
    return Episode(time, ctrl, names, signals, *state)


def read_one(model, data, kind: str, target: str) -> float | np.ndarray:
    """One reading of a perfect sensor."""
    if kind == "joint_position":
        return float(data.joint(target).qpos[0])
    if kind == "joint_velocity":
        return float(data.joint(target).qvel[0])
    if kind == "joint_torque":
        gear, force = model.actuator(target).gear[0], data.actuator(target).force[0]
        return float(gear * force)
    if kind == "sensor":
        told = np.array(data.sensor(target).data)
        return float(told[0]) if told.size == 1 else told
    if kind == "body_linear_velocity":
        six = np.zeros(6)
        body, is_body = model.body(target).id, int(mujoco.mjtObj.mjOBJ_XBODY)
        mujoco.mj_objectVelocity(model, data, is_body, body, six, 0)
        return six[3:]
    field = "xpos" if kind == "body_position" else "xquat"
    return np.array(getattr(data.body(target), field))


@dataclass(frozen=True)
class Bench:
    """A robot's model on disk, its recording, and what the diagnosis makes of them.

    Attributes:
        path: of the model.
        recording: of the robot as its model says, and noise.
        simulator: of the model, for the recording.
        robot: what is known of the robot from both.
    """

    path: Path
    recording: Recording
    simulator: "Simulator"
    robot: "RobotSummary"


def bench(robot: Robot | str, folder: Path, **how) -> Bench:
    """The robot's model in a folder, and a recording of it."""
    robot = ROBOTS[robot] if isinstance(robot, str) else robot
    return make_bench(robot, folder, record(robot, **how))


def make_bench(robot: Robot, folder: Path, recording: Recording) -> Bench:
    """The robot's model in a folder, and what a diagnosis makes of a recording."""
    from selfheal.diagnosis.simulation.build import build_simulator, summarize_robot
    from selfheal.diagnosis.simulation.model_variants import ModelCompiler

    path = folder / "model.xml"
    path.write_text(robot.xml)
    simulator = build_simulator(ModelCompiler(str(path)), [recording])
    summary = summarize_robot(simulator)
    simulator = replace(simulator, has_contact=summary.has_contact)
    return Bench(path, recording, simulator, summary)


@cache
def places() -> tuple[str, ...]:
    """The robots that together have a place for every effect."""
    return "arm", "half_seen_arm", "cart_pole", "box"
