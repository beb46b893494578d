"""A real robot in simulation: a model and what is missing in it in; runs of it out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco

Floats = NDArray[np.float64]
_ENCODER = 2 * np.pi / 4096  # [rad] a step of the joints' encoders: 12 bits


@dataclass(frozen=True)
class Run:
    """Commands of a robot and what it measured.

    Attributes:
        time: (T) [s].
        goal: (T, J) [rad] of each joint's position servo.
        position: (T, J) [rad] as an encoder of 12 bits reads it.
        velocity: (T, J) [rad/s].
    """

    time: Floats
    goal: Floats
    position: Floats
    velocity: Floats


_RUNS = 4  # of each robot; chosen


def simulate_runs(
    text: str,
    conceal: Callable[["mujoco.MjModel"], None],
    *,
    rate: float,
    seconds: float,
) -> list[Run]:
    """Runs of a robot whose joints have a position servo each, in their order.

    A quarter of the model's time step comes near to a robot's continuous motion.

    Args:
        conceal: puts into the compiled model what is missing in the text.
        rate: [Hz] of commands and readings.
        seconds: [s] of each run.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    conceal(model)
    model.opt.timestep /= 4
    time = np.arange(round(seconds * rate)) / rate
    found = []
    for number in range(_RUNS):
        goal = _make_goals(model, time, number)
        data = mujoco.MjData(model)
        data.qpos[:] = goal[0]
        position, velocity = np.empty_like(goal), np.empty_like(goal)
        for k, command in enumerate(goal):
            while data.time < time[k] - 1e-9:
                mujoco.mj_step(model, data)
            position[k], velocity[k] = data.qpos, data.qvel
            data.ctrl[:] = command
        steps = np.round(position / _ENCODER) * _ENCODER
        found.append(Run(time, goal, steps, velocity))
    return found


def _make_goals(model: "mujoco.MjModel", time: Floats, number: int) -> Floats:
    """Goals (T, J) [rad] that show what a drive does.

    By turns: sweeps, steps, climbs so slow that friction shows, and sums of sines; a
    joint's frequencies are its own.

    Args:
        time: (T) [s].
    """
    low, high = model.jnt_range.T
    share = time / time[-1]
    goals = []
    for j in range(model.njnt):
        rng = np.random.default_rng([number, j])
        own = 1 + 0.37 * rng.random()
        if number % 4 == 0:
            wave = np.sin(2 * np.pi * own * (0.15 * time + 0.04 * time**2))
        elif number % 4 == 1:
            levels = rng.uniform(-1, 1, 8)
            wave = levels[np.minimum((share * 8).astype(int), 7)]
        elif number % 4 == 2:
            wave = np.abs((share * 4 * own + 1) % 4 - 2) - 1
        else:
            phase = 2 * np.pi * rng.random(3)
            angle = 2 * np.pi * own * np.outer((0.11, 0.43, 0.9), time)
            wave = np.sin(angle + phase[:, None]).mean(axis=0)
        middle, reach = (low[j] + high[j]) / 2, 0.4 * min(high[j] - low[j], 3.0)
        goals.append(middle + reach * wave)
    return np.stack(goals, axis=1)
