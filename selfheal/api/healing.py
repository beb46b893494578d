"""`selfheal.heal`: a self-modeling run and a damage in; a recovery of the gait out."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack, cast

from ..errors import InputError, check_seed
from .run_files import (
    REPORT,
    PathLike,
    RunOptions,
    begin_run_file,
    check_options,
    follow_phases,
    take_place,
)

if TYPE_CHECKING:
    from ..body.damage import Damage
    from ..recovery.record import HealRun, HealSettings
    from ..robot.base import Robot, Walker
    from ..selfmodel.run import Run

_RUN = "heal.h5"


class HealOptions(TypedDict, total=False):
    """What `heal` takes besides the run and the damage; all of it may be left out.

    Attributes:
        hours: in place of a damage: how long it walks [h], while damages drawn by the
            seed happen.
        heading: walking direction, from forward to the left [rad].
        gait: its parameterization: "waves", or "poses" as in 2006.
        seed: of all random numbers.
        robot: that was identified; None opens it by its name.
    """

    hours: float | None
    heading: float
    gait: str
    seed: int
    robot: "Robot | None"


class _AllOptions(HealOptions, RunOptions):
    """What `heal` takes by name."""


def heal(
    run: "PathLike | Run | None" = None,
    damage: "str | Sequence[Damage] | None" = None,
    *,
    progress: Callable[[str, str, float], None] | None = None,
    on_step: "Callable[[HealRun], None] | None" = None,
    **options: Unpack[_AllOptions],
) -> "HealRun":
    """Walk, notice a damage, find what it is, and walk again.

    Args:
        run: a finished run of `identify`, or its file. With `resume` it may be left
            out, if that run has a file.
        damage: what happens to the robot, in the words of `selfheal heal --damage`.
        progress: given the phase, what it does, and the share done (0 to 1).
        on_step: given the run when it begins, and after each phase.
        **options: as `HealOptions` and `RunOptions` list them.

    Returns:
        The finished run. `result` has what `selfheal heal --json` prints.

    Raises:
        InputError: a setting makes no sense, or `out` holds a heal already.
        RunFileError: a run cannot be read, or another process works on it.
    """
    from ..files import lock_file
    from ..recovery.phased_run import load_phased_run, save_phased_run
    from ..recovery.record import HealRun
    from ..robot.open_robot import name_robot

    callbacks = progress or (lambda *what: None), on_step or (lambda run: None)
    check_options(options, _AllOptions.__optional_keys__)
    out, resume, force = take_place(options)
    if resume is not None:
        with lock_file(resume):
            begun = load_phased_run(resume, HealRun)
            known = load_identified(run or begun.settings.run, options.get("robot"))
            return _finish_heal(begun, known, Path(resume), *callbacks)
    if run is None or (damage is None) == (options.get("hours") is None):
        raise InputError("give a run and a damage or hours, or a heal to resume")
    known, settings = _make_settings(run, damage, **cast(HealOptions, options))
    name = f"heal-{name_robot(known[1])}-{settings.seed}"
    with begin_run_file(out, _RUN, name=name, force=force) as path:
        begun = HealRun(settings)
        if path:
            save_phased_run(begun, path)
        return _finish_heal(begun, known, path, *callbacks)


def check_gait_settings(gait: str, heading: float, seed: int) -> None:
    """Refuse a gait that is not known and numbers that make no sense.

    Args:
        heading: direction to walk [rad].

    Raises:
        InputError: says which, and what would do.
    """
    from ..gait.pattern import find_pattern

    find_pattern(gait)
    if not abs(heading) <= 2 * math.pi:
        raise InputError(
            f"the heading must be -2 pi to 2 pi rad, within one turn; not {heading}"
        )
    check_seed(seed)


def load_identified(
    run: "PathLike | Run", robot: "Robot | None" = None
) -> "tuple[Run, Walker]":
    """A finished run of `identify`, and its robot, which can walk.

    Raises:
        InputError: the run is not finished, or the robot cannot walk.
        RunFileError: the run cannot be read.
    """
    from ..robot.base import require_walker
    from ..robot.open_robot import open_robot
    from ..selfmodel.read_run import load_run
    from ..selfmodel.run import Run

    found = run if isinstance(run, Run) else load_run(run)
    if not found.result:
        raise InputError(
            "the run is not finished"
            if isinstance(run, Run)
            else f"{run}: the run is not finished; 'selfheal identify --resume {run}'"
        )
    s = found.settings
    recordings = Path(s.recordings) if s.recordings else None
    return found, require_walker(
        robot or open_robot(s.robot, seed=s.seed, recordings=recordings)
    )


def _make_settings(
    run: "PathLike | Run",
    damage: "str | Sequence[Damage] | None",
    **options: Unpack[HealOptions],
) -> "tuple[tuple[Run, Walker], HealSettings]":
    """The run, its robot and the settings of a new heal, checked."""
    import numpy as np

    from ..recovery.hours import PAUSE, check_hours
    from ..recovery.record import HealSettings
    from ..robot.accidents import draw_strikes, parse_accident
    from ..selfmodel.run import Run

    gait, heading = options.get("gait", "waves"), options.get("heading", 0.0)
    seed, hours = options.get("seed", 0), options.get("hours")
    check_gait_settings(gait, heading, seed)
    if hours is not None:
        check_hours(hours)
    known = load_identified(run, options.get("robot"))
    file = run.result.get("run", "") if isinstance(run, Run) else os.path.abspath(run)
    settings = HealSettings(file, (), gait=gait, heading=heading, seed=seed)
    if hours is None:
        if isinstance(damage, str):
            damage = parse_accident(damage, known[0].anatomy)
        onset = float(np.random.default_rng([seed, 30]).uniform(8, 20))
        return known, replace(settings, damage=tuple(damage or ()), onset=onset)
    truth = known[1].truth
    if truth is None:
        raise InputError(
            f"robot {known[1].name!r} is not simulated, so nobody can break it"
        )
    rng = np.random.default_rng([seed, 31])
    strikes = draw_strikes(truth, 3600 * hours, PAUSE, rng)
    damages, onsets = (tuple(s.damage for s in strikes), tuple(s.time for s in strikes))
    return known, replace(settings, damage=damages, hours=hours, onsets=onsets)


def _finish_heal(
    run: "HealRun",
    known: "tuple[Run, Walker]",
    path: Path | None,
    progress: Callable[[str, str, float], None],
    on_step: "Callable[[HealRun], None]",
) -> "HealRun":
    """Phase by phase to the end, saved after each; then the page."""
    from ..gait.rival_bodies import select_rival_bodies
    from ..recovery.heal import heal_robot
    from ..recovery.hours import heal_for_hours
    from ..recovery.phases import make_robot_states
    from ..report.heal import make_heal_page
    from ..report.hours import make_hours_page
    from ..report.page import write_page

    found, robot = known
    models, weights = select_rival_bodies(found)
    what = models, weights, run.settings
    steps = (
        heal_for_hours(robot, *what, run=run, progress=progress)
        if run.settings.hours
        else heal_robot(
            make_robot_states(robot, run.settings), *what, run=run, progress=progress
        )
    )
    run = follow_phases(run, steps, path, on_step)
    if path:
        make = make_hours_page if run.settings.hours else make_heal_page
        write_page(make(run, models), path.with_name(REPORT))
    return run
