"""`selfheal recording export`: a recording, perhaps a diagnosis, in; a file out."""

from pathlib import Path
from typing import Annotated

import typer

from selfheal.errors import UnknownNameError
from selfheal.files import check_writable

from ._options import AS_JSON, FORCE, complete
from ._print import print_document, print_line
from ._runs import refuse_existing

_TO = typer.Option(
    metavar="FORMAT",
    help="mcap (Foxglove, PlotJuggler), rrd (Rerun), csv or parquet.",
    autocompletion=complete("export.export:FORMATS"),
)
_DIAGNOSIS = typer.Option(
    metavar="DIR", help="Also what this diagnosis predicts of it."
)
_OUT = typer.Option(metavar="FILE", help="Where it goes; without it FILE.FORMAT.")


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="A recording.")],
    to: Annotated[str, _TO],
    diagnosis: Annotated[Path | None, _DIAGNOSIS] = None,
    out: Annotated[Path | None, _OUT] = None,
    force: Annotated[bool, FORCE] = False,
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Write a recording for another program to plot."""
    from selfheal.export.export import FORMATS, export_recording
    from selfheal.recording import read

    if to not in FORMATS:
        raise UnknownNameError("format", to, FORMATS)
    out = out or Path(f"{file.stem}.{to}")
    check_writable(out)
    refuse_existing(out, [file], force=force)
    recording, predicted = read(file), None
    if diagnosis is not None:
        from selfheal.diagnosis.output.replay import replay_recording

        predicted = replay_recording(diagnosis, recording)
    export_recording(recording, out, to=to, predicted=predicted)
    count = len(recording.episodes)
    if as_json:
        print_document(
            "export",
            recording=str(file),
            to=to,
            diagnosis=str(diagnosis) if diagnosis else None,
            exported=str(out),
            episodes=count,
        )
    else:
        print_line(f"{out}: {count} episode{'s' * (count > 1)}")
