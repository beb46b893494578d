"""`selfheal gait` and `heal`: a self-modeling run in; gaits, damage, a page out."""

import math
import os
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._progress import ProgressBar
from ._runs import clear_run, make_run_folder, refuse_settings

if TYPE_CHECKING:
    from selfheal.recovery.record import HealRun
    from selfheal.robot.base import Walker
    from selfheal.selfmodel.run import Run

_JSON = typer.Option("--json", help="One JSON object for scripts.")
_RUN = typer.Argument(metavar="RUN.h5", help="A run of 'selfheal identify'.")
_HEADING = typer.Option(help="Direction to walk, degrees from forward to the left.")
_DAMAGE = typer.Option(
    help="PART:SCALE, loss:PART, jam:JOINT[:DEG], weak:JOINT[:FACTOR], dead:SENSOR, "
    "slope:DEG[:AZIMUTH], friction:VALUE, several with commas, or random:SEED."
)
_GAIT = typer.Option(help="How gaits are written: waves, or poses as in 2006.")
_SEED = typer.Option(help="Of everything random.")
_PHASES = {
    "gait": "a gait from the self-model",
    "whole": "walked, whole",
    "alarm": "walked on and watched",
    "verdict": "found what happened",
    "healed": "a gait for what it is now",
    "walked": "walked, old gait and new",
    "known": "for comparison, a gait made knowing the damage",
}


