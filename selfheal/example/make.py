"""Examples by name: a folder in; a model, a log and a map of it out."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UnknownNameError
from ..files import check_writable_folder, write_text
from ..recording import Recording, list_model_names
from .simulate import Run, simulate_runs
from .write_logs import (
    write_csv,
    write_lerobot,
    write_npz,
    write_ros2_bag,
)

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class Example:
    """Files of an example, in one folder.

    Attributes:
        model: MJCF of the robot, without the physics that is concealed.
        log: as a robot's own software writes it.
        map_file: says which columns of the log are which signals.
        recording: what the map makes of the log.
        concealed: what is missing in the model, in a few words.
    """

    model: Path
    log: Path
    map_file: Path
    recording: Path
    concealed: str


@dataclass(frozen=True)
class _Plan:
    """How an example is made.

    Attributes:
        conceal: puts into the compiled model what is missing in the text.
        rate: [Hz] of the log.
        seconds: [s] of each run.
    """

    log: str
    write: Callable[[Path, Sequence[Run], Sequence[str]], None]
    conceal: Callable[["mujoco.MjModel"], None]
    concealed: str
    rate: float
    seconds: float


def _add_friction(joint: str, friction: float) -> Callable[["mujoco.MjModel"], None]:
    """Dry friction [N m] in a joint."""

    def conceal(model: "mujoco.MjModel") -> None:
        model.dof_frictionloss[model.joint(joint).dofadr[0]] = friction

    return conceal


def _add_load(model: "mujoco.MjModel") -> None:
    """A load of 3 kg, 0.1 m before the flange of the arm of six axes."""
    import mujoco

    body, load, ahead = model.body("flange").id, 3.0, np.array([0.1, 0.0, 0.0])
    mass = model.body_mass[body]
    center = (mass * model.body_ipos[body] + load * ahead) / (mass + load)
    # of two points on the line between them, beside what the flange has (Steiner)
    reduced = mass * load / (mass + load)
    model.body_inertia[body] += reduced * np.sum((ahead - model.body_ipos[body]) ** 2)
    model.body_ipos[body] = center
    model.body_mass[body] = mass + load
    mujoco.mj_setConst(model, mujoco.MjData(model))


# numbers are chosen: usual rates, and effects that a user would want to know of
EXAMPLES: Mapping[str, _Plan] = {
    "pendulum": _Plan(
        "log.csv",
        write_csv,
        _add_friction("hinge", 0.12),
        "dry friction of 0.12 N m in the joint hinge",
        rate=100.0,
        seconds=8.0,
    ),
    "desk_arm": _Plan(
        "lerobot",
        write_lerobot,
        _add_friction("shoulder_lift", 0.15),
        "dry friction of 0.15 N m in the joint shoulder_lift",
        rate=30.0,
        seconds=12.0,
    ),
    "six_axis": _Plan(
        "bag",
        write_ros2_bag,
        _add_load,
        "a load of 3 kg at the body flange",
        rate=100.0,
        seconds=8.0,
    ),
    "hung_quadruped": _Plan(
        "log.npz",
        write_npz,
        _add_friction("RL_calf_joint", 0.8),
        "dry friction of 0.8 N m in the joint RL_calf_joint",
        rate=200.0,
        seconds=6.0,
    ),
}


def make_example(name: str, folder: str | os.PathLike[str]) -> Example:
    """Make an example in a folder.

    Args:
        folder: made if it is missing; files of the same names are replaced.

    Raises:
        UnknownNameError: there is no such example.
        InputError: nothing can be written there, or the log's format needs an extra.
    """
    import mujoco

    if name not in EXAMPLES:
        raise UnknownNameError("example", name, EXAMPLES)
    plan, home = EXAMPLES[name], check_writable_folder(folder)
    text = (files("selfheal.models") / name / f"{name}.xml").read_text()
    runs = simulate_runs(text, plan.conceal, rate=plan.rate, seconds=plan.seconds)
    model = mujoco.MjModel.from_xml_string(text)
    joints = [model.joint(j).name for j in range(model.njnt)]
    map_text = (files("selfheal.example") / "maps" / f"{name}.toml").read_text()
    made = Example(
        home / "model.xml",
        home / plan.log,
        home / "map.toml",
        home / "recording.h5",
        plan.concealed,
    )
    write_text(made.model, text)
    plan.write(made.log, runs, joints)
    write_text(made.map_file, map_text)
    _write_recording(made.recording, runs, model, has_speeds="velocity" in map_text)
    return made


def _write_recording(
    path: Path, runs: Sequence[Run], model: "mujoco.MjModel", *, has_speeds: bool
) -> None:
    """Write the recording that the map makes of the log."""
    joints = [model.joint(j).name for j in range(model.njnt)]
    actuators = list_model_names(model).commands
    episodes = {}
    for number, run in enumerate(runs):
        signals = {"joint_position": dict(zip(joints, run.position.T, strict=True))}
        if has_speeds:
            signals["joint_velocity"] = dict(zip(joints, run.velocity.T, strict=True))
        ctrl = dict(zip(actuators, run.goal.T, strict=True))
        made = Recording.from_arrays(run.time, ctrl, signals)
        episodes[f"{number:03d}"] = made.episodes["000"]
    Recording(episodes).write(path)
