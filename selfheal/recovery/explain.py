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
from ..body.damage import Damage
from ..body.legged import Legged, essential
from ..engine.reflex import EVERY, SAMPLE, STEPS, Drives, damaged, drive, trimmed
from .belief import posterior
from .estimate import Hypothesis, Trial
from .hypotheses import AZIMUTHS, STRENGTHS, grounds
from .student import log_t

Progress = Callable[[float], None]

MOST = 4  # damages at a time (overview.txt 4.3)
_BEAM = 8  # hypotheses of each size from which larger ones grow; chosen
_WIDE, _FEWER = 24, 0.7  # single ones whose values move, and how fast they get fewer
_BEGINNING = 300  # steps on which hypotheses are compared while they grow; chosen
_GLANCE, _SCREENED = 100, 200  # steps after which so many of a size are left; chosen
_FINAL = 24  # hypotheses that are compared on whole series; chosen
_TRIES = 2  # values of one hypothesis that are moved; chosen
_ROUNDS = 10  # of smaller steps in values; chosen
_SMALLER = 0.65  # a round's steps : those of the one before; chosen
_WINDS = (3.0, 6.0, 10.0)  # [m/s], a breeze to a strong wind; chosen
# Chosen: a sensor's value is not trusted more than this, and values within half a
# second say the same.
_LEAST, _ALIKE = 0.05, 0.5 / SAMPLE
_EACH = 6.0  # [nats] that each damage must explain more; chosen
_FADE = 1.0  # [s] after which a sample counts half; chosen
# Chosen: damage under which likely robots are watched part, and the share of a series'
# standard deviation by which they have parted when predictions say nothing any more.
_CLEAR, _LOST = ("limb_loss", "joint_jam", "sensor_dead"), 0.5
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
        scale: (T, S) of each sensor's residual at each time that was compared.
    """

    hypotheses: tuple[Hypothesis, ...]
    probability: Floats
    scale: Floats


@dataclass(frozen=True)
class _Seen:
    """What hypotheses are held against.

    Attributes:
        robot: as it was built.
        trims: (K, 2 + D) ways it may be off, see `trim.trims`.
        trials: so far.
        scale: (T, S) of each sensor's residual at each time that is compared.
        before: (T, S) what the robot sensed in the first trial's place when whole.
    """

    robot: Legged
    trims: Floats
    trials: Sequence[Trial]
    scale: Floats
    before: Floats

    def weigh(self, hypotheses: Sequence[Hypothesis], steps: int) -> Floats:
        """(H) log likelihood and prior [nats], by the first steps of each trial."""
        prior = np.array([-_EACH * len(h) for h in hypotheses])
        fits = [self._fits(hypotheses, trim, steps) for trim in self.trims]
        return prior + np.logaddexp.reduce(fits) - np.log(len(fits))

    def _fits(
        self, hypotheses: Sequence[Hypothesis], trim: Floats, steps: int
    ) -> Floats:
        """(H) log likelihood if the robot is off in this way."""
        total = np.zeros(len(hypotheses))
        rows = min(steps // EVERY, len(self.scale))
        worth = 1 / (1 + np.arange(rows) * SAMPLE / _FADE)
        for k, trial in enumerate(self.trials):
            drives = _walks(self.robot, trim, hypotheses, trial.weights, rows)
            if k == 0 and () in hypotheses:  # a whole robot does what it did
                drives.sensed[hypotheses.index(())] = self.before[:rows]
            gap = (drives.sensed - trial.sensed[:rows]) / self.scale[:rows]
            fit = log_t(gap).sum(axis=2) @ worth / _ALIKE
            total += np.where(drives.failed, -np.inf, fit)
        return total


def _walks(
    robot: Legged,
    trim: Floats,
    hypotheses: Sequence[Hypothesis],
    weights: Floats,
    rows: int,
) -> Drives:
    """So many samples of a controller on the trimmed robot as hypotheses have it."""
    plants = trimmed(damaged(robot, hypotheses), trim)
    return drive(plants, np.tile(weights, (len(hypotheses), 1)), rows * EVERY)


def spread(sensed: Floats, predicted: Floats) -> Floats:
    """(T, S) scale of each sensor's residual so far, of series (N, T, S)."""
    square = np.cumsum(((sensed - predicted) ** 2).mean(axis=0), axis=0)
    so_far = square / np.arange(1, len(square) + 1)[:, None]
    return np.fmax(np.sqrt(so_far), _LEAST)  # a run that failed says nothing


def _trusted(robot: Legged, trims: Floats, weights: Floats, before: Floats) -> Floats:
    """(T, S) scale of each sensor's residual, as long as predictions say anything.

    Robots that walk alike while they are whole part when they are broken, and none of
    them is quite the true one: as they part from each other, they will part from it.
    """
    model = _walks(robot, trims[0], [()], weights, len(before)).sensed
    known = spread(before[None], model)
    if len(trims) == 1:
        return known
    broken = [(d,) for d in singles(robot) if d.kind in _CLEAR]
    rows = _BEGINNING // EVERY
    one, *others = (_walks(robot, trim, broken, weights, rows).sensed
                    for trim in trims)  # fmt: skip
    parted = spread(np.concatenate([one] * len(others)), np.concatenate(others))
    scale = np.fmax(known[:rows], parted)
    lost = scale.mean(axis=1) > _LOST * before.std(axis=0).mean()
    return scale[: max(1, int(np.argmax(lost))) if lost.any() else rows]


