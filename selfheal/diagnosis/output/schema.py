"""diagnosis.json (contract, section 2): its types, and what no replay could use.

What a finding may state follows from what its effect declares.
"""

import json
from collections.abc import Sequence
from typing import Annotated, Required

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from ...documents import explain_misfit, shorten_value
from ...errors import InputError, UnknownNameError
from ..effects import load_catalogue
from ..effects.base import Effect
from ..effects.declaration import FindingField, ParameterSpec

SIZE_WORDS = {2: "two", 3: "three", 4: "four", 6: "six"}  # sizes of vectors
MAX_FINDING_VALUE = 1e12  # beyond it no robot has a parameter in any unit; chosen

Number = Annotated[float, Field(allow_inf_nan=False)]
Unknown = Number | None  # what is not finite is null
Value = Unknown | list[Unknown]  # a vector has a number for each component


class StatedParameter(TypedDict, total=False):
    """A parameter of a finding; `given` is what the model states in its place."""

    name: Required[str]
    value: Required[Number | list[Number]]
    low: Value
    high: Value
    given: Unknown
    unit: str | None


class SignalShare(TypedDict, total=False):
    """A signal in which a finding shows."""

    name: Required[str]
    share_of_error: Unknown
    p_value: Unknown


class Window(TypedDict):
    """A stretch of an episode [s]."""

    episode: str
    start: Unknown
    end: Unknown


class OnsetTime(TypedDict):
    """When an effect set in [s], and the ends of its 90 % interval."""

    episode: str
    time: Unknown
    low: Unknown
    high: Unknown


class Location(TypedDict, total=False):
    """Where an effect lowers the error."""

    signals: list[SignalShare]
    regime: str
    windows: list[Window]
    onset: OnsetTime


class Finding(TypedDict, total=False):
    """An effect at a place; beside these, the fields that the effect declares."""

    effect: Required[str]
    target: Required[str]
    parameters: Required[list[StatedParameter]]
    equivalent: list[str]
    separate_by: str
    where: Location
    evidence: dict[str, Unknown] | None
    native: bool


class Refit(TypedDict, total=False):
    """A value that the model states, as given and re-fitted."""

    parameter: Required[str]
    given: Required[Number]
    value: Required[Number]
    low: Unknown
    high: Unknown
    unit: str | None


class Confounded(TypedDict):
    """Values that the recordings tell only together."""

    together: list[str]
    words: str
    fixed_by: str


class Errors(TypedDict, total=False):
    """Errors of each model, and the floor."""

    given: Unknown
    refit: Unknown
    patched: Unknown
    floor: Unknown


class KindErrors(Errors):
    """Root mean square errors of one kind of signal [unit]."""

    kind: str
    unit: str


class Scores(Errors, total=False):
    """Normalized errors [1] of a replay, in segments of so many seconds if stated."""

    seconds: Number
    explainable_removed: Unknown
    errors: list[KindErrors] | None


class FitScores(Scores, total=False):
    """Scores in whole held-out episodes, and in longer and longer segments."""

    held_out: list[str]
    horizons: list[Scores]


Stop = TypedDict(
    "Stop", {"while": str, "tried": int, "of": int, "not_tried": list[str]}
)


class Document(TypedDict, total=False):
    """diagnosis.json."""

    format: str
    version: int
    verdict: str
    findings: Required[list[Finding]]
    refit: Required[list[Refit]]
    unidentified: list[Confounded]
    fit: FitScores
    unpatched: str
    stopped: Stop


_DOCUMENT = TypeAdapter(Document)


