"""Accidents: a user's words, or a seed, in; what happens to a hidden robot out."""

from dataclasses import replace

import numpy as np

from ..body.body import Anatomy, Bodies
from ..damage.apply import Strike, list_gone_targets
from ..damage.kinds import KINDS, Damage
from ..damage.words import list_names, parse_damages
from ..errors import InputError

BODY_KINDS = ("part_scale", "limb_loss", "joint_jam", "weak_motor", "sensor_dead")
WORLD_KINDS = ("slope", "ground_friction")
# [s] between damages; chosen: an hour has about six, and what is left of the robot of
# 2006 after as many still walks. Of less than 20 minutes it is half, for two damages.
_MEAN_TIME = 600.0
_TRIES = 1000  # draws in vain after which all that can break is broken; chosen
_STEPS = 3  # of damages that grow; chosen


def parse_accident(text: str, anatomy: Anatomy) -> tuple[Damage, ...]:
    """The damages of a text as `damage.words.parse_damages` takes, or of "random:SEED".

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
    kind = KINDS[str(rng.choice(kinds))]
    target = kind.make_target(str(rng.choice(list_names(anatomy)[kind.sort])))
    azimuth = float(rng.uniform(0, 2 * np.pi)) if kind.has_azimuth else 0.0
    value = float(rng.uniform(*kind.drawn)) if kind.drawn else 0.0
    return Damage(kind.name, target, value, azimuth)


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
            if KINDS[damage.kind].grows and rng.random() < 0.5:
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
