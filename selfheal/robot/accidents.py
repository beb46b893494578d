"""Accidents: a user's words, or a seed, in; what happens to a hidden robot out."""

from dataclasses import replace

import numpy as np

from ..body.body import Anatomy, Bodies
from ..body.damage import Damage, Strike, list_sensors, parse_damages
from ..engine.plant import list_gone_targets
from ..errors import InputError

# Chosen: wide enough to matter, and inside paper A's 0.1 to 2 for scales.
_SCALE, _STRENGTH, _JAM = (0.1, 0.75), (0.15, 0.5), np.radians((-45.0, 45.0))
_SLOPE, _FRICTION = np.radians((5.0, 12.0)), (0.05, 0.2)
BODY_KINDS = ("part_scale", "limb_loss", "joint_jam", "weak_motor", "sensor_dead")
WORLD_KINDS = ("slope", "ground_friction")
# [s] between damages; chosen: an hour has about six, and what is left of the robot of
# 2006 after as many still walks. Of less than 20 minutes it is half, for two damages.
_MEAN_TIME = 600.0
_TRIES = 1000  # draws in vain after which all that can break is broken; chosen
_GROWING, _STEPS = ("part_scale", "weak_motor"), 3  # kinds that come in so many steps


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
    if kind == "weak_sensor":
        sensor = f"sensor:{rng.choice(list_sensors(anatomy))}"
        return Damage(kind, sensor, float(rng.uniform(*_STRENGTH)))
    if kind == "slope":
        azimuth = float(rng.uniform(0, 2 * np.pi))
        return Damage(kind, value=float(rng.uniform(*_SLOPE)), azimuth=azimuth)
    return Damage(kind, value=float(rng.uniform(*_FRICTION)))


def draw_strikes(
    body: Bodies, seconds: float, rest: float, rng: np.random.Generator
) -> tuple[Strike, ...]:
    """Draw what happens to a robot in a time, one damage on top of the other.

    Times are a Poisson process's, with a pause after each. Half of the parts that
    shrink and of the motors that weaken do so in equal steps, of which each comes at
    one of the next times, with others between.

    Args:
        body: the robot's, whole, a batch of one.
        seconds: how long [s].
        rest: pause before the first, and after each [s].
    """
    mean, time = min(_MEAN_TIME, seconds / 2), 0.0
    strikes, growing = list[Strike](), list[Damage]()
    while (time := time + rest + rng.exponential(max(mean - rest, 0.0))) < seconds:
        gone = list_gone_targets(body, [strike.damage for strike in strikes])
        growing = [damage for damage in growing if damage.target not in gone]
        if growing and rng.random() < 0.5:
            damage = growing.pop(0)
        else:
            drawn = _draw_possible(body.anatomy, rng, gone)
            if drawn is None:
                break
            damage = drawn
            if damage.kind in _GROWING and rng.random() < 0.5:
                damage = replace(damage, value=damage.value ** (1 / _STEPS))
                growing += [damage] * (_STEPS - 1)
        strikes.append(Strike(round(time, 3), damage))
    return tuple(strikes)


def _draw_possible(
    anatomy: Anatomy, rng: np.random.Generator, gone: set[str]
) -> Damage | None:
    """Draw a damage of a target that is not gone; None where hardly one is left."""
    for _ in range(_TRIES):
        damage = draw_damage(anatomy, rng, (*BODY_KINDS, "weak_sensor"))
        if damage.target not in gone:
            return damage
    return None
