"""The command line: takes arguments, gives tables, JSON and exit codes."""

from typing import Annotated

import typer

from selfheal import __version__

from . import (
    diagnose,
    example,
    export,
    heal,
    identify,
    model,
    recording,
    recover,
    study,
)
from ._errors import Group
from ._options import make_epilog
from ._print import print_line

# rich_markup_mode: rich's help pages would double the time to the first line
app = typer.Typer(
    cls=Group,
    name="selfheal",
    help="A robot finds out by experiment what its body is.",
    epilog=make_epilog("selfheal example pendulum --out pendulum", "quickstart.md"),
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
for _command, _example, _page in (
    (identify.identify, "selfheal identify --robot starfish", "how-identify-works.md"),
    (identify.show, "selfheal show runs/starfish-0/run.h5", "quickstart.md"),
    (identify.robots, "selfheal robots", "add-a-robot.md"),
    (heal.gait, "selfheal gait runs/starfish-0/run.h5", "how-heal-works.md"),
    (
        heal.heal,
        "selfheal heal runs/starfish-0/run.h5 --damage right_lower:0.1",
        "how-heal-works.md",
    ),
    (heal.watch, "selfheal watch body.xml recording.h5 --learn 20", "quickstart.md"),
    (
        recover.recover,
        "selfheal recover --robot quadruped --scenario 2",
        "how-recover-works.md",
    ),
    (
        diagnose.diagnose,
        "selfheal diagnose model.xml recording.h5 --out diagnosis",
        "how-diagnose-works.md",
    ),
    (
        diagnose.replay,
        "selfheal replay diagnosis recording.h5 --out predicted.h5",
        "quickstart.md",
    ),
    (diagnose.effects, "selfheal effects", "effects.md"),
    (example.example, "selfheal example pendulum --out pendulum", "four-logs.md"),
):
    app.command(epilog=make_epilog(_example, _page))(_command)
recording.app.command(
    epilog=make_epilog(
        "selfheal recording export recording.h5 --to mcap",
        "import-a-log.md#to-other-programs",
    )
)(export.export)
app.add_typer(study.app, name="study")
app.add_typer(recording.app, name="recording")
app.add_typer(model.app, name="model")


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
