"""Exceptions to exit codes (contract section 3), for every command in one place."""

import os
import sys
from contextlib import suppress
from typing import Any

import typer
from typer.core import TyperGroup

from selfheal.errors import InputError, SelfhealError
from selfheal.files import DISK_ERRORS

from ._print import print_error
from ._streams import guard_streams
from ._warnings import say_warnings


class Group(TyperGroup):
    """Commands whose expected failures are one message and an exit code.

    2: the input was refused; 1: any other failure the package raises on purpose. What
    nobody expected keeps its traceback, and Ctrl-C is typer's 130.
    """

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command line, which prints whatever text is in files and paths."""
        guard_streams()
        with say_warnings():
            return super().main(*args, **kwargs)

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        """Run the command that `ctx` names."""
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
        except SelfhealError as error:
            print_error(f"selfheal: {error}")
            raise typer.Exit(2 if isinstance(error, InputError) else 1) from error
        except OSError as error:
            if error.errno not in DISK_ERRORS:
                raise
            print_error(f"selfheal: cannot write: {error.strerror}")
            _discard_output()
            raise typer.Exit(1) from error
        return result


def _discard_output() -> None:
    """Have what could not be printed go nowhere, when Python tries once more."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
