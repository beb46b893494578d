"""`selfheal.recover`: a legged robot and a scenario in; the recovery out."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack, cast

from ..errors import InputError, UnknownNameError, check_seed
from .run_files import (
    REPORT,
    RunOptions,
    begin_run_file,
    check_options,
    follow_phases,
    take_place,
)

if TYPE_CHECKING:
    from ..recovery.recover_run import RecoverRun, RecoverSettings
    from ..robot.driven_robot import DrivenRobot

RUN = "recover.h5"


class RecoverOptions(TypedDict, total=False):
    """What `recover` takes besides the scenario; all of it may be left out.

    Attributes:
        method: "ours", "as-described" or "hardware-only".
        reach: of the joints to either side, 30 or 45 [deg].
        apart: count a hexapod's hip as two joints, each of which can break.
        gap: share by which the robot may be off its model, 0 to 0.5 [1].
        seed: of all random numbers.
        trials: most trials of a new controller on the broken robot.
        generations: of each search.
    """

    method: str
    reach: float
    apart: bool
    gap: float
    seed: int
    trials: int
    generations: int


class _AllOptions(RecoverOptions, RunOptions):
    """What `recover` takes by name."""


def recover(
    robot: str | None = None,
    scenario: int | None = None,
    *,
    driven: "DrivenRobot | None" = None,
    progress: Callable[[str, str, float], None] | None = None,
    on_step: "Callable[[RecoverRun], None] | None" = None,
    **options: Unpack[_AllOptions],
) -> "RecoverRun":
    """Break a walking robot that knows its body, find what broke, and walk again.

    Args:
        robot: "quadruped" or "hexapod". With `resume` left out.
        scenario: number of what breaks, 1 to 15, as `selfheal recover --help` says.
        driven: the robot that is run; None simulates it by the settings.
        progress: given the phase, what it does, and the share done (0 to 1).
        on_step: given the run when it begins, and after each phase.
        **options: as `RecoverOptions` and `RunOptions` list them.

    Returns:
        The finished run. `result` has what `selfheal recover --json` prints.

    Raises:
        InputError: a setting makes no sense, or `out` holds a recovery already.
        RunFileError: the run cannot be read, or another process works on it.
    """
    from ..files import lock_file
    from ..recovery.phased_run import load_phased_run, save_phased_run
    from ..recovery.recover_run import RecoverRun

    callbacks = progress or (lambda *what: None), on_step or (lambda run: None)
    check_options(options, _AllOptions.__optional_keys__)
    out, resume, force = take_place(options)
    if resume is not None:
        with lock_file(resume):
            run = load_phased_run(resume, RecoverRun)
            return _finish_run(run, driven, Path(resume), *callbacks)
    if robot is None or scenario is None:
        raise InputError("give a robot and a scenario, or a recovery to resume")
    rest = cast(RecoverOptions, options)
    settings = make_recover_settings(robot, scenario, **rest)
    name = f"recover-{robot}-{settings.seed}"
    with begin_run_file(out, RUN, name=name, force=force) as path:
        run = RecoverRun(settings)
        if path:
            save_phased_run(run, path)
        return _finish_run(run, driven, path, *callbacks)


def make_recover_settings(
    robot: str, scenario: int, **options: Unpack[RecoverOptions]
) -> "RecoverSettings":
    """The checked settings of a recovery.

    Args:
        robot: "quadruped" or "hexapod".
        **options: as `RecoverOptions` lists them.

    Raises:
        InputError: says which makes no sense, and what would do.
    """
    from ..body.legged import load_legged_robot
    from ..recovery.recover_run import METHODS, RecoverSettings
    from ..robot.scenarios import draw_scenario

    method, gap = options.get("method", "ours"), options.get("gap", 0.0)
    seed = options.get("seed", 0)
    if method not in METHODS:
        raise UnknownNameError("method", method, METHODS)
    if not 0 <= gap <= 0.5:
        raise InputError(f"the gap must be 0 to 0.5; not {gap}")
    check_seed(seed)
    legged = load_legged_robot(
        robot, options.get("reach", 30.0), options.get("apart", False)
    )
    damage = draw_scenario(scenario, legged, seed)
    return RecoverSettings(robot, scenario, damage, **options)


def begin_recovery(folder: Path, settings: "RecoverSettings", *, force: bool) -> Path:
    """Write the file of a recovery that `recover` is to resume.

    Args:
        force: replace one that is there already.

    Returns:
        The file's path.

    Raises:
        InputError: a recovery is there already.
        RunFileError: another process works on it.
    """
    from ..recovery.phased_run import save_phased_run
    from ..recovery.recover_run import RecoverRun

    with begin_run_file(folder, RUN, name="", force=force) as path:
        assert path is not None
        save_phased_run(RecoverRun(settings), path)
    return path


def _finish_run(
    run: "RecoverRun",
    driven: "DrivenRobot | None",
    path: Path | None,
    progress: Callable[[str, str, float], None],
    on_step: "Callable[[RecoverRun], None]",
) -> "RecoverRun":
    """Phase by phase to the end, saved after each; then the page."""
    from ..recovery.recover import recover_robot
    from ..report.page import write_page
    from ..report.recover import make_recover_page
    from ..robot.simulated_legs import SimulatedLegs

    s, finished = run.settings, bool(run.result)
    robot = driven or SimulatedLegs(s.legged_robot, s.seed, s.gap)
    steps = recover_robot(robot, s, run=run, progress=progress)
    run = follow_phases(run, steps, None if finished else path, on_step)
    page = path and path.with_name(REPORT)
    if page and not (finished and page.exists()):
        write_page(make_recover_page(run), page)
    return run
