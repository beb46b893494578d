"""Robots that are drawn: a seed in; the MJCF of a user and a clean recording out.

A chain of two to six hinges of any axes, bolted down, on servos or torque motors. What
the MJCF states is 8 % off, as it usually is.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from selfheal.recording import Episode, Recording, Signal
from selfheal.recording.data import name_signal

Values = np.ndarray
NAMES = ("waist", "shoulder", "elbow", "forearm", "wrist", "hand")
OFF = 0.08  # standard deviation of the logarithm of what is stated
GRAVITY = 9.81
TIMESTEP = 0.002
# of readings: a joint's position [rad], its velocity [rad/s], a gyroscope [rad/s] and
# an accelerometer [m/s^2], as of hobby drives and consumer IMUs
NOISE = {"joint_position": 3e-4, "joint_velocity": 0.01, "gyro": 5e-3, "acc": 0.04}
BANDWIDTH = 3.0  # [Hz] of a controller of torques, damped by 0.7
STEPS = (4096, 16384)  # of an encoder, a turn


@dataclass(frozen=True)
class DrawnRobot:
    """A robot and what its user has of it.

    Attributes:
        xml: the MJCF as it should be.
        recording: without any fault.
        gains: stiffness and damping of each joint's servo; empty: torque motors.
    """

    xml: str
    recording: Recording
    gains: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class _Numbers:
    """What is drawn of a joint and the link behind it, in SI units."""

    axis: str
    length: float
    mass: float
    damping: float
    friction: float
    armature: float
    low: float
    high: float


def draw_robot(seed: int) -> DrawnRobot:
    """A robot and its recording, which stays within the joints' ranges.

    Args:
        seed: of all that is drawn.
    """
    rng = np.random.default_rng(seed)
    while (robot := _attempt(rng)) is None:
        pass
    return robot


def _attempt(rng: np.random.Generator) -> DrawnRobot | None:
    """A robot; None where it moves beyond a range."""
    names = NAMES[: rng.integers(2, len(NAMES) + 1)]
    stated = _draw_numbers(rng, len(names))
    loads = [_estimate_load(stated[k:]) for k in range(len(names))]
    gains = {}
    if rng.random() < 0.6:  # servos, else torque motors
        for name, load in zip(names, loads, strict=True):
            stiffness = load * rng.uniform(12, 40)
            gains[name] = stiffness, stiffness * rng.uniform(0.03, 0.06)
    hidden = [_put_off(n, rng) for n in stated]
    put_off = {k: tuple(x * _draw_off(rng) for x in g) for k, g in gains.items()}
    model = mujoco.MjModel.from_xml_string(_write(names, hidden, put_off, loads))
    recording = _record(model, names, stated, loads, bool(gains), rng)
    for name, n in zip(names, stated, strict=True):
        for e in recording.episodes.values():
            x = e.signals[f"{name}_position"].values
            if x.min() < n.low or x.max() > n.high:
                return None
    return DrawnRobot(_write(names, stated, gains, loads), recording, gains)


def _draw_numbers(rng: np.random.Generator, count: int) -> list[_Numbers]:
    axes, found = ("1 0 0", "0 1 0", "0 0 1"), list[_Numbers]()
    last = -1
    mass = rng.uniform(0.8, 2.0)
    for _ in range(count):
        last = int(rng.choice([k for k in range(3) if k != last]))
        low, high = -rng.uniform(1.2, 2.2), rng.uniform(1.2, 2.2)
        found.append(_Numbers(
            axes[last], rng.uniform(0.08, 0.25), mass, rng.uniform(0.05, 0.3),
            rng.uniform(0.02, 0.15), rng.uniform(0.005, 0.03), low, high,
        ))  # fmt: skip
        mass *= rng.uniform(0.5, 0.9)
    return found


def _draw_off(rng: np.random.Generator) -> float:
    return float(np.exp(OFF * rng.standard_normal()))


def _put_off(n: _Numbers, rng: np.random.Generator) -> _Numbers:
    """The true numbers of a joint; its range and axis are as stated."""
    return _Numbers(
        n.axis, n.length, n.mass * _draw_off(rng), n.damping * _draw_off(rng),
        n.friction * _draw_off(rng), n.armature * _draw_off(rng), n.low, n.high,
    )  # fmt: skip


def _estimate_load(behind: list[_Numbers]) -> float:
    """The largest torque by which the links behind a joint weigh on it [N m]."""
    reach, load = 0.0, 0.0
    for n in behind:
        load += GRAVITY * n.mass * (reach + n.length / 2)
        reach += n.length
    return load


def _write(
    names: tuple[str, ...], numbers: list[_Numbers],
    gains: Mapping[str, tuple[float, ...]], loads: list[float],
) -> str:  # fmt: skip
    """The MJCF.

    Args:
        names: of the joints.
        numbers: of each.
        gains: of the servos, by joint; empty: torque motors.
        loads: that each joint carries [N m].
    """
    links, place = "", "0 0 0.06"
    for name, n in zip(names, numbers, strict=True):
        links += f"""
    <body name="{name}_link" pos="{place}">
      <joint name="{name}" axis="{n.axis}" range="{n.low:.4f} {n.high:.4f}"
        damping="{n.damping:.5g}" frictionloss="{n.friction:.5g}"
        armature="{n.armature:.5g}"/>
      <geom name="{name}_shape" type="capsule" mass="{n.mass:.5g}" size="0.02"
        fromto="0.01 0 0.05 0 0.008 {n.length + 0.05:.4f}" contype="0" conaffinity="0"/>
