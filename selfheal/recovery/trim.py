"""Trim: a walk of the whole robot in; its likely friction, masses and motors out.

A threshold network under friction, masses and motors that are a few percent off leaves
its predicted way within half a second, and any damage is then explained best by damage
that is not there. So they are fitted to how the robot walked while nothing was broken:
to its first steps, then to more, for where contacts decide a fit to all at once leads
nowhere.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ..body.body import Floats
from ..body.legged import Legged
from ..engine.reflex import EVERY, drive, trimmed, whole
from ..gait.evolve import Evolution, ask, begin, tell
from .student import log_t

Progress = Callable[[float], None]

_HORIZONS = (20, 30, 40, 60, 80, 110, 150)  # steps that are fitted in turn; chosen
_STARTS, _KEPT = 16, 4  # searches in the beginning and in the end; chosen
_CHILDREN, _GENERATIONS = 14, 10  # of each search for each horizon; chosen
_STEP, _FINEST = 0.02, 0.003  # logs of factors: first steps, least new ones; chosen
_USUAL = 0.05  # log of a factor, as wide as a careful builder would grant; chosen
_EXACT = 0.01  # scale of a sensor's residual: readings are free of noise; chosen


def trims(
    robot: Legged,
    weights: Floats,
    sensed: Floats,
    rng: np.random.Generator,
    progress: Progress,
) -> Floats:
    """(K, 2 + D) factors with which the model walks as the robot did, the best first.

    Args:
        robot: as it was built.
        weights: (synapses) of the controller.
        sensed: (T, S) what the whole robot sensed; see `engine.reflex.Drives`.
        rng: draws where to look.
        progress: told what share is done.

    Returns:
        See `engine.reflex.trimmed`; one row of ones where the model is right already.
    """
    size = 2 + len(robot.motors)
    model = drive(whole(robot, 1), weights[None]).sensed[0]
    if np.array_equal(model, sensed):
        return np.ones((1, size))

    def score(points: Floats, steps: int) -> Floats:
        plants = trimmed(whole(robot, len(points)), np.exp(points))
        drives = drive(plants, np.tile(weights, (len(points), 1)), steps)
        gap = (drives.sensed - sensed[: steps // EVERY]) / _EXACT
        prior = ((points / _USUAL) ** 2).sum(axis=1) / 2
        fit = log_t(gap).sum(axis=(1, 2)) - prior
        return np.where(drives.failed, -np.inf, fit)

    searches = [begin(rng.normal(0, _STEP, size), _STEP) for _ in range(_STARTS)]
    for turn, steps in enumerate(_HORIZONS):
        progress(turn / len(_HORIZONS))
        found = _longer(searches, partial(score, steps=steps), rng)
        left = _STARTS - (_STARTS - _KEPT) * (turn + 1) // len(_HORIZONS)
        searches = found[:left]
    return np.exp([search.mean for search in searches])


def _longer(
    searches: list[Evolution],
    score: Callable[[Floats], Floats],
    rng: np.random.Generator,
) -> list[Evolution]:
    """Searches at the best points they found for a horizon, the best search first."""
    best = np.full(len(searches), -np.inf)
    means = [search.mean for search in searches]
    for _ in range(_GENERATIONS):
        asked = [np.vstack([s.mean, ask(s, _CHILDREN - 1, rng)]) for s in searches]
        scores = score(np.concatenate(asked)).reshape(len(searches), -1)
        searches = list(map(tell, searches, asked, scores))
        for k in np.flatnonzero(scores.max(axis=1) > best):
            best[k], means[k] = scores[k].max(), asked[k][scores[k].argmax()]
    order = np.argsort(-best, kind="stable")
    return [replace(searches[k], mean=means[k], sigma=max(searches[k].sigma, _FINEST))
            for k in order]  # fmt: skip
