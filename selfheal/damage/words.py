"""Damages in words: a user's text in, damages out; what makes no sense is refused."""

import math
from collections.abc import Collection, Iterable, Mapping

from ..body.body import Anatomy
from ..errors import InputError, UnknownNameError
from ..printable import join_names
from .kinds import KINDS, Damage, DamageKind

_LARGEST_VALUE = 1e6  # beyond it a value is no damage; chosen
_MOST_TURN = 360  # [deg] of an azimuth that a user writes
_SAYABLE = {kind.usage.partition(":")[0]: kind for kind in KINDS.values() if kind.usage}
_SCALED = _SAYABLE.pop("PART")  # is written without a word of its own
WORDS = tuple(_SAYABLE)
USAGE = ", ".join(kind.usage for kind in (_SCALED, *_SAYABLE.values()))


def list_names(anatomy: Anatomy) -> dict[str, tuple[str, ...]]:
    """Names of what may break of a robot, by the sort of target."""
    from ..engine.walk import list_channels

    return {
        "body": anatomy.parts,
        "joint": anatomy.joints,
        "actuator": tuple(f"{joint}_servo" for joint in anatomy.joints),
        "sensor": tuple(dict.fromkeys(list_channels(anatomy).sensors[:-2])),
        "world": ("",),
    }


def list_targets(anatomy: Anatomy) -> dict[str, tuple[str, ...]]:
    """Names that targets may have, by their sort: an actuator also its joint's."""
    names = list_names(anatomy)
    return {**names, "actuator": (*names["actuator"], *anatomy.joints)}


def explain_misfit(
    damage: Damage, names: Mapping[str, Collection[str]] | None = None
) -> str:
    """What of a damage makes no sense, in words; "" if nothing.

    Args:
        names: what a robot has of each sort of target, "body" say; None: any names.
    """
    if damage.kind not in KINDS:
        return f"kind {damage.kind!r}; would fit: {', '.join(KINDS)}"
    kind, (found, _, name) = KINDS[damage.kind], damage.target.partition(":")
    if found != kind.sort or (kind.sort == "world") == bool(name):
        return f"target {damage.target!r}; would fit: a {kind.sort}"
    if names is not None and name and name not in names.get(kind.sort, ()):
        fits = join_names(names.get(kind.sort, ())) or "none"
        return f"target {damage.target!r}; would fit: {fits}"
    value, azimuth = damage.value, damage.azimuth
    if not max(kind.least, -_LARGEST_VALUE) <= value <= _LARGEST_VALUE:
        return f"value {value:g}; would fit: {kind.meaning}"
    if not abs(azimuth) <= _LARGEST_VALUE:
        return f"azimuth {azimuth:g}; would fit: an angle [rad]"
    return ""


def describe_damages(damages: Iterable[Damage]) -> str:
    """Damages in words."""
    return " and ".join(map(str, damages)) or "nothing broke"


def parse_damages(text: str, anatomy: Anatomy) -> tuple[Damage, ...]:
    """The damages that a user's text names.

    Args:
        text: as in "right_lower:0.1", "loss:left_upper" or "jam:left_hip:20"; several
            with commas between.

    Raises:
        InputError: there are none; the message lists what would fit.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    usage = f"{USAGE}, or several with commas between"
    if not words:
        raise InputError(f"no damage given; say {usage}")
    found = tuple(_parse_damage(word, anatomy, usage) for word in words)
    places = [damage.place for damage in found]
    for word, place in zip(words, places, strict=True):
        if places.count(place) > 1:
            raise InputError(f"damage {word!r}: the same is said twice")
    return found


def _parse_damage(word: str, anatomy: Anatomy, usage: str) -> Damage:
    """The damage of one word."""
    first, *rest = word.split(":")
    kind = _SAYABLE.get(first, _SCALED)
    if kind is _SCALED:
        rest = [first, *rest] if rest else []
    most = kind.usage.count(":") + (kind is _SCALED)
    if len(rest) > most or (kind is _SCALED and not rest):
        raise InputError(f"damage {word!r} is not understood; say {usage}")
    name, *numbers = (rest or [""]) if kind.sort != "world" else ["", *(rest or [""])]
    value = azimuth = 0.0
    if kind.limits is not None:
        default = "" if kind.default is None else f"{kind.default:g}"
        value = _parse_number(word, (*numbers, default)[0], *kind.limits)
    if kind.has_azimuth:
        azimuth = _parse_number(word, (*numbers, "0")[1], -_MOST_TURN, _MOST_TURN)
    value = math.radians(value) if kind.is_angle else value
    target = _find_target(kind, name, list_names(anatomy)[kind.sort])
    return Damage(kind.name, target, value, math.radians(azimuth))


def _find_target(kind: DamageKind, name: str, valid: tuple[str, ...]) -> str:
    """A target's full name; an actuator may be named by its joint."""
    if kind.sort == "actuator" and f"{name}_servo" in valid:
        name = f"{name}_servo"
    if name not in valid:
        raise UnknownNameError(
            "part" if kind.sort == "body" else kind.sort, name, valid
        )
    return kind.make_target(name)


def _parse_number(word: str, text: str, low: float, high: float) -> float:
    """A number within bounds."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise InputError(
            f"damage {word!r} needs a number from {low:g} to {high:g}, not {text!r}"
        )
    return value
