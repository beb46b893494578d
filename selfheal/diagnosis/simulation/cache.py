"""What simulations share: values that no hypothesis changes, and how many were run."""

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np

from ..data.segments import Segments

# numbers that a cache keeps, 200 MB; chosen: far more than the 1e5 that a diagnosis of
# 50 s of readings needs (measured), and little beside a batch
MAX_CACHED_NUMBERS = 25_000_000

Value = TypeVar("Value")


class SimulationCache:
    """Keeps what a simulator computed of segments and no hypothesis changes.

    That is: selections of segments, commands on the grid, initial states, the errors
    that servos integrate, and accelerations in an episode's first moments. Each is a
    function of the simulator and the segments alone, so that losing one costs time and
    changes no number. A simulator with other channels, episodes or steps needs a cache
    of its own.

    A value goes with the segments that it belongs to: they are known by identity, and
    held weakly. Beyond `limit` numbers in all, the segments go whose values were used
    the longest time ago.
    """

    def __init__(self, limit: int = MAX_CACHED_NUMBERS) -> None:
        """`limit`: numbers in the arrays that are kept, at most."""
        self.limit = limit
        self._entries: WeakKeyDictionary[Segments, _Entry] = WeakKeyDictionary()

    def __len__(self) -> int:
        """How many numbers are kept."""
        return sum(entry.size for entry in list(self._entries.values()))

    def load_or_compute(
        self, segments: Segments, key: Hashable, compute: Callable[[], Value]
    ) -> Value:
        """What `compute` gives, kept under `key` while the segments live.

        Args:
            key: of this value among those of these segments.
            compute: gives the value; called where it is not kept.
        """
        entry = self._entries.pop(segments, None) or _Entry({})
        self._entries[segments] = entry  # the last one, as used most recently
        if key not in entry.values:
            value = compute()
            entry.values[key] = value
            entry.size += count_numbers(value)
            self._drop_oldest(segments)
        return cast(Value, entry.values[key])

    def _drop_oldest(self, used: Segments) -> None:
        """Forget other segments' values until what is kept is within the limit."""
        excess = len(self) - self.limit
        for segments in list(self._entries):
            if excess <= 0:
                return
            if segments is not used and segments in self._entries:
                excess -= self._entries.pop(segments).size


@dataclass
class _Entry:
    """The values kept of some segments, and how many numbers they hold."""

    values: dict[Hashable, object]
    size: int = 0


def count_numbers(value: object) -> int:
    """How many numbers a value of the cache holds."""
    if isinstance(value, Segments):
        return sum(count_numbers(array) for array in vars(value).values())
    if isinstance(value, tuple):
        return sum(map(count_numbers, value))
    return int(np.asarray(value).size)


class OutOfTime(Exception):
    """The time that was given is over; what was found so far counts."""


class SimulationCounter:
    """Counts the segments simulated by all simulators that share it, within a limit.

    Attributes:
        count: how many so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._is_over: Callable[[], bool] = lambda: False

    def add(self, count: int) -> None:
        """Count some more.

        Raises:
            OutOfTime: the time of `limit` is over.
        """
        if self._is_over():
            raise OutOfTime
        self.count += count

    @contextmanager
    def limit(self, is_over: Callable[[], bool]) -> Iterator[None]:
        """Ask before each batch of simulations, while entered, whether time is over."""
        self._is_over = is_over
        try:
            yield
        finally:
            self._is_over = lambda: False