def check_entries(path: object, document: Document) -> None:
    """Refuse a document that says nothing a replay could use.

    Raises:
        InputError: the first misfit, by file and entry, and what would fit.
    """
    text = json.dumps(document)
    try:
        _DOCUMENT.validate_json(text, strict=True)
    except ValidationError as error:
        place, wrong, fits = explain_misfit("", error, text)
        end = fits and f"; would fit: {fits}"
        raise InputError(f"{path}: {place} is {wrong}{end}") from error
    for i, finding in enumerate(document["findings"]):
        _check_finding(f"{path}, findings[{i}]", finding)
    for i, entry in enumerate(document["refit"]):
        given, value = entry["given"], entry["value"]
        if given and abs(value) > MAX_FINDING_VALUE * abs(given):
            fits = f"at most {MAX_FINDING_VALUE:g} times as much as given"
            raise _misfit_error(f"{path}, refit[{i}]", "value", value, fits)


def _check_finding(where: str, entry: Finding) -> None:
    """Refuse a finding that contradicts what its effect declares."""
    name, catalogue = entry["effect"], load_catalogue()
    if name not in catalogue:
        raise UnknownNameError(f"effect in {where}:", name, catalogue)
    effect = catalogue[name]
    _check_target(where, "target", entry["target"], effect.target_kinds)
    _check_parameters(where, entry["parameters"], effect)
    for field in effect.finding_fields:
        if field.is_required or field.name in entry:
            _check_field(where, entry.get(field.name), field)
    own = {field.name for field in effect.finding_fields}
    fields = {f.name for other in catalogue.values() for f in other.finding_fields}
    for key in sorted((fields - own) & entry.keys()):
        raise _misfit_error(where, key, entry.get(key), f"no {key} beside {name}")


def _check_target(where: str, key: str, target: object, kinds: Sequence[str]) -> None:
    """Refuse what is no target ("joint:knee", "world")."""
    kind, colon, name = target.partition(":") if isinstance(target, str) else [""] * 3
    if kind not in kinds or (kind == "world") == bool(colon and name):
        fits = [k if k == "world" else f"{k}: and a name" for k in kinds]
        raise _misfit_error(where, key, target, ", ".join(fits))


def _check_field(where: str, value: object, field: FindingField) -> None:
    """Refuse a value that a finding's field cannot have."""
    if field.target_kind:
        _check_target(where, field.name, value, (field.target_kind,))
    elif isinstance(value, bool) or value not in field.values:
        fits = " or ".join(map(repr, field.values))
        raise _misfit_error(where, field.name, value, fits)


def _check_parameters(
    where: str, entries: Sequence[StatedParameter], effect: Effect
) -> None:
    """Refuse parameters that the effect does not declare."""
    names = [entry["name"] for entry in entries]
    sets = effect.list_parameter_sets()
    if tuple(names) not in sets:
        fits = " or ".join(", ".join(each) or "none" for each in sets)
        raise _misfit_error(where, "names of parameters", names, fits)
    specs = {spec.name: spec for spec in effect.parameters}
    for entry in entries:
        _check_value(where, entry["value"], specs[entry["name"]])


def _check_value(
    where: str, value: float | Sequence[float], spec: ParameterSpec
) -> None:
    """Refuse a value of another size than declared, of the wrong sign, or huge."""
    size = len(value) if isinstance(value, Sequence) else None
    numbers = np.atleast_1d(np.array(value, float))
    if spec.size is None:
        fits = "" if size != 0 else "a number, or one for each column"
    elif spec.size == 1:
        fits = "" if size is None else "a number"
    else:
        count = SIZE_WORDS.get(spec.size, spec.size)
        fits = "" if size == spec.size else f"{count} numbers"
    if not fits and spec.nonnegative and (numbers < 0).any():
        fits = "0 or more"
    if not fits and np.abs(numbers).max() > MAX_FINDING_VALUE:
        fits = f"{-MAX_FINDING_VALUE:g} to {MAX_FINDING_VALUE:g}"
    if fits:
        raise _misfit_error(where, f"value of {spec.name}", value, fits)


def _misfit_error(where: str, what: str, value: object, fits: str) -> InputError:
    """The error of a value that is wrong, by file and entry."""
    return InputError(f"{where}: {what} is {shorten_value(value)}; would fit: {fits}")
