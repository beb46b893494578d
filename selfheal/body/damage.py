"""Damage as data: what may happen to a robot or its world, in words and numbers."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from ..errors import InputError, UnknownNameError
from ..printable import join_names
from .body import Anatomy

# kind: what its target is, and what its value means
KINDS = {
    "none": ("world", "nothing happened"),
    "part_scale": ("body", "factor on a part's length, thickness and mass [1]"),
    "limb_loss": ("body", "a part and all that hangs on it is gone; value 0"),
    "joint_jam": ("joint", "a joint stands still at this angle [rad]"),
    "weak_motor": ("actuator", "factor on a motor's torque and speed [1]"),
    "sensor_dead": ("sensor", "a sensor reads this for ever; value 0"),
    "weak_sensor": ("sensor", "factor on what a sensor reads [1]"),
    "neuron_dead": ("neuron", "a hidden neuron gives this for ever; value 0"),
    "slope": ("world", "the ground tilts by this angle [rad]"),
    "ground_friction": ("world", "sliding friction of the ground [1]"),
    "wind": ("world", "speed of a steady wind [m/s]"),
}
# a user's word: the kind, and how many things may follow it
KIND_WORDS = {
    "loss": ("limb_loss", 1),
    "jam": ("joint_jam", 2),
    "weak": ("weak_motor", 2),
    "dead": ("sensor_dead", 1),
    "lie": ("weak_sensor", 2),
    "slope": ("slope", 2),
    "friction": ("ground_friction", 1),
}
_USAGE = (
    "PART:SCALE, loss:PART, jam:JOINT[:DEGREES], weak:ACTUATOR:FACTOR, dead:SENSOR, "
    "lie:SENSOR[:FACTOR], slope:DEGREES[:AZIMUTH], friction:VALUE, or several with "
    "commas between"
)


@dataclass(frozen=True)
class Damage:
    """One thing that happened.

    Attributes:
        kind: a name of `KINDS`.
        target: "body:NAME", "joint:NAME", "actuator:NAME", "sensor:NAME",
            "neuron:NUMBER" or "world".
        value: what `KINDS` says.
        azimuth: downhill of a slope, or where a wind blows to, from +x toward +y [rad].
    """

    kind: str
    target: str = "world"
    value: float = 0.0
    azimuth: float = 0.0

    @property
    def name(self) -> str:
        """The target's name without what it is; empty for the world."""
        return self.target.partition(":")[2]

    @property
    def document(self) -> dict[str, str | float]:
        """What the contract shows of it (section 3)."""
        value = round(float(self.value), 6)
        return {"kind": self.kind, "target": self.target, "value": value}

    def __str__(self) -> str:
        """It in a few words."""
        value, name = self.value, self.name.replace("_", " ")
        return {
            "none": "nothing",
            "part_scale": f"{name} x {value:.2f}",
            "limb_loss": f"{name} lost",
            "joint_jam": f"{name} jammed at {math.degrees(value):.0f} deg",
            "weak_motor": f"{name} at {value:.2f} of its strength",
            "sensor_dead": f"sensor {name} dead",
            "weak_sensor": f"sensor {name} at {value:.2f}",
            "neuron_dead": f"hidden neuron {name} dead",
            "slope": f"slope of {math.degrees(value):.0f} deg",
            "ground_friction": f"ground friction {value:.2f}",
            "wind": f"wind of {value:.0f} m/s",
        }[self.kind]


@dataclass(frozen=True)
class Strike:
    """A damage that happens at some time.

    Attributes:
        time: when [s].
        damage: what; on top of whatever happened before.
    """

    time: float
    damage: Damage


INTACT = Damage("none")
_LARGEST_VALUE = 1e6  # beyond it a value is no damage; chosen
_FACTOR_KINDS = ("part_scale", "weak_motor", "weak_sensor", "ground_friction")


