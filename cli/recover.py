"""`selfheal recover`: a legged robot and a scenario in; recovery, files, a page out."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from selfheal.errors import InputError, RunFileError, RunLockError

from ._options import (
    AS_JSON,
    SEED,
    complete,
    out_folder,
    resume_from,
    start_over,
)
from ._print import print_document, print_json, print_line, print_table
from ._progress import ProgressBar, ShowProgress, StageProgress
from ._runs import RunFolder, refuse_settings

if TYPE_CHECKING:
    from selfheal.recovery.recover_run import RecoverRun, RecoverSettings

_NAME = "recover.h5"
# what phases and the page take, in units of a search for a controller: measured, of the
# quadruped
_EFFORT = {
    "original": 0.65,
    "failure": 0.01,
    "estimate": 0.2,
    "explore": 1.0,
    "trial": 0.02,
    "hardware": 2.3,
    "page": 0.3,
}
_START = 0.1  # before the first one, measured in the same
_ROBOT = typer.Option(
    help="quadruped or hexapod.",
    metavar="NAME",
    autocompletion=complete("body.legged:LEGGED"),
)
_SCENARIO = typer.Option(
    metavar="NUMBER|all",
    autocompletion=complete("robot.scenarios:SCENARIOS", "all"),
    help="What breaks: 1 to 10 as in 2004, all of these; 11 a weak motor, 12 a weak "
    "sensor, 13 a slope, 14 slippery ground, 15 wind.",
)

_METHOD = typer.Option(help="ours, as-described or hardware-only.")
_REACH = typer.Option("--range", help="Joint range, +-30 or +-45 degrees.")
_APART = typer.Option("--apart", help="Count a hexapod's hip as two joints, not one.")
_GAP = typer.Option(help="Relative model error of the robot, 0 to 0.5.")


def recover(
    context: typer.Context,
    robot: Annotated[str | None, _ROBOT] = None,
    scenario: Annotated[str, _SCENARIO] = "all",
    method: Annotated[str, _METHOD] = "ours",
    reach: Annotated[float, _REACH] = 30.0,
    apart: Annotated[bool, _APART] = False,
    gap: Annotated[float, _GAP] = 0.0,
    seed: Annotated[int, SEED] = 0,
    out: Annotated[Path | None, out_folder("runs/recover-ROBOT-SEED")] = None,
    resume: Annotated[
        Path | None, resume_from("RECOVER.h5", "a run or a folder of runs")
    ] = None,
    force: Annotated[bool, start_over("a run")] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Break a walking robot that knows its body, find what broke, walk again."""
    from selfheal.api.recovery import make_recover_settings

    if (robot is None) == (resume is None):
        raise InputError("give either --robot quadruped|hexapod or --resume RECOVER.h5")
    if resume is not None:
        refuse_settings(context)
        _finish_runs(_find_runs(resume), as_json, progress)
        return
    assert robot is not None
    batch = [
        make_recover_settings(
            robot, n, method=method, reach=reach, apart=apart, gap=gap, seed=seed
        )
        for n in _parse_scenarios(scenario)
    ]
    folder = RunFolder(out, force)(f"recover-{robot}-{seed}")
    _finish_runs(_begin_runs(folder, batch, force), as_json, progress)


def _parse_scenarios(scenario: str) -> Sequence[int]:
    """The scenarios that a user's word means; whether they exist is not its concern."""
    from selfheal.robot.scenarios import TABLE

    if scenario == "all":
        return TABLE
    if not scenario.isdecimal():
        raise InputError(f"the scenario is a number or 'all', not {scenario!r}")
    return [int(scenario)]


def _begin_runs(
    folder: Path, batch: list["RecoverSettings"], force: bool
) -> list[Path]:
    """A run file for each, in folders of their own where there are several."""
    from selfheal.api.recovery import begin_recovery

    paths = []
    for settings in batch:
        home = folder / f"scenario-{settings.scenario:02d}" if batch[1:] else folder
        home.mkdir(exist_ok=True)
        paths.append(begin_recovery(home, settings, force=force))
    return paths


def _find_runs(place: Path) -> list[Path]:
    """The run files of a folder, or the one that was named."""
    if not place.is_dir():
        return [place]
    found = sorted(place.rglob(_NAME))
    if not found:
        raise RunFileError(f"{place}: no {_NAME} in this folder")
    return found


