"""The suites of identification: what runs, how often, and what it is held against.

Fixed before the runs that are reported. The rules of 2006, and chosen against random
actions, are repeated by `selfheal study table3` and `actions`.
"""

from dataclasses import dataclass

from benchmarks.writer import ROOT
from selfheal.selfmodel.run import Settings

REAL, HIDDEN = "starfish-2006", "starfish"


@dataclass(frozen=True)
class SuiteRow:
    """One configuration of a suite.

    Attributes:
        settings: of its runs; the seed and the recording are filled in, and `{seed}` in
            the robot's name.
    """

    name: str
    settings: Settings
    seeds: int
    target: str


def _search(
    robot: str, space: str, budget: int, *, cycles: int = 16, engine: str = "statics"
) -> Settings:
    """Our method; statics, for its speed, unless a suite or --engine says otherwise."""
    return Settings(robot, space=space, budget=budget, cycles=cycles, engine=engine)


def _describe(name: str, budget: int) -> SuiteRow:
    """A robot that a file describes; as many actions as the arm has."""
    robot = str(ROOT / "models" / "described" / f"{name}.toml")
    settings = _search(robot, "free", budget, cycles=15)
    return SuiteRow(name, settings, 20, ">= 90 % or like it")


_FULL = Settings(
    HIDDEN, space="full", budget=262_000, known_lengths=True, engine="statics"
)
SUITES = {
    "real-free": [
        SuiteRow("free, 262,000", _search(REAL, "free", 262_000), 60, ">= 95 %"),
        SuiteRow("free, 26,000", _search(REAL, "free", 26_000), 60, ">= 95 %"),
    ],
    "real-sides": [
        SuiteRow("sides, 80,000", _search(REAL, "sides", 80_000), 60, ">= 98 %"),
        SuiteRow("sides, 26,000", _search(REAL, "sides", 26_000), 60, ">= 85 %"),
    ],
    "full": [SuiteRow("hinges unknown, lengths known, 262,000", _FULL, 60, ">= 90 %")],
    "simulated": [
        SuiteRow("hidden starfish", _search(HIDDEN, "free", 262_000), 30, "30/30"),
        SuiteRow(
            "hidden trees",
            _search("tree:{seed}", "free", 262_000),
            60,
            ">= 95 % or like it",
        ),
    ],
    "described": [
        _describe(name, 262_000 if name != "quadruped" else 800_000)
        for name in ("arm", "hexapod", "snake", "quadruped")
    ],
    "mjx": [
        SuiteRow(
            "free, 262,000, every simulation on mjx",
            _search(REAL, "free", 262_000, engine="mjx"),
            3,
            "<= 720 s",
        )
    ],
}
