"""Our estimation: the sensors' series of trials in, how likely each damage is out.

Hypotheses grow one damage at a time from "nothing", the best few at every size being
kept, as long as more damage explains more. A hypothesis is simulated under the
controllers of the trials; each sensor value counts by Student's t. Series part sooner
or later where anything is wrong, so most is learned from their beginnings.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..body.body import Floats
from ..body.damage import Damage
from ..body.legged import Legged, essential
from ..engine.reflex import EVERY, STEPS, damaged, drive
from .belief import posterior
from .estimate import Hypothesis, Trial
from .hypotheses import AZIMUTHS, STRENGTHS, grounds
from .student import log_t

Progress = Callable[[float], None]

MOST = 4  # damages at a time (overview.txt 4.3)
_BEAM = 8  # hypotheses of each size from which larger ones grow; chosen
_BEGINNING = 300  # steps on which hypotheses are compared while they grow; chosen
_FINAL = 24  # hypotheses that are compared on whole series; chosen
_TRIES = 3  # values of one hypothesis that are moved; chosen
_ROUNDS = 10  # of smaller steps in values; chosen
_SMALLER = 0.65  # a round's steps : those of the one before; chosen
_WINDS = (3.0, 6.0, 10.0)  # [m/s], a breeze to a strong wind; chosen
# Chosen: a sensor's value is not trusted more than this, and values within half a
# second say the same.
_LEAST, _ALIKE = 0.05, 0.5 / (0.01 * EVERY)
_EACH = 6.0  # [nats] that each damage must explain more; chosen
_FADE = 1.0  # [s] after which a sample counts half; chosen
_TURN = np.pi / 8
# first steps of the values: a grid's half
_STEPS = {"weak_motor": 0.075, "weak_sensor": 0.075, "slope": np.radians(2.5),
          "ground_friction": 0.05, "wind": 1.5}  # fmt: skip
_RANGES = {"weak_motor": (0.02, 1.0), "weak_sensor": (0.02, 1.0),
           "slope": (0.0, 0.5), "ground_friction": (0.02, 1.5),
           "wind": (0.0, 20.0)}  # fmt: skip


@dataclass(frozen=True)
class Belief:
    """What may have happened.

    Attributes:
        hypotheses: H, the most likely first; () is "nothing".
        probability: (H).
    """

    hypotheses: tuple[Hypothesis, ...]
    probability: Floats


@dataclass(frozen=True)
class _Seen:
    """What hypotheses are held against.

    Attributes:
        robot: as it was built.
        trials: so far.
        scale: (T) of a sensor's residual at each time.
    """

    robot: Legged
    trials: Sequence[Trial]
    scale: Floats

    def weigh(self, hypotheses: Sequence[Hypothesis], steps: int) -> Floats:
        """(H) log likelihood and prior [nats], by the first steps of each trial."""
        plants = damaged(self.robot, hypotheses)
        total = np.array([-_EACH * len(h) for h in hypotheses])
        rows = steps // EVERY
        worth = 1 / (1 + np.arange(rows) * EVERY * 0.01 / _FADE)
        for trial in self.trials:
            weights = np.tile(trial.weights, (len(hypotheses), 1))
            drives = drive(plants, weights, steps)
            gap = (drives.sensed - trial.sensed[:rows]) / self.scale[:rows, None]
            fit = log_t(gap).sum(axis=2) @ worth / _ALIKE
            total += np.where(drives.failed, -np.inf, fit)
        return total


def spread(whole: Floats, predicted: Floats) -> Floats:
    """(T) scale of a sensor's residual at each time, from a run of the whole robot.

    Args:
        whole: (T, S) what the robot sensed, and
        predicted: (T, S) what the model did, under the same controller.
    """
    square = ((whole - predicted) ** 2).mean(axis=1)
    so_far = np.cumsum(square) / np.arange(1, len(square) + 1)
    return np.maximum(np.sqrt(so_far), _LEAST)


def explain(
    robot: Legged, trials: Sequence[Trial], scale: Floats, progress: Progress
) -> Belief:
    """How likely each damage is after trials.

    Args:
        robot: as it was built.
        trials: at least one.
        scale: see `spread`.
        progress: told what share is done.
    """
    seen = _Seen(robot, trials, scale)
    weights: dict[Hypothesis, float] = {}
    for size, grown in enumerate(_grow(seen, weights)):
        progress((size + 1) / (MOST + 2))
        if not grown:
            break
    best = sorted(weights, key=lambda h: -weights[h])[:_FINAL]
    total = seen.weigh(best, STEPS)
    chance = posterior(total)
    order = np.argsort(-chance, kind="stable")
    progress(1.0)
    return Belief(tuple(best[k] for k in order), chance[order])


def _grow(seen: _Seen, weights: dict[Hypothesis, float]) -> Iterator[bool]:
    """Add larger hypotheses to what is weighed, size by size; whether it helped."""
    beam: list[Hypothesis] = [()]
    weights.update(_weighed(seen, beam))
    for _ in range(MOST):
        before = max(weights.values())
        if before > -_EACH:  # all is explained: one more could not earn its place
            return
        news = {essential(seen.robot, (*h, d)): None
                for h in beam for d in singles(seen.robot) if _differs(h, d)}  # fmt: skip
        level = _weighed(seen, [h for h in news if h not in weights])
        beam = _refined(seen, level)
        weights.update(level)
        yield max(level.values()) > before


def _weighed(seen: _Seen, hypotheses: Sequence[Hypothesis]) -> dict[Hypothesis, float]:
    """Hypotheses with their weights by the beginnings of the trials."""
    weight = seen.weigh(hypotheses, _BEGINNING)
    return dict(zip(hypotheses, weight.tolist(), strict=True))


def _refined(seen: _Seen, level: dict[Hypothesis, float]) -> list[Hypothesis]:
    """The beam of a level, its values moved to where they explain most."""
    top = _varied(level, _TRIES)
    for k, part in enumerate(_SMALLER ** np.arange(_ROUNDS)):
        near = dict.fromkeys(n for h in top for n in _near(h, part))
        if not near:
            break
        steps = _BEGINNING * (k + 1) // _ROUNDS
        moved = dict(zip(near, seen.weigh(list(near), steps).tolist(), strict=True))
        top = _varied(moved, _TRIES)
        # what no step can move stays in the beam by the level's own weights
    level.update(_weighed(seen, [h for h in top if h not in level]))
    return _varied(level, 1)


def _varied(weights: dict[Hypothesis, float], tries: int) -> list[Hypothesis]:
    """The best few, of those that differ in values alone at most so many.

    A change of the world alone always stays: coarse values of it explain little.
    """
    kept: dict[tuple[tuple[str, str], ...], list[Hypothesis]] = {}
    for h in sorted(weights, key=lambda h: -weights[h]):
        alike = tuple((d.kind, d.target) for d in h)
        if alike in kept or len(kept) < _BEAM or [t for _, t in alike] == ["world"]:
            kept.setdefault(alike, [])
            kept[alike] += [h] * (len(kept[alike]) < tries)
    return [h for several in kept.values() for h in several]


def _near(hypothesis: Hypothesis, part: float) -> Iterator[Hypothesis]:
    """Hypotheses one step away in one value; steps are this part of the first ones."""
    for k, damage in enumerate(hypothesis):
        if damage.kind not in _STEPS:
            continue
        low, high = _RANGES[damage.kind]
        step = part * _STEPS[damage.kind]
        turn = part * _TURN if damage.kind in ("slope", "wind") else 0.0
        for by, round_ in product((-step, 0.0, step), (-turn, 0.0, turn)):
            value = float(np.clip(damage.value + by, low, high))
            other = replace(damage, value=value, azimuth=damage.azimuth + round_)
            yield (*hypothesis[:k], other, *hypothesis[k + 1 :])  # itself too


def _differs(hypothesis: Hypothesis, damage: Damage) -> bool:
    """Whether a damage is none that a hypothesis has already, with any value."""
    there = {(d.kind, d.target) for d in hypothesis}
    return (damage.kind, damage.target) not in there


def singles(robot: Legged) -> list[Damage]:
    """Everything that may have happened, one at a time and coarsely."""
    sensors = [f"sensor:{name}" for name in robot.sensors]
    motors = [f"actuator:{name}" for name in robot.motors]
    return [
        *(Damage("limb_loss", f"body:{part}") for part in robot.parts),
        *(Damage("joint_jam", f"joint:{place.name}") for place in robot.places),
        *(Damage("sensor_dead", name) for name in sensors),
        *(Damage("weak_sensor", name, s) for name in sensors for s in STRENGTHS),
        *(Damage("weak_motor", name, s) for name in motors for s in STRENGTHS),
        *grounds(),
        *(Damage("wind", "world", w, float(a)) for w in _WINDS for a in AZIMUTHS),
    ]
