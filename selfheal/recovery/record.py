"""Heals as records: what was asked, the phases so far, the gaits in them."""

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from ..body.damage import Damage
from ..gait.synthesis import Gait
from .phased_run import Phase, PhasedRun


@dataclass(frozen=True)
class HealSettings:
    """What a heal was asked to do.

    Attributes:
        run: path of the self-modeling run that it starts from.
        damage: what happens to the hidden robot.
        onset: when, in the walk that is watched [s].
        gait: name of the gaits' pattern.
        heading: direction to walk [rad].
        seed: of everything random.
    """

    run: str
    damage: tuple[Damage, ...]
    onset: float
    gait: str = "waves"
    heading: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class HealRun(PhasedRun):
    """A heal, finished or not."""

    WHAT: ClassVar[str] = "heal's file"
    FORMAT: ClassVar[str] = "selfheal-heal-run"
    VERSION: ClassVar[int] = 1
    SETTINGS: ClassVar[type] = HealSettings

    settings: HealSettings

    @property
    def actions(self) -> list[Phase]:
        """The actions taken after the alarm."""
        return [p for name, p in self.phases.items() if name.startswith("ask")]


def serialize_gait(gait: Gait) -> dict[str, Any]:
    """A gait as a phase keeps it."""
    return asdict(gait)


def read_gait(phase: Phase) -> Gait:
    """The gait that `serialize_gait` kept in a phase."""
    kept = phase["gait"]
    return Gait(**{**kept, "genes": np.asarray(kept["genes"], float)})
