"""Texts that state something, JSON or TOML: checked by a type, and what is wrong."""

import json
import os
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from .errors import InputError
from .files import check_file

_MAX_SIZE = 1_000_000  # bytes; chosen: ten thousand lines
_MAX_SHOWN = 60  # characters of a misfit that a message repeats; chosen
Content = TypeVar("Content")


def read_toml(path: str | os.PathLike[str], kind: type[Content]) -> Content:
    """The content of a file, as a dataclass that pydantic checks.

    Raises:
        InputError: it is missing, no TOML, or has something that is not known.
    """
    check_file(path)
    name = os.fspath(path)
    if (size := os.path.getsize(path)) > _MAX_SIZE:
        raise InputError(f"{name}: {size} bytes; at most {_MAX_SIZE} are read")
    try:
        document = tomllib.loads(Path(path).read_bytes().decode())
    except (ValueError, RecursionError) as error:  # of decoding, too
        raise InputError(f"{name}: no TOML: {error}") from error
    return check_document(document, kind, name)


def check_document(document: object, kind: type[Content], name: str) -> Content:
    """The content of a document.

    Raises:
        InputError: it has something that is not known.
    """
    # as JSON: a strict dataclass takes a document from no other form
    text = json.dumps(document, default=str)
    try:
        return TypeAdapter(kind).validate_json(text)
    except ValidationError as error:
        place, wrong, fits = explain_misfit("", error, text)
        end = fits and f"; would fit: {fits}"
        raise InputError(f"{name}: {place or 'it'} is {wrong}{end}") from error


def explain_misfit(
    member: str, error: ValidationError, text: str | bytes
) -> tuple[str, str, str]:
    """Place in a member, finding and what would fit, of the first thing that is wrong.

    Where a value may be of several types, each has an error: those that lead furthest
    into the document count.
    """
    found = error.errors(include_url=False)
    if found[0]["type"] == "json_invalid":
        said = found[0]["msg"].removeprefix("Invalid JSON: ")
        return member, f"no JSON ({said})", ""
    document = json.loads(text, parse_int=str)  # a number may be of any length
    every = [(_find_place(e, document), e) for e in found]
    start = every[0][0]
    place, first = max(
        (pair for pair in every if pair[0].startswith(start)), key=lambda p: len(p[0])
    )
    said, where = first["msg"], (member + place).removeprefix(".")
    if first["type"] == "missing":
        return where, "missing", ""
    if first["type"] == "unexpected_keyword_argument":
        return where, "not known", ""
    if first["type"] == "value_error":  # what a type of ours says of the value
        return where, said.removeprefix("Value error, "), ""
    fits = [e["msg"].removeprefix("Input should be ") for p, e in every if p == place]
    return where, shorten_value(first["input"]), " or ".join(dict.fromkeys(fits))


def _find_place(error: ErrorDetails, document: object) -> str:
    """Where in a document an error is; names of types that were tried are left out."""
    place, value, steps = "", document, error["loc"]
    for number, step in enumerate(steps, 1):
        is_missing = error["type"] == "missing" and number == len(steps)
        if isinstance(value, list) and isinstance(step, int) and step < len(value):
            place, value = f"{place}[{step}]", value[step]
        elif isinstance(value, dict) and (step in value or is_missing):
            place, value = f"{place}.{step}", value.get(step)
    return place


def shorten_value(value: object) -> str:
    """A value as a message repeats it."""
    said = repr(value)
    return said if len(said) <= _MAX_SHOWN else f"{said[:_MAX_SHOWN]}..."


def load_json(text: str | bytes) -> Any:
    """What a JSON text says; NaN and infinity are no JSON.

    Raises:
        ValueError: it is no JSON.
    """

    def refuse(word: str) -> None:
        raise ValueError(f"{word} is no number of JSON")

    return json.loads(text, parse_constant=refuse)
