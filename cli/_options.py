"""What several commands share: options, words that a shell completes, ends of helps."""

from collections.abc import Callable, Iterable

import typer
from typer.models import OptionInfo

AS_JSON = typer.Option("--json", help="One JSON object for scripts.")
FORCE = typer.Option("--force", help="Overwrite what is at --out.")
SEED = typer.Option(help="Of everything random.")
# pages of the documentation, from the top of the repository
_DOCS = "docs"


def out_folder(what: str) -> OptionInfo:
    """The option for a folder that a command writes.

    Args:
        what: where its files go if it is not given.
    """
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
    option: OptionInfo = typer.Option(metavar=name, help=f"Go on with {what}.")
    return option


def start_over(what: str) -> OptionInfo:
    """The option that replaces an earlier result, by what that is."""
    option: OptionInfo = typer.Option(
        "--force", help=f"Start over where {what} is already."
    )
    return option


def make_epilog(example: str, page: str) -> str:
    """What a command's help ends with.

    Args:
        page: of the documentation, perhaps with a place in it.
    """
    return f"\b\nExample: {example}\nMore: {_DOCS}/{page}"


def complete(find: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """A shell's completion.

    Args:
        find: gives all words that would fit; called only when a shell asks.
    """

    def start_with(incomplete: str) -> list[str]:
        """Those of the words that begin so."""
        return [word for word in find() if word.startswith(incomplete)]

    return start_with


def list_robot_names() -> Iterable[str]:
    """Robots that `identify` can ask."""
    from importlib.metadata import entry_points

    from selfheal.robot.open_robot import GROUP

    return sorted(entry_points(group=GROUP).names)


def list_legged_robots() -> Iterable[str]:
    """Robots that `recover` can break."""
    from selfheal.body.legged import LEGGED

    return LEGGED


def list_scenarios() -> Iterable[str]:
    """What can break in them."""
    from selfheal.robot.scenarios import SCENARIOS

    return ["all", *map(str, SCENARIOS)]


def list_damages() -> Iterable[str]:
    """Beginnings of what can happen to a robot that `heal` walks."""
    from selfheal.damage.words import WORDS

    return [f"{word}:" for word in (*WORDS, "random")]


def list_examples() -> Iterable[str]:
    """Examples that can be written."""
    from selfheal.example.make import EXAMPLES

    return EXAMPLES


def list_faults() -> Iterable[str]:
    """Kinds of faults of a log."""
    from selfheal.telemetry import KINDS

    return KINDS


def list_formats() -> Iterable[str]:
    """Formats that a recording is exported to."""
    from selfheal.export.export import FORMATS

    return FORMATS
