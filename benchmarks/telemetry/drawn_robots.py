"""Robots that are drawn: a seed in; the MJCF of a user and a clean recording out.

A chain of two to six hinges of any axes, bolted down, on servos or torque motors. What
the MJCF states is 8 % off, as it usually is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.hidden.motions import command_table
from benchmarks.hidden.robots.robot import GRAVITY, Robot
from benchmarks.hidden.sensors import (
    Instruments,
    Sensor,
    measure_joints,
    record_plans,
)
from benchmarks.hidden.simulator import Command, MotionPlan
from benchmarks.hidden.truth import make_hidden_robot
from selfheal.recording import Recording

Values = np.ndarray
NAMES = ("waist", "shoulder", "elbow", "forearm", "wrist", "hand")
OFF = 0.08  # standard deviation of the logarithm of what is stated
TIMESTEP = 0.002
# of readings: a joint's position [rad], its velocity [rad/s], a gyroscope [rad/s] and
# an accelerometer [m/s^2], as of hobby drives and consumer IMUs
NOISE = {"position": 3e-4, "velocity": 0.01, "gyro": 5e-3, "acc": 0.04}
_LINK, _ROBOT = (
    (Path(__file__).parent / "drawn" / f"{name}.xml").read_text()
    for name in ("link", "robot")
)
BANDWIDTH = 3.0  # [Hz] of a controller of torques, damped by 0.7
STEPS = (4096, 16384)  # of an encoder, a turn


@dataclass(frozen=True)
class DrawnRobot:
    """A robot and what its user has of it.

    Attributes:
        xml: the MJCF as it should be.
        gains: stiffness and damping of each joint's servo; empty: torque motors.
    """

    xml: str
    recording: Recording
    gains: Mapping[str, tuple[float, float]]

    @property
    def joints(self) -> list[str]:
        """Names of the joints."""
        signals = next(iter(self.recording.episodes.values())).signals.values()
        return [s.target for s in signals if s.kind == "joint_position"]

    def list_columns(self, joint: str) -> list[str]:
        """Signals of a joint."""
        signals = next(iter(self.recording.episodes.values())).signals
        return [n for n, s in signals.items() if s.target == joint]


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
    """A robot and its recording, which stays within the joints' ranges."""
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
    robot = Robot("drawn", _write(names, hidden, put_off, loads), fine=TIMESTEP)
    recording = _record(robot, names, stated, bool(gains), rng)
    for name, n in zip(names, stated, strict=True):
        for e in recording.episodes.values():
            x = e.signals[f"{name}_position"].values
            if x.min() < n.low or x.max() > n.high:
                return None
    return DrawnRobot(_write(names, stated, gains, loads), recording, gains)


def _draw_numbers(rng: np.random.Generator, count: int) -> list[_Numbers]:
    axes, found = ("1 0 0", "0 1 0", "0 0 1"), list[_Numbers]()
    last, mass = -1, rng.uniform(0.8, 2.0)
    for _ in range(count):
        last = int(rng.choice([k for k in range(3) if k != last]))
        low, high = -rng.uniform(1.2, 2.2), rng.uniform(1.2, 2.2)
        length, damping = rng.uniform(0.08, 0.25), rng.uniform(0.05, 0.3)
        losses = damping, rng.uniform(0.02, 0.15), rng.uniform(0.005, 0.03)
        found.append(_Numbers(axes[last], length, mass, *losses, low, high))
        mass *= rng.uniform(0.5, 0.9)
    return found


def _draw_off(rng: np.random.Generator) -> float:
    return float(np.exp(OFF * rng.standard_normal()))


def _put_off(n: _Numbers, rng: np.random.Generator) -> _Numbers:
    """The true numbers of a joint; its range and axis are as stated."""
    names = ("mass", "damping", "friction", "armature")
    return replace(n, **{name: getattr(n, name) * _draw_off(rng) for name in names})


