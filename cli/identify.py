"""`selfheal identify`, `show`, `robots`: settings in; progress, a body, files out."""

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from selfheal.errors import InputError, SelfhealError

from ._options import (
    AS_JSON,
    SEED,
    complete,
    out_folder,
    resume_from,
    start_over,
)
from ._print import print_document, print_json, print_line, print_table
from ._progress import DiagnosisProgress, ProgressBar, ShowProgress
from ._runs import RunFolder, refuse_settings

if TYPE_CHECKING:
    from selfheal.selfmodel.run import Run

_METHOD = typer.Option(
    help="default, paper, disagreement, random-batch or random-alternate."
)
_SPACE = typer.Option(help="Where parts may attach: free, sides or full.")
_KNOWN_LENGTHS = typer.Option(
    "--known-lengths", help="With --space full: take part lengths as known."
)
_BUDGET = typer.Option(help="Number of simulations; 262000 by default.")
_MOVES = typer.Option(
    help="Number of motions to identify joint dynamics from; 4 is enough."
)
_RANDOM_ACTIONS = typer.Option(
    "--random-actions", help="Draw actions at random, for comparison."
)

_ROBOT = typer.Option(
    help="Name of the robot, see 'selfheal robots'; or its TOML or MJCF.",
    autocompletion=complete("cli._options:list_robot_names"),
)
_RECORDINGS = typer.Option(
    metavar="FILE.h5",
    help="Recording that a replayed robot takes its readings from.",
)
_CYCLES = typer.Option(help="Number of actions; 16 by default.")