def _finish_runs(paths: list[Path], as_json: bool, progress: bool) -> None:
    """Each run to its end, and what came of them; several processes may share them."""
    from selfheal.api import recover as run_recover

    done = []
    with ProgressBar("reading", as_json=as_json, progress=progress) as live:
        for number, path in enumerate(paths):
            show = _RunProgress(live, number, len(paths))
            try:
                run = run_recover(resume=path, progress=show, on_step=show.show_step)
            except RunLockError as error:
                if not paths[1:]:
                    raise
                live.say(f"left out: {error}")
                continue
            done.append((path, run))
    if as_json:
        results = [{**run.result, "run": os.fspath(path)} for path, run in done]
        if paths[1:]:
            print_document("recover-batch", runs=results)
        else:
            print_json(results[0])
        return
    _print_results([run for _, run in done])
    for path, _ in done:
        print_line(os.fspath(path))
        print_line(os.fspath(path.with_name("report.html")))


class _RunProgress:
    """Progress of recoveries: what is done, and a line for each phase."""

    def __init__(self, live: ProgressBar, number: int, count: int) -> None:
        """Of the run of that number, from 0, among so many."""
        self.live, self.number, self.count = live, number, count
        self.scenario: int | None = None
        self.phases: list[str] = []
        self.may_end = False  # after any trial
        self.stages = StageProgress({}, _START)

    def __call__(self, phase: str, what: str, share: float) -> None:
        """Show what a phase does and how much of that is done."""
        names = self.phases
        if self.may_end:
            turn = int(phase.partition("-")[2] or 1)
            names = [n for n in names if int(n.partition("-")[2] or 0) <= turn]
        self.stages.weights = {
            n: _EFFORT[n.partition("-")[0]] for n in [*names, "page"]
        }
        over = (self.number + self.stages.compute_share(phase, share)) / self.count
        self.live.show(f"scenario {self.scenario}, {phase}: {what}", over)

    def show_step(self, run: "RecoverRun") -> None:
        """A line for a run that begins or goes on, then for each phase."""
        from selfheal.robot.scenarios import SCENARIOS

        first, s = self.scenario is None, run.settings
        self.scenario = s.scenario
        self.phases, self.may_end = run.list_phases(s), s.method == "ours"
        if run.result:
            return
        if first:
            self.live.say(f"{s.robot}, scenario {s.scenario}: {SCENARIOS[s.scenario]}")
        else:
            self.live.say(f"{self.live.seconds:6.1f} s  {_format_phase(run)}")


def _format_phase(run: "RecoverRun") -> str:
    """What came of the last phase, in a line."""
    from selfheal.recovery.recover_run import summarize_beliefs

    name, phase = list(run.phases.items())[-1]
    kind, _, turn = name.partition("-")
    if kind == "estimate":
        said, chance = next(iter(summarize_beliefs(phase).items()))
        if phase.get("unlisted"):
            return f"{turn}: no listed damage explains the trials; nearest is {said}"
        return f"{turn}: believes {said} ({100 * chance:.0f} %)"
    if kind == "explore":
        return f"{turn}: a controller predicted to go {phase['predicted']:.2f} m"
    done = {
        "original": "whole, the first controller",
        "failure": "broken, the same",
        "trial": f"{turn}: tried on the robot",
        "hardware": "evolved on the robot",
    }[kind]
    return f"{done}: {phase['way']:.2f} m"


def _print_results(runs: Sequence["RecoverRun"]) -> None:
    """A row a run."""
    from selfheal.recovery.recover_run import is_damage_named

    head = ("", "whole [m]", "broken", "recovered", "named", "trials")
    # a batch is of one robot and one method
    said = {f"{run.settings.robot}, {run.settings.method}": None for run in runs}
    rows = []
    words = {True: "yes", False: "no", None: ""}
    for run in runs:
        d = run.result["distance"]
        distances = [_format_number(d[key]) for key in ("intact", "damaged", "healed")]
        spent = str(run.result["actions"])
        name = f"scenario {run.settings.scenario}"
        named = "unlisted" if run.unlisted else words[is_damage_named(run)]
        rows.append((name, *distances, named, spent))
    print_table(head, rows, title="; ".join(said))


def _format_number(value: float | None) -> str:
    """A number of two decimals, or none."""
    return "" if value is None else f"{value:.2f}"
