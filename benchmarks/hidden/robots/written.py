"""Robots that were written down, in MJCF of many styles: sensors and motions of each.

They and their motions are of another style than those that are drawn: they were written
without looking at the program that diagnoses them.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.hidden.robots.robot import GRAVITY, Rng, Robot
from benchmarks.hidden.sensors import Sensor, Sensors

FOLDER = Path(__file__).parent / "written"
TURN = 2 * np.pi
DRONE_MASS, DRONE_ARM, DRONE_SPIN = 0.6, 0.12, 0.02  # [kg], [m], [m] of drone.xml
Control = Callable[[float, mujoco.MjData], np.ndarray]  # of the time [s] and MjData
Motion = Callable[[Rng, Robot], Control]
Start = Callable[[np.ndarray, np.ndarray, Rng], None]  # changes qpos and qvel


# ---------------------------------------------------------------- motions


def _draw_waves(rng: Rng, count: int, columns: int, slow: float, fast: float):
    """Rates [Hz] and phases of `count` waves, each (count, columns)."""
    rates = rng.uniform(slow, fast, (count, columns))
    return rates, rng.uniform(0, 6.3, (count, columns))


def command_sines(
    size: float | Sequence[float], slow=0.2, fast=1.2, steps=0.3
) -> Motion:
    """A motion of two sines and a square wave, each actuator its own.

    Args:
        size: of each actuator's command, in its unit.
        slow: [Hz] lowest rate.
        fast: [Hz] highest rate.
    """

    def motion(rng: Rng, robot: Robot) -> Control:
        columns = len(robot.actuators)
        sizes = np.atleast_1d(size) * np.ones(columns)
        f, p = _draw_waves(rng, 3, columns, slow, fast)

        def command(t: float, data: mujoco.MjData) -> np.ndarray:
            wave = [np.sin(TURN * f[k] * t + p[k]) for k in range(3)]
            return sizes * (0.6 * wave[0] + 0.4 * wave[1] + steps * np.sign(wave[2]))

        return command

    return motion


def _follow_sines(
    columns: int,
    rates: tuple[float, float],
    sizes: tuple[float, float],
    push: Callable[[np.ndarray, mujoco.MjData], np.ndarray],
) -> Motion:
    """A motion in which a feedback follows two sines, from (goal, data) to commands."""

    def motion(rng: Rng, robot: Robot) -> Control:
        f, p = _draw_waves(rng, 2, columns, *rates)

        def command(t: float, data: mujoco.MjData) -> np.ndarray:
            goal = sizes[0] * np.sin(TURN * f[0] * t + p[0])
            return push(goal + sizes[1] * np.sin(TURN * f[1] * t + p[1]), data)

        return command

    return motion


def _push_crane(goal: np.ndarray, data: mujoco.MjData) -> np.ndarray:
    """Bridge and trolley of a crane; the load swings."""
    return np.clip(3.0 * (goal - data.qpos[:2]) - 1.0 * data.qvel[:2], -1, 1)


ARM_REST = np.array([0, 0.6, 0.4, 0])  # [rad]
_STIFF, _DAMP = np.array([60, 150, 60, 12.0]), np.array([6, 12, 4, 0.6])
_WEIGHT, _GEAR = np.array([0, -6, -2.2, -0.1]), np.array([60, 80, 50, 20.0])


def _push_arm(goal: np.ndarray, data: mujoco.MjData) -> np.ndarray:
    """Torques of four geared motors: feedback, and most of the weight."""
    feedback = _STIFF * (ARM_REST + goal - data.qpos) - _DAMP * data.qvel
    return (feedback + _WEIGHT) / _GEAR


def _push_lift(goal: np.ndarray, data: mujoco.MjData) -> np.ndarray:
    """Force of a winch that follows heights, most of the weight included."""
    return 117.7 + 400 * (goal - data.qpos[:1]) - 60 * data.qvel[:1]


def _start_arm(qpos: np.ndarray, qvel: np.ndarray, rng: Rng) -> None:
    qpos[:] = ARM_REST + 0.1 * rng.normal(size=4)


CROUCH = np.array([0.35, -0.7, -0.35, 0.7])  # [rad]


def _command_hops(rng: Rng, robot: Robot) -> Control:
    """Both legs of the hopper bend and stretch, each joint in its own phase."""
    rate, phase = rng.uniform(0.5, 1.5), rng.uniform(0, 6.3, 4)

    def command(t: float, data: mujoco.MjData) -> np.ndarray:
        wave = 0.13 * np.sin(TURN * rate * t + phase)
        return CROUCH + wave * np.minimum(1, t / 0.3)

    return command


def _start_hopper(qpos: np.ndarray, qvel: np.ndarray, rng: Rng) -> None:
    """Crouched, with both feet on the floor."""
    qpos[:] = [0, -0.052, 0, *CROUCH]


# thrusts to total force and moments, of rotors at (+-arm, +-arm)
MIXER = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [-1, 1, 1, -1], [1, -1, 1, -1]])
MIXER = MIXER * np.array([[1, DRONE_ARM, DRONE_ARM, DRONE_SPIN]]).T


def _fly_drone(rng: Rng, robot: Robot) -> Control:
    """Thrusts of an autopilot that follows a wavy path."""
    f, p = _draw_waves(rng, 2, 3, 0.1, 0.5)
    sizes = np.array([0.6, 0.6, 0.3])

    def command(t: float, data: mujoco.MjData) -> np.ndarray:
        path = np.sin(TURN * f[0] * t + p[0]) - np.sin(p[0])
        goal = np.array([0, 0, 1.0]) + sizes * path
        push = 4 * (goal - data.qpos[:3]) - 3 * data.qvel[:3]
        lean = np.clip(push[:2] / GRAVITY, -0.4, 0.4)
        lift = DRONE_MASS * (GRAVITY + push[2])
        wanted = [lift, *_compute_moments(lean, data)]
        return np.clip(np.linalg.solve(MIXER, wanted), 0, 6)

    return command


def _compute_moments(
    lean: np.ndarray, data: mujoco.MjData
) -> tuple[float, float, float]:
    """Moments [N m] that turn the body to a lean [rad] along x and y."""
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, data.qpos[3:7])
    turn, spin = flat.reshape(3, 3), data.qvel[3:6]
    roll = np.arctan2(turn[2, 1], turn[2, 2])
    pitch = -np.arcsin(np.clip(turn[2, 0], -1, 1))
    yaw = np.arctan2(turn[1, 0], turn[0, 0])
    return (
        0.5 * (-lean[1] - roll) - 0.08 * spin[0],
        0.5 * (lean[0] - pitch) - 0.08 * spin[1],
        0.05 * (-yaw) - 0.03 * spin[2],
    )


def _push_cart(rng: Rng, robot: Robot) -> Control:
    """Force on a cart: a sine, a square wave, and a pull to the middle."""
    f, p = rng.uniform(0.2, 1.0, 3), rng.uniform(0, 6.3, 3)

    def command(t: float, data: mujoco.MjData) -> np.ndarray:
        wave = 6 * np.sin(TURN * f[0] * t + p[0])
        wave = wave + 3 * np.sign(np.sin(TURN * f[1] * t + p[1]))
        return np.array([wave - 4 * data.qpos[0] - 1 * data.qvel[0]])

    return command


def _throw_ball(qpos: np.ndarray, qvel: np.ndarray, rng: Rng) -> None:
    """From a hand: upwards, to some side, spinning."""
    qpos[:3] = [0, 0, 1.2]
    qvel[:3] = rng.normal(size=3) * [3, 3, 1] + [0, 0, 3.5]
    qvel[3:] = rng.normal(size=3) * 2


# ---------------------------------------------------------------- robots


MOTIONS: Mapping[str, Motion] = {
    "crane": _follow_sines(2, (0.1, 0.6), (0.3, 0.15), _push_crane),
    "arm": _follow_sines(4, (0.15, 0.7), (0.5, 0.25), _push_arm),
    "lift": _follow_sines(1, (0.1, 0.5), (0.4, 0.2), _push_lift),
    "hops": _command_hops,
    "drone": _fly_drone,
    "cart": _push_cart,
    "none": lambda rng, robot: lambda t, data: np.zeros(0),
}
STARTS: Mapping[str, Start] = {
    "arm": _start_arm,
    "crouch": _start_hopper,
    "throw": _throw_ball,
}


@dataclass(frozen=True)
class WrittenRobot:
    """A given model, its sensors and its motion.

    Attributes:
        seconds: of an episode.
        episodes: of a recording.
        rate: [Hz] of the samples.
        start: sets the first state of an episode; None: the model's own.
        fine: [s] step of the hidden robot, 0: a fifth of the given one.
        piece: [s] of the pieces of a test, where open loop does not hold longer; 0:
            whole episodes.
    """

    file: str
    signals: Sensors
    motion: Motion
    seconds: float
    episodes: int
    rate: float
    start: Start | None = None
    fine: float = 0.0
    piece: float = 0.0

    def read(self) -> Robot:
        """The robot."""
        robot = Robot(self.file, (FOLDER / f"{self.file}.xml").read_text())
        step = float(robot.model.opt.timestep)
        return replace(robot, fine=self.fine or step / 5)


def _read_robot(
    signals: Mapping[str, Sequence[Any]],
    motion: str = "",
    start: str = "",
    sines: Mapping[str, Any] | None = None,
    **more: Any,
) -> WrittenRobot:
    """A robot of a table of robots.toml."""
    return WrittenRobot(
        signals={name: Sensor(*row) for name, row in signals.items()},
        motion=command_sines(**sines) if sines else MOTIONS[motion],
        start=STARTS[start] if start else None,
        **more,
    )


WRITTEN: Mapping[str, WrittenRobot] = {
    name: _read_robot(**table)
    for name, table in tomllib.loads((FOLDER / "robots.toml").read_text()).items()
}
