"""The list of robots: a name in, a Robot out."""

from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path

from ..errors import UnknownNameError, check_seed
from .base import Robot
from .description import open_description

GROUP = "selfheal.robots"
Factory = Callable[[str, int, Path | None], Robot]


def list_robots() -> dict[str, str]:
    """Name -> first line of what its factory says, of every robot installed."""
    found = {e.name: e.load().__doc__ or "" for e in entry_points(group=GROUP)}
    return {name: found[name].split("\n")[0].rstrip(".") for name in sorted(found)}


def is_described(name: str) -> bool:
    """Whether a robot's name is a file that describes it."""
    return name.endswith((".toml", ".xml"))


def name_robot(robot: Robot) -> str:
    """A robot's name as one that a folder can have."""
    if is_described(robot.name):
        return robot.anatomy.name
    return robot.name.replace(":", "-")


def open_robot(name: str, *, seed: int = 0, recordings: Path | None = None) -> Robot:
    """The robot of a name.

    Args:
        name: of an entry point of group `selfheal.robots`, perhaps with an argument
            for its factory after a colon, as in "tree:7"; or the file of a robot.
        seed: of the robot's own chances (noise, hidden physics).
        recordings: a recording file, for robots that answer from one.

    Raises:
        UnknownNameError: no such robot.
        InputError: the robot cannot be made from these.
    """
    if is_described(name):
        check_seed(seed)
        return open_description(name, seed, recordings)
    kind, _, argument = name.partition(":")
    found = {e.name: e for e in entry_points(group=GROUP)}
    if kind not in found:
        raise UnknownNameError("robot", name, found)
    check_seed(seed)
    factory: Factory = found[kind].load()
    return factory(argument, seed, recordings)
