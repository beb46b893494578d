"""The named suites of `identify.py`: what runs, how often, and what it is held against.

Fixed before the runs that are reported.
"""

from dataclasses import dataclass
from itertools import product

from selfheal.selfmodel.run import Settings
from selfheal.selfmodel.strategy import CEILING

REAL, HIDDEN = "starfish-2006", "starfish"


@dataclass(frozen=True)
class Row:
    """One configuration of a suite.

    Attributes:
        name: in the table.
        settings: of its runs; the seed and the recording are filled in, and `{seed}` in
            the robot's name.
        seeds: how many.
        target: in words, "" if none.
        paper: successes of 30 in the paper, None if it has no such figure.
        rivals: names of the rows that this one is compared with.
    """

    name: str
    settings: Settings
    seeds: int
    target: str = ""
    paper: int | None = None
    rivals: tuple[str, ...] = ()


def _ours(robot: str, space: str, budget: int, **more) -> Settings:
    """Our method; statics, for its speed, unless a suite or --engine says otherwise."""
    engine = more.pop("engine", "statics")
    return Settings(robot, space=space, budget=budget, engine=engine, **more)


def _released(method: str) -> Settings:
    """A rule of 2006."""
    return Settings(REAL, method=method, engine="statics", budget=CEILING)


def _few(cycles: int, random: bool) -> Row:
    """A few actions, chosen or random."""
    settings = _ours(REAL, "sides", 80_000, cycles=cycles, random_actions=random)
    if random:
        return Row(f"{cycles} random actions", settings, 60)
    target = {10: ">= 95 %", 8: ">= 85 %", 6: ">= 60 %"}[cycles] + ", p < 0.01"
    name = f"{cycles} chosen actions"
    return Row(name, settings, 60, target, rivals=(f"{cycles} random actions",))


_BATCH, _ALTERNATE, _CHOSEN = "random, batch", "random, alternating", "the rule"
_FULL = _ours(HIDDEN, "full", 262_000, known_lengths=True)
_MJX = _ours(REAL, "free", 262_000, engine="mjx")

SUITES = {
    "paper": [
        Row(_BATCH, _released("random-batch"), 100, "21 %", 7),
        Row(_ALTERNATE, _released("random-alternate"), 100, "15 %", 8),
        Row(_CHOSEN, _released("paper"), 100, "49 %", 13, (_BATCH, _ALTERNATE)),
    ],
    "real-free": [
        Row("free, 262,000", _ours(REAL, "free", 262_000), 60, ">= 95 %"),
        Row("free, 80,000", _ours(REAL, "free", 80_000), 60, ">= 85 %"),
    ],
    "real-sides": [
        Row("sides, 80,000", _ours(REAL, "sides", 80_000), 60, ">= 98 %"),
        Row("sides, 26,000", _ours(REAL, "sides", 26_000), 60, ">= 85 %"),
    ],
    "few-actions": [_few(*row) for row in product((10, 8, 6), (False, True))],
    "full": [Row("hinges unknown, lengths known, 262,000", _FULL, 20, ">= 60 %")],
    "simulated": [
        Row("hidden starfish", _ours(HIDDEN, "free", 262_000), 30, "30/30"),
        Row("hidden trees", _ours("tree:{seed}", "free", 262_000), 20,
            ">= 85 % or like it"),
    ],
    "mjx": [Row("free, 262,000, every simulation on mjx", _MJX, 3, "<= 720 s")],
}  # fmt: skip
