"""Motions of the other cases: takes a generator, gives what commands a robot."""

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

Rng = np.random.Generator
Command = Callable[[float, Any], np.ndarray]
Motion = Callable[[Rng, Any], Command]
TURN = 2 * np.pi
GRAVITY = 9.81  # [m/s^2]
DRONE_MASS, DRONE_ARM, DRONE_SPIN = 0.6, 0.12, 0.02  # [kg], [m], [m] of `DRONE`


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
        steps: share of the square wave.
    """

    def motion(rng: Rng, model: Any) -> Command:
        sizes = np.atleast_1d(size) * np.ones(model.nu)
        f, p = _draw_waves(rng, 3, model.nu, slow, fast)

        def command(t: float, data: Any) -> np.ndarray:
            wave = [np.sin(TURN * f[k] * t + p[k]) for k in range(3)]
            return sizes * (0.6 * wave[0] + 0.4 * wave[1] + steps * np.sign(wave[2]))

        return command

    return motion


def drive_crane(rng: Rng, model: Any) -> Command:
    """A feedback drives bridge and trolley of a crane along sines; the load swings."""
    f, p = _draw_waves(rng, 2, 2, 0.1, 0.6)

    def command(t: float, data: Any) -> np.ndarray:
        goal = 0.3 * np.sin(TURN * f[0] * t + p[0])
        goal = goal + 0.15 * np.sin(TURN * f[1] * t + p[1])
        return np.clip(3.0 * (goal - data.qpos[:2]) - 1.0 * data.qvel[:2], -1, 1)

    return command


ARM_REST = np.array([0, 0.6, 0.4, 0])  # [rad]


def drive_arm(rng: Rng, model: Any) -> Command:
    """Torques of four geared motors along sines: feedback, and most of the weight."""
    f, p = _draw_waves(rng, 2, 4, 0.15, 0.7)
    stiff, damp = np.array([60, 150, 60, 12.0]), np.array([6, 12, 4, 0.6])
    weight, gear = np.array([0, -6, -2.2, -0.1]), np.array([60, 80, 50, 20.0])

    def command(t: float, data: Any) -> np.ndarray:
        goal = ARM_REST + 0.5 * np.sin(TURN * f[0] * t + p[0])
        goal = goal + 0.25 * np.sin(TURN * f[1] * t + p[1])
        return (stiff * (goal - data.qpos) - damp * data.qvel + weight) / gear

    return command


def start_arm(data: Any, rng: Rng) -> None:
    """Start the arm near its rest pose."""
    data.qpos[:] = ARM_REST + 0.1 * rng.normal(size=4)


CROUCH = np.array([0.35, -0.7, -0.35, 0.7])  # [rad]


def command_hops(rng: Rng, model: Any) -> Command:
    """Both legs of the hopper bend and stretch, each joint in its own phase."""
    rate, phase = rng.uniform(0.5, 1.5), rng.uniform(0, 6.3, 4)

    def command(t: float, data: Any) -> np.ndarray:
        wave = 0.13 * np.sin(TURN * rate * t + phase)
        return CROUCH + wave * np.minimum(1, t / 0.3)

    return command


def start_hopper(data: Any, rng: Rng) -> None:
    """Start the hopper crouched, with both feet on the floor."""
    data.qpos[:] = [0, -0.052, 0, *CROUCH]


# thrusts to total force and moments, of rotors at (+-arm, +-arm)
MIXER = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [-1, 1, 1, -1], [1, -1, 1, -1]])
MIXER = MIXER * np.array([[1, DRONE_ARM, DRONE_ARM, DRONE_SPIN]]).T


def fly_drone(rng: Rng, model: Any) -> Command:
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


def drive_lift(rng: Rng, model: Any) -> Command:
    """Force of a winch that follows heights, most of the weight included."""
    f, p = rng.uniform(0.1, 0.5, 2), rng.uniform(0, 6.3, 2)

    def command(t: float, data: Any) -> np.ndarray:
        goal = 0.4 * np.sin(TURN * f[0] * t + p[0])
        goal = goal + 0.2 * np.sin(TURN * f[1] * t + p[1])
        force = 117.7 + 400 * (goal - data.qpos[0]) - 60 * data.qvel[0]
        return np.array([force])

    return command


def push_cart(rng: Rng, model: Any) -> Command:
    """Force on a cart: a sine, a square wave, and a pull to the middle."""
    f, p = rng.uniform(0.2, 1.0, 3), rng.uniform(0, 6.3, 3)

    def command(t: float, data: Any) -> np.ndarray:
        wave = 6 * np.sin(TURN * f[0] * t + p[0])
        wave = wave + 3 * np.sign(np.sin(TURN * f[1] * t + p[1]))
        return np.array([wave - 4 * data.qpos[0] - 1 * data.qvel[0]])

    return command


def command_nothing(rng: Rng, model: Any) -> Command:
    """No command: for a body that is thrown."""
    return lambda t, data: np.zeros(0)


def throw_ball(data: Any, rng: Rng) -> None:
    """Start a ball from a hand: upwards, to some side, spinning."""
    data.qpos[:3] = [0, 0, 1.2]
    data.qvel[:3] = rng.normal(size=3) * [3, 3, 1] + [0, 0, 3.5]
    data.qvel[3:] = rng.normal(size=3) * 2
