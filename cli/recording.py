"""`selfheal recording`: takes a recording file, says what it holds or what is wrong."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from selfheal.recording import Episode, Recording

app = typer.Typer(
    help="Look at recordings.", no_args_is_help=True, rich_markup_mode=None
)


@app.callback()
def _recording() -> None:
    """Look at recordings."""


@app.command()
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="A recording.")],
    model: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.xml", help="Also compare it with this MJCF."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object for scripts.")
    ] = False,
) -> None:
    """Say what a recording holds; refuse one that breaks the contract."""
    from selfheal.recording import check_against_model, read, read_names

    recording = read(file)
    if model is not None:
        check_against_model(recording, read_names(model))
    summary = _summarize_recording(recording, model)
    if as_json:
        from ._print import print_json

        print_json(summary)
    else:
        _print_tables(summary)


def _summarize_recording(recording: "Recording", model: Path | None) -> dict[str, Any]:
    episodes = recording.episodes.items()
    return {
        "format": "selfheal-recording-check",
        "version": 1,
        "file": recording.file,
        "model": None if model is None else str(model),
        "robot": recording.robot,
        "source": recording.source,
        "episodes": [_summarize_episode(name, episode) for name, episode in episodes],
    }


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


def _print_tables(summary: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    for header, rows in (
        (("episode", "motion", "samples", "seconds", "missing"), _list_episode_rows),
        (
            ("signal", "kind", "unit", "target", "episodes", "missing"),
            _list_signal_rows,
        ),
    ):
        table = Table()
        for title in header:
            table.add_column(title, overflow="fold")
        for row in rows(summary["episodes"]):
            # text, not markup: a name in a file may hold square brackets
            table.add_row(*(Text(cell) for cell in row))
        console.print(table)
    console.print(Text(_format_verdict(summary)), soft_wrap=True)


def _list_episode_rows(episodes: list[dict[str, Any]]) -> Iterator[tuple[str, ...]]:
    for episode in episodes:
        yield (
            episode["id"],
            episode["motion"] or "",
            str(episode["samples"]),
            f"{episode['seconds']:.3f}",
            _format_share([signal["missing"] for signal in episode["signals"]]),
        )


def _list_signal_rows(episodes: list[dict[str, Any]]) -> Iterator[tuple[str, ...]]:
    missing: dict[tuple[str, ...], list[float]] = {}
    for episode in episodes:
        for signal in episode["signals"]:
            what = tuple(signal[key] for key in ("name", "kind", "unit", "target"))
            missing.setdefault(what, []).append(signal["missing"])
    for what, shares in missing.items():
        yield (*what, str(len(shares)), _format_share(shares))


def _format_share(shares: list[float]) -> str:
    return f"{sum(shares) / len(shares):.1%}" if shares else "no signal"


def _format_verdict(summary: dict[str, Any]) -> str:
    count = len(summary["episodes"])
    seconds = sum(episode["seconds"] for episode in summary["episodes"])
    fits = f" and fits {summary['model']}" if summary["model"] else ""
    return (
        f"{summary['file']} ({summary['robot'] or 'robot not named'}): {count} "
        f"episode{'s' * (count > 1)}, {seconds:.1f} s; it keeps the contract{fits}."
    )
