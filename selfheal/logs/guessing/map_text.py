"""A proposed map as TOML: a guess in; text with its reasons as comments out."""

import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ..base import Stream
from ..log_map import Clock
from .guess import Guess, GuessedLine
from .unit_guesses import UnitGuess

_WIDTH = 88  # characters of a line; chosen: as this program's own
_SURE = 0.7  # below, a comment asks to look; chosen


def format_map(guess: Guess, log: str, model: str) -> str:
    """A map file.

    Args:
        guess: what it proposes.
        log: name of the log.
        model: name of the model.
    """
    lines = [f"# Proposed for {_quote(log)} and {_quote(model)}: check what is less "
             "than sure.", "version = 1", ""]  # fmt: skip
    lines += _format_time(guess)
    for line in guess.lines:
        for part in _split_by_unit(line):
            lines += _format_line(part, guess.streams)
    if guess.unused:
        lines += [f"# not used: {_quote(', '.join(guess.unused))[1:-1]}"]
    lines += [f"# look: {_quote(remark)[1:-1]}" for remark in guess.remarks]
    return "\n".join(lines).rstrip() + "\n"


def _quote(text: str) -> str:
    """A TOML basic string; JSON's escapes are TOML's."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _format_time(guess: Guess) -> list[str]:
    """The tables [time] and [episodes]."""
    clocks = guess.time.clocks
    usual = Clock()
    special = {name: clock for name, clock in clocks.items() if clock != usual}
    lines = list[str]()
    if special and len(set(map(repr, clocks.values()))) == 1:
        lines += ["[time]", *_format_clock(next(iter(special.values())))]
    else:
        for name, clock in special.items():
            lines += [f"[time.streams.{_quote(name)}]", *_format_clock(clock)]
    for name, (sure, why) in guess.time.notes.items():
        stream = f"{name}: " if name else ""
        lines.append(f"# {_quote(f'{sure:.0%} sure: {stream}{why}')[1:-1]}")
    rule = guess.time.episodes
    if rule.column or rule.gap:
        lines += ["", "[episodes]"]
        lines.append(
            f"column = {_quote(rule.column)}" if rule.column else f"gap = {rule.gap}"
        )
    return [*lines, ""]


def _format_clock(clock: Clock) -> Iterator[str]:
    if clock.column:
        yield f"column = {_quote(clock.column)}"
    if clock.unit not in ("", "s"):
        yield f"unit = {_quote(clock.unit)}"
    if clock.rate is not None:
        yield f"rate = {clock.rate}"


def _split_by_unit(line: GuessedLine) -> Iterator[GuessedLine]:
    """Parts of a line whose columns have one unit and one range each."""
    width = len(line.columns) // len(line.targets)
    keys = [(unit.unit, unit.ranges) for unit in line.units]
    for key in dict.fromkeys(keys):
        members = [k for k, other in enumerate(keys) if other == key]
        yield replace(
            line,
            columns=[c for k in members
                     for c in line.columns[k * width : (k + 1) * width]],
            targets=[line.targets[k] for k in members],
            units=[line.units[k] for k in members],
            sure=[line.sure[k] for k in members],
            why=[line.why[k] for k in members],
        )  # fmt: skip


def _format_line(line: GuessedLine, streams: Sequence[Stream]) -> list[str]:
    """One [[signals]] table, its reasons below."""
    lines = ["[[signals]]", f"kind = {_quote(line.kind)}"]
    pattern, stars = _find_pattern(line.columns, line.targets, streams)
    if pattern:
        lines.append(f"columns = {_quote(pattern)}")
    else:
        lines += _format_list("columns", line.columns)
    if stars != line.targets:
        lines += _format_list("targets", line.targets)
    unit = line.units[0]
    if unit.unit:
        lines.append(f"unit = {_quote(unit.unit)}")
    if unit.ranges:
        for name, ends in zip(("from_range", "to_range"), unit.ranges, strict=True):
            lines.append(f"{name} = [{ends[0]:.6g}, {ends[1]:.6g}]")
    signs = [unit.sign for unit in line.units]
    if -1 in signs:
        lines.append(f"sign = {signs if len(set(signs)) > 1 else signs[0]}")
    if line.order != "wxyz":
        lines.append(f'order = "{line.order}"')
    return [*lines, *_explain(line), ""]


def _find_pattern(
    columns: Sequence[str], targets: Sequence[str], streams: Sequence[Stream]
) -> tuple[str, list[str]]:
    """A name with a star that stands for columns, and what the star stands for.

    Args:
        columns: with their streams' names where the log holds several.
        targets: of the columns; a star that stands for them is preferred.
        streams: of the log.

    Returns:
        The name, "" if none stands for all of these and no others; the texts.
    """
    found: tuple[str, list[str]] = "", []
    if len(columns) < 3:
        return found
    start = os.path.commonprefix(list(columns))
    end = os.path.commonprefix([name[::-1] for name in columns])[::-1]
    bare = (re.sub(r"[A-Za-z0-9]*$", "", start), re.sub(r"^.*[A-Za-z0-9]", "", end))
    every = [f"{s.name}:{c}" if len(streams) > 1 else c
             for s in streams for c in s.columns]  # fmt: skip
    for first, last in ((start, end), bare):
        pattern = re.compile(f"{re.escape(first)}(.+){re.escape(last)}")
        matches = [match for name in every if (match := pattern.fullmatch(name))]
        if [match[0] for match in matches] == list(columns):
            stars = [match[1] for match in matches]
            if not found[0] or stars == list(targets):
                found = f"{first}*{last}", stars
    return found


def _explain(line: GuessedLine) -> list[str]:
    """Comments: how sure each target is and why; one where all are alike."""
    if len(set(zip(map(_round, line.sure), line.why, strict=True))) == 1:
        return [_comment(line.sure[0], line.why[0])]
    return [
        _comment(sure, f"{target}: {why}")
        for sure, target, why in zip(line.sure, line.targets, line.why, strict=True)
    ]


def _round(sure: float) -> str:
    return f"{sure:.0%}"


def _comment(sure: float, why: str) -> str:
    mark = "" if sure >= _SURE else " LOOK:"
    return f"# {_round(sure)} sure:{mark} {_quote(why)[1:-1]}"


def _format_list(name: str, values: Sequence[str]) -> list[str]:
    """A key and its list, on several lines where one is too short."""
    quoted = [_quote(value) for value in values]
    whole = f"{name} = [{', '.join(quoted)}]"
    if len(whole) <= _WIDTH:
        return [whole]
    lines, row = [f"{name} = ["], ""
    for value in quoted:
        if row and len(row) + len(value) > _WIDTH - 6:
            lines.append(f"    {row.rstrip()}")
            row = ""
        row += f"{value}, "
    return [*lines, f"    {row.rstrip()}", "]"]


def describe_unit(unit: UnitGuess) -> str:
    """How a guess converts a column, for a table."""
    if unit.ranges:
        (low, high), (bottom, top) = unit.ranges
        return f"{low:g}..{high:g} to {bottom:.3g}..{top:.3g}"
    return f"{'-' if unit.sign < 0 else ''}{unit.unit or 'model'}"
