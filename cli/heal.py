"""`selfheal gait` and `heal`: a self-modeling run in; gaits, damage, a page out."""

import math
import os
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from selfheal.errors import InputError
from selfheal.files import check_file

from ._options import (
    AS_JSON,
    SEED,
    complete,
    out_folder,
    resume_from,
    start_over,
)
from ._print import print_document, print_json, print_line, print_paragraph, print_table
from ._progress import ProgressBar, ShowProgress, StageProgress
from ._runs import RunFolder, refuse_settings

if TYPE_CHECKING:
    from selfheal.recovery.record import HealRun

_RUN = typer.Argument(metavar="RUN.h5", help="A run of 'selfheal identify'.")
_HEADING = typer.Option(help="Walking direction in degrees, from forward to the left.")
_DAMAGE = typer.Option(
    autocompletion=complete("body.damage:KIND_WORDS", "random", end=":"),
    help="PART:SCALE, loss:PART, jam:JOINT[:DEG], weak:JOINT[:FACTOR], dead:SENSOR, "
    "lie:SENSOR[:FACTOR], slope:DEG[:AZIMUTH], friction:VALUE, several "
    "with commas, or random:SEED.",
)
_HOURS = typer.Option(
    help="Instead of --damage: walk so many hours with random damages."
)
_GAIT = typer.Option(help="Gait parameterization: waves, or poses as in 2006.")
# seconds of CPU that each phase takes, and the page: measured, of the starfish
_SECONDS = {
    "gait": 22,
    "whole": 0.5,
    "alarm": 1,
    "ask": 16,
    "verdict": 0.5,
    "healed": 29,
    "walked": 0.5,
    "known": 27,
    "page": 12,
}
_START = 1.7  # [s] of CPU before the first phase: measured in the same
_PHASES = {
    "gait": "a gait from the self-model",
    "whole": "walked, whole",
    "alarm": "walked on and watched",
    "verdict": "found what happened",
    "healed": "a gait for what it is now",
    "walked": "walked, old gait and new",
    "known": "for comparison, a gait made knowing the damage",
    "first": "for comparison, walked with its first gait",
}

_HEALED_RUN = typer.Argument(metavar="[RUN.h5]", help="A run of 'selfheal identify'.")
_BODY = typer.Argument(metavar="BODY.xml", help="The body, as identify wrote it.")
_RECORDING = typer.Argument(metavar="RECORDING.h5", help="Recording of the robot.")
_LEARN = typer.Option(help="Seconds at the start without damage; by default a third.")
_CYCLE = typer.Option(help="Period of the commands in seconds; by default estimated.")


