"""What several commands share: options, words that a shell completes, ends of helps."""

from collections.abc import Callable, Iterable
from importlib import import_module
from importlib.metadata import entry_points

import typer
from typer.models import OptionInfo

AS_JSON = typer.Option("--json", help="One JSON object for scripts.")
FORCE = typer.Option("--force", help="Overwrite the file at --out.")
SEED = typer.Option(help="Seed of all random numbers.")
# pages of the documentation, from the top of the repository
_DOCS = "docs"


def out_folder(what: str) -> OptionInfo:
    """The option for a folder that a command writes; without it `what`."""
    option: OptionInfo = typer.Option(
        "--out", metavar="FOLDER", help=f"Where the files go; without it {what}."
    )
    return option


def out_file(name: str) -> OptionInfo:
    """The option for a file that a command writes, by the name that it has in help."""
    option: OptionInfo = typer.Option("--out", metavar=name, help="Where it goes.")
    return option


def resume_from(name: str, what: str) -> OptionInfo:
    """The option for a file to go on with, by its name in help and what it is of."""
    option: OptionInfo = typer.Option(metavar=name, help=f"Continue {what}.")
    return option


def start_over(what: str) -> OptionInfo:
    """The option that replaces an earlier result, by what that is."""
    option: OptionInfo = typer.Option(
        "--force", help=f"Start over where {what} is already."
    )
    return option


def make_epilog(example: str, page: str) -> str:
    """What a command's help ends with: an example, a page of the documentation."""
    return f"\b\nExample: {example}\nMore: {_DOCS}/{page}"


def complete(place: str, *more: str, end: str = "") -> Callable[[str], list[str]]:
    """A shell's completion.

    Args:
        place: of the words, or of a function that lists them, in this package:
            "module:NAME"; loaded when a shell completes.
        more: words that would fit, too.
        end: of every word.
    """
    module, _, name = place.partition(":")

    def start_with(incomplete: str) -> list[str]:
        """Those of the words that begin so."""
        found = getattr(import_module(f"selfheal.{module}"), name)
        words: Iterable[object] = found() if callable(found) else found
        every = (f"{word}{end}" for word in (*more, *words))
        return [word for word in every if word.startswith(incomplete)]

    return start_with


def list_robot_names() -> list[str]:
    """Robots that `identify` can open; loading them would take a second."""
    from selfheal.robot.open_robot import GROUP

    return sorted(entry_points(group=GROUP).names)
