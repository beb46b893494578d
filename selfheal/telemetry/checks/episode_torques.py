"""Episodes that do not fit the others: takes what explains the motion, finds the worst.

Physics that a model lacks is missing in all episodes. What is fitted to the others
has to balance the torques of each. A sign, a zero or a load of one episode alone does
not, nor does an end in which no actuator gives a torque.
"""

import numpy as np

from ...recording.data import Floats
from ..balance import TorqueBalance
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
from ..relations import FAR_BETTER, UNIT_TOLERANCE, f_test
from ..states import ColumnMap
from ..terms import Terms
from .ranges import TOLERANCE_SHARE

MAX_FOLDS = 8  # of episodes, each predicted from the others; chosen: tenths of a second
# median share of a block that such an episode leaves, at least, of torques and of
# simulations; chosen: an eighth of a torque, and no better than no prediction
MIN_LEFT, MIN_MISSED = 0.02, 1.0
TIMES = 8.0  # that of any other episode; chosen
# share of what an episode leaves that one more number may leave to be its cause
EXPLAINED = 0.3
NORMAL = 2.198  # mean of squares over their median, of normal numbers; exact: 1 / 0.455
OFF_BASIS = (
    "F test of what torques leave with the actuators' and without, times episodes, "
    "joints and seconds"
)


def find(context: Context) -> list[Fault]:
    """The episode at whose end nothing drives the robot, or the one that fits least."""
    if context.frozen or context.is_late:
        return []
    if len(context.series.episodes) < MIN_EPISODES:
        return []
    return _find_unpowered(context.balance) or _find_unlike(context)


def _find_unpowered(balance: TorqueBalance) -> list[Fault]:
    """The episode at whose end most joints move as if their actuators gave nothing.

    In the others they move as these say.
    """
    if balance.reason:
        return []
    series, faults = balance.series, list[Fault]()
    on, off, acts = _balance_without(balance)
    ids = list(dict.fromkeys(balance.names.tolist()))
    for episode in ids:
        own = np.flatnonzero(balance.names == episode)
        _, starts = np.unique(balance.block[own], return_index=True)
        for start in starts:
            rows = own[start:]
            seconds = series.step * (balance.rows[rows[-1]] - balance.rows[rows[0]])
            count = seconds / series.independent_seconds
            share = off[rows].sum(axis=0) / np.maximum(on[rows].sum(axis=0), 1e-30)
            driven = acts[own[0]] & (on[rows] > 0).any(axis=0)
            lost = driven & (share < FAR_BETTER)
            if count < 1 or 2 * lost.sum() <= driven.sum():
                continue
            left = float(np.exp(np.log(share[lost]).mean()))
            p = f_test(1, left, *(count * lost.sum(),) * 2)
            p *= len(ids) * len(starts) * int(driven.sum())
            joints = [balance.name_dof(int(d)) for d in balance.dofs[lost]]
            seen = (
                f"in the last {seconds:.2g} s of episode {episode!r} nothing seems to "
                f"drive {format_columns(joints)}: without the actuators' torques "
                f"{100 * left:.2g} % of what is left with them is: it was aborted, say"
            )
            faults.append(report_odd((episode,), (), joints[0], seen, (p, OFF_BASIS)))
    least = min(faults, key=lambda fault: fault.p_value, default=None)
    return [least] if least and least.p_value < MAX_P_VALUE else []


def _list_folds(names: np.ndarray) -> np.ndarray:
    """Fold (n) of rows of named episodes."""
    return np.unique(names, return_inverse=True)[1] % MAX_FOLDS


def _balance_without(balance: TorqueBalance) -> tuple[Floats, Floats, np.ndarray]:
    """What is left of each episode's torques by what is fitted to the others.

    (n, D) squares that are left with the actuators' torques and without, 0 where a
    joint is at a stop, and (n, D) whether the actuators' explain anything of the other
    episodes.
    """
    fold = _list_folds(balance.names)
    on = np.empty((len(fold), len(balance.dofs)))
    off, acts = np.empty_like(on), np.empty(on.shape, bool)
    for k, terms in enumerate(balance.terms):
        for here, x in terms.fit_others(fold, True):
            left = terms.leave(x)
            given = terms.parts["act"] + terms.x[:, :2] @ x[:2]  # with gain and delay
            on[here, k], off[here, k] = left[here] ** 2, (left - given)[here] ** 2
            without = np.sum((left - given)[~here] ** 2)
            acts[here, k] = without > np.sum(left[~here] ** 2)
        stopped = _is_at_stop(balance, terms)
        on[stopped, k] = off[stopped, k] = 0.0
    return on, off, acts


