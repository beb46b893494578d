"""`selfheal recording`: takes a recording file, says what it holds or what is wrong."""

import shlex
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._options import AS_JSON, FORCE, make_epilog
from ._print import print_json, print_line, print_paragraph, print_table
from ._progress import ProgressBar, ShowProgress
from ._runs import refuse_existing

if TYPE_CHECKING:
    from selfheal.recording import Episode, Recording
    from selfheal.telemetry import Telemetry

app = typer.Typer(
    help="Look at recordings, make them, hand them on.",
    epilog=make_epilog("selfheal recording check recording.h5", "recording-format.md"),
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.callback()
def _recording() -> None:
    """Look at recordings, make them, hand them on."""


@app.command(
    epilog=make_epilog(
        "selfheal recording check recording.h5 --model model.xml", "check-a-log.md"
    )
)
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="A recording.")],
    model: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.xml", help="Also compare it with this MJCF."),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="MAP.toml",
            help="The map it was imported by: say which of its rules to replace.",
        ),
    ] = None,
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Say what a recording holds; refuse one that breaks the contract.

    With a model, also say where the two contradict each other as no physics does.
    """
    from selfheal.errors import InputError
    from selfheal.recording import (
        check_against_model,
        list_model_names,
        load_model,
        read,
    )

    if map_file is not None and model is None:
        raise InputError("--map needs --model MODEL.xml, whose check corrects it")
    recording = read(file) if model is None else read(file, model=str(model))
    found = None
    if model is not None:
        from selfheal.telemetry import examine_telemetry

        compiled = load_model(model)
        check_against_model(recording, list_model_names(compiled))
        found = examine_telemetry(recording, compiled)
    summary = _summarize_recording(recording, model, found)
    if map_file is not None and found is not None:
        summary["corrected_rules"] = _list_corrected_rules(map_file, found, recording)
    if as_json:
        print_json(summary)
    else:
        _print_tables(summary)


@app.command(
    "import",
    epilog=make_epilog(
        "selfheal recording import log.csv --model model.xml --guess", "import-a-log.md"
    ),
)
def import_log(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help="Files or folders of one robot."),
    ],
    model: Annotated[
        Path, typer.Option(metavar="MODEL.xml", help="The robot's MJCF or URDF.")
    ],
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="MAP.toml", help="Which columns are which signals."
        ),
    ] = None,
    guess: Annotated[
        bool, typer.Option("--guess", help="Propose a map, and import nothing.")
    ] = False,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="With --guess: lerobot-so101, legged_gym or ros2_control, whose logs "
            "have known columns.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Where the recording goes; with --guess the map, without it map.toml.",
        ),
    ] = None,
    force: Annotated[bool, FORCE] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Make a recording of a log: CSV, Parquet, ROS bag, LeRobot, JSON, NPZ, MAT ..."""
    from selfheal.errors import InputError

    if guess + (map_file is not None) != 1 or (preset and map_file):
        raise InputError("give either --map MAP.toml or --guess, perhaps with --preset")
    if guess:
        out = out or Path("map.toml")
    if out is None:
        raise InputError("--out FILE.h5 is missing: where the recording goes")
    used = [*logs, model, *filter(None, [map_file])]
    if out.resolve() in [path.resolve() for path in used]:
        raise InputError(f"--out {out} would overwrite what it is made of")
    refuse_existing(out, force=force)
    if map_file is None:
        _propose_map(logs, model, preset, out, as_json=as_json)
        return
    _import_logs(logs, model, map_file, out, as_json=as_json, asked=progress)


def _propose_map(
    logs: list[Path], model: Path, preset: str | None, out: Path, *, as_json: bool
) -> None:
    """Write a map that fits the first of logs, as far as can be told."""
    from selfheal.files import write_text
    from selfheal.logs.guessing.guess import guess_map
    from selfheal.logs.guessing.map_text import format_map
    from selfheal.logs.guessing.presets import read_preset
    from selfheal.logs.open_log import open_log
    from selfheal.recording import load_model

    from ._import import summarize_guess

    known = None if preset is None else read_preset(preset)
    found = guess_map(open_log(logs[0]), load_model(model), known)
    text = format_map(found, logs[0].name, model.name)
    write_text(out, text)
    if as_json:
        print_json(summarize_guess(found, out))
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
    asked: bool,
) -> None:
    """Write the recording of logs."""
    from selfheal.logs.convert import import_logs
    from selfheal.logs.log_map import read_map
    from selfheal.logs.open_log import open_log
    from selfheal.recording import list_model_names, load_model

    from ._import import print_import, summarize_import

    compiled, log_map = load_model(model), read_map(map_file)
    opened = [open_log(path) for path in paths]
    with ProgressBar("reading", as_json=as_json, asked=asked) as bar:
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
        print_json(summarize_import(report, out))
    else:
        print_import(report, out)


def _summarize_recording(
    recording: "Recording", model: Path | None, found: "Telemetry | None"
) -> dict[str, Any]:
    episodes = recording.episodes.items()
    summary = {
        "format": "selfheal-recording-check",
        "version": 1,
        "file": recording.file,
        "model": None if model is None else str(model),
        "robot": recording.robot,
        "source": recording.source,
        "episodes": [_summarize_episode(name, episode) for name, episode in episodes],
    }
    if found is not None:
        summary["telemetry"] = [
            {
                **asdict(fault),
                "corrections": [*map(str, fault.corrections)],
                "decisive": fault.is_decisive,
            }
            for fault in found.faults
        ]
        summary["unchecked"] = list(found.unchecked)
    return summary


