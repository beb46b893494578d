"""Rules of a map as TOML: rules in; lines out."""

import json
from collections.abc import Sequence

from .log_map import ColumnRule

WIDTH = 79  # characters of a line; chosen: as of a terminal


def format_rule(rule: ColumnRule) -> list[str]:
    """One [[signals]] table; what is as without a word is left out."""
    lines = ["[[signals]]", f"kind = {quote(rule.kind)}"]
    if isinstance(rule.columns, str):
        lines.append(f"columns = {quote(rule.columns)}")
    else:
        lines += format_list("columns", rule.columns)
    if rule.targets:
        lines += format_list("targets", rule.targets)
    if rule.unit:
        lines.append(f"unit = {quote(rule.unit)}")
    for name in ("from_range", "to_range"):
        if ends := getattr(rule, name):
            lines.append(f"{name} = [{ends[0]:.6g}, {ends[1]:.6g}]")
    for name, usual in (("sign", 1), ("scale", 1), ("offset", 0)):
        value = getattr(rule, name)
        if value != usual:
            numbers = [f"{x:.9g}" for x in value] if isinstance(value, list) else []
            text = f"[{', '.join(numbers)}]" if numbers else f"{value:.9g}"
            lines.append(f"{name} = {text}")
    if rule.order != "wxyz":
        lines.append(f"order = {quote(rule.order)}")
    if rule.delay:
        lines.append(f"delay = {rule.delay:.6g}")
    if rule.missing is not None:
        lines.append(f"missing = {rule.missing:g}")
    return lines


def quote(text: str) -> str:
    """A TOML basic string; JSON's escapes are TOML's."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def format_list(name: str, values: Sequence[str]) -> list[str]:
    """A key and its list, on several lines where one is too short."""
    quoted = [quote(value) for value in values]
    whole = f"{name} = [{', '.join(quoted)}]"
    if len(whole) <= WIDTH:
        return [whole]
    lines, row = [f"{name} = ["], ""
    for value in quoted:
        if row and len(row) + len(value) > WIDTH - 6:
            lines.append(f"    {row.rstrip()}")
            row = ""
        row += f"{value}, "
    return [*lines, f"    {row.rstrip()}", "]"]
