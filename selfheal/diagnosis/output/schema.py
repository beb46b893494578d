"""Entries of diagnosis.json: takes them as read, refuses what no replay could use.

What a finding may state follows from what its effect declares.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...documents import shorten_value
from ...errors import InputError, UnknownNameError
from ..effects import load_catalogue
from ..effects.base import Effect
from ..effects.declaration import FindingField, ParameterSpec

SIZE_WORDS = {2: "two", 3: "three", 4: "four", 6: "six"}  # sizes of vectors
MAX_FINDING_VALUE = 1e12  # beyond it no robot has a parameter in any unit; chosen


def check_entries(path: object, document: Mapping[str, Any]) -> None:
    """Refuse findings and re-fitted values that say nothing a replay could use.

    Raises:
        InputError: the first one, by file and entry, and what would fit.
    """
    checks = {
        "findings": _check_finding,
        "refit": _check_refit,
    }
    for key, check in checks.items():
        entries = document.get(key)
        if not isinstance(entries, list):
            raise InputError(f"{path}: {key} is no list; would fit: a list of entries")
        for i, entry in enumerate(entries):
            where = f"{path}, {key}[{i}]"
            if not isinstance(entry, dict):
                raise _misfit_error(where, "the entry", entry, "an object with names")
            check(where, entry)


def _check_finding(where: str, entry: Mapping[str, Any]) -> None:
    """Refuse a finding that contradicts what its effect declares."""
    name = entry.get("effect")
    if not isinstance(name, str):
        fits = "a name that 'selfheal effects' lists"
        raise _misfit_error(where, "effect", name, fits)
    catalogue = load_catalogue()
    if name not in catalogue:
        raise UnknownNameError(f"effect in {where}:", name, catalogue)
    effect = catalogue[name]
    _check_target(where, "target", entry.get("target"), effect.target_kinds)
    _check_parameters(where, entry.get("parameters"), effect)
    for field in effect.finding_fields:
        if field.is_required or field.name in entry:
            _check_field(where, entry.get(field.name), field)
    own = {field.name for field in effect.finding_fields}
    fields = {f.name for other in catalogue.values() for f in other.finding_fields}
    for key in sorted(fields - own):
        if key in entry:
            raise _misfit_error(where, key, entry[key], f"no {key} beside {name}")
    if not isinstance(native := entry.get("native", False), bool):
        raise _misfit_error(where, "native", native, "true or false")


def _check_target(where: str, key: str, target: Any, kinds: Sequence[str]) -> None:
    """Refuse what is no target ("joint:knee", "world").

    Args:
        where: file and entry, for the message.
    """
    kind, colon, name = target.partition(":") if isinstance(target, str) else [""] * 3
    if kind not in kinds or (kind == "world") == bool(colon and name):
        fits = [k if k == "world" else f"{k}: and a name" for k in kinds]
        raise _misfit_error(where, key, target, ", ".join(fits))


def _check_field(where: str, value: Any, field: FindingField) -> None:
    """Refuse a value that a finding's field cannot have.

    Args:
        where: file and entry, for the message.
    """
    if field.target_kind:
        _check_target(where, field.name, value, (field.target_kind,))
    elif isinstance(value, bool) or value not in field.values:
        fits = " or ".join(map(repr, field.values))
        raise _misfit_error(where, field.name, value, fits)


def _check_parameters(where: str, entries: Any, effect: Effect) -> None:
    """Refuse parameters that the effect does not declare.

    Args:
        where: file and entry, for the message.
        entries: "parameters" of a finding, as read.
    """
    is_list = isinstance(entries, list)
    if not is_list or not all(isinstance(p, dict) for p in entries):
        fits = "a list, each with name and value"
        raise _misfit_error(where, "parameters", entries, fits)
    names = [p.get("name") for p in entries]
    sets = effect.list_parameter_sets()
    if tuple(names) not in sets:
        fits = " or ".join(", ".join(each) or "none" for each in sets)
        raise _misfit_error(where, "names of parameters", names, fits)
    specs = {spec.name: spec for spec in effect.parameters}
    for entry in entries:
        _check_value(where, entry.get("value"), specs[entry["name"]])


def _check_value(where: str, value: Any, spec: ParameterSpec) -> None:
    """Refuse a value of another size than declared, or of the wrong sign.

    Args:
        where: file and entry, for the message.
    """
    what = f"value of {spec.name}"
    is_list = isinstance(value, list)
    if spec.size is None and is_list:
        if not value or not all(map(_is_number, value)):
            fits = "a number, or one for each column"
            raise _misfit_error(where, what, value, fits)
    elif spec.size not in (None, 1):
        if not is_list or len(value) != spec.size or not all(map(_is_number, value)):
            fits = f"{SIZE_WORDS.get(spec.size, spec.size)} numbers"
            raise _misfit_error(where, what, value, fits)
    elif not _is_number(value):
        raise _misfit_error(where, what, value, "a number")
    elif spec.nonnegative and value < 0:
        raise _misfit_error(where, what, value, "0 or more")
    if np.max(np.abs(value)) > MAX_FINDING_VALUE:
        fits = f"{-MAX_FINDING_VALUE:g} to {MAX_FINDING_VALUE:g}"
        raise _misfit_error(where, what, value, fits)


def _check_refit(where: str, entry: Mapping[str, Any]) -> None:
    """Refuse a re-fitted value without a name and two numbers."""
    if not isinstance(entry.get("parameter"), str):
        fits = "a text such as 'joint:knee/damping'"
        raise _misfit_error(where, "parameter", entry.get("parameter"), fits)
    for key in ("given", "value"):
        if not _is_number(entry.get(key)):
            raise _misfit_error(where, key, entry.get(key), "a number")
    given, value = entry["given"], entry["value"]
    if given and abs(float(value)) > MAX_FINDING_VALUE * abs(given):
        fits = f"at most {MAX_FINDING_VALUE:g} times as much as given"
        raise _misfit_error(where, "value", value, fits)


def _is_number(value: Any) -> bool:
    """Whether a value is a finite number that a double holds."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _misfit_error(where: str, what: str, value: Any, fits: str) -> InputError:
    """The error of a value that is wrong."""
    return InputError(f"{where}: {what} is {shorten_value(value)}; would fit: {fits}")