"""
        place = f"0 0 {n.length + 0.05:.4f}"
    links += f'      <site name="board" pos="0.01 0.02 {numbers[-1].length:.4f}"/>'
    drives = ""
    for name, load in zip(names, loads, strict=True):
        if gains:
            kp, kv = gains[name]
            drives += (
                f'\n    <position name="{name}_servo" joint="{name}" kp="{kp:.5g}" '
                f'kv="{kv:.5g}" forcerange="{-4 * load:.4g} {4 * load:.4g}"/>'
            )
        else:
            drives += (
                f'\n    <motor name="{name}_motor" joint="{name}" '
                f'ctrlrange="{-6 * load:.4g} {6 * load:.4g}"/>'
            )
    return f"""<mujoco model="drawn">
  <compiler angle="radian"/>
  <option timestep="{TIMESTEP}" integrator="implicitfast"/>
  <worldbody>
    <body name="trunk" pos="0 0 0.5">
    <geom name="trunk_shape" type="box" size="0.05 0.05 0.05" mass="2" contype="0"
      conaffinity="0"/>{links}{"</body>" * (len(names) + 1)}
  </worldbody>
  <actuator>{drives}
  </actuator>
  <sensor>
    <gyro name="gyro" site="board"/><accelerometer name="acc" site="board"/>
  </sensor>
</mujoco>"""


def _record(
    model: mujoco.MjModel, names: tuple[str, ...], stated: list[_Numbers],
    loads: list[float], is_servo: bool, rng: np.random.Generator,
) -> Recording:  # fmt: skip
    """Episodes in which each joint follows sines.

    Args:
        model: of the true robot.
        names: of the joints.
        stated: numbers of each.
        loads: that each carries [N m].
        is_servo: whether goals are commanded, not torques.
        rng: of motions, rates and noise.
    """
    rate = float(rng.choice([50, 100, 250]))
    has_speed = rng.random() < 0.7
    step = 2 * np.pi / rng.choice(STEPS)
    episodes = {}
    for k in range(int(rng.integers(4, 7))):
        time = np.arange(0, rng.uniform(6, 9), 1 / rate)
        goals = np.stack([_draw_goal(n, time, rng) for n in stated], 1)
        ctrl, q, v, read = _simulate(model, time, goals, loads, is_servo)
        signals = dict[str, Signal]()
        for j, name in enumerate(names):
            x = q[:, j] + rng.normal(0, NOISE["joint_position"], len(time))
            _add(signals, "joint_position", name, np.round(x / step) * step, "rad")
        for j, name in enumerate(names if has_speed else ()):
            x = v[:, j] + rng.normal(0, NOISE["joint_velocity"], len(time))
            _add(signals, "joint_velocity", name, x, "rad/s")
        for columns, name, unit in (
            (slice(0, 3), "gyro", "rad/s"), (slice(3, 6), "acc", "m/s^2"),
        ):  # fmt: skip
            noise = rng.normal(0, NOISE[name], (len(time), 3))
            _add(signals, "sensor", name, read[:, columns] + noise, unit)
        commands = tuple(model.actuator(a).name for a in range(model.nu))
        episodes[f"run{k}"] = Episode(time, ctrl, commands, signals)
    return Recording(episodes, robot="drawn")


def _add(
    signals: dict[str, Signal], kind: str, target: str, values: Values, unit: str
) -> None:
    """A signal by the name that an import would give it.

    Args:
        signals: to which it is added.
        kind, target, values, unit: of it.
    """
    name = name_signal(kind, target, signals)
    signals[name] = Signal(values, kind, target, unit)


def _draw_goal(n: _Numbers, time: Values, rng: np.random.Generator) -> Values:
    """Three sines that stay within a part of a joint's range (T) [rad]."""
    middle = (n.low + n.high) / 2 + rng.uniform(-0.2, 0.2)
    sizes = rng.dirichlet(np.ones(3)) * rng.uniform(0.45, 0.65) * (n.high - n.low) / 2
    return middle + sum(
        size * np.sin(2 * np.pi * rng.uniform(0.15, 0.9) * time + rng.uniform(0, 6.3))
        for size in sizes
    )


def _simulate(
    model: mujoco.MjModel, time: Values, goals: Values, loads: list[float],
    is_servo: bool,
) -> tuple[Values, Values, Values, Values]:  # fmt: skip
    """Commands, positions, velocities and readings of the board, a row each sample.

    Torques are those of a controller of 3 Hz that knows the weight by half.

    Args:
        model: of the true robot.
        time: (T) of the samples [s].
        goals: (T, n) [rad].
        loads: that each joint carries [N m].
        is_servo: whether goals are commanded.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = goals[0]
    ctrl, q, v = (np.empty_like(goals) for _ in range(3))
    read = np.empty((len(time), model.nsensordata))
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    rate = 2 * np.pi * BANDWIDTH
    stiffness = rate**2 * np.diag(inertia)
    for k in range(len(time)):
        mujoco.mj_forward(model, data)
        if is_servo:
            data.ctrl[:] = goals[k]
        else:
            data.ctrl[:] = (
                stiffness * (goals[k] - data.qpos) - 1.4 / rate * stiffness * data.qvel
                + data.qfrc_bias / 2
            )  # fmt: skip
        low, high = model.actuator_ctrlrange.T
        if not is_servo:
            data.ctrl[:] = np.clip(data.ctrl, low, high)
        mujoco.mj_forward(model, data)
        ctrl[k], q[k], v[k], read[k] = (
            data.ctrl, data.qpos, data.qvel, data.sensordata,
        )  # fmt: skip
        ahead = (time[k + 1] if k + 1 < len(time) else time[k]) - data.time
        mujoco.mj_step(model, data, round(ahead / model.opt.timestep))
    return ctrl, q, v, read
