"""Aborted episodes: takes servos' commands and positions, finds where none follows.

A drive that was switched off, or held where it was, follows no more; what physics a
model lacks has joints follow alike in all episodes.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .disagreements import INDEPENDENT_KERNELS, Comparison
from .fault import Fault
from .series import Series

if TYPE_CHECKING:
    from .joints import JointColumns

MIN_EPISODES = 3  # of which one is told; chosen: two tell that they differ, not which
# share of a position's variance that its command does not tell in an aborted episode,
# and how many times that of any other episode; chosen: as of an odd one
MIN_LEFT, TIMES = 0.1, 8.0
MAX_P_VALUE = 1e-3
BASIS = "F test of what commands do not tell of positions, times episodes and joints"


def find_aborted(
    comparison: Comparison, joints: Mapping[str, "JointColumns"], series: Series
) -> list[Fault]:
    """The episode in which most servos do not follow, as they do in all others.

    Args:
        comparison: of what is commanded with the position, by joint.
        joints: by name.
        series: of the recording.
    """
    ids = series.episodes
    names = np.array(series.ids)[series.episode]
    if len(ids) < MIN_EPISODES:
        return []
    left = {j: _measure_left(comparison, j, series, names) for j in comparison.first}
    best: tuple[float, str, list[str], float, float] | None = None
    for episode in ids:
        found = {
            joint: judged
            for joint, each in left.items()
            if (judged := _judge(each, series, episode))
        }
        lost = [joint for joint, (here, there, p) in found.items()
                if here > max(MIN_LEFT, TIMES * there)
                and p * len(ids) * len(found) < MAX_P_VALUE]  # fmt: skip
        if lost and 2 * len(lost) > len(found):
            p = min(1.0, max(found[j][2] for j in lost) * len(ids) * len(found))
            here = float(np.median([found[j][0] for j in lost]))
            there = float(max(found[j][1] for j in lost))
            if best is None or len(lost) * here > best[0]:
                best = len(lost) * here, episode, lost, there, p
    if best is None:
        return []
    score, episode, lost, there, p = best
    return [Fault(
        "odd_episode", (episode,), tuple(joints[j].position for j in lost), lost[0],
        f"in episode {episode!r} {len(lost)} joints do not follow their commands: "
        f"{100 * score / len(lost):.2g} % of the square of their motion is left, and "
        f"in no other episode more than {100 * there:.2g} %: it was aborted, say",
        p, BASIS, (f"leave episode {episode!r} out",),
    )]  # fmt: skip


def _measure_left(
    comparison: Comparison, joint: str, series: Series, names: np.ndarray
) -> dict[str, tuple[float, int]]:
    """What a command leaves of a position in each episode [1], and in how many rows.

    Gain and lag are those of each episode, for they change with how fast it moves.

    Args:
        comparison: of commands and positions.
        joint: its name.
        series: of the recording.
        names: (N) id of the episode of each row.
    """
    relations = {
        name: comparison.relate(joint, joint, series, np.flatnonzero(names == name))
        for name in series.ids
    }
    return {
        name: (1 - relation.r**2, relation.rows)
        for name, relation in relations.items()
        if relation.is_known
    }


def _judge(
    left: Mapping[str, tuple[float, int]], series: Series, episode: str
) -> tuple[float, float, float] | None:
    """What a command leaves of a position in an episode, at most in others, and the p.

    Args:
        left: in each episode, from `_measure_left`.
        series: of the recording.
        episode: that is asked about.
    """
    from scipy.stats import f

    if episode not in left or len(left) < MIN_EPISODES:
        return None
    here, count = left[episode]
    others = [each for name, each in left.items() if name != episode]
    independent = INDEPENDENT_KERNELS * series.kernel / series.step
    there = max(share for share, _ in others)
    counts = [max(n / independent, 1.0) for n in (count, sum(n for _, n in others))]
    return here, there, float(f.sf(here / max(there, 1e-12), *counts))
