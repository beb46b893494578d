"""Which column is whose: names and motions of columns in; an assignment out."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base import Stream
from ..log_map import ColumnRule
from ..model_facts import Place
from ..motion import Sample
from .column_names import NameFacts, find_number, read_name, score_kinds, score_names
from .words import read_words

Floats = NDArray[np.float64]
# evidence for a place [nats]; chosen: a name outweighs all else
_NAME, _ORDER, _POSITION = 6.0, 1.5, 0.5
_LEAST_KIND = 0.15  # below, the words of a name say nothing of its kind; chosen
_VECTOR = re.compile(r"(.+?)[._ /]?([xyzw])$")
ELEMENT = re.compile(r"(.+)\[(\d+)\]$")


@dataclass(frozen=True)
class Column:
    """A column of numbers of a log.

    Attributes:
        values: (n) those of the sample.
        time: (n) [s].
        rule: of a preset, or from its motion; None where its name decides.
        margin: by how much the rule is ahead of what the name says.
    """

    stream: str
    name: str
    facts: NameFacts
    values: Floats
    time: Floats
    rule: ColumnRule | None = None
    margin: float = 0.0


def qualify(column: Column, several: bool) -> str:
    """The name of a column in a map, with its stream where the log has several."""
    return f"{column.stream}:{column.name}" if several else column.name


@dataclass(frozen=True)
class Match:
    """A column and whose it is.

    Attributes:
        sure: probability that it is right.
    """

    column: Column
    place: Place
    sure: float
    why: str


def list_columns(
    streams: Sequence[Stream], samples: Mapping[str, Sample], taken: set[str]
) -> list[Column]:
    """Columns that may be signals, in the order of the log.

    Args:
        taken: "STREAM:COLUMN" of those that hold times and labels.
    """
    found = list[Column]()
    for stream in streams:
        sample = samples[stream.name]
        for name, unit in stream.columns.items():
            if f"{stream.name}:{name}" in taken or name not in sample.columns:
                continue
            facts = read_name(stream.name, name)
            facts = replace(facts, unit=unit or facts.unit)
            values = sample.columns[name]
            found.append(Column(stream.name, name, facts, values, sample.time))
    return found


def group_vectors(columns: Sequence[Column]) -> dict[tuple[str, str], list[Column]]:
    """Columns x, y, z and perhaps w of one thing, by stream and name without them.

    So are the three or four elements of an array that is named after a body.
    """
    found = dict[tuple[str, str], dict[str, Column]]()
    for column in columns:
        if match := _VECTOR.fullmatch(column.name):
            found.setdefault((column.stream, match[1]), {})[match[2]] = column
        elif (match := ELEMENT.fullmatch(column.name)) and _is_of_body(column):
            parts = found.setdefault((column.stream, match[1]), {})
            parts["xyzw"[int(match[2])] if int(match[2]) < 4 else "more"] = column
    return {
        key: [parts[axis] for axis in "xyzw" if axis in parts]
        for key, parts in found.items()
        if {"x", "y", "z"} <= parts.keys() and "more" not in parts
    }


def _is_of_body(column: Column) -> bool:
    """Whether a preset, or else the name, says that a column is of a body."""
    if column.rule:
        return column.rule.kind.startswith("body_")
    return not read_words().bodies.isdisjoint(column.facts.own)


def group_scalars(
    columns: Sequence[Column], places: Sequence[Place]
) -> list[tuple[str, float, list[Column]]]:
    """Columns of one kind and one name but for whose they are.

    Args:
        columns: in the order of the log.
        places: of the model, whose names are no evidence of a kind.

    Returns:
        Kind, how far ahead of the next kind it is, and the columns; first those whose
        names say most.
    """
    words = read_words()
    names = {name for place in places for name in (place.name, *place.aliases)}
    own = {word for name in names for word in read_name("", name).own} - words.beside
    groups = dict[tuple[str, int, tuple[str, ...]], list[Column]]()
    for column in columns:
        if not words.differences.isdisjoint(column.facts.own):
            continue
        stem = tuple(
            word
            for word in column.facts.own
            if word in words.beside
            or not (word.isdigit() or word in own or len(word) == 1)
        )
        key = column.stream, id(column.rule), () if column.rule else stem
        groups.setdefault(key, []).append(column)
    found = []
    for members in groups.values():
        if rule := members[0].rule:
            found.append((rule.kind, members[0].margin, members))
            continue
        scores = [score_kinds(column.facts) for column in members]
        mean = {kind: float(np.mean([s[kind] for s in scores])) for kind in scores[0]}
        first, second = sorted(mean, key=lambda k: -mean[k])[:2]
        if mean[first] >= _LEAST_KIND:
            found.append((first, mean[first] - mean[second], members))
    return sorted(found, key=lambda group: (len(group[2]) < 2, -group[1]))


def assign_columns(
    columns: Sequence[Column],
    places: Sequence[Place],
    judge: Callable[[Column, Place], tuple[float, str]],
) -> list[Match]:
    """Give each column of a group the place that fits it best.

    The assignment has the largest sum of scores (Hungarian method).

    Args:
        places: of that kind, in the order of the model.
        judge: evidence for a place other than names [nats], and its reason.

    Returns:
        A match for each column that has a place.
    """
    from scipy.optimize import linear_sum_assignment

    if not columns or not places:
        return []
    score = np.zeros((len(columns), len(places)))
    why = [["" for _ in places] for _ in columns]
    numbers = [find_number(column.name) for column in columns]
    first, whole = min(numbers), len(columns) == len(places)
    in_a_row = sorted(numbers) == [*range(first, first + len(columns))]
    if whole and in_a_row and first in (0, 1):
        ranks, worth, word = [n - first for n in numbers], _ORDER, "its number"
    else:
        ranks, worth = [*range(len(columns))], _POSITION
        word = "its place in the order"
    for i, column in enumerate(columns):
        for j, place in enumerate(places):
            named = score_names(column.facts, place.name, place.aliases)
            is_next = whole and ranks[i] == j
            more, reason = judge(column, place)
            score[i, j] = _NAME * named + worth * is_next + more
            by_name = "its name" if named > 0.3 else word * is_next
            why[i][j] = " and ".join(filter(None, (by_name, reason)))
    found = []
    for i, j in zip(*linear_sum_assignment(-score), strict=True):
        if score[i, j] <= 0 and len(places) > 1:
            continue
        rivals = np.delete(score[i], j)
        ahead = float(score[i, j] - rivals.max()) if rivals.size else 2.0
        sure = 1 / (1 + math.exp(-ahead)) if rivals.size else 0.9
        found.append(Match(columns[i], places[j], sure, why[i][j] or "nothing else"))
    return found
