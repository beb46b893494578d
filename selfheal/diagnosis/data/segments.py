"""Segments: takes episodes, gives parts of them to simulate from their own states."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np

from ...recording.data import Floats
from .episodes import SampledEpisode

# readings in some segment; chosen: fewer tell no correlation in time
MIN_CORRELATED_READINGS = 4
# share by which segments may be longer than wanted; chosen: rather than cut anew
MAX_SEGMENT_EXCESS = 0.3


@dataclass(frozen=True, eq=False)
class Segments:
    """W segments of episodes, and the M samples that lie in them, in order.

    Attributes:
        episode: (W) number of each segment's episode.
        first_step: (W) where each begins on its episode's grid [steps].
        lengths: (W) of each [steps].
        segment_of_sample: (M) number of each sample's segment.
        sample_steps: (M) time of each sample since its segment began [steps].
        readings: (M, C) of all channels [each channel's unit]; NaN where missing.
    """

    episode: np.ndarray
    first_step: np.ndarray
    lengths: np.ndarray
    segment_of_sample: np.ndarray
    sample_steps: Floats
    readings: Floats

    def __len__(self) -> int:
        """How many segments."""
        return len(self.episode)

    @property
    def is_single_readings(self) -> bool:
        """Whether each holds single readings, as those of a robot that takes poses."""
        counts = np.bincount(self.segment_of_sample)
        return bool(len(counts)) and int(counts.max()) < MIN_CORRELATED_READINGS

    def with_finer_steps(self, factor: int) -> "Segments":
        """These segments, counted in so many times as many steps."""
        return replace(
            self,
            first_step=factor * self.first_step,
            lengths=factor * self.lengths,
            sample_steps=factor * self.sample_steps,
        )

    def select(self, chosen: np.ndarray) -> "Segments":
        """Select segments by number, in the order of `chosen` (w)."""
        rows = self.find_sample_rows(chosen)
        return Segments(
            self.episode[chosen],
            self.first_step[chosen],
            self.lengths[chosen],
            self._renumber(chosen)[self.segment_of_sample[rows]],
            self.sample_steps[rows],
            self.readings[rows],
        )

    def find_sample_rows(self, chosen: np.ndarray) -> np.ndarray:
        """Numbers (n) of the samples in segments `chosen` (w), in order of `select`."""
        new = self._renumber(chosen)[self.segment_of_sample]
        rows = np.flatnonzero(new >= 0)
        return rows[np.argsort(new[rows], kind="stable")]

    def _renumber(self, chosen: np.ndarray) -> np.ndarray:
        """(W) where each segment is among the chosen; -1 where it is not."""
        new = np.full(len(self), -1)
        new[chosen] = np.arange(len(chosen))
        return new

    @classmethod
    def concatenate(cls, parts: Sequence["Segments"]) -> "Segments":
        """Put several sets of segments into one."""
        first = np.cumsum([0, *(len(p) for p in parts)])
        moved = [
            replace(p, segment_of_sample=p.segment_of_sample + n)
            for p, n in zip(parts, first, strict=False)
        ]
        return cls(
            *(np.concatenate([getattr(p, f.name) for p in moved]) for f in fields(cls))
        )


def cut_segments(
    episodes: Sequence[SampledEpisode],
    steps: int | None,
    *,
    only: int | None = None,
    empty: bool = False,
) -> Segments:
    """Cut episodes into segments of about equal length that hold a sample.

    A sample at a cut belongs to the segment before it.

    Args:
        steps: of a segment; None: each episode is one segment.
        only: number of the one episode to cut; None: all.
        empty: whether a sample without a reading counts.
    """
    parts, width = [], episodes[0].readings.shape[1]
    for i, episode in enumerate(episodes):
        if only is not None and i != only:
            continue
        at = episode.sample_steps
        for a, b in pairwise(_place_cuts(at[-1], steps)):
            inside = (at > a) & (at <= b) | (at == 0) & (a == 0)
            if not empty:
                inside &= np.isfinite(episode.readings).any(axis=1)
            if inside.any():
                number, begin, length = np.array([[i], [a], [np.ceil(b - a)]], int)
                own, read = np.zeros(int(inside.sum()), int), episode.readings[inside]
                parts.append(Segments(number, begin, length, own, at[inside] - a, read))
    no, none = np.zeros(0, int), np.zeros((0, width))
    return Segments.concatenate([*parts, Segments(no, no, no, no, np.zeros(0), none)])


def _place_cuts(last: float, steps: int | None) -> Floats:
    """Begins and ends [steps] of segments up to a last sample; whole steps inside."""
    count = 1
    if steps is not None:
        count = max(1, int(np.ceil(last / steps - MAX_SEGMENT_EXCESS)))
    cuts = np.linspace(0, last, count + 1)
    cuts[1:-1] = np.round(cuts[1:-1])
    return cuts
