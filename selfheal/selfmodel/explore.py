"""Choice of actions: the one whose reading tells most of the body."""

import numpy as np
from numpy.random import Generator

from ..body.body import Floats, Ints
from .neighborhood import Hypotheses
from .symmetry import SymmetryGroup

_VOTERS = 384  # bodies that vote, drawn by belief; chosen
# Chosen: two degrees (or 4 mm) apart is well apart, given the half degree by
# which even the right body misses a reading; a degree of loss makes a body e times
# less likely.
_RESOLUTION, TEMPERATURE = 2.0, 1.0
# of what an action says of bodies of one tree; chosen, from 0.02 to 0.1 all is the same
_BODY_WEIGHT = 0.05
# Of disagreement. Chosen on runs of other seeds (from 200 on) than the results': what a
# model misses by is much the same in many actions, so that belief is too sure of it.
DISAGREEMENT_TEMPERATURE = 4.0
# of a degree of tilt, or as much of another channel as counts like it in the loss, by
# which a reading tells two bodies apart; chosen: more than a sensor's noise and less
# than what servos add to it.
DISTINGUISHABLE = 1.0
_TABLES_AT_ONCE = 4096  # tables compared at a time, some 20 MB; chosen


def compute_plausibility(costs: Floats, temperature: float = TEMPERATURE) -> Floats:
    """(M) share of belief in bodies of these costs, sum 1 (a Laplace likelihood)."""
    weight = np.exp(-(costs - costs.min()) / temperature)
    return weight / weight.sum()


def measure_disagreement(tables: Floats, belief: Floats) -> float:
    """Mean standard deviation of what bodies foretell, each as far as it is believed.

    Args:
        tables: (M, A, C) of the bodies; NaN, where a simulation failed, counts nothing.
        belief: (M) in them, in any unit.

    Returns:
        In the tables' unit; 0 where there is no action left.
    """
    weight = belief[:, None, None] * ~np.isnan(tables)
    weight = weight / np.maximum(weight.sum(axis=0), 1e-300)
    mean = (weight * np.nan_to_num(tables)).sum(axis=0)
    square = (weight * np.nan_to_num(tables - mean) ** 2).sum(axis=0)
    return float(np.sqrt(square).mean()) if square.size else 0.0


def find_indistinguishable(
    found: Hypotheses, table: Floats, weight: Floats
) -> Hypotheses:
    """Hypotheses that no action tells from the body of a table.

    An action under which a body's channels are not known, NaN, tells nothing.

    Args:
        table: (A, C) of the body.
        weight: (C) of the channels in the loss [1/unit].
    """
    rows = np.arange(len(found))
    alike = [np.empty(0, np.int64)]
    for some in np.array_split(rows, 1 + len(rows) // _TABLES_AT_ONCE):
        gap = np.nan_to_num(np.abs(found[some].tables - table)) * weight
        alike.append(some[(gap <= DISTINGUISHABLE).all(axis=(1, 2))])
    return found[np.concatenate(alike)]


def draw_voters(
    found: Hypotheses, rng: Generator, temperature: float = TEMPERATURE
) -> tuple[Hypotheses, Floats]:
    """Draw bodies by belief at even distances, each once.

    Args:
        temperature: loss that makes a body e times less likely.

    Returns:
        The bodies, and the belief (N) that each stands for.
    """
    sums = np.cumsum(compute_plausibility(found.costs, temperature))
    marks = (rng.random() + np.arange(_VOTERS)) / _VOTERS
    drawn = np.searchsorted(sums, marks * sums[-1])
    rows, count = np.unique(np.minimum(drawn, len(sums) - 1), return_counts=True)
    return found[rows], count / count.sum()


def predict_belief(
    tables: Floats, parent: Ints, belief: Floats, weight: Floats
) -> tuple[Floats, Floats]:
    """Beliefs that each action would leave in a body's tree, and in bodies like it.

    P(tree of k | reading of k), where a reading of body k leaves to body l
    w_l exp(-d_kl^2 / 2 s^2), d the distance of their channels.

    Args:
        tables: (M, A, C) channels.
        parent: (M, P) trees.
        belief: (M) sum 1.
        weight: (C) of the channels in the loss [1/unit].

    Returns:
        (A, M) belief in the tree of each body if it is right, and (A, M) in a body.
    """
    seen = np.nan_to_num(tables * weight / _RESOLUTION).transpose(1, 0, 2)
    _, tree = np.unique(parent, axis=0, return_inverse=True)
    same = tree.ravel()[:, None] == tree.ravel()
    left = np.empty((2, *seen.shape[:2]))
    for action, points in enumerate(seen):
        square = (points**2).sum(axis=1)
        gap = square[:, None] + square - 2 * points @ points.T
        alike = np.exp(-np.maximum(gap, 0) / 2)
        every = alike @ belief
        left[:, action] = ((alike * same) @ belief) / every, belief / every
    return left[0], left[1]


def score_actions(tree: Floats, body: Floats, belief: Floats) -> Floats:
    """(A) information about the tree and the body (Lindley 1956) [nats].

    It is the expected logarithm of the belief in the right one, up to a constant. What
    an action says of the tree goes before what it says of bodies of the same tree.

    Args:
        tree: (A, M) belief left in the tree of each body if it is right.
        body: (A, M) belief left in the body itself.
        belief: (M) sum 1.
    """
    return np.log(tree) @ belief + _BODY_WEIGHT * (np.log(body) @ belief)


def count_contrasts(twins: SymmetryGroup, actions: Floats) -> Floats:
    """(A) number of pairs of like parts whose joints each action sends apart.

    Two parts that are alike can trade places, unnoticed, as long as every action
    sends their joints to the same angle.

    Args:
        actions: (A, P) joint targets [rad].
    """
    i, j = np.triu_indices(actions.shape[1], 1)
    alike = np.array(
        [(twins.trade[:, a] == b).any() for a, b in zip(i, j, strict=True)]
    )
    apart = np.abs(actions[:, i[alike]] - actions[:, j[alike]]) > 1e-6
    return apart.sum(axis=1).astype(float)


def choose_first_action(twins: SymmetryGroup, actions: Floats, rng: Generator) -> int:
    """Draw one of the actions that send most like parts apart, all equally likely.

    Args:
        actions: (A, P) joint targets [rad].
    """
    apart = count_contrasts(twins, actions)
    return int(rng.choice(np.flatnonzero(apart == apart.max())))


def choose_action(score: Floats, tried: tuple[int, ...]) -> int:
    """The untried action of the highest score (A)."""
    score = np.array(score, float)
    score[list(tried)] = -np.inf
    return int(np.argmax(score))


def choose_random_action(count: int, tried: tuple[int, ...], rng: Generator) -> int:
    """Draw an untried action, all equally likely."""
    left: Ints = np.setdiff1d(np.arange(count), tried)
    return int(left[rng.integers(len(left))])
