"""Units of logs: their names in, factors to the SI units of the contract out."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from pydantic.dataclasses import dataclass

from ..documents import read_toml
from ..errors import UnknownNameError


@dataclass(frozen=True)
class Unit:
    """How a unit is converted: value in SI = factor * value + offset.

    Attributes:
        si: the unit of the contract to which it is converted.
        offset: [si], of a temperature.
        also: other spellings of its name.
    """

    si: str
    factor: float = 1.0
    offset: float = 0.0
    also: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Units:
    units: dict[str, Unit]


@cache
def _read_units() -> Mapping[str, Unit]:
    """Units by name, as `units.toml` has them."""
    return read_toml(Path(__file__).with_suffix(".toml"), _Units).units


@cache
def _list_spellings() -> Mapping[str, Unit]:
    """Units by each of their names."""
    units = _read_units()
    also = {name: unit for unit in units.values() for name in unit.also}
    return {**also, **units}


def find_unit(name: str) -> Unit | None:
    """The unit of a name, as logs spell it; None where nobody knows it."""
    known, name = _list_spellings(), " ".join(name.split())
    return known.get(name) or known.get(name.lower())


def get_unit(name: str) -> Unit:
    """The unit of a name.

    Raises:
        UnknownNameError: it is none of those that are known.
    """
    found = find_unit(name)
    if found is None:
        raise UnknownNameError("unit", name, _read_units())
    return found


def list_units(si: str) -> list[str]:
    """Names of units that are converted to one of the contract."""
    return [name for name, unit in _read_units().items() if unit.si == si]
