"""Our estimation: the sensors' series of trials in, how likely each damage is out.

Hypotheses grow one damage at a time from "nothing", the best few at every size being
kept, as long as more damage explains more. A hypothesis is simulated under the
controllers of the trials; each sensor value counts by Student's t. Series part sooner
or later where anything is wrong, so most is learned from their beginnings, and nothing
from what follows after robots that are equally likely have parted.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..body.body import Floats
from ..body.legged import LeggedRobot
from ..damage.apply import build_damaged_plants, reduce_damages
from ..damage.kinds import KINDS, Damage
from ..engine.reflex import (
    SAMPLE,
    STEPS,
    STEPS_PER_SAMPLE,
    Rollouts,
    scale_physics,
    simulate_controllers,
)
from ..evolution.ranking import rank_best_first
from .belief import compute_log_t, compute_posterior
from .estimate import ESTIMATED_KINDS, Hypothesis, Trial

MOST_DAMAGES = 4  # damages at a time (overview.txt 4.3)
_BEAM = 8  # hypotheses of each size from which larger ones grow; chosen
# single ones whose values move, and how fast they get fewer
_FIRST_BEAM, _BEAM_DECAY = 24, 0.7
COMPARED_STEPS = 300  # steps on which hypotheses are compared while they grow; chosen
# steps after which so many of a size are left; chosen
_SCREEN_STEPS, _SCREENED = 100, 200
_FINALISTS = 24  # hypotheses that are compared on whole series; chosen
_VARIANTS = 2  # values of one hypothesis that are moved; chosen
_ROUNDS = 10  # of smaller steps in values; chosen
_STEP_DECAY = 0.65  # a round's steps : those of the one before; chosen
# Chosen: a sensor's value is not trusted more than this, and values within half a
# second say the same.
_LEAST_SCALE, _CORRELATED = 0.05, 0.5 / SAMPLE
DAMAGE_COST = 6.0  # [nats] that each damage must explain more; chosen
_HALF_TIME = 1.0  # [s] after which a sample counts half; chosen
# Chosen: damage under which likely robots are watched part, and the share of a series'
# standard deviation by which they have parted when predictions say nothing any more.
_CLEAR_KINDS, _TIE_SHARE = ESTIMATED_KINDS, 0.5
_AZIMUTH_STEP = np.pi / 8
# the last step of a value, of the first one; within it a value is not known
LAST_STEP = _STEP_DECAY ** (_ROUNDS - 1)


@dataclass(frozen=True)
class HypothesisPosterior:
    """What may have happened.

    Attributes:
        hypotheses: H, the most likely first; () is "nothing".
        probability: (H).
        scale: (T, S) of each sensor's residual at each time that was compared.
    """

    hypotheses: tuple[Hypothesis, ...]
    probability: Floats
    scale: Floats


@dataclass(frozen=True)
class _Evidence:
    """What hypotheses are held against.

    Attributes:
        robot: as it was built.
        factors: (K, 2 + D) of its physics, see `engine.reflex.scale_physics`.
        trials: so far.
        scale: (T, S) of each sensor's residual at each time that is compared.
        intact: (T, S) what the robot sensed in the first trial's place when whole.
    """

    robot: LeggedRobot
    factors: Floats
    trials: Sequence[Trial]
    scale: Floats
    intact: Floats

    def compute_log_weights(
        self, hypotheses: Sequence[Hypothesis], steps: int
    ) -> Floats:
        """(H) log likelihood and prior [nats], by the first steps of each trial."""
        prior = np.array([-DAMAGE_COST * len(h) for h in hypotheses])
        rows = min(steps // STEPS_PER_SAMPLE, len(self.scale))
        fits = [self._score_trials(hypotheses, each, rows) for each in self.factors]
        return prior + np.logaddexp.reduce(fits) - np.log(len(fits))

    def _score_trials(
        self, hypotheses: Sequence[Hypothesis], scaling: Floats, rows: int
    ) -> Floats:
        """(H) log likelihood with these factors of its physics, by the first rows."""
        total = np.zeros(len(hypotheses))
        for k, trial in enumerate(self.trials):
            drives = simulate_hypotheses(
                self.robot, scaling, hypotheses, trial.weights, rows
            )
            if k == 0 and () in hypotheses:  # a whole robot does what it did
                drives.sensors[hypotheses.index(())] = self.intact[:rows]
            fit = score_series(drives.sensors, trial.sensors[:rows], self.scale[:rows])
            total += np.where(drives.failed, -np.inf, fit[:, -1])
        return total


def score_series(predicted: Floats, sensed: Floats, scale: Floats) -> Floats:
    """How well predictions explain a series so far.

    Args:
        predicted: (H, T, S) sensor values [1].
        sensed: (T, S) those that there were.
        scale: (T, S) of their residuals.

    Returns:
        (H, T) log likelihoods of all until each time [nats].
    """
    worth = 1 / (1 + np.arange(len(sensed)) * SAMPLE / _HALF_TIME)
    gap = (predicted - sensed) / scale
    return np.cumsum(compute_log_t(gap).sum(axis=2) * worth, axis=1) / _CORRELATED


def simulate_hypotheses(
    robot: LeggedRobot,
    scaling: Floats,
    hypotheses: Sequence[Hypothesis],
    weights: Floats,
    rows: int,
) -> Rollouts:
    """Robots as hypotheses have them, under one controller or one each.

    Args:
        scaling: (2 + D) or (H, 2 + D) factors, see `engine.reflex.scale_physics`.
        weights: (W) or (H, W) of the controllers' synapses [1].

    Returns:
        What H robots did in so many samples.
    """
    plants = scale_physics(build_damaged_plants(robot, hypotheses), scaling)
    each = weights if weights.ndim > 1 else np.tile(weights, (len(hypotheses), 1))
    return simulate_controllers(plants, each, rows * STEPS_PER_SAMPLE)


def compute_residual_scale(sensed: Floats, predicted: Floats) -> Floats:
    """(T, S) scale of each sensor's residual so far, of series (N, T, S)."""
    square = np.cumsum(((sensed - predicted) ** 2).mean(axis=0), axis=0)
    so_far = square / np.arange(1, len(square) + 1)[:, None]
    return np.fmax(np.sqrt(so_far), _LEAST_SCALE)  # a run that failed says nothing


