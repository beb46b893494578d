"""`selfheal.identify`: a robot in; a self-modeling run with its best body out."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

from ..errors import InputError
from .dynamics import DYNAMICS, HELD, MOVES, check_moves, identify_dynamics
from .run_files import (
    REPORT,
    PathLike,
    RunOptions,
    begin_run_file,
    check_options,
    take_place,
)

if TYPE_CHECKING:
    from ..robot.base import Robot
    from ..selfmodel.run import Run, Settings

_RUN, _MODEL = "run.h5", "best.xml"
_FILES = (_MODEL, REPORT, MOVES, HELD, DYNAMICS)

# [s] between two saves, which take a tenth of it: a killed run loses as much
_SAVE_EVERY = 1.0


class IdentifyOptions(TypedDict, total=False):
    """What `identify` takes besides the robot; all of it may be left out.

    Attributes:
        recordings: file of readings that the robot answers from.
        method: "default", or one of 2006: "paper", "disagreement", "random-batch",
            "random-alternate".
        space: where parts may attach: "free", "sides" or "full".
        known_lengths: in the space "full", take the parts' lengths as known.
        random_actions: draw actions at random, for comparison.
        engine: "auto", "statics", "mjx" or "mujoco".
        cycles: number of actions to try; None takes 16, or all where there are fewer.
        budget: number of simulations of the search; None takes the method's own.
        seed: of all random numbers, 0 by default.
        moves: number of motions from which the dynamics of the joints of the best body
            are identified, 0 by default; they need `out`.
    """

    recordings: PathLike | None
    method: str
    space: str
    known_lengths: bool
    random_actions: bool
    engine: str
    cycles: int | None
    budget: int | None
    seed: int
    moves: int


class _AllOptions(IdentifyOptions, RunOptions):
    """What `identify` takes by name."""


def identify(
    robot: "str | Robot | None" = None,
    *,
    progress: Callable[[int], None] | None = None,
    on_step: "Callable[[Run], None] | None" = None,
    on_stage: Callable[[str, float], None] | None = None,
    **options: Unpack[_AllOptions],
) -> "Run":
    """Find out what a robot's body is, by actions on which candidates disagree.

    Args:
        robot: its name, as `selfheal robots` lists it, or the robot itself. With
            `resume` it may be left out.
        progress: given the number of the search's simulations so far.
        on_step: given the run when it begins, and after each cycle.
        on_stage: called with what is being done of the moves, and its share (0 to 1).
        **options: as `IdentifyOptions` and `RunOptions` list them.

    Returns:
        The finished run. `run.result` has what `selfheal identify --json` prints:
        parents, lengths [m] and probabilities of the attachments.

    Raises:
        InputError: a setting makes no sense, or `out` holds a run already.
        RunFileError: the run cannot be read, or another process works on it.
    """
    from ..files import lock_file
    from ..robot.open_robot import name_robot
    from ..selfmodel.loop import check_settings
    from ..selfmodel.read_run import load_run
    from ..selfmodel.run import Run, save_run

    stage = on_stage or (lambda what, share: None)
    callbacks = progress or (lambda count: None), on_step or (lambda run: None), stage
    check_options(options, _AllOptions.__optional_keys__)
    out, resume, force = take_place(options)
    if resume is not None:
        with lock_file(resume):
            return _finish_run(load_run(resume), robot, Path(resume), *callbacks)
    if robot is None:
        raise InputError("give either a robot or a run to resume")
    settings = _make_settings(robot, **cast(IdentifyOptions, options))
    robot = _open_robot(robot, settings)
    if options.get("cycles") is None:
        settings = replace(settings, cycles=min(settings.cycles, len(robot.actions)))
    check_settings(settings, robot)
    check_moves(robot, settings.moves, has_folder=out is not None)
    name = f"{name_robot(robot)}-{settings.seed}"
    begun = begin_run_file(out, _RUN, name=name, force=force, others=_FILES)
    with begun as path:
        run = Run(settings, robot.anatomy, robot.actions, truth=robot.truth)
        if path:
            save_run(run, path)
        return _finish_run(run, robot, path, *callbacks)


def _make_settings(
    robot: "str | Robot", **options: Unpack[IdentifyOptions]
) -> "Settings":
    """The settings of a new run; the budget is the method's own unless given."""
    from ..robot.open_robot import is_described
    from ..selfmodel.run import Settings
    from ..selfmodel.strategy import BUDGETS

    recordings, budget = options.pop("recordings", None), options.pop("budget", None)
    method, rest = options.get("method", "default"), cast(dict[str, Any], options)
    if rest.get("cycles") is None:
        rest.pop("cycles", None)
    name = robot if isinstance(robot, str) else robot.name
    return Settings(
        robot=os.path.realpath(name) if is_described(name) else name,
        recordings=os.fspath(Path(recordings).resolve()) if recordings else "",
        budget=BUDGETS.get(method, 1) if budget is None else budget,
        **rest,
    )


