"""Exceptions to exit codes (contract section 3), for every command in one place."""

from typing import Any

import typer
from typer.core import TyperGroup

from selfheal.errors import InputError, SelfhealError


class Group(TyperGroup):
    """Commands whose expected failures are one message and an exit code.

    2: the input was refused; 1: any other failure the package raises on purpose. What
    nobody expected keeps its traceback, and Ctrl-C is typer's 130.
    """

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        """Run the command that `ctx` names."""
        try:
            return super().invoke(ctx)
        except SelfhealError as error:
            typer.echo(f"selfheal: {error}", err=True)
            raise typer.Exit(2 if isinstance(error, InputError) else 1) from error