def _compute_trusted_scale(
    robot: LeggedRobot, scalings: Floats, weights: Floats, before: Floats
) -> Floats:
    """(T, S) scale of each sensor's residual, as long as predictions say anything.

    Robots that walk alike while they are whole part when they are broken, and none of
    them is quite the true one: as they part from each other, they will part from it.
    """
    model = simulate_hypotheses(robot, scalings[0], [()], weights, len(before)).sensors
    known = compute_residual_scale(before[None], model)
    if len(scalings) == 1:
        return known
    broken = [(d,) for d in list_single_damages(robot) if d.kind in _CLEAR_KINDS]
    rows = COMPARED_STEPS // STEPS_PER_SAMPLE
    one, *others = (
        simulate_hypotheses(robot, scaling, broken, weights, rows).sensors
        for scaling in scalings
    )
    first = np.concatenate([one] * len(others))
    parted = compute_residual_scale(first, np.concatenate(others))
    scale = np.fmax(known[:rows], parted)
    lost = scale.mean(axis=1) > _TIE_SHARE * before.std(axis=0).mean()
    return scale[: max(1, int(np.argmax(lost))) if lost.any() else rows]


def estimate_damage(
    robot: LeggedRobot,
    scalings: Floats,
    trials: Sequence[Trial],
    before: Floats,
    known: Sequence[Hypothesis],
    progress: Callable[[float], None],
) -> HypothesisPosterior:
    """How likely each damage is after trials.

    Args:
        scalings: (K, 2 + D) likely factors, see `engine.reflex.scale_physics`.
        trials: at least one.
        before: (T, S) what the robot sensed under the first trial's controller when it
            was whole.
        known: what was believed before the last trial; if one of them still explains
            all, there is nothing to look for.
        progress: called with what share is done.
    """
    scale = _compute_trusted_scale(robot, scalings, trials[0].weights, before)
    seen = _Evidence(robot, scalings, trials, scale, before)
    weights = _weigh_hypotheses(seen, list(dict.fromkeys([(), *known])))
    for size, grown in enumerate(_grow_hypotheses(seen, weights)):
        progress((size + 1) / (MOST_DAMAGES + 2))
        if not grown:
            break
    best = sorted(weights, key=lambda h: -weights[h])[:_FINALISTS]
    total = seen.compute_log_weights(best, STEPS)
    chance = compute_posterior(total)
    order = rank_best_first(chance)
    progress(1.0)
    return HypothesisPosterior(tuple(best[k] for k in order), chance[order], seen.scale)


