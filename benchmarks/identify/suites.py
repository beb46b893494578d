"""The suites of identification: what runs, how often, and what it is held against.

Fixed before the runs that are reported.
"""

from dataclasses import dataclass
from itertools import product

from benchmarks.writer import ROOT
from selfheal.selfmodel.paper import CEILING
from selfheal.selfmodel.run import Settings

REAL, HIDDEN = "starfish-2006", "starfish"


@dataclass(frozen=True)
class SuiteRow:
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


def _make_our_settings(robot: str, space: str, budget: int, **more) -> Settings:
    """Our method; statics, for its speed, unless a suite or --engine says otherwise."""
    engine = more.pop("engine", "statics")
    return Settings(robot, space=space, budget=budget, engine=engine, **more)


def _make_2006_settings(method: str) -> Settings:
    """A rule of 2006."""
    return Settings(REAL, method=method, engine="statics", budget=CEILING)


def _make_few_actions_row(cycles: int, random: bool) -> SuiteRow:
    """A few actions, chosen or random."""
    settings = _make_our_settings(
        REAL, "sides", 80_000, cycles=cycles, random_actions=random
    )
    if random:
        return SuiteRow(f"{cycles} random actions", settings, 60)
    target = {10: ">= 95 %", 8: ">= 95 %", 6: ">= 90 %"}[cycles] + ", p < 0.01"
    name = f"{cycles} chosen actions"
    return SuiteRow(name, settings, 60, target, rivals=(f"{cycles} random actions",))


DESCRIBED = {"arm": 262_000, "hexapod": 262_000, "snake": 262_000, "quadruped": 800_000}


def _describe(name: str, budget: int) -> Settings:
    """Our method on a robot that a file describes; as many actions as the arm has."""
    robot = str(ROOT / "models" / "described" / f"{name}.toml")
    return _make_our_settings(robot, "free", budget, cycles=15)


_BATCH, _ALTERNATE, _CHOSEN = "random, batch", "random, alternating", "the rule"
_FULL = _make_our_settings(HIDDEN, "full", 262_000, known_lengths=True)
_MJX = _make_our_settings(REAL, "free", 262_000, engine="mjx")

SUITES = {
    "paper": [
        SuiteRow(_BATCH, _make_2006_settings("random-batch"), 100, "21 %", 7),
        SuiteRow(_ALTERNATE, _make_2006_settings("random-alternate"), 100, "15 %", 8),
        SuiteRow(
            _CHOSEN, _make_2006_settings("paper"), 100, "49 %", 13, (_BATCH, _ALTERNATE)
        ),
    ],
    "real-free": [
        SuiteRow(
            "free, 262,000", _make_our_settings(REAL, "free", 262_000), 60, ">= 95 %"
        ),
        SuiteRow(
            "free, 26,000", _make_our_settings(REAL, "free", 26_000), 60, ">= 95 %"
        ),
    ],
    "real-sides": [
        SuiteRow(
            "sides, 80,000", _make_our_settings(REAL, "sides", 80_000), 60, ">= 98 %"
        ),
        SuiteRow(
            "sides, 26,000", _make_our_settings(REAL, "sides", 26_000), 60, ">= 85 %"
        ),
    ],
    "few-actions": [
        _make_few_actions_row(*row) for row in product((10, 8, 6), (False, True))
    ],
    "full": [SuiteRow("hinges unknown, lengths known, 262,000", _FULL, 60, ">= 90 %")],
    "simulated": [
        SuiteRow(
            "hidden starfish", _make_our_settings(HIDDEN, "free", 262_000), 30, "30/30"
        ),
        SuiteRow(
            "hidden trees",
            _make_our_settings("tree:{seed}", "free", 262_000),
            60,
            ">= 95 % or like it",
        ),
    ],
    "described": [
        SuiteRow(name, _describe(name, budget), 20, ">= 90 % or like it")
        for name, budget in DESCRIBED.items()
    ],
    "mjx": [SuiteRow("free, 262,000, every simulation on mjx", _MJX, 3, "<= 720 s")],
}
