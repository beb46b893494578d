"""Pieces of the recordings that are simulated each from its own start."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from .episodes import SampledEpisode

FEW = 4  # readings in a window, fewer of which tell no correlation in time


@dataclass(frozen=True, eq=False)
class Segments:
    """W pieces, and the M samples that lie in them.

    Attributes:
        log: (W) which episode.
        start: (W) in steps of its grid.
        steps: (W) how many.
        window: (M) of each sample.
        at: (M) time of each sample in its window [steps].
        readings: (M, C).
    """

    episode: np.ndarray
    first_step: np.ndarray
    lengths: np.ndarray
    segment_of_sample: np.ndarray
    sample_steps: Floats
    readings: Floats

    def __len__(self) -> int:
        """How many windows."""
        return len(self.episode)

    @property
    def is_single_readings(self) -> bool:
        """Whether they hold single readings, as those of a robot that takes poses."""
        return (
            bool(len(self.segment_of_sample))
            and int(np.bincount(self.segment_of_sample).max()) < FEW
        )

    @property
    def with_half_step(self) -> "Segments":
        """The same, counted in steps of half the size."""
        return replace(
            self,
            first_step=2 * self.first_step,
            lengths=2 * self.lengths,
            sample_steps=2 * self.sample_steps,
        )

    def select(self, chosen: np.ndarray) -> "Segments":
        """Some of them, by number."""
        new = np.full(len(self), -1)
        new[chosen] = np.arange(len(chosen))
        rows = np.flatnonzero(new[self.segment_of_sample] >= 0)
        rows = rows[np.argsort(new[self.segment_of_sample[rows]], kind="stable")]
        return Segments(
            self.episode[chosen],
            self.first_step[chosen],
            self.lengths[chosen],
            new[self.segment_of_sample[rows]],
            self.sample_steps[rows],
            self.readings[rows],
        )

    def find_sample_rows(self, chosen: np.ndarray) -> np.ndarray:
        """Numbers of the samples of some windows, as `take` orders them."""
        new = np.full(len(self), -1)
        new[chosen] = np.arange(len(chosen))
        rows = np.flatnonzero(new[self.segment_of_sample] >= 0)
        return rows[np.argsort(new[self.segment_of_sample[rows]], kind="stable")]

    @classmethod
    def concatenate(cls, parts: Sequence["Segments"]) -> "Segments":
        """Several as one."""
        first = np.cumsum([0, *(len(p) for p in parts)])
        each = zip(parts, first, strict=False)
        return cls(
            np.concatenate([p.episode for p in parts]),
            np.concatenate([p.first_step for p in parts]),
            np.concatenate([p.lengths for p in parts]),
            np.concatenate([p.segment_of_sample + n for p, n in each]),
            np.concatenate([p.sample_steps for p in parts]),
            np.concatenate([p.readings for p in parts]),
        )


def cut_segments(
    logs: Sequence[SampledEpisode],
    steps: int | None,
    *,
    only: int | None = None,
    empty: bool = False,
) -> Segments:
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
        last = episode.sample_steps[-1]
        count = 1 if steps is None else max(1, int(np.ceil(last / steps - 0.3)))
        cuts = np.linspace(0, last, count + 1)
        cuts[1:-1] = np.round(cuts[1:-1])
        for a, b in zip(cuts[:-1], cuts[1:], strict=True):
            inside = (episode.sample_steps > a) & (episode.sample_steps <= b)
            if a == 0:
                inside |= episode.sample_steps == 0
            if not empty:
                inside &= np.isfinite(episode.readings).any(axis=1)
            if not inside.any():
                continue
            rows.append(np.full(int(inside.sum()), len(log)))
            log.append(i)
            start.append(int(a))
            length.append(int(np.ceil(b - a)))
            at.append(episode.sample_steps[inside] - a)
            readings.append(episode.readings[inside])
    return Segments(
        np.array(log, int), np.array(start, int), np.array(length, int),
        np.concatenate([*rows, np.zeros(0, int)]), np.concatenate([*at, np.zeros(0)]),
        np.concatenate([*readings, np.zeros((0, logs[0].readings.shape[1]))]),
    )  # fmt: skip