def _is_at_stop(balance: TorqueBalance, terms: Terms) -> np.ndarray:
    """(n) whether a joint is where its range ends, whose torque is not known."""
    model, position = balance.model, terms.parts["q"]
    joint = int(model.dof_jntid[terms.dof])
    if not model.jnt_limited[joint]:
        return np.zeros(len(position), bool)
    low, high = model.jnt_range[joint]
    near = TOLERANCE_SHARE * (high - low)
    return (position < low + near) | (position > high - near)


def _find_unlike(context: Context) -> list[Fault]:
    """The episode that fits the others least, if none of their physics explains it."""
    balance, rollouts = context.balance, context.rollouts
    if not balance.reason:
        # a fit that saw such an episode predicts the others badly, too
        suspect = _score_torques(balance, "").find_suspect()
        scores, least = _score_torques(balance, suspect), MIN_LEFT
        words = "the torques predicted from the others miss those"
    elif not rollouts.reason:
        blocks, groups = rollouts.evaluate(ColumnMap()).blocks, list(rollouts.groups)
        scores, least = Scores(blocks, rollouts.block_names, groups), MIN_MISSED
        words = "short simulations miss the motion"
    else:
        return []
    every = scores.list_odd(least, TIMES)
    odd = max(every, key=lambda one: one.median, default=None)
    if odd is None:
        return []
    name, joint = odd.episode, scores.names[odd.at]
    cause = "" if balance.reason else _name_cause(balance, name, odd.at)
    seen = (
        f"episode {name!r} does not fit the others: {words} of {joint!r} by "
        f"{100 * odd.median:.2g} % of their mean square, and of no other episode by "
        f"more than {100 * odd.next_median:.2g} %{cause}"
    )
    return [report_odd((name,), (), joint, seen, (odd.p_value, BASIS), ALONE)]


def _score_torques(balance: TorqueBalance, suspect: str) -> Scores:
    """What fits to the other episodes, the suspect one aside, leave of the torques.

    A block is scored by the median of the squares [1]: an episode that does not fit
    misses them all along, and a late command only where it jumps.
    """
    from scipy.ndimage import median

    names = balance.names
    fold, trusted = _list_folds(names), names != suspect
    fold[~trusted] = fold.max()
    blocks = np.empty((balance.count, len(balance.dofs)))
    for k, terms in enumerate(balance.terms):
        # what a servo at its limit gives, no gain says
        limit = (1 - UNIT_TOLERANCE) * balance.find_limit(terms.dof)
        free = np.abs(terms.parts["act"]) < limit
        left = np.empty(len(names))
        for here, x in terms.fit_others(fold, trusted & free):
            left[here] = terms.leave(x)[here] ** 2
        left[~free] = 0.0
        _, of = np.unique(names, return_inverse=True)
        usual = (np.bincount(of, terms.size) / np.bincount(of))[of]
        share = left / np.maximum(usual, terms.size.mean())
        blocks[:, k] = NORMAL * median(share, balance.block, np.arange(balance.count))
    joints = [balance.name_dof(int(d)) for d in balance.dofs]
    return Scores(blocks, balance.block_names, joints)


def _name_cause(balance: TorqueBalance, episode: str, at: int) -> str:
    """What one number alone would explain the episode, as the end of a sentence."""
    own, terms = balance.names == episode, balance.terms[at]
    left = terms.leave(terms.fit(~own))[own]
    causes = {
        "another zero of a sensor, or a constant force": np.ones(len(left)),
        "another load": terms.parts["all"][own],
        "another gain": terms.parts["act"][own],
    }
    after = {
        said: float(np.mean((left - c * (c @ left) / max(c @ c, 1e-12)) ** 2))
        for said, c in causes.items()
    }
    best = min(after, key=lambda said: after[said])
    is_cause = after[best] < EXPLAINED * float(np.mean(left**2))
    return f"; {best} would explain it" if is_cause else ""