def _grow_hypotheses(
    seen: _Evidence, weights: dict[Hypothesis, float]
) -> Iterator[bool]:
    """Add larger hypotheses to what is weighed, size by size; whether it helped."""
    beam: list[Hypothesis] = [()]
    coarse = list_single_damages(seen.robot)
    fine = [d for c in coarse for d in _subdivide_damage(c)]
    for width in (_FIRST_BEAM, *[_BEAM] * (MOST_DAMAGES - 1)):
        catalogue = fine if width == _FIRST_BEAM else coarse
        if _is_explained(weights):
            return
        before = max(weights.values())
        pairs = [(h, d) for h in beam for d in catalogue]
        grown = (
            reduce_damages(seen.robot, (*h, d))
            for h, d in pairs
            if d.place not in _strip_values(h)
        )
        new = [h for h in dict.fromkeys(grown) if h not in weights]
        if not new:
            return
        first = seen.compute_log_weights(new, _SCREEN_STEPS)
        kept = [new[k] for k in rank_best_first(first)[:_SCREENED]]
        level = _weigh_hypotheses(seen, kept)
        if not _is_explained(level):
            level |= _refine_values(seen, _keep_diverse(level, width, _VARIANTS))
        beam = _keep_diverse(level, _BEAM, 1)
        weights.update(level)
        yield max(level.values()) > before


def _is_explained(weights: dict[Hypothesis, float]) -> bool:
    """Whether one more damage could not earn its place."""
    best = max(weights, key=lambda h: weights[h])
    return weights[best] > -DAMAGE_COST * (len(best) + 1)


def _weigh_hypotheses(
    seen: _Evidence, hypotheses: Sequence[Hypothesis]
) -> dict[Hypothesis, float]:
    """Hypotheses with their weights by the beginnings of the trials."""
    weight = seen.compute_log_weights(hypotheses, COMPARED_STEPS)
    return dict(zip(hypotheses, weight.tolist(), strict=True))


def _refine_values(seen: _Evidence, top: list[Hypothesis]) -> dict[Hypothesis, float]:
    """Hypotheses whose values stand where they explain most, weighed."""
    groups = len({_strip_values(h) for h in top})
    for part in _STEP_DECAY ** np.arange(_ROUNDS):
        near = list(dict.fromkeys(n for h in top for n in _vary_values(h, part)))
        if not near:
            return {}
        top = _keep_diverse(_weigh_hypotheses(seen, near), groups, _VARIANTS)
        groups = max(_BEAM, round(groups * _BEAM_DECAY))
    return _weigh_hypotheses(seen, top)


def _keep_diverse(
    weights: dict[Hypothesis, float], count: int, tries: int
) -> list[Hypothesis]:
    """The best few, of those that differ in values alone at most so many.

    A change of the world alone always stays: coarse values of it explain little.
    """
    kept: dict[tuple[tuple[str, str], ...], list[Hypothesis]] = {}
    for h in sorted(weights, key=lambda h: -weights[h]):
        alike = _strip_values(h)
        if alike in kept or len(kept) < count or [t for _, t in alike] == ["world"]:
            kept.setdefault(alike, [])
            kept[alike] += [h] * (len(kept[alike]) < tries)
    return [h for several in kept.values() for h in several]


def _strip_values(hypothesis: Hypothesis) -> tuple[tuple[str, str], ...]:
    """A hypothesis without its values."""
    return tuple(damage.place for damage in hypothesis)


def _vary_values(hypothesis: Hypothesis, part: float) -> Iterator[Hypothesis]:
    """Hypotheses one step away in one value; steps are this part of the first ones."""
    for k, damage in enumerate(hypothesis):
        kind = KINDS[damage.kind]
        if not kind.recover_values.step:
            continue
        by, turn = kind.recover_values, part * _AZIMUTH_STEP * kind.has_azimuth
        step = part * by.step
        for shift, turned in product((-step, 0.0, step), (-turn, 0.0, turn)):
            value = float(np.clip(damage.value + shift, by.low, by.high))
            other = replace(damage, value=value, azimuth=damage.azimuth + turned)
            yield (*hypothesis[:k], other, *hypothesis[k + 1 :])  # itself too


def _subdivide_damage(damage: Damage) -> Iterator[Damage]:
    """A damage with the values about its own, half-way to its neighbors' and nearer.

    Alone a damage is simulated often enough to be found by trying: where contacts
    decide, a value that is a little wrong explains hardly more than one far off.
    """
    kind = KINDS[damage.kind]
    if not kind.recover_values.step:
        yield damage
        return
    steps = kind.recover_values.step * np.array((-1.0, -0.5, 0.0, 0.5, 1.0))
    turns = np.array((0.0, _AZIMUTH_STEP)) * kind.has_azimuth
    for step, turn in product(steps.tolist(), dict.fromkeys(turns.tolist())):
        yield replace(damage, value=damage.value + step, azimuth=damage.azimuth + turn)


def list_single_damages(robot: LeggedRobot) -> list[Damage]:
    """Everything that may have happened, one at a time and coarsely."""
    return [
        damage
        for sort, names in robot.targets.items()
        for kind in KINDS.values()
        if kind.sort == sort
        for damage in kind.list_damages(names, kind.recover_values.grid)
    ]
