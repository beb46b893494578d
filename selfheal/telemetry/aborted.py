"""Aborted episodes: takes commands, positions and torques, finds where none acts.

A drive that was switched off, or held where it was, follows no more, and gives no
torque; what physics a model lacks, it lacks in all episodes.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..recording.data import Floats
from .balance import TorqueBalance, solve_bounded
from .disagreements import INDEPENDENT_KERNELS, Comparison
from .fault import Fault, format_columns
from .odd import MAX_FOLDS, name_dof
from .pairs import FAR_BETTER
from .ranges import TOLERANCE_SHARE
from .series import Series

if TYPE_CHECKING:
    from .joints import JointColumns

MIN_EPISODES = 3  # of which one is told; chosen: two tell that they differ, not which
# share of a position's variance that its command does not tell in an aborted episode,
# and how many times that of any other episode; chosen: as of an odd one
MIN_LEFT, TIMES = 0.1, 8.0
MAX_P_VALUE = 1e-3
BASIS = "F test of what commands do not tell of positions, times episodes and joints"
OFF_BASIS = (
    "F test of what torques leave with the actuators' and without, times episodes, "
    "joints and seconds"
)


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


def find_unpowered(balance: TorqueBalance) -> list[Fault]:
    """The episode at whose end most joints move as if their actuators gave nothing.

    In the others they move as these say.

    Args:
        balance: of the torques.
    """
    from scipy.stats import f

    if balance.reason or len(balance.series.episodes) < MIN_EPISODES:
        return []
    series = balance.series
    names = np.array(series.ids)[series.episode[balance.rows]]
    on, off, acts = _balance_without(balance, names)
    ids, best = list(dict.fromkeys(names.tolist())), None
    for episode in ids:
        own = np.flatnonzero(names == episode)
        _, starts = np.unique(balance.block[own], return_index=True)
        for start in starts:
            rows = own[start:]
            seconds = series.step * (balance.rows[rows[-1]] - balance.rows[rows[0]])
            count = seconds / (INDEPENDENT_KERNELS * series.kernel)
            share = off[rows].sum(axis=0) / np.maximum(on[rows].sum(axis=0), 1e-30)
            driven = acts[own[0]] & (on[rows] > 0).any(axis=0)
            lost = driven & (share < FAR_BETTER)
            if count < 1 or 2 * lost.sum() <= driven.sum():
                continue
            left = float(np.exp(np.log(share[lost]).mean()))
            p = float(f.sf(1 / left, *(count * lost.sum(),) * 2))
            p *= len(ids) * len(starts) * int(driven.sum())
            if p < MAX_P_VALUE and (best is None or p < best[0]):
                best = p, episode, seconds, lost, left
    if best is None:
        return []
    p, episode, seconds, lost, left = best
    joints = [name_dof(balance, int(d)) for d in balance.dofs[lost]]
    return [Fault(
        "odd_episode", (episode,), (), joints[0],
        f"in the last {seconds:.2g} s of episode {episode!r} nothing seems to drive "
        f"{format_columns(joints)}: without the actuators' torques "
        f"{100 * left:.2g} % of what is left with them is: it was aborted, say",
        p, OFF_BASIS, (f"leave episode {episode!r} out",),
    )]  # fmt: skip


def _balance_without(
    balance: TorqueBalance, names: np.ndarray
) -> tuple[Floats, Floats, np.ndarray]:
    """What is left of each episode's torques by what is fitted to the others.

    Args:
        balance: of the torques.
        names: (n) id of the episode of each row.

    Returns:
        (n, D) squares that are left with the actuators' torques and without, 0 where a
        joint is at a stop, and (n, D) whether the actuators' explain anything of the
        other episodes.
    """
    fold = np.unique(names, return_inverse=True)[1] % MAX_FOLDS
    on = np.empty((len(fold), len(balance.dofs)))
    off, acts = np.empty_like(on), np.empty(on.shape, bool)
    for k, d in enumerate(balance.dofs):
        own, terms = balance.make_terms(balance.torques, d)
        for number in np.unique(fold):
            here = fold == number
            x = solve_bounded(terms.x[~here], -terms.missing[~here], terms.bounds)
            left = terms.missing + terms.x @ x
            given = own["act"] + terms.x[:, :2] @ x[:2]  # with gain and delay
            on[here, k], off[here, k] = left[here] ** 2, (left - given)[here] ** 2
            without = np.sum((left - given)[~here] ** 2)
            acts[here, k] = without > np.sum(left[~here] ** 2)
        stopped = _is_at_stop(balance, int(d), own["q"])
        on[stopped, k] = off[stopped, k] = 0.0
    return on, off, acts


def _is_at_stop(balance: TorqueBalance, dof: int, position: Floats) -> np.ndarray:
    """(n) whether a joint is where its range ends, whose torque is not known.

    Args:
        balance: of the torques.
        dof: of the joint.
        position: (n) of the joint [rad or m].
    """
    model, joint = balance.given, int(balance.given.dof_jntid[dof])
    if not model.jnt_limited[joint]:
        return np.zeros(len(position), bool)
    low, high = model.jnt_range[joint]
    near = TOLERANCE_SHARE * (high - low)
    return (position < low + near) | (position > high - near)
