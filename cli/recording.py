"""`selfheal recording`: takes a recording file, says what it holds or what is wrong."""

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from selfheal.errors import InputError
from selfheal.files import write_text

from ._options import AS_JSON, FORCE, make_epilog
from ._print import print_document, print_line, print_paragraph, print_table
from ._progress import ProgressBar, ShowProgress
from ._runs import refuse_existing

if TYPE_CHECKING:
    from selfheal.recording import Episode, Recording, Signal
    from selfheal.telemetry import Telemetry

app = typer.Typer(
    help="Check, import and export recordings.",
    epilog=make_epilog("selfheal recording check recording.h5", "recording-format.md"),
    no_args_is_help=True,
    rich_markup_mode=None,
)

_CHECK_MODEL = typer.Option(metavar="MODEL.xml", help="Also compare it with this MJCF.")
_CHECK_MAP = typer.Option(
    "--map",
    metavar="MAP.toml",
    help="The map it was imported with: print corrected rules.",
)
_LOGS = typer.Argument(metavar="LOG...", help="Files or folders of one robot.")
_MODEL = typer.Option(metavar="MODEL.xml", help="The robot's MJCF or URDF.")
_MAP_FILE = typer.Option(
    "--map", metavar="MAP.toml", help="Which columns are which signals."
)
_GUESS = typer.Option("--guess", help="Propose a map, and import nothing.")
_PRESET = typer.Option(
    metavar="NAME",
    help="With --guess: lerobot-so101, legged_gym or ros2_control, whose logs "
    "have known columns.",
)
_OUT = typer.Option(
    metavar="FILE",
    help="Where the recording goes; with --guess the map, without it map.toml.",
)


@app.callback()
def _recording() -> None:
    """Check, import and export recordings."""


@app.command(
    epilog=make_epilog(
        "selfheal recording check recording.h5 --model model.xml", "check-a-log.md"
    )
)
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="A recording.")],
    model: Annotated[Path | None, _CHECK_MODEL] = None,
    map_file: Annotated[Path | None, _CHECK_MAP] = None,
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Summarize a recording; refuse one that breaks the format.

    With a model, also find faults of the log that no missing physics explains.
    """
    from selfheal.recording import (
        check_against_model,
        list_model_names,
        load_model,
        read,
    )

    if map_file is not None and model is None:
        raise InputError("--map needs --model MODEL.xml, whose check corrects it")
    recording = read(file) if model is None else read(file, model=str(model))
    found, rules = None, None
    if model is not None:
        from selfheal.telemetry import examine_telemetry

        compiled = load_model(model)
        check_against_model(recording, list_model_names(compiled))
        found = examine_telemetry(recording, compiled)
    if map_file is not None and found is not None:
        rules = _list_corrected_rules(map_file, found, recording)
    if as_json:
        _print_as_json(recording, model, found, rules)
        return
    _print_recording(recording)
    if found is not None:
        _print_telemetry(recording, found, rules or [])
    print_line(_format_verdict(recording, model, found))


@app.command(
    "import",
    epilog=make_epilog(
        "selfheal recording import log.csv --model model.xml --guess", "import-a-log.md"
    ),
)
def import_log(
    logs: Annotated[list[Path], _LOGS],
    model: Annotated[Path, _MODEL],
    map_file: Annotated[Path | None, _MAP_FILE] = None,
    guess: Annotated[bool, _GUESS] = False,
    preset: Annotated[str | None, _PRESET] = None,
    out: Annotated[Path | None, _OUT] = None,
    force: Annotated[bool, FORCE] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Make a recording of a log: CSV, Parquet, ROS bag, LeRobot, JSON, NPZ, MAT ..."""
    if guess + (map_file is not None) != 1 or (preset and map_file):
        raise InputError("give either --map MAP.toml or --guess, perhaps with --preset")
    if guess:
        out = out or Path("map.toml")
    if out is None:
        raise InputError("--out FILE.h5 is missing: where the recording goes")
    used = [*logs, model, *filter(None, [map_file])]
    refuse_existing(out, used, force=force)
    if map_file is None:
        _propose_map(logs, model, preset, out, as_json=as_json)
        return
    _import_logs(logs, model, map_file, out, as_json=as_json, progress=progress)


def _propose_map(
    logs: list[Path], model: Path, preset: str | None, out: Path, *, as_json: bool
) -> None:
    """Write a map that fits the first of logs, as far as it can be guessed."""
    from selfheal.logs.guessing.guess import guess_map
    from selfheal.logs.guessing.map_text import format_map
    from selfheal.logs.guessing.presets import read_preset
    from selfheal.logs.open_log import open_log
    from selfheal.recording import load_model

    from ._import import print_guess_as_json

    known = None if preset is None else read_preset(preset)
    found = guess_map(open_log(logs[0]), load_model(model), known)
    text = format_map(found, logs[0].name, model.name)
    write_text(out, text)
    if as_json:
        print_guess_as_json(found, out)
        return
    for line in text.splitlines():
        print_line(line)
    print_line("")
    words = ["--model", model, "--map", out, "--out", "recording.h5"]
    again = shlex.join(map(str, [*logs, *words]))
    print_line(f"wrote {out}; look at it, then: selfheal recording import {again}")


def _import_logs(
    paths: list[Path],
    model: Path,
    map_file: Path,
    out: Path,
    *,
    as_json: bool,
    progress: bool,
) -> None:
    """Write the recording of logs."""
    from selfheal.logs.convert import import_logs
    from selfheal.logs.log_map import read_map
    from selfheal.logs.open_log import open_log
    from selfheal.recording import list_model_names, load_model

    from ._import import print_import

    compiled, log_map = load_model(model), read_map(map_file)
    opened = [open_log(path) for path in paths]
    with ProgressBar("reading", as_json=as_json, progress=progress) as bar:
        report = import_logs(
            opened,
            log_map,
            list_model_names(compiled),
            out,
            map_name=str(map_file),
            model=compiled,
            report=lambda file, share: bar.show(f"reading {file}", share),
        )
    if as_json:
        print_document("import", recording=str(out), **asdict(report))
    else:
        print_import(report, out)


