"""Recoveries as records: what was asked, the phases so far, the hypotheses in them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import ClassVar

from ..body.damage import Damage, spoken
from ..body.legged import Legged, legged
from .estimate import Hypothesis, Trial
from .phased import Phase, PhasedRun

METHODS = {
    "ours": "sensor series, graded damage, the world; trials that separate hypotheses",
    "as-described": "the two searches of 2004, by displacement alone",
    "hardware-only": "the control of 2004: evolution on the robot itself",
}
TRIALS = 3  # after the failure (overview.txt 4.4)


@dataclass(frozen=True)
class RecoverSettings:
    """What a recovery was asked to do.

    Attributes:
        robot: of `body.legged.LEGGED`.
        scenario: its number.
        damage: what happens to the hidden robot.
        method: of `METHODS`.
        seed: of everything random.
        reach: of the joints [deg].
        apart: whether each degree of freedom can break by itself.
        gap: share by which the hidden robot may be off the model.
        trials: after the failure.
        generations: of each search.
    """

    robot: str
    scenario: int
    damage: tuple[Damage, ...]
    method: str = "ours"
    seed: int = 0
    reach: float = 30.0
    apart: bool = False
    gap: float = 0.0
    trials: int = TRIALS
    generations: int = 30

    @property
    def legged(self) -> Legged:
        """The robot's body as it was built."""
        return legged(self.robot, self.reach, self.apart)


@dataclass(frozen=True)
class RecoverRun(PhasedRun):
    """A recovery, finished or not."""

    WHAT: ClassVar[str] = "recovery's file"
    FORMAT: ClassVar[str] = "selfheal-recover-run"
    VERSION: ClassVar[int] = 2
    SETTINGS: ClassVar[type] = RecoverSettings

    settings: RecoverSettings

    @property
    def estimates(self) -> list[Phase]:
        """What was believed after each trial, the last one last."""
        return [p for name, p in self.phases.items() if name.startswith("estimate")]

    @property
    def trials(self) -> list[Trial]:
        """What the broken robot has answered so far, its failure first."""
        done = self.phases
        asked = {"failure": "original"}
        asked |= {f"trial-{k}": f"explore-{k}" for k in range(1, len(done) + 1)}
        return [Trial(done[by]["weights"], float(done[name]["way"]),
                      done[name]["sensed"])
                for name, by in asked.items() if name in done]  # fmt: skip


def hypotheses_document(hypotheses: Sequence[Hypothesis]) -> list[list[dict]]:
    """Hypotheses as a phase keeps them."""
    return [[asdict(damage) for damage in h] for h in hypotheses]


def hypotheses_of(phase: Phase) -> list[Hypothesis]:
    """The hypotheses that `hypotheses_document` kept in a phase."""
    return [tuple(Damage(**d) for d in h) for h in phase["believed"]]


def believed(phase: Phase) -> dict[str, float]:
    """What a phase believes, in words, and how likely each is; the best one first.

    Hypotheses that only differ in digits that are not said count as one.
    """
    shares: dict[str, float] = {}
    for h, chance in zip(hypotheses_of(phase), phase["probability"], strict=True):
        shares[spoken(h)] = shares.get(spoken(h), 0.0) + float(chance)
    return shares
