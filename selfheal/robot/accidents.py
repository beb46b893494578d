"""Accidents: a user's words, or a seed, in; what happens to a hidden robot out."""

import numpy as np

from ..body.body import Anatomy
from ..body.damage import Damage, list_sensors, parse_damages
from ..errors import InputError

# Chosen: wide enough to matter, and inside paper A's 0.1 to 2 for scales.
_SCALE, _STRENGTH, _JAM = (0.1, 0.75), (0.15, 0.5), np.radians((-45.0, 45.0))
_SLOPE, _FRICTION = np.radians((5.0, 12.0)), (0.05, 0.2)
BODY_KINDS = ("part_scale", "limb_loss", "joint_jam", "weak_motor", "sensor_dead")
WORLD_KINDS = ("slope", "ground_friction")


def parse_accident(text: str, anatomy: Anatomy) -> tuple[Damage, ...]:
    """The damages of a text as `body.damage.parse_damages` takes, or of "random:SEED".

    Raises:
        InputError: it is neither.
    """
    kind, _, seed = text.partition(":")
    if kind != "random":
        return parse_damages(text, anatomy)
    if not seed.isdecimal():
        raise InputError(
            f"random damage takes a seed and stands alone, as random:7; not {text!r}"
        )
    rng = np.random.default_rng([int(seed), 6])
    return (draw_damage(anatomy, rng, BODY_KINDS + WORLD_KINDS),)


def draw_damage(
    anatomy: Anatomy, rng: np.random.Generator, kinds: tuple[str, ...]
) -> Damage:
    """Draw a damage: one of the kinds, each as likely, then its target and value.

    Args:
        anatomy: the robot's parts.
        rng: draws it.
        kinds: of damage that may be drawn.
    """
    kind = str(rng.choice(kinds))
    if kind in ("part_scale", "limb_loss"):
        part = f"body:{rng.choice(anatomy.parts)}"
        scale = float(rng.uniform(*_SCALE)) if kind == "part_scale" else 0.0
        return Damage(kind, part, scale)
    if kind == "joint_jam":
        joint = f"joint:{rng.choice(anatomy.joints)}"
        return Damage(kind, joint, float(rng.uniform(*_JAM)))
    if kind == "weak_motor":
        servo = f"actuator:{rng.choice(anatomy.joints)}_servo"
        return Damage(kind, servo, float(rng.uniform(*_STRENGTH)))
    if kind == "sensor_dead":
        return Damage(kind, f"sensor:{rng.choice(list_sensors(anatomy))}")
    if kind == "slope":
        azimuth = float(rng.uniform(0, 2 * np.pi))
        return Damage(kind, value=float(rng.uniform(*_SLOPE)), azimuth=azimuth)
    return Damage(kind, value=float(rng.uniform(*_FRICTION)))