def explain(
    robot: Legged,
    trims: Floats,
    trials: Sequence[Trial],
    before: Floats,
    known: Sequence[Hypothesis],
    progress: Progress,
) -> Belief:
    """How likely each damage is after trials.

    Args:
        robot: as it was built.
        trims: (K, 2 + D) ways it may be off, see `trim.trims`.
        trials: at least one.
        before: (T, S) what the robot sensed under the first trial's controller when it
            was whole.
        known: what was believed before the last trial; if one of them still explains
            all, there is nothing to look for.
        progress: told what share is done.
    """
    scale = _trusted(robot, trims, trials[0].weights, before)
    seen = _Seen(robot, trims, trials, scale, before)
    weights = _weighed(seen, list(dict.fromkeys([(), *known])))
    for size, grown in enumerate(_grow(seen, weights)):
        progress((size + 1) / (MOST + 2))
        if not grown:
            break
    best = sorted(weights, key=lambda h: -weights[h])[:_FINAL]
    total = seen.weigh(best, STEPS)
    chance = posterior(total)
    order = np.argsort(-chance, kind="stable")
    progress(1.0)
    return Belief(tuple(best[k] for k in order), chance[order], seen.scale)


def _grow(seen: _Seen, weights: dict[Hypothesis, float]) -> Iterator[bool]:
    """Add larger hypotheses to what is weighed, size by size; whether it helped."""
    beam: list[Hypothesis] = [()]
    coarse = singles(seen.robot)
    fine = [d for c in coarse for d in _finely(c)]
    for width in (_WIDE, *[_BEAM] * (MOST - 1)):
        catalogue = fine if width == _WIDE else coarse
        if _is_explained(weights):
            return
        before = max(weights.values())
        grown = (essential(seen.robot, (*h, d)) for h in beam for d in catalogue
                 if _differs(h, d))  # fmt: skip
        new = [h for h in dict.fromkeys(grown) if h not in weights]
        level = _weighed(seen, _screened(seen, new))
        if not _is_explained(level):
            level |= _moved(seen, _varied(level, width, _TRIES))
        beam = _varied(level, _BEAM, 1)
        weights.update(level)
        yield max(level.values()) > before


def _is_explained(weights: dict[Hypothesis, float]) -> bool:
    """Whether one more damage could not earn its place."""
    best = max(weights, key=lambda h: weights[h])
    return weights[best] > -_EACH * (len(best) + 1)


def _screened(seen: _Seen, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Those that explain the first second of the trials best."""
    weight = seen.weigh(hypotheses, _GLANCE)
    order = np.argsort(-weight, kind="stable")[:_SCREENED]
    return [hypotheses[k] for k in order]


def _weighed(seen: _Seen, hypotheses: Sequence[Hypothesis]) -> dict[Hypothesis, float]:
    """Hypotheses with their weights by the beginnings of the trials."""
    weight = seen.weigh(hypotheses, _BEGINNING)
    return dict(zip(hypotheses, weight.tolist(), strict=True))


def _moved(seen: _Seen, top: list[Hypothesis]) -> dict[Hypothesis, float]:
    """Hypotheses whose values stand where they explain most, weighed."""
    groups = len({_kinds(h) for h in top})
    for part in _SMALLER ** np.arange(_ROUNDS):
        near = list(dict.fromkeys(n for h in top for n in _near(h, part)))
        if not near:
            return {}
        top = _varied(_weighed(seen, near), groups, _TRIES)
        groups = max(_BEAM, round(groups * _FEWER))
    return _weighed(seen, top)


def _varied(
    weights: dict[Hypothesis, float], count: int, tries: int
) -> list[Hypothesis]:
    """The best few, of those that differ in values alone at most so many.

    A change of the world alone always stays: coarse values of it explain little.
    """
    kept: dict[tuple[tuple[str, str], ...], list[Hypothesis]] = {}
    for h in sorted(weights, key=lambda h: -weights[h]):
        alike = _kinds(h)
        if alike in kept or len(kept) < count or [t for _, t in alike] == ["world"]:
            kept.setdefault(alike, [])
            kept[alike] += [h] * (len(kept[alike]) < tries)
    return [h for several in kept.values() for h in several]


def _kinds(hypothesis: Hypothesis) -> tuple[tuple[str, str], ...]:
    """A hypothesis without its values."""
    return tuple((d.kind, d.target) for d in hypothesis)


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
    return (damage.kind, damage.target) not in _kinds(hypothesis)


def _finely(damage: Damage) -> Iterator[Damage]:
    """A damage with the values about its own, half-way to its neighbors' and nearer.

    Alone a damage is simulated often enough to be found by trying: where contacts
    decide, a value that is a little wrong explains hardly more than one far off.
    """
    if damage.kind not in _STEPS:
        yield damage
        return
    steps = _STEPS[damage.kind] * np.array((-1.0, -0.5, 0.0, 0.5, 1.0))
    turns = np.array((0.0, _TURN)) * (damage.kind in ("slope", "wind"))
    for step, turn in product(steps.tolist(), dict.fromkeys(turns.tolist())):
        yield replace(damage, value=damage.value + step, azimuth=damage.azimuth + turn)


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
