"""The body schema of paper C: poses and what was sensed in them in, models out.

A reading has 7 channels: tilts left/right, forward/back [deg], clearance [mm], and of
each of the four feet whether it touches the floor [1].
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations
from typing import Any

import numpy as np

from ..body.body import Bodies, Floats
from ..body.genome import LENGTH_RANGE, Genomes, build, from_matrix
from ..engine.statics import Statics
from .crowding import generation

CHANNELS = {"tilt": (0, 1), "clearance": (2,), "touch": (3, 4, 5, 6)}
SENSOR_SETS = tuple(
    chain.from_iterable(combinations(CHANNELS, n) for n in range(1, len(CHANNELS) + 1))
)
# Chosen, for paper C does not say how modalities are weighed: about how far random
# bodies differ, so that each counts alike.
_SCALE = np.array([10.0, 10.0, 20.0, 2.0, 2.0, 2.0, 2.0])
# Of our estimation, chosen: starts and steps of least squares, how far a gene is moved
# for a slope (2 mm of a length), from where a gap counts less (1 degree of tilt), and
# what a failed simulation counts.
_STARTS, _STEPS, _NUDGE, _ROBUST, _FAILED = 10, 40, 0.01, 0.1, 10.0

Decode = Callable[[Floats], Genomes]


def sense(bodies: Bodies, targets: Floats, engine: Statics) -> Floats:
    """(N, 7) what N bodies sense, each under its own joint targets (N, P) [rad]."""
    seen = engine.simulate(bodies, targets)
    tilt, gap = np.degrees(seen.tilt), 1000 * seen.clearance[:, None]
    return np.hstack([tilt, gap, seen.touch])


def with_lengths(known: Genomes, genes: Floats) -> Genomes:
    """Bodies of a known tree (1) with the lengths of genes (N, P) in [0, 1]."""
    low, high = LENGTH_RANGE
    copies = known[np.zeros(len(genes), np.int64)]
    return Genomes(
        copies.parent, copies.placement, copies.hinge, low + genes * (high - low)
    )


@dataclass(frozen=True)
class Plan:
    """How models are searched for.

    Attributes:
        genes: of a model, each in [0, 1].
        decode: genes (N, G) to genomes.
        population: models.
        generations: after each pose.
        sensors: names of `CHANNELS` that the error hears of.
        cap: of what a channel is off, in `_SCALE`; farther off is no worse.
    """

    genes: int
    decode: Decode
    population: int
    generations: int
    sensors: tuple[str, ...]
    cap: float = np.inf


def lengths_plan(known: Genomes, sensors: tuple[str, ...]) -> Plan:
    """Eight lengths: 100 models, 10 generations (papers.md 2, C)."""
    count = known.parent.shape[1]
    return Plan(count, lambda g: with_lengths(known, g), 100, 10, sensors)


def refined_plan(known: Genomes, sensors: tuple[str, ...]) -> Plan:
    """Eight lengths, our way: 60 models, 40 generations, 5 degrees (chosen)."""
    plan = lengths_plan(known, sensors)
    return replace(plan, population=60, generations=40, cap=0.5)


def matrix_plan(bodies: Bodies, sensors: tuple[str, ...]) -> Plan:
    """The 8 x 4 matrix: 300 models, 40 generations (papers.md 2, C)."""
    anatomy = bodies.anatomy

    def decode(genes: Floats) -> Genomes:
        return from_matrix(anatomy, genes.reshape(len(genes), anatomy.size, 4))

    return Plan(4 * anatomy.size, decode, 300, 40, sensors)


class _Judge:
    """How badly models explain poses; counts what it simulates."""

    def __init__(self, like: Bodies, poses: Floats, felt: Floats, plan: Plan) -> None:
        self.like, self.poses, self.felt, self.plan = like, poses, felt, plan
        self.engine, self.spent = Statics(), 0
        self.heard = [c for name in plan.sensors for c in CHANNELS[name]]

    def gaps(self, count: int, genes: Floats) -> Floats:
        """(N, count, C) predicted less measured in the first poses, see `_SCALE`."""
        bodies = build(self.like.anatomy, self.plan.decode(genes))
        rows = np.repeat(np.arange(len(genes)), count)
        targets = np.tile(self.poses[:count], (len(genes), 1))
        seen = sense(bodies[rows], targets, self.engine)
        self.spent += len(rows)
        gap = seen.reshape(len(genes), count, -1) - self.felt[:count]
        return gap[..., self.heard] / _SCALE[self.heard]

    def errors(self, count: int, genes: Floats) -> Floats:
        """(N) mean over the first poses of the sum of channels; infinite: failed."""
        gap = np.minimum(np.abs(self.gaps(count, genes)), self.plan.cap)
        return np.nan_to_num(gap, nan=np.inf).sum(axis=2).mean(axis=1)


def estimate(
    like: Bodies, poses: Floats, felt: Floats, plan: Plan, rng: np.random.Generator
) -> Iterator[tuple[Genomes, float, int]]:
    """The estimation of paper C, a yield a pose; poses come in the order given.

    Args:
        like: any body of the robot's anatomy.
        poses: (n, P) joint targets [rad].
        felt: (n, 7) channels measured there.
        plan: what is searched, and how.
        rng: of everything random.

    Yields:
        The best model (1), its error (mean over poses, see `_SCALE`) and the
        simulations so far.
    """
    judge = _Judge(like, poses, felt, plan)
    genes = rng.random((plan.population, plan.genes))
    for count in range(1, len(poses) + 1):
        score = partial(judge.errors, count)
        found = score(genes)
        for _ in range(plan.generations):
            genes, found = generation(genes, found, score, rng)
        best = int(np.argmin(found))
        yield plan.decode(genes[best : best + 1]), float(found[best]), judge.spent


def refined(
    like: Bodies, poses: Floats, felt: Floats, plan: Plan, rng: np.random.Generator
) -> tuple[Genomes, float, int]:
    """Our estimation: crowding on all poses at once, then least squares from its best.

    Takes what `estimate` takes, and gives what it yields last. The squares are robust
    (Cauchy): some poses rest otherwise than they should, however right a model is.
    """
    from scipy.optimize import least_squares

    judge, count = _Judge(like, poses, felt, plan), len(poses)
    score = partial(judge.errors, count)
    genes = rng.random((plan.population, plan.genes))
    found = score(genes)
    for _ in range(plan.generations):
        genes, found = generation(genes, found, score, rng)

    def squares(x: Floats) -> Floats:
        return np.nan_to_num(judge.gaps(count, x[None]).ravel(), nan=_FAILED)

    def slopes(x: Floats) -> Floats:
        step = np.where(x < 0.5, _NUDGE, -_NUDGE)
        both = np.nan_to_num(judge.gaps(count, x + np.diag(step)), nan=_FAILED)
        return (both.reshape(len(x), -1) - squares(x)).T / step

    how: dict[str, Any] = {"loss": "cauchy", "f_scale": _ROBUST, "max_nfev": _STEPS}
    for row in np.argsort(found, kind="stable")[:_STARTS]:
        near = least_squares(squares, genes[row], slopes, bounds=(0, 1), **how)
        genes[row] = near.x
    found = score(genes)
    best = int(np.argmin(found))
    return plan.decode(genes[best : best + 1]), float(found[best]), judge.spent
