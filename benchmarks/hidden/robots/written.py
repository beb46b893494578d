"""Robots that were written down, in MJCF of many styles: sensors and motions of each.

They and their motions are of another style than those that are drawn: they were written
without looking at the program that diagnoses them.
"""

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
Control = Callable[[float, Any], np.ndarray]  # of the time [s] and MjData
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

        def command(t: float, data: Any) -> np.ndarray:
            wave = [np.sin(TURN * f[k] * t + p[k]) for k in range(3)]
            return sizes * (0.6 * wave[0] + 0.4 * wave[1] + steps * np.sign(wave[2]))

        return command

    return motion


def _follow_sines(
    columns: int, slow: float, fast: float, sizes: tuple[float, float], push
) -> Motion:
    """A motion in which a feedback follows two sines, from (goal, data) to commands."""

    def motion(rng: Rng, robot: Robot) -> Control:
        f, p = _draw_waves(rng, 2, columns, slow, fast)

        def command(t: float, data: Any) -> np.ndarray:
            goal = sizes[0] * np.sin(TURN * f[0] * t + p[0])
            return push(goal + sizes[1] * np.sin(TURN * f[1] * t + p[1]), data)

        return command

    return motion


def _push_crane(goal: np.ndarray, data: Any) -> np.ndarray:
    """Bridge and trolley of a crane; the load swings."""
    return np.clip(3.0 * (goal - data.qpos[:2]) - 1.0 * data.qvel[:2], -1, 1)


ARM_REST = np.array([0, 0.6, 0.4, 0])  # [rad]
_STIFF, _DAMP = np.array([60, 150, 60, 12.0]), np.array([6, 12, 4, 0.6])
_WEIGHT, _GEAR = np.array([0, -6, -2.2, -0.1]), np.array([60, 80, 50, 20.0])


def _push_arm(goal: np.ndarray, data: Any) -> np.ndarray:
    """Torques of four geared motors: feedback, and most of the weight."""
    feedback = _STIFF * (ARM_REST + goal - data.qpos) - _DAMP * data.qvel
    return (feedback + _WEIGHT) / _GEAR


def _push_lift(goal: np.ndarray, data: Any) -> np.ndarray:
    """Force of a winch that follows heights, most of the weight included."""
    return 117.7 + 400 * (goal - data.qpos[:1]) - 60 * data.qvel[:1]


def _start_arm(qpos: np.ndarray, qvel: np.ndarray, rng: Rng) -> None:
    qpos[:] = ARM_REST + 0.1 * rng.normal(size=4)


CROUCH = np.array([0.35, -0.7, -0.35, 0.7])  # [rad]


def _command_hops(rng: Rng, robot: Robot) -> Control:
    """Both legs of the hopper bend and stretch, each joint in its own phase."""
    rate, phase = rng.uniform(0.5, 1.5), rng.uniform(0, 6.3, 4)

    def command(t: float, data: Any) -> np.ndarray:
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

    def command(t: float, data: Any) -> np.ndarray:
        path = np.sin(TURN * f[0] * t + p[0]) - np.sin(p[0])
        goal = np.array([0, 0, 1.0]) + sizes * path
        push = 4 * (goal - data.qpos[:3]) - 3 * data.qvel[:3]
        lean = np.clip(push[:2] / GRAVITY, -0.4, 0.4)
        lift = DRONE_MASS * (GRAVITY + push[2])
        wanted = [lift, *_compute_moments(lean, data)]
        return np.clip(np.linalg.solve(MIXER, wanted), 0, 6)

    return command


def _compute_moments(lean: np.ndarray, data: Any) -> tuple[float, float, float]:
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

    def command(t: float, data: Any) -> np.ndarray:
        wave = 6 * np.sin(TURN * f[0] * t + p[0])
        wave = wave + 3 * np.sign(np.sin(TURN * f[1] * t + p[1]))
        return np.array([wave - 4 * data.qpos[0] - 1 * data.qvel[0]])

    return command


def _command_nothing(rng: Rng, robot: Robot) -> Control:
    return lambda t, data: np.zeros(0)


def _throw_ball(qpos: np.ndarray, qvel: np.ndarray, rng: Rng) -> None:
    """From a hand: upwards, to some side, spinning."""
    qpos[:3] = [0, 0, 1.2]
    qvel[:3] = rng.normal(size=3) * [3, 3, 1] + [0, 0, 3.5]
    qvel[3:] = rng.normal(size=3) * 2


# ---------------------------------------------------------------- robots


@dataclass(frozen=True)
class WrittenRobot:
    """A given model, its sensors and its motion.

    Attributes:
        file: its name in the folder `written`.
        signals: by name.
        motion: what commands it.
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


def measure_angle(joint: str, noise: float, step: float = 0.0) -> Sensor:
    """A sensor of a hinge's position, with noise and encoder step [rad]."""
    return Sensor("joint_position", joint, "rad", noise, step)


def _measure_angles(noise: float, **joints: str) -> dict[str, Sensor]:
    return {name: measure_angle(joint, noise) for name, joint in joints.items()}


def measure_slide(joint: str, noise: float) -> Sensor:
    """A sensor of a slide's position, with noise [m]."""
    return Sensor("joint_position", joint, "m", noise)


def _measure_speed(joint: str, noise: float) -> Sensor:
    return Sensor("joint_velocity", joint, "rad/s", noise)


