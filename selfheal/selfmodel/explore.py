"""Choice of actions: the one on which the candidate bodies disagree most."""

import numpy as np

from ..body.body import Floats, Ints
from ..body.genome import Genomes, concatenate
from .evaluate import Evaluator, Evidence
from .search import Crowd
from .space import genome_key
from .symmetry import Twins

_HYPOTHESES = 256  # chosen: twins of rivals that vote; more seldom change the choice
# Chosen: two degrees (or 4 mm) apart is well told apart, given the half degree by
# which even the right body misses a reading; a degree of loss makes a body e times
# less likely.
_RESOLUTION, _TEMPERATURE = 2.0, 1.0
_SCALE = np.array([1.0, 1.0, 0.5])  # mm of clearance count half, as in the loss


def hypotheses(
    crowd: Crowd, twins: Twins, evidence: Evidence, evaluator: Evaluator
) -> tuple[Genomes, Floats, Floats]:
    """The likeliest bodies among the rivals and all their twins, each once.

    Returns:
        genomes: (M).
        tables: (M, A, 3) channels under every action.
        losses: (M), best first.
    """
    tried, felt = np.asarray(evidence.tried), evidence.felt
    every = np.array(
        [
            twins.losses(parent, table, tried, felt, evaluator.loss).ravel()
            for parent, table in zip(crowd.genomes.parent, crowd.tables, strict=True)
        ]
    )
    # among equals every rival sends its first twins before any sends its second
    rank = np.argsort(np.argsort(every, axis=1, kind="stable"), axis=1)
    order = np.lexsort((rank.ravel(), np.round(every.ravel(), 6)))
    genomes, tables, losses = [], [], []
    known: set[bytes] = set()
    for row, twin in zip(*np.unravel_index(order, every.shape), strict=True):
        if not np.isfinite(every[row, twin]) or len(known) == _HYPOTHESES:
            break
        turn, trade = divmod(int(twin), len(twins.trade))
        genome = twins.genome(crowd.genomes, int(row), turn, trade)
        key = genome_key(genome, 0)
        if key not in known:
            known.add(key)
            genomes.append(genome)
            tables.append(twins.table(crowd.tables[row], turn, trade))
            losses.append(every[row, twin])
    return concatenate(*genomes), np.array(tables), np.array(losses)


def plausibility(losses: Floats) -> Floats:
    """(M) share of belief in bodies of these losses, sum 1 (a Laplace likelihood)."""
    weight = np.exp(-(losses - losses.min()) / _TEMPERATURE)
    return weight / weight.sum()


def telling_apart(tables: Floats, belief: Floats) -> Floats:
    """(A) how well each action would tell the bodies apart.

    The chance that two bodies drawn by belief read differently:
    sum_kl w_k w_l (1 - exp(-d_kl^2 / 2 s^2)), d the distance of their channels.

    Args:
        tables: (M, A, 3) channels.
        belief: (M) sum 1.
    """
    seen = np.nan_to_num(tables * _SCALE / _RESOLUTION).transpose(1, 0, 2)
    score = np.empty(len(seen))
    for action, points in enumerate(seen):
        square = (points**2).sum(axis=1)
        gap = square[:, None] + square - 2 * points @ points.T
        score[action] = 1 - belief @ np.exp(-np.maximum(gap, 0) / 2) @ belief
    return score


def new_contrasts(twins: Twins, actions: Floats, tried: tuple[int, ...]) -> Floats:
    """(A) share of like parts' pairs that each action would be the first to tell apart.

    Two parts that are alike can trade places, unnoticed, as long as every action
    sends their joints to the same angle. It takes three actions of one upper and one
    lower joint to set all eight of the starfish apart.

    Args:
        twins: whose trades say which parts are alike.
        actions: (A, P) joint targets [rad].
        tried: actions so far.
    """
    size = actions.shape[1]
    i, j = np.triu_indices(size, 1)
    alike = np.array(
        [(twins.trade[:, a] == b).any() for a, b in zip(i, j, strict=True)]
    )
    i, j = i[alike], j[alike]
    apart = np.abs(actions[:, i] - actions[:, j]) > 1e-6  # (A, pairs)
    new = apart & ~apart[list(tried)].any(axis=0)
    return new.sum(axis=1) / max(len(i), 1)


def choose(score: Floats, tried: tuple[int, ...]) -> int:
    """The untried action of the highest score."""
    score = np.array(score, float)
    score[list(tried)] = -np.inf
    return int(np.argmax(score))


def random_action(count: int, tried: tuple[int, ...], rng: np.random.Generator) -> int:
    """An untried action, all equally likely."""
    left: Ints = np.setdiff1d(np.arange(count), tried)
    return int(left[rng.integers(len(left))])
