"""Libraries that only some commands need: a module's name in, the module out."""

from importlib import import_module
from importlib.metadata import requires
from typing import Any

from .errors import InputError

# as pyproject.toml has it: "selfheal" is another project of the package index
DISTRIBUTION = "selfheal-robotics"


def import_extra(module: str, extra: str, purpose: str) -> Any:
    """A module that only an extra of pyproject.toml installs.

    `purpose` says what needs it, as the beginning of the message.

    Raises:
        InputError: it is not installed; the message has the line that installs it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"{purpose} needs more libraries: {format_install(extra)} ({error})"
        ) from error


def format_install(extra: str) -> str:
    """The line that installs what an extra names.

    It names the libraries alone, so it is right wherever selfheal was installed from.
    """
    stated = (line.partition(";") for line in requires(DISTRIBUTION) or ())
    wanted = [name.strip() for name, _, mark in stated if f'extra == "{extra}"' in mark]
    return " ".join(["pip install", *(f"'{name}'" for name in wanted)])
