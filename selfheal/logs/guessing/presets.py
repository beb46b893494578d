"""Presets: what the logs of one software have in common, as maps without a model."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...errors import UnknownNameError
from ..log_map import ColumnRule, LogMap, read_map
from .assignment import Column

_FOLDER = Path(__file__).parent / "presets"
_MARGIN = 5.0  # by which a preset is ahead of a name; chosen: more than any name is


def list_presets() -> list[str]:
    """Names of all presets."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def read_preset(name: str) -> LogMap:
    """A preset: a map whose columns may have several stars, and without targets.

    Raises:
        UnknownNameError: there is none of that name.
    """
    if name not in list_presets():
        raise UnknownNameError("preset", name, list_presets())
    return read_map(_FOLDER / f"{name}.toml")


def apply_preset(columns: Sequence[Column], preset: LogMap) -> list[Column]:
    """Columns with what a preset states of them: the first rule that fits each."""
    return [replace(c, rule=_find_rule(c, preset), margin=_MARGIN) for c in columns]


def _find_rule(column: Column, preset: LogMap) -> ColumnRule | None:
    names = column.name, f"{column.stream}:{column.name}"
    for rule in preset.signals:
        assert isinstance(rule.columns, str)
        pattern = ".*".join(map(re.escape, rule.columns.split("*")))
        if any(re.fullmatch(pattern, name) for name in names):
            return rule
    return None