def _see_body(body: str, place: float, turn: float) -> dict[str, Sensor]:
    """A camera's two signals of a body, with noise [m] and [rad]."""
    return {
        "pos": Sensor("body_position", body, "m", place),
        "ori": Sensor("body_orientation", body, "quaternion", turn),
    }


_ARM = ("yaw", "shoulder", "elbow", "wrist")
_LEGS = ("pitch", "f_hip", "f_knee", "b_hip", "b_knee")
_FURUTA = _measure_angles(5e-4, enc="turn")
_IMU = {
    "swing": measure_angle("swing", 1.5e-3),
    "imu": Sensor("sensor", "imu", "rad/s", 5e-3),
}
# fmt: off
WRITTEN: Mapping[str, WrittenRobot] = {
    "gantry": WrittenRobot(
        "gantry",
        {"px": measure_slide("x", 2e-4), "py": measure_slide("y", 2e-4),
         **_measure_angles(1e-3, sx="swing_x", sy="swing_y")},
        _follow_sines(2, 0.1, 0.6, (0.3, 0.15), _push_crane), 8, 8, 200, piece=0.5),
    "geared_arm": WrittenRobot(
        "geared_arm",
        {f"q_{j}": measure_angle(j, 3e-4) for j in _ARM}
        | {f"dq_{j}": _measure_speed(j, 1e-2) for j in _ARM},
        _follow_sines(4, 0.15, 0.7, (0.5, 0.25), _push_arm), 10, 6, 250,
        start=_start_arm, piece=0.5),
    # a stick that whirls does so at another moment
    "furuta": WrittenRobot(
        "furuta", {**_FURUTA, "stick": measure_angle("swing", 1.5e-3)},
        command_sines(4.0, 0.3, 1.5), 6, 8, 100, piece=2.0),
    "furuta_imu": WrittenRobot(
        "furuta", {**_FURUTA, **_IMU}, command_sines(4.0, 0.3, 1.5), 6, 8, 100,
        piece=2.0),
    "hopper": WrittenRobot(
        "hopper",
        {j: measure_slide(j, 5e-4) for j in ("rx", "rz")}
        | {j: measure_angle(j, 5e-4) for j in _LEGS},
        _command_hops, 4, 8, 200, start=_start_hopper, fine=0.00025, piece=1.0),
    "rover": WrittenRobot(
        "rover",
        _measure_angles(1e-3, left="left", right="right")
        | _see_body("chassis", 1e-3, 2e-3),
        command_sines(8.0, 0.1, 0.6), 6, 8, 100, fine=0.0005, piece=1.0),
    "scara": WrittenRobot(
        "scara",
        {"q1": measure_angle("q1", 2e-4), "q2": measure_angle("q2", 2e-4),
         "z": measure_slide("z", 5e-5), "r": measure_angle("r", 1e-3)},
        command_sines([0.8, 0.8, 0.05, 1.5], 0.1, 0.8, 0.2), 8, 6, 100),
    "drone": WrittenRobot(
        "drone", _see_body("drone", 1e-3, 2e-3), _fly_drone, 8, 6, 120, piece=0.5),
    "belt_pendulum": WrittenRobot(
        "belt_pendulum", _measure_angles(1e-3, angle="hinge"),
        command_sines(1.0, 0.1, 0.8), 20, 3, 50),
    "coarse_pendulum": WrittenRobot(
        "belt_pendulum", {"angle": measure_angle("hinge", 0.0, step=0.0015)},
        command_sines(1.0, 0.1, 0.8), 60, 1, 50),
    "tacho_pendulum": WrittenRobot(
        "belt_pendulum",
        {"angle": measure_angle("hinge", 1e-3),
         "speed": _measure_speed("hinge", 2e-2)},
        command_sines(1.0, 0.3, 2.5), 10, 6, 100),
    "planar_arm": WrittenRobot(
        "planar_arm", {f"p{j}": measure_angle(j, 2e-4) for j in "abc"},
        command_sines(0.8), 8, 6, 250, fine=0.00025),
    "elevator": WrittenRobot(
        "elevator", {"h": measure_slide("z", 5e-4)},
        _follow_sines(1, 0.1, 0.5, (0.4, 0.2), _push_lift), 10, 5, 100, piece=0.5),
    "sled": WrittenRobot(
        "sled", _see_body("sled", 1e-3, 2e-3), command_sines(5.0, 0.1, 0.6), 8, 6, 100,
        fine=0.0005, piece=1.0),
    "ball": WrittenRobot(
        "ball", _see_body("ball", 1e-3, 4e-3), _command_nothing, 0.8, 20, 240,
        start=_throw_ball, fine=0.0005),
    "cartpole": WrittenRobot(
        "cartpole",
        {"rail_enc": Sensor("sensor", "rail_enc", "m", 3e-4),
         "pole_enc": Sensor("sensor", "pole_enc", "rad", 1e-3),
         "tacho": Sensor("sensor", "tacho", "m/s", 1e-2)},
        _push_cart, 8, 6, 125, piece=0.5),
    "cartpole_encoders": WrittenRobot(
        "cartpole",
        {"rail": measure_slide("rail", 3e-4), "pole": measure_angle("hinge", 1e-3)},
        _push_cart, 8, 6, 125, piece=0.5),
}
# fmt: on