def _summarize_episode(name: str, episode: "Episode") -> dict[str, Any]:
    import numpy as np

    return {
        "id": name,
        "motion": episode.motion,
        "samples": episode.time.size,
        "seconds": float(episode.time[-1] - episode.time[0]),
        "actuators": list(episode.ctrl_names),
        "initial_state": episode.qpos0 is not None and episode.qvel0 is not None,
        "signals": [
            {
                "name": name,
                "kind": signal.kind,
                "target": signal.target,
                "unit": signal.unit,
                "missing": float(np.isnan(signal.values).mean()),
            }
            for name, signal in episode.signals.items()
        ],
    }


def _list_corrected_rules(
    map_file: Path, found: "Telemetry", recording: "Recording"
) -> list[dict[str, Any]]:
    """Rules of a map, and what is to stand in their place."""
    from selfheal.logs.log_map import read_map
    from selfheal.logs.map_rules import format_rule
    from selfheal.telemetry.map_corrections import correct_rules

    corrected = correct_rules(read_map(map_file), found.faults, recording)
    return [
        {
            "map": str(map_file),
            "rule": number,
            "lines": [line for rule in rules for line in (*format_rule(rule), "")],
        }
        for number, rules in corrected.items()
    ]


def _print_tables(summary: dict[str, Any]) -> None:
    print_table(
        ("episode", "motion", "samples", "seconds", "missing"),
        _list_episode_rows(summary["episodes"]),
    )
    for line in _list_signal_lines(summary["episodes"]):
        print_paragraph(line, "  ")
    _print_telemetry(summary)
    print_line(_format_verdict(summary))


def _print_telemetry(summary: dict[str, Any]) -> None:
    """Each fault of the log with its corrections, and what was not looked at."""
    for fault in summary.get("telemetry", []):
        every = len(fault["episodes"]) == len(summary["episodes"])
        names = ", ".join(fault["episodes"])
        episodes = "all episodes" if every else f"episode {names}"
        print_paragraph(
            f"{fault['kind']} ({episodes}, p {_format_p_value(fault['p_value'])}): "
            f"{fault['seen']}",
            "  ",
        )
        for line in fault["corrections"]:
            if not (line.startswith("[[signals]]") and summary.get("corrected_rules")):
                print_paragraph(f"  correction: {line}", "    ")
    if summary.get("telemetry") == []:
        print_line("telemetry: no fault of the log was found")
    for rule in summary.get("corrected_rules", []):
        print_paragraph(
            f"in {rule['map']}, in place of the {rule['rule'] + 1}. [[signals]]:"
        )
        for line in rule["lines"]:
            print_line(f"    {line}".rstrip())
    for reason in summary.get("unchecked", []):
        print_paragraph(f"not checked: {reason}", "  ")


def _format_p_value(value: float) -> str:
    """A p-value; below what a double can hold there is no number."""
    return f"= {value:.0e}" if value else "< 1e-300"


def _list_episode_rows(episodes: list[dict[str, Any]]) -> Iterator[tuple[str, ...]]:
    for episode in episodes:
        yield (
            episode["id"],
            episode["motion"] or "",
            str(episode["samples"]),
            f"{episode['seconds']:.3f}",
            _format_share([signal["missing"] for signal in episode["signals"]]),
        )


def _list_signal_lines(episodes: list[dict[str, Any]]) -> Iterator[str]:
    """A line for the signals of each kind that are alike."""
    missing: dict[tuple[str, str, str], list[float]] = {}
    for episode in episodes:
        for signal in episode["signals"]:
            what = signal["kind"], signal["unit"], signal["name"]
            missing.setdefault(what, []).append(signal["missing"])
    alike: dict[tuple[str, str, int, str], list[str]] = {}
    for (kind, unit, name), shares in missing.items():
        key = kind, unit, len(shares), _format_share(shares)
        alike.setdefault(key, []).append(name)
    for (kind, unit, count, share), names in alike.items():
        yield (
            f"{kind} [{unit}] in {count} episode{'s' * (count > 1)}, {share} missing: "
            f"{', '.join(names)}"
        )


def _format_share(shares: list[float]) -> str:
    return f"{sum(shares) / len(shares):.1%}" if shares else "no signal"


def _format_verdict(summary: dict[str, Any]) -> str:
    count = len(summary["episodes"])
    seconds = sum(episode["seconds"] for episode in summary["episodes"])
    fits = f" and fits {summary['model']}" if summary["model"] else ""
    if any(fault["decisive"] for fault in summary.get("telemetry", [])):
        fits = (
            f", but contradicts {summary['model']}: diagnose refuses it until what is "
            "told above is mended"
        )
    return (
        f"{summary['file']} ({summary['robot'] or 'robot not named'}): {count} "
        f"episode{'s' * (count > 1)}, {seconds:.1f} s; it keeps the contract{fits}."
    )