def _estimate_load(behind: list[_Numbers]) -> float:
    """The largest torque by which the links behind a joint weigh on it [N m]."""
    reach, load = 0.0, 0.0
    for n in behind:
        load += GRAVITY * n.mass * (reach + n.length / 2)
        reach += n.length
    return load


def _write(
    names: tuple[str, ...],
    numbers: list[_Numbers],
    gains: Mapping[str, tuple[float, ...]],
    loads: list[float],
) -> str:
    """The MJCF.

    Args:
        gains: of the servos, by joint; empty: torque motors.
        loads: that each joint carries [N m].
    """
    links, drives, place = "", "", "0 0 0.06"
    for name, n, load in zip(names, numbers, loads, strict=True):
        end = f"{n.length + 0.05:.4f}"
        links += _LINK.format(name=name, n=n, place=place, end=end)
        place = f"0 0 {end}"
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
    links += f'      <site name="board" pos="0.01 0.02 {numbers[-1].length:.4f}"/>'
    closing = "</body>" * (len(names) + 1)
    return _ROBOT.format(links=links + closing, drives=drives, timestep=TIMESTEP)


def _record(
    robot: Robot,
    names: tuple[str, ...],
    stated: list[_Numbers],
    is_servo: bool,
    rng: np.random.Generator,
) -> Recording:
    """Episodes in which each joint follows sines.

    Args:
        is_servo: whether goals are commanded, not torques.
    """
    rate = float(rng.choice([50, 100, 250]))
    has_speed = rng.random() < 0.7
    step = 2 * np.pi / rng.choice(STEPS)
    sensors = {
        name: replace(sensor, step=step)
        for name, sensor in measure_joints(robot, names, NOISE["position"]).items()
    }
    if has_speed:
        both = measure_joints(robot, names, NOISE["position"], NOISE["velocity"])
        sensors = sensors | {n: s for n, s in both.items() if n not in sensors}
    for name, unit in (("gyro", "rad/s"), ("acc", "m/s^2")):
        sensors[name] = Sensor("sensor", name, unit, NOISE[name])

    def plan_episode() -> MotionPlan:
        time = np.arange(0, rng.uniform(6, 9), 1 / rate)
        goals = np.stack([_draw_goal(n, time, rng) for n in stated], 1)
        command = command_table(goals) if is_servo else _follow_by_torque(robot, goals)
        rows = np.round(time / TIMESTEP).astype(int)
        return MotionPlan("", rows, command, goals[0], 0 * goals[0])

    plans = (plan_episode() for _ in range(int(rng.integers(4, 7))))
    truth = make_hidden_robot(robot, {}, "")
    return record_plans(
        Instruments(robot, sensors), truth, plans, rng, state=False
    ).seen


def _draw_goal(n: _Numbers, time: Values, rng: np.random.Generator) -> Values:
    """Three sines that stay within a part of a joint's range (T) [rad]."""
    middle = (n.low + n.high) / 2 + rng.uniform(-0.2, 0.2)
    sizes = rng.dirichlet(np.ones(3)) * rng.uniform(0.45, 0.65) * (n.high - n.low) / 2
    return middle + sum(
        size * np.sin(2 * np.pi * rng.uniform(0.15, 0.9) * time + rng.uniform(0, 6.3))
        for size in sizes
    )


def _follow_by_torque(robot: Robot, goals: Values) -> Command:
    """Torques of a controller of 3 Hz that knows the weight by half.

    Args:
        goals: (T, n) [rad].
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = goals[0]
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    rate = 2 * np.pi * BANDWIDTH
    stiffness = rate**2 * np.diag(inertia)
    low, high = model.actuator_ctrlrange.T

    def command(k: int, there: mujoco.MjData) -> Values:
        data.qpos[:], data.qvel[:] = there.qpos, there.qvel
        mujoco.mj_forward(model, data)
        torque = stiffness * (goals[k] - data.qpos) + data.qfrc_bias / 2
        return np.clip(torque - 1.4 / rate * stiffness * data.qvel, low, high)

    return command