class _Rule(TypedDict):
    """What is to stand in place of a rule of a map, by its number from 0."""

    map: str
    rule: int
    lines: list[str]


def _list_corrected_rules(
    map_file: Path, found: "Telemetry", recording: "Recording"
) -> list[_Rule]:
    """Rules of a map that are to be replaced."""
    from selfheal.logs.log_map import read_map
    from selfheal.logs.map_rules import format_rule
    from selfheal.telemetry.map_corrections import correct_rules

    listed = list[_Rule]()
    corrected = correct_rules(read_map(map_file), found.faults, recording)
    for number, rules in corrected.items():
        lines = [line for rule in rules for line in (*format_rule(rule), "")]
        listed.append({"map": str(map_file), "rule": number, "lines": lines})
    return listed


def _print_as_json(
    recording: "Recording",
    model: Path | None,
    found: "Telemetry | None",
    rules: list[_Rule] | None,
) -> None:
    """What a recording holds, and what its check found."""
    said: dict[str, object] = {}
    if found is not None:
        said["telemetry"] = [
            asdict(fault)
            | {"corrections": [*map(str, fault.corrections)]}
            | {"decisive": fault.is_decisive}
            for fault in found.faults
        ]
        said["unchecked"] = list(found.unchecked)
    if rules is not None:
        said["corrected_rules"] = rules
    print_document(
        "recording-check",
        file=recording.file,
        model=None if model is None else str(model),
        robot=recording.robot,
        source=recording.source,
        episodes=[_serialize_episode(k, e) for k, e in recording.episodes.items()],
        **said,
    )


def _serialize_episode(name: str, episode: "Episode") -> dict[str, object]:
    return {
        "id": name,
        "motion": episode.motion,
        "samples": episode.time.size,
        "seconds": _measure_seconds(episode),
        "actuators": list(episode.ctrl_names),
        "initial_state": episode.qpos0 is not None and episode.qvel0 is not None,
        "signals": [
            {
                "name": name,
                "kind": signal.kind,
                "target": signal.target,
                "unit": signal.unit,
                "missing": _measure_missing(signal),
            }
            for name, signal in episode.signals.items()
        ],
    }


def _measure_seconds(episode: "Episode") -> float:
    return float(episode.time[-1] - episode.time[0])


def _measure_missing(signal: "Signal") -> float:
    """Share of values that were not read."""
    import numpy as np

    return float(np.isnan(signal.values).mean())


def _print_recording(recording: "Recording") -> None:
    """A row an episode, and a line for the signals of each kind that are alike."""
    rows = []
    missing: dict[tuple[str, str, str], list[float]] = {}
    for key, episode in recording.episodes.items():
        shares = []
        for name, signal in episode.signals.items():
            shares.append(_measure_missing(signal))
            what = signal.kind, signal.unit, name
            missing.setdefault(what, []).append(shares[-1])
        length = str(episode.time.size), f"{_measure_seconds(episode):.3f}"
        rows.append((key, episode.motion or "", *length, _format_share(shares)))
    print_table(("episode", "motion", "samples", "seconds", "missing"), rows)
    alike: dict[tuple[str, str, int, str], list[str]] = {}
    for (kind, unit, name), shares in missing.items():
        group = kind, unit, len(shares), _format_share(shares)
        alike.setdefault(group, []).append(name)
    for (kind, unit, count, share), names in alike.items():
        print_paragraph(
            f"{kind} [{unit}] in {count} episode{'s' * (count > 1)}, {share} missing: "
            f"{', '.join(names)}",
            "  ",
        )


def _format_share(shares: list[float]) -> str:
    return f"{sum(shares) / len(shares):.1%}" if shares else "no signal"


def _print_telemetry(
    recording: "Recording", found: "Telemetry", rules: list[_Rule]
) -> None:
    """Each fault of the log with its corrections, and what was not looked at."""
    for fault in found.faults:
        every = len(fault.episodes) == len(recording.episodes)
        where = "all episodes" if every else f"episode {', '.join(fault.episodes)}"
        # below what a double can hold there is no number
        p = f"= {fault.p_value:.0e}" if fault.p_value else "< 1e-300"
        print_paragraph(f"{fault.kind} ({where}, p {p}): {fault.seen}", "  ")
        for line in map(str, fault.corrections):
            if not (line.startswith("[[signals]]") and rules):
                print_paragraph(f"  correction: {line}", "    ")
    if not found.faults:
        print_line("telemetry: no fault of the log was found")
    for rule in rules:
        print_paragraph(
            f"in {rule['map']}, in place of the {rule['rule'] + 1}. [[signals]]:"
        )
        for line in rule["lines"]:
            print_line(f"    {line}".rstrip())
    for reason in found.unchecked:
        print_paragraph(f"not checked: {reason}", "  ")


def _format_verdict(
    recording: "Recording", model: Path | None, found: "Telemetry | None"
) -> str:
    count = len(recording.episodes)
    seconds = sum(map(_measure_seconds, recording.episodes.values()))
    fits = f" and fits {model}" if model else ""
    if found and any(fault.is_decisive for fault in found.faults):
        fits = (
            f", but contradicts {model}: diagnose refuses it until what is listed "
            "above is corrected"
        )
    return (
        f"{recording.file} ({recording.robot or 'robot not named'}): {count} "
        f"episode{'s' * (count > 1)}, {seconds:.1f} s; it keeps the contract{fits}."
    )
