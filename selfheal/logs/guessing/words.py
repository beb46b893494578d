"""What words of names say: a file of words in, sets and weights out."""

from functools import cache, cached_property
from pathlib import Path

from pydantic.dataclasses import dataclass

from ...documents import read_toml


@dataclass(frozen=True, config={"extra": "forbid"})
class VectorWords:
    """What words say of a vector.

    Attributes:
        unit: of a sensor that measures it.
        kind: of a body's signal; "" where a body has none such.
    """

    words: frozenset[str]
    unit: str
    kind: str = ""


@dataclass(frozen=True, config={"extra": "forbid"})
class Words:
    """What is in `words.toml`, which explains it."""

    times: frozenset[str]
    episodes: frozenset[str]
    differences: frozenset[str]
    bodies: frozenset[str]
    grippers: frozenset[str]
    fillers: frozenset[str]
    kinds: dict[str, frozenset[str]]
    weights: dict[str, float]
    units: dict[str, dict[str, float]]
    vectors: list[VectorWords]

    @cached_property
    def beside(self) -> frozenset[str]:
        """Words that are no part of the name of a joint."""
        return self.fillers.union(*self.kinds.values())


@cache
def read_words() -> Words:
    """The words that are known."""
    return read_toml(Path(__file__).with_name("words.toml"), Words)
