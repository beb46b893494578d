"""`selfheal example`: writes a model and a log with something concealed in it."""

from pathlib import Path
from typing import Annotated

import typer


def example(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="pendulum, desk_arm, six_axis or hung_quadruped."
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for its files; made if missing.")
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object for scripts.")
    ] = False,
) -> None:
    """Write a model, a log of its robot with something concealed, and what to type."""
    from selfheal.example import make_example

    from ._print import print_json

    made = make_example(name, out)
    if as_json:
        print_json(
            {
                "format": "selfheal-example",
                "version": 1,
                "name": name,
                "model": str(made.model),
                "log": str(made.log),
                "map": str(made.map_file),
                "recording": str(made.recording),
                "concealed": made.concealed,
            }
        )
        return
    print(
        f"{made.model}: what is known of the robot\n"
        f"{made.log}: what it did, in its own software's units\n"
        f"{made.map_file}: which columns are which signals\n"
        f"{made.recording}: the log as selfheal reads it, made by\n"
        f"  selfheal recording import {made.log} --model {made.model} "
        f"--map {made.map_file} --out {made.recording}\n"
        "The robot has a physics that the model lacks. To find it:\n"
        f"  selfheal diagnose {made.model} {made.recording} --out {out / 'diagnosis'}"
    )