def _open_robot(robot: "str | Robot | None", settings: "Settings") -> "Robot":
    """The robot that was given, or the one that settings name."""
    from ..robot.open_robot import open_robot

    if robot is not None and not isinstance(robot, str):
        return robot
    recordings = Path(settings.recordings) if settings.recordings else None
    return open_robot(settings.robot, seed=settings.seed, recordings=recordings)


def _finish_run(
    run: "Run",
    robot: "str | Robot | None",
    path: Path | None,
    progress: Callable[[int], None],
    on_step: "Callable[[Run], None]",
    on_stage: Callable[[str, float], None],
) -> "Run":
    """Cycle by cycle to the end, saved now and then; then body, moves, page."""
    from ..report.picture import load_matplotlib
    from ..selfmodel.loop import check_same_robot, identify_body
    from ..selfmodel.run import save_run

    start, before = time.perf_counter(), run.cycles[-1].seconds if run.cycles else 0.0
    robot = _open_robot(robot, run.settings)
    check_same_robot(run, robot)
    on_step(run)
    saved, last = run, start
    with ThreadPoolExecutor(1) as beside:
        if path:  # the page need not wait for it then
            beside.submit(load_matplotlib)
        try:
            for step in identify_body(robot, run.settings, run=run, progress=progress):
                run = step
                if "seconds" in run.result:  # it was finished before
                    saved = run
                    break
                if run.result:
                    took = round(before + time.perf_counter() - start, 1)
                    files = _write_model(run, path) if path else {}
                    run = replace(run, result={**run.result, "seconds": took, **files})
                if path and time.perf_counter() - last >= _SAVE_EVERY:
                    save_run(run, path)
                    saved, last = run, time.perf_counter()
                on_step(run)
        finally:
            if path and saved is not run:
                save_run(run, path)
    if path and run.settings.moves and not run.result.get("dynamics"):
        write_identify_report(run, path)  # moves may be refused, or take long
        model = path.with_name(_MODEL)
        dynamics = identify_dynamics(run, robot, path, model, on_stage)
        run = replace(run, result={**run.result, "dynamics": dynamics})
        save_run(run, path)
    if path:
        write_identify_report(run, path)
    return run


def _write_model(run: "Run", path: Path) -> dict[str, str]:
    """Write the best body, and name the run's files as its result does."""
    model = write_best_model(run, path)
    return {"run": str(path.absolute()), "model": str(model.absolute())}


def write_best_model(run: "Run", path: Path) -> Path:
    """Write the best body of a run as MJCF.

    Args:
        run: with a cycle at least.
        path: of the run file; the model lies beside it.

    Returns:
        The model's path.
    """
    from ..body.genome import build_bodies
    from ..body.mjcf import format_mjcf
    from ..files import write_text

    model = path.with_name(_MODEL)
    text = format_mjcf(build_bodies(run.anatomy, run.cycles[-1].genomes[:1]))
    write_text(model, text)
    return model


def write_identify_report(run: "Run", path: Path) -> Path:
    """Write the report page of a run beside its file, and return the page's path."""
    from ..report.identify import make_identify_page
    from ..report.page import write_page

    page = path.with_name(REPORT)
    write_page(make_identify_page(run), page)
    return page
