"""The dynamics of a body: a run and its robot in; moves, and a model that moves so."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:
    from ..body.body import Bodies, Floats
    from ..recording import Episode, Recording, Signal
    from ..robot.base import Mover, Robot
    from ..selfmodel.run import Run

MOVES, HELD, FOUND, DYNAMICS = "moves.h5", "held.xml", "dynamics", "dynamics.xml"
MOST_MOVES = 100  # chosen: ten minutes; the same moves for an hour hold no more
_FIRST_TRIAL = 400  # of a robot's trials: those before are for gaits
Stage = Callable[[str, float], None]


def check_moves(robot: "Robot", moves: int, *, has_folder: bool) -> None:
    """Refuse a number of moves that makes no sense, or of a robot that makes none.

    Args:
        has_folder: whether there is one for what is identified from them.

    Raises:
        InputError: says what would fit.
    """
    from ..engine.plant import check_can_walk
    from ..robot.base import require_mover
    from ..robot.simulated import SimulatedRobot

    if not 0 <= moves <= MOST_MOVES:
        raise InputError(f"moves must be 0 to {MOST_MOVES}; not {moves}")
    if moves and not has_folder:
        raise InputError(
            "moves need a folder for what is identified from them; give out"
        )
    if moves:
        require_mover(robot)
    if moves and isinstance(robot, SimulatedRobot):
        check_can_walk(robot.anatomy)  # its simulation can move no other


def identify_dynamics(
    run: "Run", robot: "Robot", path: Path, model: Path, stage: Stage
) -> dict[str, object]:
    """Have the robot move, diagnose its best body by that, and write what was found.

    Where the torso lies still in all moves, so that only joints move, that body is
    diagnosed with its torso bolted down: nothing makes and breaks contact then.

    Args:
        path: of the run file; all that is written lies beside it.
        stage: called with what is being done, and the share (0 to 1) of it.

    Returns:
        What the run's result says of it, see `selfmodel.read_run.DynamicsResult`.
    """
    from ..body.genome import build_bodies
    from ..diagnosis.output.storage import claim_folder
    from ..files import write_text
    from ..gait.excitation import plan_excitation
    from ..mjcf.edit import apply_edits
    from ..robot.base import require_mover
    from .diagnosis import diagnose

    body = build_bodies(run.anatomy, run.cycles[-1].genomes[:1])
    stage("planning moves", 0.0)
    count, seed = run.settings.moves, run.settings.seed
    plan = plan_excitation(body, run.actions, count, seed)
    moved = _move(require_mover(robot), plan.commands, path.with_name(MOVES), stage)
    is_held = plan.is_held and _lies_still(moved)
    given = _write_held_model(body, path) if is_held else model
    kept = _keep_readings(moved, body, is_held)
    folder = path.with_name(FOUND)
    with claim_folder(folder, force=True, resume=True) as memory:
        found = diagnose(given, kept, seed=seed, memory=memory, progress=stage)
        found.save(folder, force=True)
    write_text(path.with_name(DYNAMICS), apply_edits(model, found.edits, path.parent))
    fit = found.document["fit"]
    return {
        "moves": os.path.abspath(path.with_name(MOVES)),
        "diagnosis": os.path.abspath(folder),
        "model": os.path.abspath(path.with_name(DYNAMICS)),
        "held": is_held,
        "verdict": found.document["verdict"],
        **{key: fit[key] for key in ("given", "patched", "floor")},
    }


def _move(robot: "Mover", commands: "Floats", path: Path, stage: Stage) -> "Recording":
    """The recording of all moves; that of a run that was killed since is taken."""
    from ..recording import Recording, read, write

    if not path.exists():
        episodes: dict[str, Episode] = {}
        for k, each in enumerate(commands):
            stage(f"move {k + 1} of {len(commands)}", 0.0)
            made = robot.move(each, trial=_FIRST_TRIAL + k)
            (episodes[f"move-{k + 1}"],) = made.episodes.values()
        write(Recording(episodes, robot.name, made.source), path)
    return read(path)


def _lies_still(moved: "Recording") -> bool:
    """Whether the torso's vertical stays where it was and no foot touched the floor."""
    import numpy as np

    from ..gait.excitation import STILL

    for episode in moved.episodes.values():
        for name, signal in episode.signals.items():
            if name.endswith("_touch") and np.nanmax(signal.values) > 0:
                return False
            if name == "vertical":
                up = np.nanmean(signal.values, axis=0)
                cosine = signal.values @ (up / np.linalg.norm(up))
                if np.nanmin(cosine) < np.cos(STILL):
                    return False
    return True


def _write_held_model(body: "Bodies", path: Path) -> Path:
    """Write the body with its torso bolted down, and return the model's path."""
    from ..body.mjcf import format_mjcf
    from ..files import write_text

    held = replace(body, anatomy=replace(body.anatomy, fixed=True))
    write_text(path.with_name(HELD), format_mjcf(held))
    return path.with_name(HELD)


def _keep_readings(moved: "Recording", body: "Bodies", is_held: bool) -> "Recording":
    """The recording without what the model has no sensor for, or that says nothing."""
    from ..body.mjcf import build_spec

    sensors = {sensor.name for sensor in build_spec(body).sensors}

    def is_kept(signal: "Signal") -> bool:
        if is_held:
            return bool(signal.kind.startswith("joint_"))
        return signal.kind != "sensor" or signal.target in sensors

    episodes = {
        key: replace(e, signals={n: s for n, s in e.signals.items() if is_kept(s)})
        for key, e in moved.episodes.items()
    }
    return replace(moved, episodes=episodes)
