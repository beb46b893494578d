"""Episodes that do not fit the others: scores of blocks in, the odd one out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..recording.data import Floats
from .fault import Fault

MIN_EPISODES = 3  # of which one is found; chosen: of two either may be wrong
MIN_BLOCKS = 3  # of that episode; chosen: one may hold a stop or a push
MAX_P_VALUE = 1e-3  # times the number of episodes and of joints
ALONE = ", or diagnose it alone"
BASIS = (
    "Mann and Whitney's test of blocks of a second, in that episode and in the others, "
    "times the episodes and the joints"
)


class OddEpisode(NamedTuple):
    """An episode in which a joint, number `at`, fits less than in any other.

    The medians are those of its scores, and of the next worst episode's.
    """

    episode: str
    at: int
    median: float
    next_median: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Scores:
    """How badly joints fit, by blocks of a second.

    Attributes:
        blocks: (B, D) score of each block and joint; NaN where it is not known.
        episode: (B) id of the episode of each block.
        names: (D) of the joints, or of what moves.
    """

    blocks: Floats
    episode: np.ndarray
    names: Sequence[str]

    def list_medians(self, at: int) -> dict[str, float]:
        """The median score of a joint, by its number, in each episode."""
        known = np.isfinite(self.blocks[:, at])
        return {
            str(k): float(np.median(self.blocks[known & (self.episode == k), at]))
            for k in dict.fromkeys(self.episode[known])
        }

    def list_odd(self, least: float, times: float) -> Iterator[OddEpisode]:
        """For each joint its worst episode, if that is as in no other.

        Args:
            least: median of its scores.
            times: of the next worst episode's, at least.
        """
        from scipy.stats import mannwhitneyu

        for at, score in enumerate(self.blocks.T):
            medians = self.list_medians(at)
            if len(medians) < MIN_EPISODES:
                continue
            worst = max(medians, key=lambda k: medians[k])
            *_, second, first = sorted(medians.values())
            own, known = self.episode == worst, np.isfinite(score)
            here, elsewhere = score[known & own], score[known & ~own]
            if len(here) < MIN_BLOCKS or first < max(least, times * second):
                continue
            p = float(mannwhitneyu(here, elsewhere, alternative="greater").pvalue)
            p *= len(medians) * len(self.names)
            if p < MAX_P_VALUE:
                yield OddEpisode(worst, at, first, second, p)

    def find_suspect(self) -> str:
        """The episode that is worse than the next one by most; "" of too few."""
        every = [self.list_medians(at) for at in range(len(self.names))]
        if min(map(len, every), default=0) < MIN_EPISODES:
            return ""
        ordered = [sorted(medians.values()) for medians in every]
        ratios = [first / (second + 1e-12) for *_, second, first in ordered]
        medians = every[int(np.argmax(ratios))]
        return max(medians, key=lambda k: medians[k])


def report_odd(
    episodes: Sequence[str],
    columns: Sequence[str],
    target: str,
    seen: str,
    test: tuple[float, str],
    advice: str = "",
) -> Fault:
    """The fault of odd episodes.

    Args:
        test: the p-value [1], and of which test.
        advice: what could be done instead of leaving them out.
    """
    correction = f"leave episode {', '.join(map(repr, episodes))} out{advice}"
    where = tuple(episodes), tuple(columns), target
    return Fault("odd_episode", *where, seen, *test, (correction,))
