"""Synthesis: what the robot may be in, a gait that carries every such robot out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.body import Floats, count_ancestors
from ..engine.plant import Plant
from ..engine.walk import SAMPLE, Walks, simulate_walks
from .cma_es import CmaState, ask, start_search, tell
from .pattern import SECONDS, find_pattern

Progress = Callable[[str, float], None]

# Chosen on development seeds: of what a search costs, most goes to the best of its
# starts. A rung: how many searches live, generations, seconds that each gait is tried.
Rungs = Sequence[tuple[int, int, float]]
ONE_GAIT: Rungs = ((6, 10, 5.0), (3, 20, 5.0), (1, 60, 10.0))
THREE_GAITS: Rungs = ((6, 10, 5.0), (3, 20, 5.0), (3, 30, 10.0))
_STANCE = np.radians(60.0)  # of joints as far from the torso; chosen
_RANDOM = 192  # gaits drawn before the searches start
_CHILDREN, _STEP = 14, 0.4
_AGAIN_STEP = 0.25  # of a search that starts from an old gait
_ROWS = round(SECONDS / SAMPLE)
_JUDGES = 16  # plants that the finished gait is predicted on
# What may differ between the self-model and the robot, as wide as a careful builder
# would grant: friction, mass, servo stiffness, strength, speed, delay, play, zero.
_FRICTION, _DENSITY, _STIFFNESS = (0.5, 1.2), (0.92, 1.08), (30.0, 60.0)
_STRENGTH, _SPEED, _DELAYS = (0.8, 1.1), (0.8, 1.1), (0.0, 0.02, 0.04, 0.06)
_BACKLASH, _ZERO = np.radians(2.0), np.radians(1.0)
_SIDEWAYS_COST = 0.5  # of the way to the side is taken off; chosen
# A gait that tilts the torso beyond 15 degrees costs, up to 0.3 m at 60; chosen
_LEVEL_COSINE, _TIPPED_COSINE, _FALL_COST = (
    np.cos(np.radians(15.0)),
    np.cos(np.radians(60.0)),
    0.3,
)


@dataclass(frozen=True)
class Gait:
    """A gait and what the self-model says of it.

    Attributes:
        pattern: how `genes` are written; see `gait.pattern`.
        genes: (D).
        heading: direction to walk, from +x toward +y [rad].
        predicted: median distance along the heading in `SECONDS` [m].
        low: 10th percentile of it over what the robot may be.
        high: 90th percentile.
        simulations: spent to find it.
        failed: of these, diverged.
    """

    pattern: str
    genes: Floats
    heading: float
    predicted: float
    low: float
    high: float
    simulations: int
    failed: int

    def commands(self, joints: int, seconds: float = SECONDS) -> Floats:
        """(T, P) [rad], one row every `engine.walk.PERIOD`."""
        return find_pattern(self.pattern).compute_commands(
            self.genes[None], joints, seconds
        )[0]

    @property
    def cycle(self) -> float:
        """Seconds in which it repeats."""
        return find_pattern(self.pattern).compute_period(self.genes)


def project_on_heading(position: Floats, heading: float) -> tuple[Floats, Floats]:
    """Distance along and across a heading [m] of positions (..., 2 or more)."""
    c, s = np.cos(heading), np.sin(heading)
    x, y = position[..., 0], position[..., 1]
    return c * x + s * y, c * y - s * x


def measure_distance(position: Floats, orientation: Floats, heading: float) -> float:
    """Distance of a walk along the heading, as the robot faces each `SECONDS` anew [m].

    A gait has no compass: what curves a little in that time is far off its heading
    after a few of them, and still carries the robot where it faces.

    Args:
        position: (S, 3) of the torso [m].
        orientation: (S, 4) of the torso, quaternion.
        heading: of the gait, from forward to the left [rad].
    """
    rows = [*range(0, len(position) - 1, _ROWS), len(position) - 1]
    w, x, y, z = orientation[rows[:-1]].T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    pieces = np.diff(position[rows], axis=0)
    along = [
        project_on_heading(piece, heading + turn)[0]
        for piece, turn in zip(pieces, yaw, strict=True)
    ]
    return float(np.sum(along))


def compute_fitness(walks: Walks, heading: float) -> Floats:
    """(N) [m] way along the heading, less half the way across, less a tipping."""
    along, across = project_on_heading(walks.position[:, -1], heading)
    lowest = walks.up[..., 2].min(axis=1)
    tipped = np.clip((_LEVEL_COSINE - lowest) / (_LEVEL_COSINE - _TIPPED_COSINE), 0, 1)
    return along - _SIDEWAYS_COST * np.abs(across) - _FALL_COST * tipped


def randomize_plant(plant: Plant, rng: np.random.Generator) -> Plant:
    """A plant that the robot may be where its self-model is `plant`."""
    p = plant.physics
    physics = replace(
        p,
        friction=p.friction * rng.uniform(*_FRICTION),
        kp=rng.uniform(*_STIFFNESS),
        density=p.density * rng.uniform(*_DENSITY),
    )
    return replace(
        plant,
        physics=physics,
        torque=plant.torque * rng.uniform(*_STRENGTH),
        speed=plant.speed * rng.uniform(*_SPEED),
        delay=float(rng.choice(_DELAYS)),
        backlash=float(rng.uniform(0, _BACKLASH)),
        offset=plant.offset + rng.normal(0, _ZERO, plant.offset.shape),
    )


def walk_gait(plants: Sequence[Plant], gait: Gait, seconds: float = SECONDS) -> Walks:
    """Simulate a gait on several plants.

    Args:
        seconds: length of the walk [s].
    """
    joints = plants[0].body.anatomy.size
    commands = gait.commands(joints, seconds)
    return simulate_walks(plants, np.repeat(commands[None], len(plants), axis=0))


class _GaitSearch:
    """The trials of one synthesis, counted."""

    def __init__(
        self,
        plants: Sequence[Plant],
        weights: Sequence[float] | Floats,
        name: str,
        heading: float,
        rng: np.random.Generator,
    ) -> None:
        self.plants, self.heading, self.rng = plants, heading, rng
        self.weights = np.asarray(weights, float) / np.sum(weights)
        self.pattern, self.joints = find_pattern(name), plants[0].body.anatomy.size
        self.simulations = self.failed = 0

    def draw_plant(self) -> Plant:
        """One of the robots that it may be."""
        return randomize_plant(
            self.plants[self.rng.choice(len(self.plants), p=self.weights)], self.rng
        )

    def score_genes(self, genes: Floats, seconds: float) -> Floats:
        """(N) [m/s] fitness of genes (N, D) on one plant; diverged ones are worst."""
        commands = self.pattern.compute_commands(genes, self.joints, seconds)
        walks = simulate_walks([self.draw_plant()] * len(genes), commands)
        self.simulations += len(genes)
        self.failed += int(walks.failed.sum())
        with np.errstate(invalid="ignore"):
            fit = compute_fitness(walks, self.heading) / seconds
        return np.where(walks.failed, -np.inf, fit)


def synthesize_gaits(
    plants: Sequence[Plant],
    *,
    rungs: Rungs = ONE_GAIT,
    weights: Sequence[float] | Floats = (1.0,),
    name: str = "waves",
    heading: float = 0.0,
    seed: int = 0,
    start: Gait | None = None,
    progress: Progress = lambda what, share: None,
) -> list[Gait]:
    """Gaits for a robot that may be any of these plants, each a little otherwise.

    Args:
        plants: (K) rival self-models.
        rungs: by which searches are halved; each that is left at the end gives a gait.
        weights: (K) how likely each is [1].
        heading: direction to walk [rad].
        start: a gait that one of the searches starts from.
        progress: called with what is done and how much of it.
    """
    search = _GaitSearch(plants, weights, name, heading, np.random.default_rng(seed))
    lives = _start_searches(search, start, rungs[0])
    total = sum(count * times * seconds for count, times, seconds in rungs)
    done = 0.0
    for count, generations, seconds in rungs:
        lives = sorted(lives, key=lambda life: -life[0])[:count]
        after = []
        for score, state in lives:
            for _ in range(generations):
                score, state = _run_generation(search, score, state, seconds)
                done += seconds
                progress(f"{SECONDS * score:.2f} m in 10 s", done / total)
            after.append((score, state))
        lives = after
    found = [Gait(name, state.mean, heading, 0.0, 0.0, 0.0,
                  search.simulations, search.failed) for _, state in lives]  # fmt: skip
    return [evaluate_gait(plants, gait, weights=weights, seed=seed) for gait in found]


def _start_searches(
    search: _GaitSearch, start: Gait | None, rung: tuple[int, int, float]
) -> list[tuple[float, CmaState]]:
    """Where searches begin: the old gait, and the best of many random ones."""
    genes, (count, _, seconds) = _draw_genes(search), rung
    scores = search.score_genes(genes, seconds)
    order = np.argsort(-np.where(np.isfinite(scores), scores, -np.inf), kind="stable")
    lives = [(float(scores[i]), start_search(genes[i], _STEP)) for i in order[:count]]
    if start is not None and start.pattern == search.pattern.name:
        lives[-1] = (np.inf, start_search(start.genes, _AGAIN_STEP))
    return lives


def _draw_genes(search: _GaitSearch) -> Floats:
    """(_RANDOM, D) genes; joints as far from the torso share a stance."""
    rng, joints = search.rng, search.joints
    genes = _STEP * rng.normal(size=(_RANDOM, search.pattern.count_genes(joints)))
    depth = count_ancestors(search.plants[0].body.parent[0])
    stance = rng.uniform(-_STANCE, _STANCE, (_RANDOM, depth.max() + 1))[:, depth]
    return search.pattern.add_stance(genes, stance)


def _run_generation(
    search: _GaitSearch, score: float, state: CmaState, seconds: float
) -> tuple[float, CmaState]:
    """One generation on a plant drawn anew; the score is a running mean."""
    genes = ask(state, _CHILDREN, search.rng)
    scores = search.score_genes(genes, seconds)
    state = tell(state, genes, scores)
    best = float(np.sort(scores)[-4:].mean())
    if not np.isfinite(score) or state.generation < 4:
        return best, state
    return 0.8 * score + 0.2 * best, state


def evaluate_gait(
    plants: Sequence[Plant],
    gait: Gait,
    *,
    weights: Sequence[float] | Floats = (1.0,),
    seed: int = 0,
) -> Gait:
    """A gait with what is predicted of it on plants that the robot may be.

    Args:
        plants: (K) rival self-models.
        weights: (K) how likely each is [1].
    """
    rng = np.random.default_rng([seed, 1])
    chance = np.asarray(weights, float) / np.sum(weights)
    drawn = rng.choice(len(plants), size=_JUDGES, p=chance)
    walks = walk_gait([randomize_plant(plants[k], rng) for k in drawn], gait)
    along, _ = project_on_heading(walks.position[:, -1], gait.heading)
    along = along[~walks.failed] if not walks.failed.all() else np.zeros(1)
    low, middle, high = np.quantile(along, [0.1, 0.5, 0.9])
    return replace(
        gait,
        predicted=float(middle),
        low=float(low),
        high=float(high),
        simulations=gait.simulations + _JUDGES,
        failed=gait.failed + int(walks.failed.sum()),
    )
