"""Searches of controllers and damage that take a second."""

from collections.abc import Callable

from selfheal.body.damage import Damage
from selfheal.gait import genetic
from selfheal.recovery import explain, recover

LOST = Damage("limb_loss", "body:left_front_upper")
LOWER = Damage("limb_loss", "body:left_front_lower")
JAM = Damage("joint_jam", "joint:right_back_hip")
DEAF = Damage("sensor_dead", "sensor:left_back_lower_touch")


def shorten(patch: Callable[[object, str, object], None]) -> None:
    """Make searches short, by `setattr` or one that undoes."""
    patch(genetic, "POPULATION", 12)
    patch(genetic, "KEPT", 6)
    patch(genetic, "_PAIRS", 2)
    patch(recover, "KEPT", 4)
    patch(recover, "HARDWARE_GENERATIONS", 2)
    patch(explain, "list_single_damages", lambda robot: [LOST, LOWER, JAM, DEAF])