def identify(
    context: typer.Context,
    robot: Annotated[str | None, _ROBOT] = None,
    recordings: Annotated[Path | None, _RECORDINGS] = None,
    method: Annotated[str, _METHOD] = "default",
    space: Annotated[str, _SPACE] = "free",
    known_lengths: Annotated[bool, _KNOWN_LENGTHS] = False,
    random_actions: Annotated[bool, _RANDOM_ACTIONS] = False,
    engine: Annotated[str, typer.Option(help="auto, statics, mjx or mujoco.")] = "auto",
    cycles: Annotated[int | None, _CYCLES] = None,
    budget: Annotated[int | None, _BUDGET] = None,
    seed: Annotated[int, SEED] = 0,
    moves: Annotated[int, _MOVES] = 0,
    out: Annotated[Path | None, out_folder("runs/ROBOT-SEED")] = None,
    resume: Annotated[Path | None, resume_from("RUN.h5", "a run")] = None,
    force: Annotated[bool, start_over("a run")] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Find out what a robot's body is."""
    if moves or resume:  # as `diagnose` does
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from selfheal.api import identify as run_identify

    if (robot is None) == (resume is None):
        raise InputError("give either --robot NAME or --resume RUN.h5")
    with ProgressBar("starting", as_json=as_json, progress=progress) as live:
        show = _CycleProgress(live)
        stage = DiagnosisProgress(live)
        if resume is not None:
            refuse_settings(context)
            run = run_identify(
                resume=resume, progress=show, on_step=show.show_cycle, on_stage=stage
            )
        else:
            run = run_identify(
                robot,
                recordings=recordings,
                method=method,
                space=space,
                known_lengths=known_lengths,
                random_actions=random_actions,
                engine=engine,
                cycles=cycles,
                budget=budget,
                seed=seed,
                moves=moves,
                out=RunFolder(out, force),
                force=force,
                progress=show,
                on_step=show.show_cycle,
                on_stage=stage,
            )
    if as_json:
        print_json(run.result)
    else:
        _print_result(run, _list_files(run, resume or Path(run.result["run"])))


def _list_files(run: "Run", path: Path) -> list[Path]:
    """What a run left, its file first."""
    files = [path, Path(run.result["model"]), path.with_name("report.html")]
    if found := run.result.get("dynamics"):
        files += [Path(found[name]) for name in ("model", "moves", "diagnosis")]
    return files


# Shares of a run's time that are over with the first simulation, with the first cycle
# (once all is compiled) and before the page. Measured: two runs of the starfish
_SETUP_SHARE, _COMPILED_SHARE, _SEARCH_SHARE = 0.12, 0.25, 0.92
# Of a search's time a share x of its simulations takes x to this power: early cycles
# simulate few at once. Measured in the same, to a tenth
_EXPONENT = 0.65
_LEAST = 0.02  # of the simulations, before which that is not known; chosen


class _CycleProgress:
    """Progress of a run: its simulations, and a line for each cycle."""

    def __init__(self, live: ProgressBar) -> None:
        self.live, self.count = live, 0
        self.run: Run | None = None  # as it stood last
        # simulations and seconds at the end of the first cycle, once all is compiled
        self.begun: tuple[int, float] | None = None

    def __call__(self, count: int) -> None:
        """Show the number of simulations so far."""
        assert self.run is not None  # a run begins before it simulates
        is_first, self.count = self.count == 0, count
        said = f"{count:,} simulations"  # of which cycle, only the search knows
        if self.begun is None:
            self.live.show(said, _SETUP_SHARE if is_first else 0.0)
            return
        begun, since = self.begun
        done = (count - begun) / max(self.run.settings.budget - begun, 1)
        over = self.live.seconds
        search = (over - since) / max(done, _LEAST) ** _EXPONENT
        share = _SEARCH_SHARE * over / (since + search)
        self.live.show(said, share if done > _LEAST else 0.0)

    def show_cycle(self, run: "Run") -> None:
        """A line for the last cycle, of a run that has a new one."""
        first, self.run = self.run is None, run
        if first or run.result:
            return
        if self.begun is None:
            self.begun = self.count, self.live.seconds
            self.live.show("searching", _COMPILED_SHARE)
        from selfheal.robot.actions import describe_action

        cycle = run.cycles[-1]
        action = describe_action(run.anatomy, run.actions[cycle.action])
        line = (
            f" {action}: {cycle.why}. Best error {cycle.tilt_error:.2f} deg, "
            f"disagreement {cycle.disagreement:.1f} deg"
        )
        self.live.say(line, head=f"{len(run.cycles):>2}")


def _print_result(run: "Run", files: list[Path]) -> None:
    """The table of the inferred body, the errors, the files."""
    names = ("torso", *run.anatomy.parts)
    best, result = run.cycles[-1].genomes, run.result
    truth = run.truth
    head = ["part", "hangs on", "side", "length", "sure"]
    head += [] if truth is None else ["truth"]
    rows = []
    sides = ("left", "front", "right", "back")
    for i, name in enumerate(run.anatomy.parts):
        row = [
            name,
            names[best.parent[0, i]],
            sides[best.side[0, i]],
            f"{1000 * best.length[0, i]:.0f} mm",
            f"{100 * result['sureness'][i]:.0f} %",
        ]
        if truth is not None:
            right = truth.parent[0, i] == best.parent[0, i]
            row.append("correct" if right else f"is {names[truth.parent[0, i]]}")
        rows.append(row)
    print_table(head, rows)
    for line in (*_summarize_run(run), *map(os.fspath, files)):
        print_line(line)


def _summarize_run(run: "Run") -> Iterator[str]:
    """Errors, rivals and simulations, a line each."""
    from selfheal.body.body import (
        compute_edge_f1,
        measure_center_distance,
        measure_tip_distance,
    )
    from selfheal.body.genome import build_bodies
    from selfheal.engine.channels import list_channels

    result, cycle = run.result, run.cycles[-1]
    error = {
        "tilt": "tilt error (left/right plus forward/back)",
        "sensor": "error of all sensors, as degrees of tilt count",
    }[list_channels(run.anatomy).error_name]
    yield (
        f"{error}: {result['tilt_error']:.2f} deg, "
        f"the mean of {len(run.cycles)} actions"
    )
    if run.truth is not None:
        best = build_bodies(run.anatomy, cycle.genomes[:1])
        yield (
            f"against the truth: centers of parts "
            f"{measure_center_distance(best, run.truth)[0]:.1f} cm away, "
            f"tips {measure_tip_distance(best, run.truth)[0]:.1f} cm, "
            f"attachments {100 * compute_edge_f1(best, run.truth)[0]:.0f} % correct"
        )
    # one degree a reading is what even the right body misses; chosen
    close = int((cycle.losses[1:] < cycle.losses[0] + len(run.cycles) / 4).sum())
    if close:
        yield f"{close} other bodies explain the readings nearly as well; see the page"
    if len(run.indistinguishable):
        yield (
            "other bodies that explain the readings and that no action of this robot "
            f"tells from it: {len(run.indistinguishable):,}; other trees: "
            f"{run.indistinguishable_trees}"
        )
    words = {"choice": "to choose actions", "failed": "of all diverged"}
    counts = ", ".join(
        f"{count:,} {words.get(name, f'by {name}')}"
        for name, count in sorted(run.counts.items(), key=lambda x: x[0] in words)
    )
    seconds = result.get("seconds", round(cycle.seconds, 1))  # no file, no seconds
    yield f"simulations: {counts}; {seconds} s in all"
    if found := result.get("dynamics"):
        yield from _summarize_dynamics(found)


def _summarize_dynamics(found: Mapping[str, Any]) -> Iterator[str]:
    """What moves over time showed, a line each."""
    from selfheal.diagnosis.output.storage import read_document
    from selfheal.report.phrases import state_verdict

    how = "while the torso lay still" if found["held"] else "with limbs on the floor"
    yield (
        f"dynamics, {how}: error on a held-out move {found['given']:.3f} of the body's "
        f"model, {found['patched']:.3f} with what was found, {found['floor']:.3f} of "
        "noise alone, in standard deviations of the readings"
    )
    with suppress(SelfhealError):  # the folder was moved since
        yield state_verdict(read_document(found["diagnosis"]))


def show(
    file: Annotated[Path, typer.Argument(metavar="RUN.h5", help="A run.")],
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Show a finished or interrupted run."""
    from selfheal.api.identification import write_identify_report
    from selfheal.selfmodel.read_run import load_run

    run = load_run(file)
    if as_json:
        if run.result:
            print_json(run.result)
        else:
            print_document("identify", cycles=len(run.cycles))
        return
    if not run.cycles:
        raise InputError(
            f"{file}: the run has no cycle yet; go on with --resume {file}"
        )
    page = write_identify_report(run, file)
    if run.result:
        _print_result(run, [file, page])
    else:
        cycle = run.cycles[-1]
        print_line(
            f"{len(run.cycles)} of {run.settings.cycles} cycles, error "
            f"{cycle.tilt_error:.2f} deg; go on with: selfheal identify --resume {file}"
        )


def robots(as_json: Annotated[bool, AS_JSON] = False) -> None:
    """List the robots that can be identified."""
    from selfheal.robot.open_robot import list_robots as listed

    found = listed()
    if as_json:
        print_document("robots", robots=found)
        return
    width = max(len(name) for name in found)
    for name, text in found.items():
        print_line(f"{name:{width}}  {text}")
