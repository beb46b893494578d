"""Predictive check: a belief and moves in; whether it explains them out.

A posterior predictive check (Rubin 1984). In a walk any prediction fails sooner or
later, for contacts make much of little. What counts is how long it holds: until the
sensors lie further off than one more damage could earn its place by. How soon may that
be? Twins tell: robots drawn from the belief itself, which make the same moves. They
differ from the prediction as the robot may, in what the moves so far leave open. If
the robot is one more twin, its prediction is the first of all to fail with a chance of
`FALSE_ALARM` at most.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.body import Floats
from ..body.legged import LeggedRobot
from ..damage.kinds import KINDS, Damage
from ..engine.reflex import STEPS_PER_SAMPLE
from .estimate import Hypothesis, Trial
from .explain import (
    COMPARED_STEPS,
    DAMAGE_COST,
    LAST_STEP,
    HypothesisPosterior,
    score_series,
    simulate_hypotheses,
)

FALSE_ALARM = 0.05  # chance that what is believed rightly is refuted by a new move
_TWINS = round(1 / FALSE_ALARM) - 1  # so that the robot is the worst of 20


def is_refuted(
    robot: LeggedRobot,
    scalings: Floats,
    belief: HypothesisPosterior,
    trials: Sequence[Trial],
    rng: np.random.Generator,
) -> bool:
    """Whether a belief's prediction of moves fails sooner than that of any twin.

    Args:
        scalings: (K, 2 + D) likely factors, see `engine.reflex.scale_physics`.
        trials: moves, not fitted by the belief if the false alarms are to hold.
    """
    factors = rng.integers(len(scalings), size=_TWINS)
    twins = _draw_twins(belief, rng)
    moves = [
        _score_move(robot, scalings, belief, trial, scalings[factors], twins)
        for trial in trials
    ]
    fits = np.sum(moves, axis=0)
    if len(scalings) > 1:  # a twin is not predicted by itself
        fits[np.arange(_TWINS), factors] = -np.inf
    with np.errstate(divide="ignore"):
        chance = np.log(belief.probability)[:, None]
    total = np.logaddexp.reduce(fits + chance, axis=(1, 2)) - np.log(len(scalings))
    failed = total < -DAMAGE_COST
    lasted = np.where(failed.any(axis=1), failed.argmax(axis=1), failed.shape[1])
    return bool(lasted[-1] < lasted[:-1].min())


def _draw_twins(
    belief: HypothesisPosterior, rng: np.random.Generator
) -> list[Hypothesis]:
    """Hypotheses as likely as they are, values anywhere within their last step."""
    drawn = rng.choice(len(belief.hypotheses), _TWINS, p=belief.probability)

    def move_value(damage: Damage) -> Damage:
        width = KINDS[damage.kind].recover_values.step * LAST_STEP
        return replace(damage, value=damage.value + width * rng.uniform(-1, 1))

    return [tuple(map(move_value, belief.hypotheses[k])) for k in drawn]


def _score_move(
    robot: LeggedRobot,
    scalings: Floats,
    belief: HypothesisPosterior,
    trial: Trial,
    factors: Floats,
    twins: Sequence[Hypothesis],
) -> Floats:
    """How well a move of each twin, then of the robot, is predicted so far.

    Args:
        scalings: (K, 2 + D) likely factors of its physics.
        trial: the move, and what the robot answered.
        factors: (N, 2 + D) of each twin.
        twins: N hypotheses that are true of them.

    Returns:
        (N + 1, K, H, T) log densities until each time [nats]; -inf where the
        simulation of a prediction diverged.
    """
    scale = belief.scale[: COMPARED_STEPS // STEPS_PER_SAMPLE]
    rows, weights = len(scale), trial.weights
    moved = simulate_hypotheses(robot, factors, twins, weights, rows).sensors
    sensed = [*moved, trial.sensors[:rows]]
    fits = np.empty((len(sensed), len(scalings), len(belief.hypotheses), rows))
    for k, scaling in enumerate(scalings):
        predicted = simulate_hypotheses(
            robot, scaling, belief.hypotheses, weights, rows
        )
        for n, series in enumerate(sensed):
            fit = score_series(predicted.sensors, series, scale)
            fits[n, k] = np.where(predicted.failed[:, None], -np.inf, fit)
    return fits
