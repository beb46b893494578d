"""A proposed map as TOML: a guess in; text with its reasons as comments out."""

import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from ..base import Stream
from ..log_map import COMMAND, Clock, ColumnRule
from ..map_rules import WIDTH, format_list, format_rule, quote
from .guess import Guess
from .unit_guesses import Ends, GuessedLine, GuessedTarget

_MANY = 4  # columns that differ in brackets, which are shown as one; chosen
_SURE = 0.7  # below, a comment asks to look; chosen


def format_map(guess: Guess, log: str, model: str) -> str:
    """A map file."""
    lines = _comment(
        f"Proposed for {quote(log)} and {quote(model)}: check what is less than sure."
    )
    lines += ["version = 1", ""]
    lines += _format_time(guess)
    for line in guess.lines:
        for part in _split_by_unit(line):
            lines += _format_line(part, guess.streams)
    lines += _format_open(guess)
    for remark in guess.remarks:
        lines += _comment(f"look: {remark}")
    return "\n".join(lines).rstrip() + "\n"


def _format_open(guess: Guess) -> list[str]:
    """What is left to a user: unused columns, and lines for what has none."""
    lines = list[str]()
    for kind, targets in (("joint_position", guess.unread), (COMMAND, guess.missing)):
        if targets and guess.unused:
            lines += ["# to be filled in with columns that are not used:"]
            body = ["[[signals]]", f"kind = {quote(kind)}", "columns = []"]
            body += [*format_list("targets", targets), 'unit = ""', ""]
            lines += [f"# {line}".rstrip() for line in body]
    if guess.unused:
        lines += _comment(f"not used: {', '.join(_shorten(guess.unused))}")
    return lines


def _shorten(names: Sequence[str]) -> list[str]:
    """Names, those that differ only in brackets as one: "reference[6 columns]"."""
    groups = dict[str, list[str]]()
    for name in names:
        groups.setdefault(re.sub(r"\[[^\]]*\]$", "", name), []).append(name)
    return [
        name
        for stem, members in groups.items()
        for name in (
            members if len(members) < _MANY else [f"{stem}[{len(members)} columns]"]
        )
    ]


def _format_time(guess: Guess) -> list[str]:
    """The tables [time] and [episodes]."""
    clocks = guess.time.clocks
    usual = Clock()
    special = {name: clock for name, clock in clocks.items() if clock != usual}
    lines = list[str]()
    if special and len(set(map(repr, clocks.values()))) == 1:
        name, clock = next(iter(special.items()))
        lines += ["[time]", *_format_clock(clock, guess.time.notes[name][0])]
    else:
        for name, clock in special.items():
            lines += [f"[time.streams.{quote(name)}]"]
            lines += _format_clock(clock, guess.time.notes[name][0])
    for name, (sure, why) in guess.time.notes.items():
        said = " LOOK:" * (not sure) + f" {name}:" * bool(name)
        lines += _comment(f"{_format_sure(sure)} sure:{said} {why}")
    rule = guess.time.episodes
    if rule.column or rule.gap:
        lines += ["", "[episodes]"]
        lines.append(
            f"column = {quote(rule.column)}" if rule.column else f"gap = {rule.gap}"
        )
    return [*lines, ""]


def _format_clock(clock: Clock, sure: float) -> Iterator[str]:
    """Lines of a clock; a rate that nothing states is left to the user."""
    if clock.column:
        yield f"column = {quote(clock.column)}"
    if clock.unit not in ("", "s"):
        yield f"unit = {quote(clock.unit)}"
    if clock.rate is not None:
        yield f"{'' if sure else '# '}rate = {clock.rate}"


def _split_by_unit(line: GuessedLine) -> Iterator[GuessedLine]:
    """Parts of a line whose columns have one unit, or are shares alike."""
    groups = dict[tuple[str, Ends | None], list[GuessedTarget]]()
    for target in line.targets:
        unit = target.unit
        key = unit.unit, unit.ranges[0] if unit.ranges else None
        groups.setdefault(key, []).append(target)
    for members in groups.values():
        yield replace(line, targets=members)


def _format_line(line: GuessedLine, streams: Sequence[Stream]) -> list[str]:
    """One [[signals]] table, its reasons below."""
    targets = [target.target for target in line.targets]
    pattern, stars = _find_pattern(line.columns, targets, streams)
    unit, signs = line.targets[0].unit, [target.unit.sign for target in line.targets]
    rule = ColumnRule(
        line.kind,
        pattern or line.columns,
        targets if stars != targets else [],
        unit.unit,
        signs[0] if len(set(signs)) == 1 else signs,
        from_range=unit.ranges[0] if unit.ranges else None,
        order=line.order,
        missing=line.missing,
    )
    lines = format_rule(rule)
    if line.missing is not None:
        lines.append("# rows of zeros come between: of a second publisher, say")
    return [*lines, *_explain(line), ""]


def _find_pattern(
    columns: Sequence[str], targets: Sequence[str], streams: Sequence[Stream]
) -> tuple[str, list[str]]:
    """A name with a star that stands for columns, and what the star stands for.

    Args:
        columns: with their streams' names where the log holds several.
        targets: of the columns; a star that stands for them is preferred.

    Returns:
        The name, "" if none stands for all of these and no others; the texts.
    """
    found: tuple[str, list[str]] = "", []
    if len(columns) < 3:
        return found
    start = _find_common_start(columns)
    end = _find_common_start([name[::-1] for name in columns])[::-1]
    bare = (re.sub(r"[A-Za-z0-9]*$", "", start), re.sub(r"^.*[A-Za-z0-9]", "", end))
    several = len(streams) > 1
    every = [f"{s.name}:{c}" if several else c for s in streams for c in s.columns]
    for first, last in ((start, end), bare):
        pattern = re.compile(f"{re.escape(first)}(.+){re.escape(last)}")
        matches = [match for name in every if (match := pattern.fullmatch(name))]
        if [match[0] for match in matches] == list(columns):
            stars = [match[1] for match in matches]
            if not found[0] or stars == list(targets):
                found = f"{first}*{last}", stars
    return found


def _find_common_start(texts: Sequence[str]) -> str:
    """What all texts begin with; their least and greatest have least in common."""
    ends = min(texts), max(texts)
    pairs = enumerate(zip(*ends, strict=False))
    return ends[0][: next((k for k, (a, b) in pairs if a != b), len(ends[0]))]


def _explain(line: GuessedLine) -> list[str]:
    """Comments: how sure each target is and why; one where the reasons are alike."""
    groups = dict[tuple[str, bool], list[GuessedTarget]]()
    for target in line.targets:
        groups.setdefault((target.why, target.sure < _SURE), []).append(target)
    said = list[str]()
    for (why, is_doubtful), members in groups.items():
        names = ", ".join(member.target for member in members)
        mark = " LOOK:" * is_doubtful + f" {names}:" * (len(groups) > 1)
        least = _format_sure(min(member.sure for member in members))
        said += _comment(f"{least} sure:{mark} {why}")
    return said


def _format_sure(sure: float) -> str:
    """Percent, rounded down: what is called less than 70 % sure reads as 69%."""
    return f"{int(100 * sure + 1e-9)}%"


def _comment(text: str) -> list[str]:
    """A comment, on as many lines as it needs."""
    shown = quote(text)[1:-1].replace('\\"', '"')
    wrap = partial(textwrap.wrap, break_long_words=False, break_on_hyphens=False)
    return [f"# {line}" for line in wrap(shown, WIDTH - 2)]
