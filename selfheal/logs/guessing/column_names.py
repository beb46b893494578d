"""What the name of a column says: kind, unit and whose it is."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..units import find_unit
from .words import read_words

_SHARED = 0.8  # what a shared name says beside an own one; chosen
_SPLIT = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_TRAILING_UNIT = re.compile(r"[ _]*[(\[]([^)\]]*)[)\]]\s*$")


@dataclass(frozen=True)
class NameFacts:
    """What the name of a column says.

    Attributes:
        tokens: its words and numbers in lower case, those of its stream before them.
        own: those of the column alone.
        unit: that it states; "" if none.
    """

    tokens: tuple[str, ...]
    own: tuple[str, ...]
    unit: str


def read_name(stream: str, column: str) -> NameFacts:
    """Take the name of a column apart."""
    unit, name = "", column
    match = _TRAILING_UNIT.search(column)
    if match and find_unit(match[1]) and not match[1].isdigit():
        unit, name = match[1], column[: match.start()]
    own = split_words(name)
    if not unit and len(own) > 1:
        # "q1_deg", "time_ms"; one letter may be anything
        last = own[-1]
        if len(last) > 1 and find_unit(last):
            unit, own = last, own[:-1]
    return NameFacts((*split_words(stream), *own), own, unit)


def split_words(name: str) -> tuple[str, ...]:
    """Words and numbers of a name, in lower case: "LeftHip_pos[3]" has four."""
    return tuple(word.lower() for word in _SPLIT.findall(name))


def score_kinds(facts: NameFacts) -> dict[str, float]:
    """Evidence of a name's words for each kind; 0 where there is none."""
    words = read_words()
    scores = dict.fromkeys(words.kinds, 0.0)
    for kind, known in words.kinds.items():
        for tokens, weight in ((facts.own, 1.0), (facts.tokens, 0.5)):
            worth = (words.weights.get(t, 1.0) for t in tokens if t in known)
            scores[kind] += weight * max(worth, default=0.0)
    unit = find_unit(facts.unit) if facts.unit else None
    for kind, worth_of_unit in (words.units.get(unit.si, {}) if unit else {}).items():
        scores[kind] += worth_of_unit
    return scores


def score_names(facts: NameFacts, name: str, aliases: Iterable[str] = ()) -> float:
    """How much of a name of the model a column's name repeats, 0 to 1.

    Args:
        aliases: names that several things in the model may share.
    """
    shared = max((_score_name(facts, alias) for alias in aliases), default=0.0)
    return max(_score_name(facts, name), _SHARED * shared)


def _score_name(facts: NameFacts, name: str) -> float:
    wanted = split_words(name)
    if _contains(facts.own, wanted):
        return 1.0
    bare = tuple(word for word in wanted if word not in read_words().beside)
    if all(word.isdigit() for word in bare):  # "data[1]" need not be of "joint_1"
        return 0.0
    if bare and _contains(facts.own, bare):
        return 0.95
    left = {word for word in facts.own if word not in read_words().beside}
    if not left:
        return 0.0
    shared = len(left & set(bare)) / len(left | set(bare))
    joined, other = "".join(sorted(bare)), "".join(sorted(left))
    return max(0.9 * shared, 0.9 if joined == other else 0.0)


def _contains(tokens: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether words stand in a row among others."""
    starts = range(len(tokens) - len(wanted) + 1)
    return any(tuple(tokens[k : k + len(wanted)]) == tuple(wanted) for k in starts)


def find_number(column: str) -> int:
    """The last number of a name; -1 if it has none."""
    numbers = re.findall(r"\d+", column)
    return int(numbers[-1]) if numbers else -1
