"""Episodes whose columns contradict each other as in no other episode.

A drive that was switched off, or held where it was, follows its command no more. A
sign, a unit or a zero of one episode alone is no fault of the whole log.
"""

from collections.abc import Iterator

import numpy as np

from ..comparisons import Comparison, Disagreement
from ..context import Context
from ..fault import Fault, format_columns
from ..residuals import average_blocks

MIN_EPISODES = 3  # of which one is found; chosen: of two either may be wrong
# share of a position's variance that its command does not predict when aborted,
# and how many times that of any other episode; chosen: an eighth of the motion
MIN_LEFT, TIMES = 0.1, 8.0
# [rad or m] that a joint is farther from its command in one episode, and how many
# times as far as in the next one; chosen: a degree, and more than gravity in a pose
MIN_ZERO, TIMES_ZERO = 0.02, 5.0
MIN_BLOCKS = 3  # of that episode; chosen: one may hold a stop or a push
MAX_P_VALUE = 1e-3  # times the number of episodes and of joints
ALONE = ", or diagnose it alone"
BASES = {
    "following": "F test of what commands do not predict of positions, times episodes "
    "and joints",
    "columns": "correlation in that episode, Fisher's z",
    "blocks": "Mann and Whitney's test of blocks of a second, in that episode and "
    "in the others, times the episodes and the joints",
}


def find(context: Context) -> list[Fault]:
    """The episode in which servos do not follow; or whose columns are wrong."""
    if len(context.series.episodes) < MIN_EPISODES:
        return []
    found = _find_aborted(context) or [
        f for one in context.disagreements for f in _judge_columns(context, one)
    ]
    if found or not context.balance.reason:  # torques distinguish a zero from a load
        return found
    servos = context.comparisons["command"].first
    return [f for joint in servos for f in _judge_zero(context, joint)]


def leave_out(*names: str, advice: str = "") -> tuple[str]:
    """What to do about episodes."""
    return (f"leave episode {', '.join(map(repr, names))} out{advice}",)


def _find_aborted(context: Context) -> list[Fault]:
    """The episode in which most servos do not follow, as they do in all others."""
    ids, comparison = context.series.episodes, context.comparisons["command"]
    left = {j: _measure_left(comparison, j) for j in comparison.first}
    faults = list[tuple[float, Fault]]()
    for episode in ids:
        judged = {j: _judge(context, each, episode) for j, each in left.items()}
        known = {j: each for j, each in judged.items() if each is not None}
        number = len(ids) * len(known)
        lost = {j: (here, there, p) for j, (here, there, p) in known.items()
                if here > max(MIN_LEFT, TIMES * there)
                and p * number < MAX_P_VALUE}  # fmt: skip
        if 2 * len(lost) <= len(known):
            continue
        shares, others, p_values = zip(*lost.values(), strict=True)
        here = float(np.median(shares))
        faults.append((len(lost) * here, Fault(
            "odd_episode", (episode,),
            tuple(context.joints[j].position for j in lost), next(iter(lost)),
            f"in episode {episode!r} {len(lost)} joints do not follow their commands: "
            f"{100 * here:.2g} % of the square of their motion is left, and in no "
            f"other episode more than {100 * max(others):.2g} %: it was aborted, say",
            min(1.0, max(p_values) * number), BASES["following"], leave_out(episode),
        )))  # fmt: skip
    return [max(faults, key=lambda f: f[0])[1]] if faults else []


def _measure_left(comparison: Comparison, joint: str) -> dict[str, tuple[float, int]]:
    """What a command leaves of a position in each episode [1], and in how many rows.

    Gain and lag are those of each episode, for they change with how fast it moves.
    """
    numbers = comparison.series.numbers
    relations = {k: comparison.relate_own(joint, n) for k, n in numbers.items()}
    return {
        name: (1 - relation.r**2, relation.rows)
        for name, relation in relations.items()
        if relation.is_known
    }


def _judge(
    context: Context, left: dict[str, tuple[float, int]], episode: str
) -> tuple[float, float, float] | None:
    """What a command leaves of a position in an episode, at most in others, and p."""
    from scipy.stats import f

    if episode not in left or len(left) < MIN_EPISODES:
        return None
    here, count = left[episode]
    others = [each for name, each in left.items() if name != episode]
    independent = context.series.independent_seconds / context.series.step
    there = max(share for share, _ in others)
    counts = [max(n / independent, 1.0) for n in (count, sum(n for _, n in others))]
    return here, there, float(f.sf(here / max(there, 1e-12), *counts))


def _judge_columns(context: Context, one: Disagreement) -> Iterator[Fault]:
    """Columns that contradict each other in few episodes, and agree in the others."""
    if one.kind not in ("sign", "unit"):
        return
    comparison = context.comparisons[one.what]
    relations = [
        comparison.relate_own(one.joint, numbers)
        for name, numbers in context.series.numbers.items()
        if name not in one.episodes
    ]
    agree = [r.is_same and r.r > 0 and not r.has_other_unit for r in relations]
    if sum(agree) < 2 * len(one.episodes):
        return
    joint = context.joints[one.joint]
    columns = joint.columns if one.what == "velocity" else (joint.position,)
    said = {
        "sign": f"has another sign than in the others ({one.relation.r:.3f})",
        "unit": f"is {abs(one.relation.ratio):.3g} times as large",
    }[one.kind]
    yield Fault(
        "odd_episode", one.episodes, columns, one.joint,
        f"in episode {', '.join(map(repr, one.episodes))} joint {one.joint!r} {said}: "
        f"{format_columns(columns)} against its "
        f"{'position' if one.what == 'velocity' else 'command'}",
        one.p_value, BASES["columns"],
        leave_out(*one.episodes, advice=", or correct it alone"),
    )  # fmt: skip


def _judge_zero(context: Context, joint: str) -> Iterator[Fault]:
    """A servo's joint that in one episode stands elsewhere by its command."""
    from scipy.stats import mannwhitneyu

    comparison, series = context.comparisons["command"], context.series
    off = comparison.second[joint] - comparison.first[joint]
    known = np.isfinite(off)
    blocks, first, of = np.unique(
        series.block[known], return_index=True, return_inverse=True
    )
    if len(blocks) < MIN_EPISODES:
        return
    mean = average_blocks(off[known], of, len(blocks))
    episode = series.name_episodes(np.flatnonzero(known))[first]
    median = {k: float(np.median(mean[episode == k])) for k in series.episodes
              if (episode == k).any()}  # fmt: skip
    if len(median) < MIN_EPISODES:  # the others are too short, or not read
        return
    middle = float(np.median(list(median.values())))
    far = sorted(median, key=lambda k: abs(median[k] - middle))
    here, there = (abs(median[k] - middle) for k in (far[-1], far[-2]))
    own = episode == far[-1]
    if own.sum() < MIN_BLOCKS or here < max(MIN_ZERO, TIMES_ZERO * there):
        return
    number = len(series.episodes) * len(context.joints)
    p = float(mannwhitneyu(mean[own], mean[~own]).pvalue) * number
    if p < MAX_P_VALUE:
        yield Fault(
            "odd_episode", (far[-1],), (context.joints[joint].position,), joint,
            f"in episode {far[-1]!r} joint {joint!r} stands {here:.3g} farther from "
            f"its command than in most, and in no other by more than {there:.3g}: "
            "another zero of its sensor, or a load",
            p, BASES["blocks"], leave_out(far[-1], advice=ALONE),
        )  # fmt: skip
