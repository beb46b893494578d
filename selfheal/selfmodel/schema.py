"""The body schema of paper C: poses and what was sensed in them in, models out.

A reading has 7 channels: tilts left/right, forward/back [deg], clearance [mm], and of
each of the four feet whether it touches the floor [1].
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain, combinations

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
    """

    genes: int
    decode: Decode
    population: int
    generations: int
    sensors: tuple[str, ...]


def lengths_plan(known: Genomes, sensors: tuple[str, ...]) -> Plan:
    """Eight lengths: 100 models, 10 generations (papers.md 2, C)."""
    count = known.parent.shape[1]
    return Plan(count, lambda g: with_lengths(known, g), 100, 10, sensors)


def matrix_plan(bodies: Bodies, sensors: tuple[str, ...]) -> Plan:
    """The 8 x 4 matrix: 300 models, 40 generations (papers.md 2, C)."""
    anatomy = bodies.anatomy

    def decode(genes: Floats) -> Genomes:
        return from_matrix(anatomy, genes.reshape(len(genes), anatomy.size, 4))

    return Plan(4 * anatomy.size, decode, 300, 40, sensors)


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
    engine, spent = Statics(), 0
    heard = [c for name in plan.sensors for c in CHANNELS[name]]

    def errors(count: int, genes: Floats) -> Floats:
        nonlocal spent
        bodies = build(like.anatomy, plan.decode(genes))
        rows = np.repeat(np.arange(len(genes)), count)
        targets = np.tile(poses[:count], (len(genes), 1))
        seen = sense(bodies[rows], targets, engine).reshape(len(genes), count, -1)
        spent += len(rows)
        gap = np.abs(seen - felt[:count])[..., heard] / _SCALE[heard]
        return np.nan_to_num(gap, nan=np.inf).sum(axis=2).mean(axis=1)

    genes = rng.random((plan.population, plan.genes))
    for count in range(1, len(poses) + 1):
        score = partial(errors, count)
        found = score(genes)
        for _ in range(plan.generations):
            genes, found = generation(genes, found, score, rng)
        best = int(np.argmin(found))
        yield plan.decode(genes[best : best + 1]), float(found[best]), spent