def gait(
    run: Annotated[Path, _RUN],
    heading: Annotated[float, _HEADING] = 0.0,
    gait: Annotated[str, _GAIT] = "waves",
    seed: Annotated[int, SEED] = 0,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Optimize a gait for a self-model and walk it on the robot."""
    from selfheal.api.healing import check_gait_settings, load_identified
    from selfheal.recovery.walk_trial import walk_trial

    check_gait_settings(gait, math.radians(heading), seed)
    found, robot = load_identified(run)
    start = time.perf_counter()
    with ProgressBar("reading", as_json=as_json, progress=progress) as live:
        trial = walk_trial(
            found,
            robot,
            name=gait,
            heading=math.radians(heading),
            seed=seed,
            progress=partial(_PhaseProgress(live, {"gait": _SECONDS["gait"]}), "gait"),
        )
    trial |= {"seconds": round(time.perf_counter() - start, 1), "run": str(run)}
    if as_json:
        print_json(trial)
        return
    p = trial["predicted"]
    print_line(
        f"walked {trial['walked']:.2f} m in {trial['duration']:.0f} s, predicted "
        f"{p['distance']:.2f} m ({p['low']:.2f} to {p['high']:.2f}); "
        f"{trial['across']:+.2f} m to the left"
    )
    print_line(
        f"speed {100 * trial['speed']:.1f} cm/s; by the self-model "
        f"{p['energy']:.1f} J of work, cost of transport {p['cost_of_transport']:.2f}"
    )
    print_line(f"{trial['simulations']} simulations, {trial['seconds']} s")


def heal(
    context: typer.Context,
    run: Annotated[Path | None, _HEALED_RUN] = None,
    damage: Annotated[str | None, _DAMAGE] = None,
    hours: Annotated[float | None, _HOURS] = None,
    heading: Annotated[float, _HEADING] = 0.0,
    gait: Annotated[str, _GAIT] = "waves",
    seed: Annotated[int, SEED] = 0,
    out: Annotated[Path | None, out_folder("runs/heal-ROBOT-SEED")] = None,
    resume: Annotated[Path | None, resume_from("HEAL.h5", "a heal")] = None,
    force: Annotated[bool, start_over("a heal")] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Walk, notice a damage, find what it is, and walk again."""
    from selfheal.api import heal as run_heal

    if (run is None) == (resume is None):
        raise InputError("give either RUN.h5 --damage WHAT or --resume HEAL.h5")
    if run is not None and (damage is None) == (hours is None):
        raise InputError(
            "say what happens to the robot: either --damage right_lower:0.1, say, or "
            "--hours 1 of random damages"
        )
    folder = RunFolder(out, force)
    with ProgressBar("reading", as_json=as_json, progress=progress) as live:
        show = _PhaseProgress(live, _SECONDS)
        if resume is not None:
            refuse_settings(context)
            done = run_heal(resume=resume, progress=show, on_step=show.show_phase)
        else:
            done = run_heal(
                run,
                damage,
                hours=hours,
                heading=math.radians(heading),
                gait=gait,
                seed=seed,
                out=folder,
                force=force,
                progress=show,
                on_step=show.show_phase,
            )
    if as_json:
        print_json(done.result)
    else:
        path = resume or folder.path / "heal.h5"
        _print_result(done, [path, path.with_name("report.html")])


def watch(
    body: Annotated[Path, _BODY],
    recording: Annotated[Path, _RECORDING],
    learn: Annotated[float | None, _LEARN] = None,
    cycle: Annotated[float | None, _CYCLE] = None,
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Detect when a recording stops fitting a body."""
    from selfheal.body.mjcf import load
    from selfheal.recording import read
    from selfheal.recovery.monitor import FALSE_ALARMS
    from selfheal.recovery.watch_recording import watch_recording

    for value in (learn, cycle):
        if value is not None and not 0 < value < 1e6:
            raise InputError(f"seconds must be positive; not {value:g}")
    check_file(body)
    found = watch_recording(load(body), read(recording), learn=learn, cycle=cycle)
    if as_json:
        print_document(
            "watch",
            body=str(body),
            recording=str(recording),
            false_alarms_per_hour=FALSE_ALARMS,
            episodes=found,
        )
        return
    for episode in found:
        print_line(_format_watched(episode))


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


class _PhaseProgress:
    """Progress of a heal: what is done, and a line for each phase."""

    def __init__(self, live: ProgressBar, seconds: Mapping[str, float]) -> None:
        """`seconds`: that each phase takes, about."""
        self.live, self.begun, self.is_long = live, False, False
        self.stages = StageProgress(seconds, _START)

    def __call__(self, phase: str, what: str, share: float) -> None:
        """Show what a phase does and how much of that is done."""
        over = share if self.is_long else self.stages.compute_share(phase, share)
        self.live.show(f"{_PHASES.get(phase, phase)}: {what}", over)

    def show_phase(self, run: "HealRun") -> None:
        """A line for the last phase, of a run that has a new one."""
        first, self.begun = not self.begun, True
        self.is_long = bool(run.settings.hours)
        if first or run.result:
            return
        name, phase = list(run.phases.items())[-1]
        said = _format_phase(name.partition(" ")[0], phase)
        self.live.say(f"{self.live.seconds:6.1f} s  {said}")


def _format_phase(name: str, phase: Mapping[str, Any]) -> str:
    """What came of a phase, in a line."""
    from selfheal.recovery.phases import describe_belief
    from selfheal.report.heal import describe_alarm

    said = ""
    if name in ("gait", "healed"):
        said = f"predicted {phase['gait']['predicted']:.2f} m in 10 s"
    elif name == "whole":
        said = f"{phase['distance']:.2f} m in 10 s"
    elif name == "alarm":
        said = describe_alarm(phase["alarm"], None) if phase["alarm"] else "no alarm"
    elif name == "verdict" or name.startswith("ask"):
        said = describe_belief(phase["believed"][0])
    elif name == "walked":
        said = f"{phase['damaged']:.2f} m and {phase['healed']:.2f} m"
    done = phase["why"] if name.startswith("ask") else _PHASES[name]
    return f"{done}: {said}" if said else done


def _print_result(run: "HealRun", files: list[Path]) -> None:
    """What happened, the distances, the files."""
    result = run.result
    if run.settings.hours:
        from selfheal.report.hours import EVENT_HEAD, describe_hours, format_events

        print_table(EVENT_HEAD, format_events(result))
        print_paragraph(describe_hours(result))
        print_line(f"speeds in m/min; {result['seconds']} s in all")
    else:
        _print_heal(run)
    for file in files:
        print_line(os.fspath(file))


def _print_heal(run: "HealRun") -> None:
    """What happened once, and the distances."""
    from selfheal.recovery.phases import read_damage

    result, rows = run.result, []
    for k, believed in enumerate(run.phases["verdict"]["believed"]):
        if k == 0 or believed["probability"] >= 0.005:  # else it is printed as 0 %
            sure = f"{100 * believed['probability']:.0f} %"
            rows.append((str(read_damage(believed)), sure))
    print_table(("what happened", "probability"), rows)
    names = {
        "intact": "whole",
        "damaged": "broken, old gait",
        "healed": "broken, new gait",
        "best_known": "broken, a gait made knowing the damage",
    }
    went = {name: result["distance"][key] for key, name in names.items()}
    rows = [(k, "unknown" if v is None else f"{v:.2f} m") for k, v in went.items()]
    print_table(("robot", "walks in 10 s"), rows)
    print_line(
        f"{result['actions']} actions to find what happened, "
        f"{result['seconds']} s in all"
    )
