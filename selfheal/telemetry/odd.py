"""Odd episodes: takes what explains the motion, finds an episode that does not fit.

Whatever physics a model lacks, it lacks in all episodes. What the others tell of it has
to balance the torques of each; a sign, a zero or a load of one episode alone does not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..logs.model_facts import find_force_range
from ..recording import find_joint
from ..recording.data import Floats
from .balance import TorqueBalance, solve_bounded
from .disagreements import Comparison, Disagreement
from .fault import Fault, format_columns
from .pairs import UNIT_TOLERANCE
from .rollouts import Rollouts
from .series import Series
from .states import Mend

if TYPE_CHECKING:
    from .joints import JointColumns

MIN_EPISODES = 3  # of which one is odd; chosen: two tell that they differ, not which
MAX_FOLDS = 8  # of episodes, each predicted from the others; chosen: tenths of a second
# median share of a block that an odd episode leaves, at least, of torques and of
# simulations, and how many times that of the next one; chosen: an eighth of a torque,
# no better than no prediction, and more than a motion of another speed does
MIN_LEFT, MIN_MISSED, TIMES = 0.02, 1.0, 8.0
# share of what an odd episode leaves that one more number may leave to be its cause
EXPLAINED = 0.3
# [rad or m] that a joint is farther from its command in an odd episode, and how many
# times as far as in the next one; chosen: a degree, and more than gravity in a pose
MIN_ZERO, TIMES_ZERO = 0.02, 5.0
MAX_P_VALUE = 1e-3  # times the number of episodes and of joints
NORMAL = 2.198  # mean of squares over their median, of normal numbers; exact: 1 / 0.455
MIN_BLOCKS = 3  # of an odd episode; chosen: one may hold a stop or a push
BASES = {
    "blocks": "Mann and Whitney's test of blocks of a second, in the odd episode and "
    "in the others, times the episodes and the joints",
    "columns": "correlation in that episode, Fisher's z",
}


@dataclass(frozen=True, eq=False)
class Scores:
    """How badly each block fits what the other episodes tell.

    Attributes:
        blocks: (B, D) share of the mean square that a block leaves [1]. Of torques it
            is by the median of their squares: an odd episode misses them all along,
            and a late command only where it jumps.
        episode: (B) id of the episode of each block.
        names: (D) of the joints, or of what moves.
        words: how an episode that does not fit is told.
        least: share that an odd episode leaves.
    """

    blocks: Floats
    episode: np.ndarray
    names: Sequence[str]
    words: str
    least: float


def find_odd(series: Series, balance: TorqueBalance, rollouts: Rollouts) -> list[Fault]:
    """The episode that fits the others least, if none of their physics explains it.

    Args:
        series: of the recording.
        balance: of its torques.
        rollouts: where there is no balance.
    """
    if len(series.episodes) < MIN_EPISODES:
        return []
    if not balance.reason:
        # a fit that saw an odd episode predicts the others badly, too
        suspect = _find_suspect(_score_torques(balance, ""))
        scores = _score_torques(balance, suspect)
    elif not rollouts.reason:
        scores = _score_rollouts(rollouts)
    else:
        return []
    found = _find_worst(scores)
    if found is None:
        return []
    episode, at, here, there, p = found
    cause = "" if balance.reason else _name_cause(balance, episode, at)
    return [Fault(
        "odd_episode", (episode,), (), scores.names[at],
        f"episode {episode!r} does not fit the others: {scores.words} of "
        f"{scores.names[at]!r} by {100 * here:.2g} % of their mean square, and of no "
        f"other episode by more than {100 * there:.2g} %{cause}",
        p, BASES["blocks"], (f"leave episode {episode!r} out, or diagnose it alone",),
    )]  # fmt: skip


def find_odd_columns(
    comparison: Comparison, found: Sequence[Disagreement],
    joints: Mapping[str, "JointColumns"], series: Series, what: str,
) -> list[Fault]:  # fmt: skip
    """Columns that contradict each other in few episodes, and agree in the others.

    Args:
        comparison: of two columns of each joint.
        found: their disagreements.
        joints: by name.
        series: of the recording.
        what: "velocity" or "command": what is compared with the position.
    """
    faults = []
    for one in found:
        if one.kind not in ("sign", "unit") or len(series.episodes) < MIN_EPISODES:
            continue
        others = [k for k in series.episodes if k not in one.episodes]
        if _count_right(comparison, one.joint, others, series) < 2 * len(one.episodes):
            continue
        j = joints[one.joint]
        names = [j.position, getattr(j, what, "")]
        said = {
            "sign": f"has another sign than in the others ({one.relation.r:.3f})",
            "unit": f"is {abs(one.relation.ratio):.3g} times as large",
        }[one.kind]
        faults.append(Fault(
            "odd_episode", one.episodes, tuple(filter(None, names)), one.joint,
            f"in episode {', '.join(map(repr, one.episodes))} joint {one.joint!r} "
            f"{said}: {format_columns(list(filter(None, names)))} against its "
            f"{'position' if what == 'velocity' else 'command'}",
            one.p_value, BASES["columns"],
            (f"leave episode {', '.join(map(repr, one.episodes))} out, or correct it "
             "alone",),
        ))  # fmt: skip
    return faults


def find_odd_zeros(
    comparison: Comparison, joints: Mapping[str, "JointColumns"], series: Series
) -> list[Fault]:
    """Servos' joints that in one episode stand elsewhere by their command.

    Args:
        comparison: of what is commanded with the position, by joint.
        joints: by name.
        series: of the recording.
    """
    from scipy.stats import mannwhitneyu

    ids, faults = series.episodes, list[Fault]()
    if len(ids) < MIN_EPISODES:
        return []
    for name, goal in comparison.first.items():
        off = comparison.second[name] - goal
        known = np.isfinite(off)
        blocks, of = np.unique(series.block[known], return_inverse=True)
        if len(blocks) < MIN_EPISODES:
            continue
        mean = _average_blocks(off[known], of)
        episode = _name_blocks(np.array(series.ids)[series.episode[known]], of)
        median = {k: float(np.median(mean[episode == k])) for k in ids
                  if (episode == k).any()}  # fmt: skip
        if len(median) < MIN_EPISODES:  # the others are too short, or not read
            continue
        middle = float(np.median(list(median.values())))
        far = sorted(median, key=lambda k: abs(median[k] - middle))
        here, there = (abs(median[k] - middle) for k in (far[-1], far[-2]))
        own = episode == far[-1]
        if own.sum() < MIN_BLOCKS or here < max(MIN_ZERO, TIMES_ZERO * there):
            continue
        p = mannwhitneyu(mean[own], mean[~own]).pvalue * len(ids) * len(joints)
        if p < MAX_P_VALUE:
            faults.append(Fault(
                "odd_episode", (far[-1],), (joints[name].position,), name,
                f"in episode {far[-1]!r} joint {name!r} stands {here:.3g} farther from "
                f"its command than in most, and in no other by more than {there:.3g}: "
                "another zero of its sensor, or a load",
                float(p), BASES["blocks"],
                (f"leave episode {far[-1]!r} out, or diagnose it alone",),
            ))  # fmt: skip
    return faults


def _count_right(
    comparison: Comparison, joint: str, ids: Sequence[str], series: Series
) -> int:
    """In how many episodes the columns of a joint agree.

    Args:
        comparison: of two columns of each joint.
        joint: its name.
        ids: of the episodes.
        series: of the recording.
    """
    count = 0
    for name in ids:
        numbers = [i for i, n in enumerate(series.ids) if n == name]
        rows = np.flatnonzero(np.isin(series.episode, numbers))
        relation = comparison.relate(joint, joint, series, rows)
        count += relation.is_same and relation.r > 0 and not relation.has_other_unit
    return count


def _find_suspect(scores: Scores) -> str:
    """The episode that leaves most, by the next one."""
    ids = [str(k) for k in dict.fromkeys(scores.episode)]
    medians = np.array(
        [np.median(scores.blocks[scores.episode == k], axis=0) for k in ids]
    )
    if len(ids) < MIN_EPISODES:
        return ""
    ratio = np.sort(medians, axis=0)[-1] / (np.sort(medians, axis=0)[-2] + 1e-12)
    return ids[int(np.argmax(medians[:, int(np.argmax(ratio))]))]


def _score_torques(balance: TorqueBalance, suspect: str) -> Scores:
    """What fits to the other episodes leave of each block's torques.

    Args:
        balance: of the recording.
        suspect: id of an episode that no fit sees.
    """
    from scipy.ndimage import median

    series, rows = balance.series, balance.rows
    names = np.array(series.ids)[series.episode[rows]]
    fold = np.unique(names, return_inverse=True)[1] % MAX_FOLDS
    count = int(balance.block.max()) + 1
    blocks = np.empty((count, len(balance.dofs)))
    for k, d in enumerate(balance.dofs):
        own, terms = balance.make_terms(balance.torques, d)
        # what a servo at its limit gives, no gain tells
        free = np.abs(own["act"]) < (1 - UNIT_TOLERANCE) * _find_limit(balance, int(d))
        left = np.empty(len(rows))
        for f in np.unique(fold):
            rest = (fold != f) & (names != suspect)
            fit = rest & free
            x = solve_bounded(terms.x[fit], -terms.missing[fit], terms.bounds)
            left[~rest] = (terms.missing + terms.x @ x)[~rest] ** 2
        left[~free] = 0.0
        size = np.maximum(_average(terms.size, names), terms.size.mean())
        blocks[:, k] = NORMAL * median(left / size, balance.block, np.arange(count))
    return Scores(
        blocks, _name_blocks(names, balance.block),
        [name_dof(balance, int(d)) for d in balance.dofs],
        "the torques that the others tell miss those", MIN_LEFT,
    )  # fmt: skip


def _find_limit(balance: TorqueBalance, dof: int) -> float:
    """Largest torque of a joint's actuators [N m or N]; infinite where none is stated.

    Args:
        balance: of the torques.
        dof: of the joint.
    """
    model = balance.given
    joint, total = int(model.dof_jntid[dof]), 0.0
    for a in range(model.nactuator):
        if find_joint(model, a) == joint:
            ends = find_force_range(model, a)
            total += min(map(abs, ends)) if ends else np.inf
    return total or np.inf


def _score_rollouts(rollouts: Rollouts) -> Scores:
    """What simulations miss in each block."""
    series = rollouts.states.series
    names = np.array(series.ids)[series.episode[rollouts.rows]]
    return Scores(
        rollouts.evaluate(Mend()).blocks, _name_blocks(names, rollouts.block),
        rollouts.groups, "short simulations miss the motion", MIN_MISSED,
    )  # fmt: skip


def _find_worst(scores: Scores) -> tuple[str, int, float, float, float] | None:
    """Episode, number of the joint, its median, the next one's and the p-value."""
    from scipy.stats import mannwhitneyu

    ids = [str(k) for k in dict.fromkeys(scores.episode)]
    if len(ids) < MIN_EPISODES:
        return None
    best = None
    for d in range(scores.blocks.shape[1]):
        share = scores.blocks[:, d]
        median = {k: float(np.median(share[scores.episode == k])) for k in ids}
        episode = max(ids, key=lambda k: median[k])
        rest = max((median[k] for k in ids if k != episode), default=np.inf)
        own = scores.episode == episode
        if own.sum() < MIN_BLOCKS or median[episode] < max(scores.least, TIMES * rest):
            continue
        p = mannwhitneyu(share[own], share[~own], alternative="greater").pvalue
        p = float(p) * len(ids) * scores.blocks.shape[1]
        if p < MAX_P_VALUE and (best is None or median[episode] > best[2]):
            best = episode, d, median[episode], rest, p
    return best


