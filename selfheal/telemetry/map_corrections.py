"""A log's map as a check would have it: a map and faults in, corrected rules out."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..logs.log_map import COMMAND, ColumnRule, LogMap
from ..recording import Recording
from .fault import SKIP, ColumnCorrection, Fault

_RULE = ("missing", "delay", "order")  # keys with one value for all columns
Key = tuple[str, str]  # kind and target of a column


def correct_rules(
    log_map: LogMap, faults: Sequence[Fault], recording: Recording
) -> dict[int, list[ColumnRule]]:
    """The rules of a map that faults change, by their number, as they should be.

    Args:
        log_map: by which the recording was made.

    Returns:
        None is in it that the faults' corrections do not speak of. A rule may become
        several, or none.
    """
    changes = dict[Key, dict[str, Any]]()
    for one in (one for fault in faults for one in fault.corrections):
        if not isinstance(one, ColumnCorrection):
            continue
        change = dict(one.changes)
        found = changes.setdefault(_find_key(one, recording), {})
        for name in ("scale", "sign"):  # of two faults, one after the other
            if name in change and name in found:
                change[name] = np.multiply(change[name], found[name]).tolist()
        found |= change
    return {
        number: made
        for number, rule in enumerate(log_map.signals)
        if (made := _correct_rule(rule, changes)) != [rule]
    }


def _find_key(one: ColumnCorrection, recording: Recording) -> Key:
    """Kind and target of the column that is corrected."""
    if one.is_command:
        return COMMAND, one.name
    episodes = recording.episodes.values()
    signal = next(e.signals[one.name] for e in episodes if one.name in e.signals)
    return signal.kind, signal.target


def _correct_rule(
    rule: ColumnRule, changes: Mapping[Key, dict[str, Any]]
) -> list[ColumnRule]:
    """What a rule becomes: one for the columns of each change that parts it."""
    targets = rule.targets or _list_stars(rule, changes)
    found = [changes.get((rule.kind, target), {}) for target in targets]
    if not any(found):
        return [rule]
    parts = dict[str, list[int]]()
    for k, change in enumerate(found):
        parting = {
            n: v for n, v in change.items() if n not in ("sign", "scale", "missing")
        }
        parts.setdefault(json.dumps(parting), []).append(k)
    if len(parts) > 1 and isinstance(rule.columns, str) and rule.targets:
        return [rule]  # only the log says which column is whose
    made = list[ColumnRule]()
    for members in parts.values():
        part = rule if len(parts) == 1 else _take(rule, targets, members)
        own = [found[k] for k in members]
        if not any(SKIP in change for change in own):
            made.append(_change(part, own, [targets[k] for k in members]))
    return made


def _list_stars(
    rule: ColumnRule, changes: Mapping[Key, dict[str, Any]]
) -> Sequence[str]:
    """Targets that stand for a star, as far as changes name them."""
    return [target for kind, target in changes if kind == rule.kind]


def _take(rule: ColumnRule, targets: Sequence[str], members: list[int]) -> ColumnRule:
    """A rule for some of its targets, by their numbers."""
    names = [targets[k] for k in members]
    if isinstance(rule.columns, str):
        columns = [rule.columns.replace("*", name) for name in names]
        return replace(rule, columns=columns, targets=names)
    width = max(1, len(rule.columns) // len(targets))
    columns = [rule.columns[k * width + i] for k in members for i in range(width)]
    spread = dict[str, Any]()
    for name in ("sign", "scale", "offset"):
        value = getattr(rule, name)
        if isinstance(value, list):
            spread[name] = [value[k * width + i] for k in members for i in range(width)]
    return replace(rule, columns=columns, targets=names, **spread)


def _change(
    rule: ColumnRule, changes: Sequence[dict[str, Any]], targets: Sequence[str]
) -> ColumnRule:
    """A rule whose columns are read otherwise, by the changes of each target."""
    first = changes[0]
    if ends := first.get("from_range"):
        rule = replace(rule, from_range=tuple(ends), to_range=None, unit="", sign=1,
                       scale=1.0, offset=0.0)  # fmt: skip
        if "to_range" in first:
            rule = replace(rule, to_range=tuple(first["to_range"]))
    if "targets" in first:
        rule = replace(rule, targets=first["targets"])
    if "columns" in first and isinstance(rule.columns, list):
        rule = replace(rule, columns=[rule.columns[k] for k in first["columns"]])
    said = {n: c[n] for n in _RULE for c in changes if n in c}
    if "delay" in said:
        said["delay"] += rule.delay
    rule = replace(rule, **said)
    width = len(rule.columns) // len(targets) if isinstance(rule.columns, list) else 1
    for name in ("sign", "scale"):
        by = [np.broadcast_to(c.get(name, 1), max(1, width)) for c in changes]
        factor = np.concatenate(by)
        if (factor != 1).any():
            rule = replace(rule, **{
                name: _shorten(np.array(getattr(rule, name)) * factor),
                "offset": _shorten(np.array(rule.offset) * factor),
            })  # fmt: skip
    return rule


def _shorten(values: Any) -> Any:
    """One number where all are alike, else a list."""
    numbers = np.round(np.atleast_1d(values), 12).tolist()
    whole = [int(x) if float(x).is_integer() else x for x in numbers]
    return whole[0] if len(set(whole)) == 1 else whole
