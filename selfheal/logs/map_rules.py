"""Rules of a map as TOML: rules in; lines out."""

import json
from collections.abc import Sequence
from dataclasses import fields

from .log_map import ColumnRule

WIDTH = 79  # characters of a line; chosen: as of a terminal


def format_rule(rule: ColumnRule) -> list[str]:
    """One [[signals]] table; what is as without a word is left out."""
    lines = ["[[signals]]"]
    for field in fields(rule):
        name, value = field.name, getattr(rule, field.name)
        if name != "columns" and (value == field.default or value in ("", [], None)):
            continue
        if isinstance(value, str):
            lines.append(f"{name} = {quote(value)}")
        elif name in ("columns", "targets"):
            lines += format_list(name, value)
        else:
            numbers = value if isinstance(value, Sequence) else [value]
            digits = 9 if name in ("sign", "scale", "offset") else 6
            text = ", ".join(f"{number:.{digits}g}" for number in numbers)
            is_list = isinstance(value, Sequence)
            lines.append(f"{name} = [{text}]" if is_list else f"{name} = {text}")
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
