"""A log's map as a check would have it: a map and faults in, corrected rules out."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ..logs.log_map import COMMAND, ColumnRule, LogMap
from ..recording import Recording
from .fault import Changes, ColumnCorrection, Fault

FACTORS: tuple[Literal["sign"], Literal["scale"]] = ("sign", "scale")
Key = tuple[str, str]  # kind and target of a column


def correct_rules(
    log_map: LogMap, faults: Sequence[Fault], recording: Recording
) -> dict[int, list[ColumnRule]]:
    """The rules of a map that faults change, by their number, as they should be.

    A rule may become several, or none.

    Args:
        log_map: by which the recording was made.
    """
    changes = dict[Key, Changes]()
    for one in (one for fault in faults for one in fault.corrections):
        if isinstance(one, ColumnCorrection):
            key = _find_key(one, recording)
            changes[key] = _join(changes.get(key, {}), one.changes)
    rules = enumerate(log_map.signals)
    made = {number: (rule, _correct_rule(rule, changes)) for number, rule in rules}
    return {number: new for number, (old, new) in made.items() if new != [old]}


def _join(first: Changes, then: Changes) -> Changes:
    """The changes of two faults, one after the other."""
    joined: Changes = {**first, **then}
    if "sign" in first and "sign" in then:
        joined["sign"] = np.multiply(first["sign"], then["sign"]).tolist()
    if "scale" in first and "scale" in then:
        joined["scale"] = first["scale"] * then["scale"]
    return joined


def _find_key(one: ColumnCorrection, recording: Recording) -> Key:
    """Kind and target of the column that is corrected."""
    if one.is_command:
        return COMMAND, one.name
    episodes = recording.episodes.values()
    signal = next(e.signals[one.name] for e in episodes if one.name in e.signals)
    return signal.kind, signal.target


def _correct_rule(rule: ColumnRule, changes: Mapping[Key, Changes]) -> list[ColumnRule]:
    """What a rule becomes: one for the columns of each change that parts it."""
    # targets that stand for a star are known as far as changes name them
    targets = rule.targets or [to for kind, to in changes if kind == rule.kind]
    found = [changes.get((rule.kind, target), Changes()) for target in targets]
    if not any(found):
        return [rule]
    parts = dict[str, list[int]]()
    for k, change in enumerate(found):
        shared = (*FACTORS, "missing")
        parting = {n: v for n, v in change.items() if n not in shared}
        parts.setdefault(json.dumps(parting), []).append(k)
    if len(parts) > 1 and isinstance(rule.columns, str) and rule.targets:
        return [rule]  # only the log says which column is whose
    made = list[ColumnRule]()
    for members in parts.values():
        part = rule if len(parts) == 1 else _take(rule, targets, members)
        own = [found[k] for k in members]
        if not any("skip" in change for change in own):
            made.append(_change(part, own))
    return made


def _take(rule: ColumnRule, targets: Sequence[str], members: list[int]) -> ColumnRule:
    """A rule for some of its targets, by their numbers."""
    names = [targets[k] for k in members]
    if isinstance(rule.columns, str):
        columns = [rule.columns.replace("*", name) for name in names]
        return replace(rule, columns=columns, targets=names)
    width = max(1, len(rule.columns) // len(targets))
    places = [k * width + i for k in members for i in range(width)]
    spread: dict[str, Any] = {
        name: [value[place] for place in places]
        for name in ("columns", *FACTORS, "offset")
        if isinstance(value := getattr(rule, name), list)
    }
    return replace(rule, targets=names, **spread)


def _change(rule: ColumnRule, changes: Sequence[Changes]) -> ColumnRule:
    """A rule whose columns are read otherwise, by the changes of each target."""
    first = changes[0]
    if ends := first.get("from_range"):
        rule = replace(rule, sign=1, scale=1.0, offset=0.0, unit="", from_range=ends)
        rule = replace(rule, to_range=first.get("to_range"))
    if "columns" in first and isinstance(rule.columns, list):
        rule = replace(rule, columns=[rule.columns[k] for k in first["columns"]])
    rule = replace(
        rule,
        targets=first.get("targets", rule.targets),
        order=first.get("order", rule.order),
        delay=rule.delay + first.get("delay", 0.0),
        missing=next((c["missing"] for c in changes if "missing" in c), rule.missing),
    )
    width = len(rule.columns) // len(changes) if isinstance(rule.columns, list) else 1
    for name in FACTORS:
        by = [np.broadcast_to(c.get(name, 1), max(1, width)) for c in changes]
        factor = np.concatenate(by)
        if (factor != 1).any():
            old = {key: np.array(getattr(rule, key)) for key in (name, "offset")}
            new: dict[str, Any] = {k: _shorten(x * factor) for k, x in old.items()}
            rule = replace(rule, **new)
    return rule


def _shorten(values: np.ndarray) -> float | list[float]:
    """One number where all of (n) are alike, else a list."""
    numbers = np.round(np.atleast_1d(values), 12).tolist()
    whole = [int(x) if float(x).is_integer() else x for x in numbers]
    return whole[0] if len(set(whole)) == 1 else whole
