"""Fit of physics: a walk of the whole robot in; its friction, masses and motors out.

A threshold network is sensitive. With friction, masses and motors that are a few
percent off, its predicted way leaves the real one within half a second. Any damage is
then explained best by damage that is not there. So they are fitted to how the robot
walked while nothing was broken: to its first steps, then to more. Where contacts
decide, a fit to all steps at once leads nowhere.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..body.body import Floats
from ..body.legged import LeggedRobot
from ..engine.reflex import (
    STEPS_PER_SAMPLE,
    build_intact_plants,
    scale_physics,
    simulate_controllers,
)
from ..evolution.cma_es import CmaState, ask, start_search, tell
from ..evolution.ranking import rank_best_first
from .belief import compute_log_t

# steps that are fitted in turn, by how many searches, and those left at the end; chosen
RUNGS = ((20, 16), (30, 15), (40, 13), (60, 11), (80, 10), (110, 8), (150, 6))
_LEFT = 4
_CHILDREN, _GENERATIONS = 14, 10  # of each search for each horizon; chosen
_STEP, _LEAST_STEP = 0.02, 0.003  # logs of factors: first steps, least new ones; chosen
_PRIOR_WIDTH = 0.05  # log of a factor, as wide as a careful builder would grant; chosen
# scale of a sensor's residual: readings are free of noise; chosen
_RESIDUAL_SCALE = 0.01


def fit_physics(
    robot: LeggedRobot,
    weights: Floats,
    sensed: Floats,
    rng: np.random.Generator,
    progress: Callable[[float], None],
    rungs: Sequence[tuple[int, int]] = RUNGS,
) -> Floats:
    """(K, 2 + D) factors with which the model walks as the robot did, the best first.

    Args:
        weights: (W) of the controller's synapses [1].
        sensed: (T, S) what the whole robot sensed; see `engine.reflex.Rollouts`.
        rng: draws where to look.
        progress: called with what share is done.
        rungs: steps that are fitted in turn, and by how many searches.

    Returns:
        See `engine.reflex.scale_physics`; one row of ones where the model is right
        already.
    """
    size = 2 + len(robot.motors)
    model = simulate_controllers(build_intact_plants(robot, 1), weights[None])
    if np.array_equal(model.sensors[0], sensed):
        return np.ones((1, size))

    def score(points: Floats, steps: int) -> Floats:
        plants = scale_physics(build_intact_plants(robot, len(points)), np.exp(points))
        drives = simulate_controllers(plants, np.tile(weights, (len(points), 1)), steps)
        gap = (drives.sensors - sensed[: steps // STEPS_PER_SAMPLE]) / _RESIDUAL_SCALE
        prior = ((points / _PRIOR_WIDTH) ** 2).sum(axis=1) / 2
        fit = compute_log_t(gap).sum(axis=(1, 2)) - prior
        return np.where(drives.failed, -np.inf, fit)

    starts = (rng.normal(0, _STEP, size) for _ in range(rungs[0][1]))
    searches = [start_search(start, _STEP) for start in starts]
    for turn, (steps, count) in enumerate(rungs):
        progress(turn / len(rungs))
        longer = partial(score, steps=steps)
        searches = _extend_horizon(searches[:count], longer, rng)
    return np.exp([search.mean for search in searches[:_LEFT]])


def _extend_horizon(
    searches: list[CmaState],
    score: Callable[[Floats], Floats],
    rng: np.random.Generator,
) -> list[CmaState]:
    """Searches at the best points they found for a horizon, the best search first."""
    best = np.full(len(searches), -np.inf)
    means = [search.mean for search in searches]
    for _ in range(_GENERATIONS):
        drawn = [np.vstack([s.mean, ask(s, _CHILDREN - 1, rng)]) for s in searches]
        scores = score(np.concatenate(drawn)).reshape(len(searches), -1)
        searches = list(map(tell, searches, drawn, scores))
        for k in np.flatnonzero(scores.max(axis=1) > best):
            best[k], means[k] = scores[k].max(), drawn[k][scores[k].argmax()]
    return [
        replace(searches[k], mean=means[k], sigma=max(searches[k].sigma, _LEAST_STEP))
        for k in rank_best_first(best)
    ]
