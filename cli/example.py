"""`selfheal example`: writes a model and a log with something concealed in it."""

from pathlib import Path
from typing import Annotated

import typer

from ._options import AS_JSON, complete, out_folder
from ._print import print_document, print_line
from ._runs import choose_run_folder

_NAME = typer.Argument(
    metavar="NAME",
    help="pendulum, desk_arm, six_axis or hung_quadruped.",
    autocompletion=complete("example.make:EXAMPLES"),
)


def example(
    name: Annotated[str, _NAME],
    out: Annotated[Path | None, out_folder("runs/example-NAME")] = None,
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Write a model, a log of its robot with something concealed, and what to type."""
    from selfheal.example import make_example

    out = out or choose_run_folder(f"example-{name}")
    made = make_example(name, out)
    if as_json:
        paths = {
            "model": made.model,
            "log": made.log,
            "map": made.map_file,
            "recording": made.recording,
        }
        said = {key: str(path) for key, path in paths.items()}
        print_document("example", name=name, **said, concealed=made.concealed)
        return
    for line in (
        f"{made.model}: what is known of the robot",
        f"{made.log}: what it did, in its own software's units",
        f"{made.map_file}: which columns are which signals",
        f"{made.recording}: the log as selfheal reads it, made by",
        f"  selfheal recording import {made.log} --model {made.model} "
        f"--map {made.map_file} --out {made.recording}",
        "The model lacks one effect of the robot. To identify it:",
        f"  selfheal diagnose {made.model} {made.recording} --out {out / 'diagnosis'}",
    ):
        print_line(line)
