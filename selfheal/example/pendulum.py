"""A pendulum whose joint has a friction that its model lacks: files out."""

import csv
import io
import os
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..files import atomic_path, check_writable_folder
from ..recording import Recording

Floats = NDArray[np.float64]
_FRICTION = 0.12  # [N m] dry friction that is concealed; chosen: 8 % of the weight's
_RATE = 100.0  # [Hz] of the log; chosen: a usual one
_SECONDS = 8.0  # [s] of each episode; chosen
_ENCODER = 4096  # steps of a turn
_MAP = """\
# Which columns of log.csv are which signals of model.xml.
[time]
column = "time [ms]"
unit = "ms"

[episodes]
column = "run"

[[signals]]
kind = "command"
columns = ["goal [deg]"]
targets = ["servo"]

[[signals]]
kind = "joint_position"
columns = ["angle [deg]"]
targets = ["hinge"]
"""


@dataclass(frozen=True)
class Example:
    """Files of an example, in one folder.

    Attributes:
        model: MJCF of the robot, without the physics that is concealed.
        log: as a robot's own software writes it.
        map_file: says which columns of the log are which signals.
        recording: that the map makes of the log.
        concealed: what the model lacks, in a sentence.
    """

    model: Path
    log: Path
    map_file: Path
    recording: Path
    concealed: str


def make_pendulum_example(folder: str | os.PathLike[str]) -> Example:
    """Make the example in a folder.

    Args:
        folder: made if it is missing; files of the same names are replaced.

    Raises:
        InputError: nothing can be written there.
    """
    home = check_writable_folder(folder)
    text = (files("selfheal.models") / "pendulum" / "pendulum.xml").read_text()
    runs = {
        f"run {k + 1}": _simulate(text, goal) for k, goal in enumerate(_list_goals())
    }
    made = Example(
        home / "model.xml", home / "log.csv", home / "map.toml", home / "recording.h5",
        f"dry friction of {_FRICTION} N m in the joint 'hinge'",
    )  # fmt: skip
    _write_text(made.model, text)
    _write_text(made.log, _format_log(runs))
    _write_text(made.map_file, _MAP)
    episodes = {
        name: Recording.from_arrays(
            time - time[0], {"servo": goal}, {"joint_position": {"hinge": angle}}
        ).episodes["000"]
        for name, (time, goal, angle) in runs.items()
    }
    Recording(episodes, "pendulum", "log.csv").write(made.recording)
    return made


def _list_goals() -> list[Floats]:
    """Goals (T) [rad] of each run: what shows a drive's physics.

    Slow and fast sweeps, steps, and a climb slow enough that friction shows.
    """
    time = np.arange(0.0, _SECONDS, 1 / _RATE)
    share = time / _SECONDS
    sweep = 0.9 * np.sin(2 * np.pi * (0.15 * time + 0.04 * time**2))
    levels = np.array([0.5, -0.7, 1.2, 0.2, -1.1, 0.8, -0.3, 0.0])
    steps = levels[np.minimum((share * levels.size).astype(int), levels.size - 1)]
    climb = 1.4 * np.abs((share * 4 + 1) % 4 - 2) - 1.4
    return [sweep, steps, climb, 0.6 * sweep[::-1] + 0.4 * climb]


def _simulate(text: str, goal: Floats) -> tuple[Floats, Floats, Floats]:
    """A run of the real pendulum.

    Args:
        text: MJCF of the model.
        goal: (T) [rad] of the servo.

    Returns:
        Time [s], goal and angle [rad], each (T); the angle as an encoder reads it.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    model.dof_frictionloss[0] = _FRICTION
    data = mujoco.MjData(model)
    time, angle = np.arange(goal.size) / _RATE, np.empty(goal.size)
    steps = round(1 / _RATE / model.opt.timestep)
    for k, value in enumerate(goal):
        angle[k] = data.qpos[0]
        data.ctrl[0] = value
        mujoco.mj_step(model, data, nstep=steps)
    count = 2 * np.pi / _ENCODER
    return time, goal, np.round(angle / count) * count


def _format_log(runs: dict[str, tuple[Floats, Floats, Floats]]) -> str:
    """A CSV of runs, in milliseconds and degrees as a servo's software has them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time [ms]", "run", "goal [deg]", "angle [deg]"])
    for name, (time, goal, angle) in runs.items():
        for row in zip(1000 * time, np.rad2deg(goal), np.rad2deg(angle), strict=True):
            writer.writerow([f"{row[0]:.0f}", name, f"{row[1]:.3f}", f"{row[2]:.3f}"])
    return text.getvalue()


def _write_text(path: Path, text: str) -> None:
    """Write a text, whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(text)
