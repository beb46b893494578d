"""Entries of diagnosis.json: takes them as read, refuses what no replay could use."""

import math
from collections.abc import Mapping
from typing import Any

from ...errors import InputError, UnknownNameError
from ..effects import load_catalogue

# of each effect of contract section 4: what its target is, its parameters
SAID: Mapping[str, tuple[str, str]] = {
    "viscous_friction": ("joint", "damping"),
    "coulomb_friction": ("joint", "frictionloss"),
    "stribeck_friction": ("joint", "coulomb static stribeck_velocity"),
    "load_dependent_friction": ("joint", "load_coefficient"),
    "asymmetric_friction": ("joint", "positive negative"),
    "quadratic_damping": ("joint", "damping2"),
    "backlash": ("joint", "gap"),
    "compliance": ("joint", "stiffness damping"),
    "cogging": ("joint", "amplitude poles phase"),
    "armature": ("joint", "armature"),
    "joint_spring": ("joint", "stiffness springref"),
    "joint_coupling": ("joint", "stiffness ratio"),
    "hard_stop": ("joint", "range"),
    "command_delay": ("actuator", "delay"),
    "actuator_lag": ("actuator", "timeconst"),
    "torque_saturation": ("actuator", "limit"),
    "speed_torque_limit": ("actuator", "stall_torque no_load_speed"),
    "rate_limit": ("actuator", "rate"),
    "servo_gain": ("actuator", "kp kv"),
    "integral_action": ("actuator", "ki imax"),
    "payload": ("body", "mass position"),
    "com_shift": ("body", "x y z"),
    "link_length": ("body", "length"),
    "mount_shift": ("body", "x y z"),
    "limb_loss": ("body", ""),
    "joint_jam": ("joint", "angle"),
    "slope": ("world", "tilt azimuth"),
    "fluid_drag": ("world", "density"),
    "wind": ("world", "vx vy vz"),
    "ground_friction": ("world geom", "friction"),
    "ground_compliance": ("world geom", "timeconst dampratio"),
    "sensor_bias": ("sensor", "bias"),
    "sensor_gain": ("sensor", "gain"),
    "sensor_delay": ("sensor", "delay"),
    "quantization": ("sensor", "step"),
}
OR: Mapping[str, str] = {  # as well
    "servo_gain": "kp", "fluid_drag": "viscosity", "hard_stop": "range timeconst",
}  # fmt: skip
TARGET_KINDS = "joint actuator body geom sensor world"
# what else a finding must say, and what would fit
MORE: Mapping[str, tuple[str, tuple[Any, ...]]] = {
    "hard_stop": ("side", (-1, 1)),
    "backlash": ("measured", ("motor", "link")),
    "compliance": ("measured", ("motor", "link")),
}
NEVER_NEGATIVE = ("delay", "timeconst", "step")


def check_entries(path: object, document: Mapping[str, Any]) -> None:
    """Refuse findings and re-fitted values that say nothing a replay could use.

    Raises:
        InputError: the first one, by file and entry, and what would fit.
    """
    for key, check in (("findings", _check_finding), ("refit", _check_refit)):
        entries = document.get(key)
        if not isinstance(entries, list):
            raise InputError(f"{path}: {key} is no list; would fit: a list of entries")
        for i, entry in enumerate(entries):
            where = f"{path}, {key}[{i}]"
            if not isinstance(entry, dict):
                raise _misfit_error(where, "the entry", entry, "an object with names")
            check(where, entry)


def _check_finding(where: str, entry: Mapping[str, Any]) -> None:
    name = entry.get("effect")
    if not isinstance(name, str):
        raise _misfit_error(
            where, "effect", name, "a name that 'selfheal effects' lists"
        )
    if name not in load_catalogue():
        raise UnknownNameError(f"effect in {where}:", name, load_catalogue())
    sorts, names = SAID.get(name, (TARGET_KINDS, None))
    _check_target(where, "target", entry.get("target"), sorts)
    _check_parameters(
        where, entry.get("parameters"), _list_parameter_names(name, names)
    )
    if name == "joint_coupling":
        _check_target(where, "other", entry.get("other"), "joint")
    if name in MORE and entry.get(MORE[name][0]) not in MORE[name][1]:
        key, fits = MORE[name]
        raise _misfit_error(where, key, entry.get(key), " or ".join(map(repr, fits)))


def _list_parameter_names(effect: str, names: str | None) -> tuple[list[str], ...]:
    """Names of parameters that an effect may have; none: any."""
    either = () if names is None else (names, *filter(None, [OR.get(effect)]))
    return tuple(each.split() for each in either)


def _check_target(where: str, key: str, target: Any, sorts: str) -> None:
    sort, colon, name = target.partition(":") if isinstance(target, str) else [""] * 3
    if sort not in sorts.split() or (sort == "world") == bool(colon and name):
        predicted = [s if s == "world" else f"{s}: and a name" for s in sorts.split()]
        raise _misfit_error(where, key, target, ", ".join(predicted))


def _check_parameters(where: str, predicted: Any, fits: tuple[list[str], ...]) -> None:
    if not isinstance(predicted, list) or not all(
        isinstance(p, dict) for p in predicted
    ):
        raise _misfit_error(
            where, "parameters", predicted, "a list, each with name and value"
        )
    names = [p.get("name") for p in predicted]
    if fits and names not in fits:
        ways = " or ".join(", ".join(each) or "none" for each in fits)
        raise _misfit_error(where, "names of parameters", names, ways)
    for p in predicted:
        value, what = p.get("value"), f"value of {p.get('name')}"
        if p.get("name") == "position":
            if not _is_position(value):
                raise _misfit_error(where, what, value, "three numbers")
        elif p.get("name") == "bias" and isinstance(value, list):
            if not value or not all(map(_is_number, value)):
                raise _misfit_error(
                    where, what, value, "a number, or one for each column"
                )
        elif not _is_number(value):
            raise _misfit_error(where, what, value, "a number")
        elif p.get("name") in NEVER_NEGATIVE and value < 0:
            raise _misfit_error(where, what, value, "0 or more")


def _is_position(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))


def _check_refit(where: str, entry: Mapping[str, Any]) -> None:
    if not isinstance(entry.get("parameter"), str):
        fits = "a text such as 'joint:knee/damping'"
        raise _misfit_error(where, "parameter", entry.get("parameter"), fits)
    for key in ("given", "value"):
        if not _is_number(entry.get(key)):
            raise _misfit_error(where, key, entry.get(key), "a number")


def _is_number(value: Any) -> bool:
    """Whether it is one that a double holds."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _misfit_error(where: str, what: str, value: Any, fits: str) -> InputError:
    said = repr(value)
    said = said if len(said) <= 60 else f"{said[:60]}..."
    return InputError(f"{where}: {what} is {said}; would fit: {fits}")
