"""The command line: takes arguments, gives tables, JSON and exit codes."""

from typing import Annotated

import typer

from selfheal import __version__

from . import diagnose, example, heal, identify, recording, recover, study
from ._errors import Group
from ._print import print_line

# rich_markup_mode: rich's help pages would double the time to the first line
app = typer.Typer(
    cls=Group,
    name="selfheal",
    help="A robot finds out by experiment what its body is.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command()(identify.identify)
app.command()(identify.show)
app.command()(identify.robots)
app.command()(heal.gait)
app.command()(heal.heal)
app.command()(heal.watch)
app.command()(recover.recover)
app.command()(diagnose.diagnose)
app.command()(diagnose.replay)
app.command()(diagnose.effects)
app.command()(example.example)
app.add_typer(study.app, name="study")
app.add_typer(recording.app, name="recording")


def _show_version(wanted: bool) -> None:
    if wanted:
        print_line(f"selfheal {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Say it and stop."
        ),
    ] = False,
) -> None:
    """A robot finds out by experiment what its body is."""