def _name_cause(balance: TorqueBalance, episode: str, at: int) -> str:
    """What one number alone would explain the episode, as the end of a sentence."""
    series, rows, d = balance.series, balance.rows, int(balance.dofs[at])
    own = np.array(series.ids)[series.episode[rows]] == episode
    parts, terms = balance.make_terms(balance.torques, d)
    x = solve_bounded(terms.x[~own], -terms.missing[~own], terms.bounds)
    left = (terms.missing + terms.x @ x)[own]
    causes = {
        "another zero of a sensor, or a constant force": np.ones(len(left)),
        "another load": parts["all"][own],
        "another gain": parts["act"][own],
    }
    after = {
        said: float(np.mean((left - c * (c @ left) / max(c @ c, 1e-12)) ** 2))
        for said, c in causes.items()
    }
    best = min(after, key=lambda said: after[said])
    return f"; {best} would explain it" if (
        after[best] < EXPLAINED * float(np.mean(left**2))) else ""  # fmt: skip


def _average(values: Floats, names: np.ndarray) -> Floats:
    """Mean (n) over the episode of each row."""
    _, of = np.unique(names, return_inverse=True)
    return (np.bincount(of, values) / np.bincount(of))[of]


def _average_blocks(values: Floats, block: np.ndarray) -> Floats:
    """Mean (B) over the rows of each block."""
    return np.bincount(block, values) / np.maximum(np.bincount(block), 1)


def _name_blocks(names: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Id (B) of the episode of each block."""
    first = np.unique(block, return_index=True)[1]
    return names[first]


def name_dof(balance: TorqueBalance, dof: int) -> str:
    """The joint of a degree of freedom, or the body of a free joint."""
    m = balance.given
    joint = m.joint(int(m.dof_jntid[dof]))
    return joint.name or m.body(int(m.dof_bodyid[dof])).name
