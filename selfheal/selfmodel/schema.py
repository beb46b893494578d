"""The body schema of paper C: poses and what was sensed in them in, models out.

A reading has 7 channels: tilts left/right, forward/back [deg], clearance [mm], and of
each of the four feet whether it touches the floor [1].
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain, combinations

import numpy as np
from numpy.random import Generator

from ..body.body import Bodies, Floats
from ..body.genome import LENGTH_RANGE, Genomes, build_bodies, decode_matrix
from ..engine.statics import Statics
from .crowding import run_generation

CHANNELS = {"tilt": (0, 1), "clearance": (2,), "touch": (3, 4, 5, 6)}
SENSOR_SETS = tuple(
    chain.from_iterable(combinations(CHANNELS, n) for n in range(1, len(CHANNELS) + 1))
)
# Chosen, for paper C does not say how modalities are weighed: about how far random
# bodies differ, so that each counts alike.
_SCALE = np.array([10.0, 10.0, 20.0, 2.0, 2.0, 2.0, 2.0])

Decode = Callable[[Floats], Genomes]


def simulate_channels(bodies: Bodies, targets: Floats, engine: Statics) -> Floats:
    """What bodies sense, each under its own joint targets.

    Args:
        targets: (N, P) joint targets [rad].

    Returns:
        (N, 7) tilts [deg], clearance [mm], touch of four feet [1].
    """
    seen = engine.simulate(bodies, targets)
    tilt, gap = np.degrees(seen.tilt), 1000 * seen.clearance[:, None]
    return np.hstack([tilt, gap, seen.touch])


def set_lengths(known: Genomes, genes: Floats) -> Genomes:
    """Bodies of a known tree (1) with the lengths of genes (N, P) in [0, 1]."""
    low, high = LENGTH_RANGE
    copies = known[np.zeros(len(genes), np.int64)]
    return Genomes(
        copies.parent, copies.placement, copies.hinge, low + genes * (high - low)
    )


@dataclass(frozen=True)
class SearchPlan:
    """How models are searched for.

    Attributes:
        genes: of a model, each in [0, 1].
        decode: genes (N, G) to genomes.
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


def make_lengths_plan(known: Genomes, sensors: tuple[str, ...]) -> SearchPlan:
    """Eight lengths: 100 models, 10 generations (papers.md 2, C)."""
    count = known.parent.shape[1]
    return SearchPlan(count, lambda g: set_lengths(known, g), 100, 10, sensors)


def make_matrix_plan(bodies: Bodies, sensors: tuple[str, ...]) -> SearchPlan:
    """The 8 x 4 matrix: 300 models, 40 generations (papers.md 2, C)."""
    anatomy = bodies.anatomy

    def decode(genes: Floats) -> Genomes:
        return decode_matrix(anatomy, genes.reshape(len(genes), anatomy.size, 4))

    return SearchPlan(4 * anatomy.size, decode, 300, 40, sensors)


class PoseEvaluator:
    """How badly models explain poses; counts what it simulates."""

    def __init__(self, like: Bodies, plan: SearchPlan) -> None:
        """`like` is any body of the robot's anatomy."""
        self.like, self.plan = like, plan
        self.engine, self.spent = Statics(), 0
        self.columns = [c for name in plan.sensors for c in CHANNELS[name]]

    def simulate_poses(self, bodies: Bodies, targets: Floats) -> Floats:
        """(N, n, 7) what N bodies sense in n poses, targets (n, P) or (N, n, P)."""
        shape = len(bodies), *targets.shape[-2:]
        rows = np.repeat(np.arange(shape[0]), shape[1])
        flat = np.broadcast_to(targets, shape).reshape(-1, shape[2])
        self.spent += len(rows)
        return simulate_channels(bodies[rows], flat, self.engine).reshape(
            *shape[:2], -1
        )

    def compute_errors(self, poses: Floats, measured: Floats, genes: Floats) -> Floats:
        """(N) mean over poses of the sum of channels, see `_SCALE`; infinite: failed.

        Args:
            poses: (n, P) joint targets [rad].
            measured: (n, 7) channels measured there.
            genes: (N, G) of models.
        """
        bodies = build_bodies(self.like.anatomy, self.plan.decode(genes))
        gap = (self.simulate_poses(bodies, poses) - measured) / _SCALE
        far = np.minimum(np.abs(gap[..., self.columns]), self.plan.cap)
        return np.nan_to_num(far, nan=np.inf).sum(axis=2).mean(axis=1)


def estimate_models(
    like: Bodies,
    poses: Floats,
    measured: Floats,
    plan: SearchPlan,
    rng: Generator,
) -> Iterator[tuple[Genomes, float, int]]:
    """The estimation of paper C, a yield a pose; poses come in the order given.

    Args:
        poses: (n, P) joint targets [rad].
        measured: (n, 7) channels measured there.

    Yields:
        The best model (1), its error (mean over poses, see `_SCALE`) and the
        simulations so far.
    """
    judge = PoseEvaluator(like, plan)
    genes = rng.random((plan.population, plan.genes))
    for count in range(1, len(poses) + 1):
        score = partial(judge.compute_errors, poses[:count], measured[:count])
        found = score(genes)
        for _ in range(plan.generations):
            genes, found = run_generation(genes, found, score, rng)
        best = int(np.argmin(found))
        yield plan.decode(genes[best : best + 1]), float(found[best]), judge.spent
