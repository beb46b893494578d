"""Robots after damages: plants and damages in, damaged plants out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..body.body import Bodies
from ..body.legged import LeggedRobot
from .kinds import KINDS, Damage

if TYPE_CHECKING:  # they load MuJoCo
    from ..engine.plant import Plant
    from ..engine.reflex import LeggedPlants


@dataclass(frozen=True)
class Strike:
    """A damage that happens at some time.

    Attributes:
        time: when [s].
        damage: what; on top of whatever happened before.
    """

    time: float
    damage: Damage


def apply_damages(plant: "Plant", *damages: Damage) -> "Plant":
    """The plant after these damages, in order."""
    for damage in damages:
        plant = KINDS[damage.kind].change_plant(plant, damage)
    return plant


def list_gone_targets(body: Bodies, damages: Sequence[Damage]) -> set[str]:
    """Targets of damages that can change nothing more after some damages."""
    gone = (KINDS[damage.kind].list_gone(body, damage.name) for damage in damages)
    return set[str]().union(*gone)


def build_damaged_plants(
    robot: LeggedRobot, damages: Sequence[Sequence[Damage]]
) -> "LeggedPlants":
    """Robots after their damages, one for each element."""
    from ..engine.reflex import build_intact_plants

    plants = build_intact_plants(robot, len(damages))
    for row, several in enumerate(damages):
        for damage in several:
            KINDS[damage.kind].change_legged(plants, row, damage)
    return plants


def reduce_damages(robot: LeggedRobot, damages: Sequence[Damage]) -> tuple[Damage, ...]:
    """Damages in one order, without those that others among them imply.

    Descendants of a lost part are lost, nothing of them jams or is driven, and the
    angle sensor of a broken joint is gone.
    """
    kept = set(damages)
    for damage in damages:
        implied = KINDS[damage.kind].list_implied(robot, damage.name)
        kept = {d for d in kept if d == damage or d.target not in implied}
    return tuple(sorted(kept, key=lambda d: (*d.place, d.value, d.azimuth)))