def gait(
    run: Annotated[Path, _RUN],
    heading: Annotated[float, _HEADING] = 0.0,
    gait: Annotated[str, _GAIT] = "waves",
    seed: Annotated[int, _SEED] = 0,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Make a gait from a self-model and walk it on the robot."""
    from selfheal.recovery.walk_trial import walk_trial

    _check_arguments(gait, heading, seed)
    found, robot = _load_identified(run)
    start = time.perf_counter()
    with ProgressBar("reading", quiet=as_json) as live:
        told = walk_trial(
            found,
            robot,
            name=gait,
            heading=math.radians(heading),
            seed=seed,
            progress=partial(_show_progress, live, "gait"),
        )
    told |= {"seconds": round(time.perf_counter() - start, 1), "run": str(run)}
    if as_json:
        from ._print import print_json

        print_json(told)
        return
    p = told["predicted"]
    typer.echo(
        f"walked {told['walked']:.2f} m in {told['duration']:.0f} s, predicted "
        f"{p['distance']:.2f} m ({p['low']:.2f} to {p['high']:.2f}); "
        f"{told['across']:+.2f} m to the left\n"
        f"speed {100 * told['speed']:.1f} cm/s; by the self-model {p['energy']:.1f} J "
        f"of work, cost of transport {p['cost_of_transport']:.2f}\n"
        f"{told['simulations']} simulations, {told['seconds']} s"
    )


def heal(
    context: typer.Context,
    run: Annotated[
        Path | None,
        typer.Argument(metavar="[RUN.h5]", help="A run of 'selfheal identify'."),
    ] = None,
    damage: Annotated[str | None, _DAMAGE] = None,
    heading: Annotated[float, _HEADING] = 0.0,
    gait: Annotated[str, _GAIT] = "waves",
    seed: Annotated[int, _SEED] = 0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where files go; runs/heal-ROBOT-SEED."),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="HEAL.h5", help="Go on with a heal.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Start over where a heal is already.")
    ] = False,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Walk, notice a damage, find what it is, and walk again."""
    import numpy as np

    from selfheal.errors import InputError
    from selfheal.files import check_writable_folder
    from selfheal.recovery.phased_run import load_phased_run, save_phased_run
    from selfheal.recovery.record import HealRun, HealSettings
    from selfheal.robot.accidents import parse_accident
    from selfheal.selfmodel.run import lock_run

    if (run is None) == (resume is None):
        raise InputError("give either RUN.h5 --damage WHAT or --resume HEAL.h5")
    if resume is not None:
        refuse_settings(context)
        with lock_run(resume):
            begun = load_phased_run(resume, HealRun)
            _finish_heal(
                begun, _load_identified(Path(begun.settings.run)), resume, as_json
            )
        return
    assert run is not None
    if damage is None:
        raise InputError("say what happens to the robot: --damage right_lower:0.1, say")
    _check_arguments(gait, heading, seed)
    known = _load_identified(run)
    what = parse_accident(damage, known[0].anatomy)
    onset = float(np.random.default_rng([seed, 30]).uniform(8, 20))
    settings = HealSettings(str(run), what, onset, gait, math.radians(heading), seed)
    name = f"heal-{known[1].name.replace(':', '-')}-{seed}"
    folder = make_run_folder(name, force) if out is None else check_writable_folder(out)
    path = folder / "heal.h5"
    with lock_run(path):
        clear_run(path, force, ("report.html",))
        begun = HealRun(settings)
        save_phased_run(begun, path)
        _finish_heal(begun, known, path, as_json)


def watch(
    body: Annotated[
        Path, typer.Argument(metavar="BODY.xml", help="The body, as identify wrote it.")
    ],
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING.h5", help="What the robot did.")
    ],
    learn: Annotated[
        float | None,
        typer.Option(help="Seconds at the start in which it was whole; a third."),
    ] = None,
    cycle: Annotated[
        float | None,
        typer.Option(help="Seconds in which commands repeat; found in them."),
    ] = None,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Say when a recording stopped fitting a body."""
    from selfheal.body.mjcf import load
    from selfheal.errors import InputError
    from selfheal.files import check_file
    from selfheal.recording import read
    from selfheal.recovery.monitor import FALSE_ALARMS
    from selfheal.recovery.watch_recording import watch_recording

    for value in (learn, cycle):
        if value is not None and not 0 < value < 1e6:
            raise InputError(f"seconds must be positive; not {value:g}")
    check_file(body)
    found = watch_recording(load(body), read(recording), learn=learn, cycle=cycle)
    if as_json:
        from ._print import print_json

        print_json({"format": "selfheal-watch", "version": 1, "body": str(body),
                    "recording": str(recording), "false_alarms_per_hour": FALSE_ALARMS,
                    "episodes": found})  # fmt: skip
        return
    for episode in found:
        typer.echo(_format_watched(episode))


def _format_watched(episode: dict[str, Any]) -> str:
    """A line on one watched episode."""
    alarm, name = episode["alarm"], episode["id"]
    if alarm is None:
        return f"{name}: fits throughout"
    sure = f"{alarm['sensor']} fits worst, p {alarm['p_value']:.1g}"
    if "cycle" not in episode:
        return f"{name}: stopped fitting by {episode['episode']} ({sure})"
    return (
        f"{name}: stopped fitting at {alarm['since']:.1f} s, said at "
        f"{alarm['time']:.1f} s ({sure})"
    )


def _check_arguments(gait: str, heading: float, seed: int) -> None:
    """Refuse a gait that is not known and numbers that make no sense."""
    from selfheal.errors import InputError, check_seed
    from selfheal.gait.pattern import find_pattern

    find_pattern(gait)
    if not -360 <= heading <= 360:
        raise InputError(f"the heading must be -360 to 360 degrees; not {heading}")
    check_seed(seed)


def _load_identified(path: Path) -> tuple["Run", "Walker"]:
    """A finished run of `identify`, and its robot, which can walk."""
    from selfheal.errors import InputError
    from selfheal.robot.base import open_robot, require_walker
    from selfheal.selfmodel.run import load_run

    run = load_run(path)
    if not run.result:
        raise InputError(
            f"{path}: the run is not finished; 'selfheal identify --resume {path}'"
        )
    s = run.settings
    recordings = Path(s.recordings) if s.recordings else None
    return run, require_walker(open_robot(s.robot, seed=s.seed, recordings=recordings))


def _finish_heal(
    run: "HealRun", known: tuple["Run", "Walker"], path: Path, as_json: bool
) -> None:
    """Phase by phase to the end, saved after each; then the page."""
    from selfheal.gait.rival_bodies import select_rival_bodies
    from selfheal.recovery.heal import heal_robot as phases
    from selfheal.recovery.phased_run import save_phased_run
    from selfheal.recovery.phases import make_robot_states
    from selfheal.report.heal import make_heal_page
    from selfheal.report.page import write_page

    found, robot = known
    models, weights = select_rival_bodies(found)
    robots = make_robot_states(robot, run.settings)
    with ProgressBar("reading", quiet=as_json) as live:
        steps = phases(robots, models, weights, run.settings, run=run,
                       progress=partial(_show_progress, live))  # fmt: skip
        for step in steps:
            run = step
            save_phased_run(run, path)
            if not run.result:
                name, phase = list(run.phases.items())[-1]
                live.say(f"{live.seconds:6.1f} s  {_format_phase(name, phase)}")
    page = path.with_name("report.html")
    write_page(make_heal_page(run, models), page)
    if as_json:
        from ._print import print_json

        print_json(run.result)
    else:
        _print_result(run, [path, page])


def _show_progress(live: ProgressBar, phase: str, what: str, share: float) -> None:
    """Show what a phase does and how much of that is done."""
    live.show(f"{_PHASES.get(phase, phase)}: {what}", share)


def _format_phase(name: str, phase: Any) -> str:
    """What came of a phase, in a line."""
    if name.startswith("ask"):
        first = phase["believed"][0]
        return f"{phase['why']}: {_format_hypothesis(first)}"
    told = _PHASES[name]
    if name in ("gait", "healed"):
        return f"{told}: predicted {phase['gait']['predicted']:.2f} m in 10 s"
    if name == "whole":
        return f"{told}: {phase['distance']:.2f} m in 10 s"
    if name == "alarm":
        a = phase["alarm"]
        return f"{told}: " + (
            f"alarm after {a['time']:.1f} s by {a['sensor']}" if a else "no alarm"
        )
    if name == "verdict":
        return f"{told}: {_format_hypothesis(phase['believed'][0])}"
    if name == "walked":
        return f"{told}: {phase['damaged']:.2f} m and {phase['healed']:.2f} m"
    return told


def _format_hypothesis(believed: dict[str, Any]) -> str:
    """A hypothesis and its probability in words."""
    from selfheal.recovery.phases import read_damage

    return f"{read_damage(believed)} ({100 * believed['probability']:.0f} %)"


def _print_result(run: "HealRun", files: list[Path]) -> None:
    """What happened, the distances, the files."""
    from rich.console import Console
    from rich.table import Table

    console, result = Console(), run.result
    table = Table("happened", "sure")
    for k, believed in enumerate(run.phases["verdict"]["believed"]):
        if k == 0 or believed["probability"] >= 0.005:  # else it is printed as 0 %
            words = _format_hypothesis(believed).rpartition(" (")
            table.add_row(words[0], words[2].rstrip(")"))
    console.print(table)
    names = {"intact": "whole", "damaged": "broken, old gait", "healed": "broken, new",
             "best_known": "made knowing the damage"}  # fmt: skip
    table = Table("distance in 10 s", "m")
    for key, name in names.items():
        value = result["distance"][key]
        table.add_row(name, "unknown" if value is None else f"{value:.2f}")
    console.print(table)
    console.print(f"{result['actions']} actions, {result['seconds']} s")
    for file in files:
        console.print(os.fspath(file), highlight=False, soft_wrap=True)