def explain_misfit(
    damage: Damage, names: Mapping[str, Collection[str]] | None = None
) -> str:
    """What of a damage makes no sense, in words; "" if nothing.

    Args:
        names: what a robot has of each sort of target, "body" say; None: any names.
    """
    if damage.kind not in KINDS:
        return f"kind {damage.kind!r}; would fit: {', '.join(KINDS)}"
    sort, (found, _, name) = KINDS[damage.kind][0], damage.target.partition(":")
    if found != sort or (sort == "world") == bool(name):
        return f"target {damage.target!r}; would fit: a {sort}"
    if names is not None and name and name not in names.get(sort, ()):
        fits = join_names(names.get(sort, ())) or "none"
        return f"target {damage.target!r}; would fit: {fits}"
    low = 0.0 if damage.kind in _FACTOR_KINDS else -_LARGEST_VALUE
    value, azimuth = damage.value, damage.azimuth
    if not low <= value <= _LARGEST_VALUE or (damage.kind, value) == ("part_scale", 0):
        return f"value {value:g}; would fit: {KINDS[damage.kind][1]}"
    if not abs(azimuth) <= _LARGEST_VALUE:
        return f"azimuth {azimuth:g}; would fit: an angle [rad]"
    return ""


def list_targets(anatomy: Anatomy) -> dict[str, tuple[str, ...]]:
    """Names of what may break of a robot, by what it is."""
    servos = tuple(f"{joint}_servo" for joint in anatomy.joints)
    return {
        "body": anatomy.parts,
        "joint": anatomy.joints,
        "actuator": (*servos, *anatomy.joints),
        "sensor": list_sensors(anatomy),
    }


def describe_damages(damages: Iterable[Damage]) -> str:
    """Damages in words."""
    return " and ".join(map(str, damages)) or "nothing broke"


def list_sensors(anatomy: Anatomy) -> tuple[str, ...]:
    """Names of the signals that a walking robot gives and that can die."""
    angles = tuple(f"{joint}_position" for joint in anatomy.joints)
    touch = tuple(f"{anatomy.parts[f - 1]}_touch" for f in anatomy.feet)
    return ("vertical", "clearance", *angles, *touch)


def parse_damages(text: str, anatomy: Anatomy) -> tuple[Damage, ...]:
    """The damages that a user's text names.

    Args:
        text: as in "right_lower:0.1", "loss:left_upper" or "jam:left_hip:20"; several
            with commas between.

    Raises:
        InputError: it says none; the message lists what would.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words:
        raise InputError(f"no damage given; say {_USAGE}")
    found = tuple(_parse_damage(word, anatomy) for word in words)
    for k, word in enumerate(words):
        same = [(d.kind, d.target) == (found[k].kind, found[k].target) for d in found]
        if sum(same) > 1:
            raise InputError(f"damage {word!r}: the same is said twice")
    return found


def _parse_damage(word: str, anatomy: Anatomy) -> Damage:
    """The damage of one word."""
    first, *rest = word.split(":")
    kind, most = KIND_WORDS.get(first, ("part_scale", 1))
    if len(rest) > most or (kind == "part_scale" and not rest):
        raise InputError(f"damage {word!r} is not understood; say {_USAGE}")
    rest = rest or [""]
    if kind == "part_scale":
        target = _parse_target("body", first, anatomy.parts)
        return Damage(kind, target, _parse_number(word, rest[0], 0.05, 2.0))
    if kind == "limb_loss":
        return Damage(kind, _parse_target("body", rest[0], anatomy.parts))
    if kind in ("sensor_dead", "weak_sensor"):
        target = _parse_target("sensor", rest[0], list_sensors(anatomy))
        if kind == "sensor_dead":
            return Damage(kind, target)
        return Damage(kind, target, _parse_number(word, (*rest, "0.5")[1], 0.05, 1.0))
    if kind == "joint_jam":
        angle = _parse_number(word, rest[1] if len(rest) > 1 else "0", -90, 90)
        target = _parse_target("joint", rest[0], anatomy.joints)
        return Damage(kind, target, math.radians(angle))
    if kind == "weak_motor":
        servos = tuple(f"{joint}_servo" for joint in anatomy.joints)
        target = _parse_target("actuator", rest[0], servos)
        return Damage(kind, target, _parse_number(word, (*rest, "0.5")[1], 0.05, 1.0))
    if kind == "slope":
        azimuth = _parse_number(word, (*rest, "0")[1], -360, 360)
        tilt = _parse_number(word, rest[0], 0, 40)
        return Damage(kind, value=math.radians(tilt), azimuth=math.radians(azimuth))
    return Damage(kind, value=_parse_number(word, rest[0], 0.01, 5.0))


def _parse_target(what: str, name: str, valid: tuple[str, ...]) -> str:
    """A target's full name; an actuator may be named by its joint."""
    if what == "actuator" and f"{name}_servo" in valid:
        name = f"{name}_servo"
    if name not in valid:
        raise UnknownNameError("part" if what == "body" else what, name, valid)
    return f"{what}:{name}"


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
