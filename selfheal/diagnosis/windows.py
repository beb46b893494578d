"""Pieces of the recordings that are simulated each from its own start."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..recording.data import Floats
from .logs import Log

FEW = 4  # readings in a window, fewer of which tell no correlation in time


@dataclass(frozen=True, eq=False)
class Windows:
    """W pieces, and the M samples that lie in them.

    Attributes:
        log: (W) which episode.
        start: (W) in steps of its grid.
        steps: (W) how many.
        window: (M) of each sample.
        at: (M) time of each sample in its window [steps].
        readings: (M, C).
    """

    log: np.ndarray
    start: np.ndarray
    steps: np.ndarray
    window: np.ndarray
    at: Floats
    readings: Floats

    def __len__(self) -> int:
        """How many windows."""
        return len(self.log)

    @property
    def is_single(self) -> bool:
        """Whether they hold single readings, as those of a robot that takes poses."""
        return bool(len(self.window)) and int(np.bincount(self.window).max()) < FEW

    @property
    def halved(self) -> "Windows":
        """The same, counted in steps of half the size."""
        return replace(self, start=2 * self.start, steps=2 * self.steps, at=2 * self.at)

    def take(self, chosen: np.ndarray) -> "Windows":
        """Some of them, by number."""
        new = np.full(len(self), -1)
        new[chosen] = np.arange(len(chosen))
        rows = np.flatnonzero(new[self.window] >= 0)
        rows = rows[np.argsort(new[self.window[rows]], kind="stable")]
        return Windows(
            self.log[chosen], self.start[chosen], self.steps[chosen],
            new[self.window[rows]], self.at[rows], self.readings[rows],
        )  # fmt: skip

    def rows(self, chosen: np.ndarray) -> np.ndarray:
        """Numbers of the samples of some windows, as `take` orders them."""
        new = np.full(len(self), -1)
        new[chosen] = np.arange(len(chosen))
        rows = np.flatnonzero(new[self.window] >= 0)
        return rows[np.argsort(new[self.window[rows]], kind="stable")]

    @classmethod
    def joined(cls, parts: Sequence["Windows"]) -> "Windows":
        """Several as one."""
        first = np.cumsum([0, *(len(p) for p in parts)])
        each = zip(parts, first, strict=False)
        return cls(
            np.concatenate([p.log for p in parts]),
            np.concatenate([p.start for p in parts]),
            np.concatenate([p.steps for p in parts]),
            np.concatenate([p.window + n for p, n in each]),
            np.concatenate([p.at for p in parts]),
            np.concatenate([p.readings for p in parts]),
        )


def windows(
    logs: Sequence[Log],
    steps: int | None,
    *,
    only: int | None = None,
    empty: bool = False,
) -> Windows:
    """Cut episodes into pieces of about `steps`; None: each episode is one piece.

    Args:
        logs: episodes.
        steps: of a piece.
        only: the one episode to cut; None: all.
        empty: whether samples without a reading count.
    """
    log: list[int] = []
    start: list[int] = []
    length: list[int] = []
    rows: list[np.ndarray] = []
    at: list[Floats] = []
    readings: list[Floats] = []
    for i, episode in enumerate(logs):
        if only is not None and i != only:
            continue
        last = episode.at[-1]
        count = 1 if steps is None else max(1, int(np.ceil(last / steps - 0.3)))
        cuts = np.linspace(0, last, count + 1)
        cuts[1:-1] = np.round(cuts[1:-1])
        for a, b in zip(cuts[:-1], cuts[1:], strict=True):
            inside = (episode.at > a) & (episode.at <= b)
            if a == 0:
                inside |= episode.at == 0
            if not empty:
                inside &= np.isfinite(episode.readings).any(axis=1)
            if not inside.any():
                continue
            rows.append(np.full(int(inside.sum()), len(log)))
            log.append(i)
            start.append(int(a))
            length.append(int(np.ceil(b - a)))
            at.append(episode.at[inside] - a)
            readings.append(episode.readings[inside])
    return Windows(
        np.array(log, int), np.array(start, int), np.array(length, int),
        np.concatenate([*rows, np.zeros(0, int)]), np.concatenate([*at, np.zeros(0)]),
        np.concatenate([*readings, np.zeros((0, logs[0].readings.shape[1]))]),
    )  # fmt: skip
