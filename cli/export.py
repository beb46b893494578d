"""`selfheal recording export`: a recording, perhaps a diagnosis, in; a file out."""

from pathlib import Path
from typing import Annotated

import typer

from ._options import AS_JSON, FORCE, complete, list_formats
from ._print import print_json, print_line
from ._runs import refuse_existing


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="A recording.")],
    to: Annotated[
        str,
        typer.Option(
            metavar="FORMAT",
            help="mcap (Foxglove, PlotJuggler), rrd (Rerun), csv or parquet.",
            autocompletion=complete(list_formats),
        ),
    ],
    diagnosis: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also what this diagnosis predicts of it."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where it goes; without it FILE.FORMAT."),
    ] = None,
    force: Annotated[bool, FORCE] = False,
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Write a recording for another program to plot."""
    from selfheal.errors import InputError, UnknownNameError
    from selfheal.export.export import FORMATS, export_recording
    from selfheal.files import check_writable
    from selfheal.recording import read

    if to not in FORMATS:
        raise UnknownNameError("format", to, FORMATS)
    out = out or Path(f"{file.stem}.{to}")
    check_writable(out)
    refuse_existing(out, force=force)
    recording, predicted = read(file), None
    if out.exists() and out.samefile(file):
        raise InputError(f"--out {out} would overwrite the recording itself")
    if diagnosis is not None:
        from selfheal.diagnosis.output.replay import replay_recording

        predicted = replay_recording(diagnosis, recording)
    export_recording(recording, out, to=to, predicted=predicted)
    if as_json:
        document = {
            "format": "selfheal-export",
            "version": 1,
            "recording": str(file),
            "to": to,
            "diagnosis": str(diagnosis) if diagnosis else None,
            "exported": str(out),
            "episodes": len(recording.episodes),
        }
        print_json(document)
    else:
        count = len(recording.episodes)
        print_line(f"{out}: {count} episode{'s' * (count > 1)}")
