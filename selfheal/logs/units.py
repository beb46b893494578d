"""Units of logs: their names in, factors to the SI units of the contract out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..errors import UnknownNameError


@dataclass(frozen=True)
class Unit:
    """How a unit is converted: value in SI = factor * value + offset.

    Attributes:
        si: the unit of the contract to which it is converted.
        factor: of a value.
        offset: [si], of a temperature.
    """

    si: str
    factor: float = 1.0
    offset: float = 0.0


_DEGREE, _TURN = math.pi / 180, 2 * math.pi
_KGF, _LBF, _INCH = 9.80665, 4.4482216152605, 0.0254  # [N] [N] [m], NIST SP 811
# by name; what follows "/s" or "*" is spelled as UCUM and ROS's REP 103 do
_UNITS: Mapping[str, Unit] = {
    "rad": Unit("rad"),
    "mrad": Unit("rad", 1e-3),
    "deg": Unit("rad", _DEGREE),
    "turn": Unit("rad", _TURN),
    "m": Unit("m"),
    "cm": Unit("m", 1e-2),
    "mm": Unit("m", 1e-3),
    "in": Unit("m", _INCH),
    "rad/s": Unit("rad/s"),
    "deg/s": Unit("rad/s", _DEGREE),
    "turn/s": Unit("rad/s", _TURN),
    "rpm": Unit("rad/s", _TURN / 60),
    "m/s": Unit("m/s"),
    "cm/s": Unit("m/s", 1e-2),
    "mm/s": Unit("m/s", 1e-3),
    "m/s^2": Unit("m/s^2"),
    "g": Unit("m/s^2", 9.80665),  # the standard acceleration of gravity, NIST SP 811
    "rad/s^2": Unit("rad/s^2"),
    "N": Unit("N"),
    "kgf": Unit("N", _KGF),
    "N m": Unit("N m"),
    "mN m": Unit("N m", 1e-3),
    "N cm": Unit("N m", 1e-2),
    "N mm": Unit("N m", 1e-3),
    "kgf cm": Unit("N m", _KGF / 100),
    "kgf m": Unit("N m", _KGF),
    "lbf in": Unit("N m", _LBF * _INCH),
    "s": Unit("s"),
    "ms": Unit("s", 1e-3),
    "us": Unit("s", 1e-6),
    "ns": Unit("s", 1e-9),
    "V": Unit("V"),
    "mV": Unit("V", 1e-3),
    "degC": Unit("degC"),
    "K": Unit("degC", 1.0, -273.15),
    "degF": Unit("degC", 5 / 9, -160 / 9),
    "1": Unit("1"),
    "quaternion": Unit("quaternion"),
}
_ALIASES: Mapping[str, str] = {
    **dict.fromkeys(("radian", "radians", "rads"), "rad"),
    **dict.fromkeys(("degree", "degrees", "degs", "°"), "deg"),
    **dict.fromkeys(("rev", "revolution", "revolutions", "turns"), "turn"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    "millimeter": "mm",
    "inch": "in",
    **dict.fromkeys(("rad/sec", "radians/s"), "rad/s"),
    **dict.fromkeys(("°/s", "deg/sec", "dps", "degrees/s"), "deg/s"),
    **dict.fromkeys(("rev/s", "rps"), "turn/s"),
    **dict.fromkeys(("rev/min", "1/min", "r/min"), "rpm"),
    **dict.fromkeys(("m/s2", "m/s²", "m/s/s"), "m/s^2"),
    **dict.fromkeys(("newton", "newtons"), "N"),
    **dict.fromkeys(("Nm", "N*m", "N.m", "N·m", "N-m"), "N m"),
    **dict.fromkeys(("mNm", "mN*m", "mN.m"), "mN m"),
    **dict.fromkeys(("Ncm", "N*cm"), "N cm"),
    **dict.fromkeys(("Nmm", "N*mm", "N.mm"), "N mm"),
    **dict.fromkeys(("kgcm", "kg cm", "kg*cm", "kgf*cm", "kg.cm", "kg-cm"), "kgf cm"),
    **dict.fromkeys(("in lbf", "lbf*in", "in*lbf"), "lbf in"),
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("µs", "μs", "usec", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("°C", "C", "celsius"), "degC"),
    **dict.fromkeys(("kelvin",), "K"),
    **dict.fromkeys(("°F", "F"), "degF"),
    **dict.fromkeys(("unit quaternion", "quat"), "quaternion"),
    **dict.fromkeys(("unitless", "dimensionless", "-"), "1"),
}


def find_unit(name: str) -> Unit | None:
    """The unit of a name, as logs spell it; None where nobody knows it."""
    name = " ".join(name.split())
    for spelled in (name, name.lower()):
        found = _UNITS.get(_ALIASES.get(spelled, spelled))
        if found is not None:
            return found
    return None


def get_unit(name: str) -> Unit:
    """The unit of a name.

    Raises:
        UnknownNameError: it is none of those that are known.
    """
    found = find_unit(name)
    if found is None:
        raise UnknownNameError("unit", name, _UNITS)
    return found


def list_units(si: str) -> list[str]:
    """Names of units that are converted to one of the contract."""
    return [name for name, unit in _UNITS.items() if unit.si == si]
