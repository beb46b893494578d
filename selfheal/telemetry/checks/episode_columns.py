"""Episodes whose columns contradict each other as in no other episode.

A drive that was switched off, or held where it was, follows its command no more. A
sign, a unit or a zero of one episode alone is no fault of the whole log.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from ..comparisons import Comparison, Disagreement
from ..context import Context
from ..fault import Fault, format_columns
from ..odd_episodes import (
    ALONE,
    BASIS,
    MAX_P_VALUE,
    MIN_EPISODES,
    Scores,
    report_odd,
)
from ..relations import f_test

# share of a position's variance that its command does not predict when aborted,
# and how many times that of any other episode; chosen: an eighth of the motion
MIN_LEFT, TIMES = 0.1, 8.0
# [rad or m] that a joint is farther from its command in one episode, and how many
# times as far as in the next one; chosen: a degree, and more than gravity in a pose
MIN_ZERO, TIMES_ZERO = 0.02, 5.0
FOLLOWING = (
    "F test of what commands do not predict of positions, times episodes and joints"
)
CORRELATION = "correlation in that episode, Fisher's z"


def find(context: Context) -> Iterable[Fault]:
    """The episode in which servos do not follow; or whose columns are wrong."""
    if len(context.series.episodes) < MIN_EPISODES:
        return []
    found = _find_aborted(context) or [
        f for one in context.disagreements for f in _judge_columns(context, one)
    ]
    if found or not context.balance.reason:  # torques distinguish a zero from a load
        return found
    return _find_zeros(context)


def _find_aborted(context: Context) -> list[Fault]:
    """The episode in which most servos do not follow, as they do in all others."""
    ids, comparison = context.series.episodes, context.comparisons["command"]
    left = {j: _measure_left(comparison, j) for j in comparison.first}
    faults = list[tuple[float, Fault]]()
    for episode in ids:
        judged = {j: _judge(context, each, episode) for j, each in left.items()}
        known = {j: each for j, each in judged.items() if each is not None}
        number = len(ids) * len(known)
        lost = {
            j: (here, there, p)
            for j, (here, there, p) in known.items()
            if here > max(MIN_LEFT, TIMES * there) and p * number < MAX_P_VALUE
        }
        if 2 * len(lost) <= len(known):
            continue
        shares, others, p_values = zip(*lost.values(), strict=True)
        here = float(np.median(shares))
        columns = [context.joints[j].position for j in lost]
        seen = (
            f"in episode {episode!r} {len(lost)} joints do not follow their commands: "
            f"{100 * here:.2g} % of the square of their motion is left, and in no "
            f"other episode more than {100 * max(others):.2g} %: it was aborted, say"
        )
        test = min(1.0, max(p_values) * number), FOLLOWING
        fault = report_odd((episode,), columns, next(iter(lost)), seen, test)
        faults.append((len(lost) * here, fault))
    return [max(faults, key=lambda f: f[0])[1]] if faults else []


def _measure_left(comparison: Comparison, joint: str) -> dict[str, tuple[float, int]]:
    """What a command leaves of a position in each episode [1], and in how many rows.

    Gain and lag are those of each episode, for they change with how fast it moves.
    """
    numbers = comparison.series.numbers
    relations = {k: comparison.relate_own(joint, n) for k, n in numbers.items()}
    return {k: (1 - r.r**2, r.rows) for k, r in relations.items() if r.is_known}


def _judge(
    context: Context, left: dict[str, tuple[float, int]], episode: str
) -> tuple[float, float, float] | None:
    """What a command leaves of a position in an episode, at most in others, and p."""
    if episode not in left or len(left) < MIN_EPISODES:
        return None
    here, count = left[episode]
    others = [each for name, each in left.items() if name != episode]
    independent = context.series.independent_seconds / context.series.step
    there = max(share for share, _ in others)
    counts = [max(n / independent, 1.0) for n in (count, sum(n for _, n in others))]
    return here, there, f_test(here, there, *counts)


def _judge_columns(context: Context, one: Disagreement) -> Iterator[Fault]:
    """Columns that contradict each other in few episodes, and agree in the others."""
    if one.kind not in ("sign", "unit"):
        return
    comparison, joint = context.comparisons[one.what], context.joints[one.joint]
    relations = [
        comparison.relate_own(one.joint, numbers)
        for name, numbers in context.series.numbers.items()
        if name not in one.episodes
    ]
    agree = [r.is_same and r.r > 0 and not r.has_other_unit for r in relations]
    if sum(agree) < 2 * len(one.episodes):
        return
    if one.what == "velocity":
        columns, other = joint.columns, "position"
    else:
        columns, other = (joint.position,), "command"
    said = {
        "sign": f"has another sign than in the others ({one.relation.r:.3f})",
        "unit": f"is {abs(one.relation.ratio):.3g} times as large",
    }[one.kind]
    seen = (
        f"in episode {', '.join(map(repr, one.episodes))} joint {one.joint!r} {said}: "
        f"{format_columns(columns)} against its {other}"
    )
    test, advice = (one.p_value, CORRELATION), ", or correct it alone"
    yield report_odd(one.episodes, columns, one.joint, seen, test, advice)


def _find_zeros(context: Context) -> Iterator[Fault]:
    """Servos' joints that in one episode stand elsewhere by their commands."""
    comparison, series = context.comparisons["command"], context.series
    _, first, block = np.unique(series.block, return_index=True, return_inverse=True)
    means = np.full((len(first), len(comparison.first)), np.nan)
    for at, joint in enumerate(comparison.first):
        off = comparison.second[joint] - comparison.first[joint]
        rows = np.bincount(block, np.isfinite(off), minlength=len(first))
        sums = np.bincount(block, np.nan_to_num(off), minlength=len(first))
        means[rows > 0, at] = sums[rows > 0] / rows[rows > 0]
    joints, episode = list(comparison.first), series.name_episodes(first)
    each = [Scores(means, episode, joints).list_medians(k) for k in range(len(joints))]
    usual = [np.median([*medians.values()]) if medians else 0.0 for medians in each]
    scores = Scores(np.abs(means - usual), episode, joints)
    for odd in scores.list_odd(MIN_ZERO, TIMES_ZERO):
        joint = joints[odd.at]
        seen = (
            f"in episode {odd.episode!r} joint {joint!r} stands {odd.median:.3g} "
            "farther from its command than in most, and in no other by more than "
            f"{odd.next_median:.3g}: another zero of its sensor, or a load"
        )
        column, test = context.joints[joint].position, (odd.p_value, BASIS)
        yield report_odd((odd.episode,), (column,), joint, seen, test, ALONE)
