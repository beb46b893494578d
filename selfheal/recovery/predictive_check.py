"""Predictive check: a belief and moves in; whether it explains them out.

The posterior predictive check of Rubin (1984), with the density that a belief predicts
of what a move makes the sensors say. How low may it be? Twins tell: robots drawn from
the belief itself, which make the same move. They differ from the prediction as the
robot may, in what the moves so far leave open. A belief of the right kind is refuted
by a move that it was not fitted to with a chance of `FALSE_ALARM` at most: if the
robot is one more twin, it is the worst of all so often.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.body import Floats
from ..body.legged import LeggedRobot
from ..engine.reflex import STEPS_PER_SAMPLE
from .estimate import Hypothesis, Trial
from .explain import (
    COMPARED_STEPS,
    DAMAGE_COST,
    LAST_STEPS,
    HypothesisPosterior,
    score_series,
    simulate_hypotheses,
)

FALSE_ALARM = 0.05  # chance that what is believed rightly is refuted by a new move
_TWINS = round(1 / FALSE_ALARM) - 1  # so that the robot is the worst of 20


def is_refuted(
    robot: LeggedRobot,
    trims: Floats,
    belief: HypothesisPosterior,
    trials: Sequence[Trial],
    rng: np.random.Generator,
) -> bool:
    """Whether the robot answered moves worse than a belief and its twins allow.

    Residuals that one more damage could not earn its place by are noise.

    Args:
        robot: as it was built.
        trims: (K, 2 + D) ways it may be off, see `engine.reflex.scale_physics`.
        belief: what may have happened.
        trials: moves, not fitted by the belief if the false alarms are to hold.
        rng: draws the twins.
    """
    factors = rng.integers(len(trims), size=_TWINS)
    twins = _draw_twins(belief, rng)
    fits = sum(
        _score_move(robot, trims, belief, trial, trims[factors], twins)
        for trial in trials
    )
    if len(trims) > 1:  # a twin is not predicted by itself
        fits[np.arange(_TWINS), factors] = -np.inf
    with np.errstate(divide="ignore"):
        weighted = fits + np.log(belief.probability)
    *others, own = np.logaddexp.reduce(weighted, axis=(1, 2)) - np.log(len(trims))
    return bool(own < min(-DAMAGE_COST, *others))


def _draw_twins(
    belief: HypothesisPosterior, rng: np.random.Generator
) -> list[Hypothesis]:
    """Hypotheses as likely as they are, values anywhere within their last step."""
    drawn = rng.choice(len(belief.hypotheses), _TWINS, p=belief.probability)
    return [
        tuple(
            replace(d, value=d.value + LAST_STEPS.get(d.kind, 0.0) * rng.uniform(-1, 1))
            for d in belief.hypotheses[k]
        )
        for k in drawn
    ]


def _score_move(
    robot: LeggedRobot,
    trims: Floats,
    belief: HypothesisPosterior,
    trial: Trial,
    factors: Floats,
    twins: Sequence[Hypothesis],
) -> Floats:
    """How well a move of each twin, then of the robot, is predicted.

    Args:
        robot: as it was built.
        trims: (K, 2 + D) ways it may be off.
        belief: its H hypotheses predict.
        trial: the move, and what the robot answered.
        factors: (N, 2 + D) how each twin is off.
        twins: N hypotheses that are true of them.

    Returns:
        (N + 1, K, H) log densities [nats]; -inf where a prediction failed.
    """
    scale = belief.scale[: COMPARED_STEPS // STEPS_PER_SAMPLE]
    rows, weights = len(scale), trial.weights
    moved = simulate_hypotheses(robot, factors, twins, weights, rows).sensors
    sensed = [*moved, trial.sensors[:rows]]
    fits = np.empty((len(sensed), len(trims), len(belief.hypotheses)))
    for k, trim in enumerate(trims):
        told = simulate_hypotheses(robot, trim, belief.hypotheses, weights, rows)
        for n, series in enumerate(sensed):
            fit = score_series(told.sensors, series, scale)
            fits[n, k] = np.where(told.failed, -np.inf, fit)
    return fits
