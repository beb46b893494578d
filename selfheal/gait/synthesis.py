"""Synthesis: what the robot may be in, a gait that carries every such robot out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.body import Floats, count_ancestors
from ..engine.plant import Plant
from ..engine.walk import SAMPLE, Walks, simulate_walks
from ..evolution.cma_es import CmaState, ask, start_search, tell
from ..evolution.ranking import rank_best_first
from .pattern import SECONDS, find_pattern

Progress = Callable[[str, float], None]

_STANCE = np.radians(60.0)  # of joints as far from the torso; chosen
_CHILDREN = 14
_ROWS = round(SECONDS / SAMPLE)
_JUDGES = 16  # plants that the finished gait is predicted on
# What may differ between the self-model and the robot, as wide as a careful builder
# would grant: friction, mass, servo stiffness, strength, speed, delay, play, zero.
_FRICTION, _DENSITY, _STIFFNESS = (0.5, 1.2), (0.92, 1.08), (30.0, 60.0)
_STRENGTH, _SPEED, _DELAYS = (0.8, 1.1), (0.8, 1.1), (0.0, 0.02, 0.04, 0.06)
_BACKLASH, _ZERO = np.radians(2.0), np.radians(1.0)
_SIDEWAYS_COST = 0.5  # of the way to the side is taken off; chosen
# A gait that tilts the torso beyond 15 degrees costs, up to 0.3 m at 60; chosen
_LEVEL_COSINE, _TIPPED_COSINE = np.cos(np.radians(15.0)), np.cos(np.radians(60.0))
_FALL_COST = 0.3


@dataclass(frozen=True)
class GaitTask:
    """A gait that is wanted.

    Attributes:
        pattern: how genes are written; see `gait.pattern`.
        heading: direction to walk, from +x toward +y [rad].
        seed: of all that is drawn.
    """

    pattern: str = "waves"
    heading: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Effort:
    """How much a search for gaits does.

    Attributes:
        rungs: by which searches are halved: how many live, their generations, and for
            how long each gait is tried [s]. Those left at the end give a gait each.
        drawn: gaits that are drawn before the searches start.
        step: of the genes that are drawn, and of searches that start from them [1].
        step_again: of a search that starts from an old gait [1].
    """

    rungs: Sequence[tuple[int, int, float]]
    drawn: int = 192
    step: float = 0.4
    step_again: float = 0.25


# Chosen on development seeds: of what a search costs, most goes to the best of its
# starts.
ONE_GAIT = Effort(((6, 10, 5.0), (3, 20, 5.0), (1, 60, 10.0)))
THREE_GAITS = Effort(((6, 10, 5.0), (3, 20, 5.0), (3, 30, 10.0)))


@dataclass(frozen=True)
class LikelyPlants:
    """What the robot may be.

    Attributes:
        plants: K rival self-models, each of which may be off a little.
        weights: (K) how likely each is [1].
    """

    plants: Sequence[Plant]
    weights: Sequence[float] | Floats = (1.0,)

    def draw(self, count: int, rng: np.random.Generator) -> list[Plant]:
        """Draw rivals, then what they are off by."""
        chance = np.asarray(self.weights, float) / np.sum(self.weights)
        drawn = rng.choice(len(self.plants), size=count, p=chance)
        return [randomize_plant(self.plants[k], rng) for k in drawn]


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
        pattern = find_pattern(self.pattern)
        return pattern.compute_commands(self.genes[None], joints, seconds)[0]

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


class GaitSearch:
    """The trials of one synthesis, counted."""

    def __init__(self, likely: LikelyPlants, task: GaitTask, effort: Effort) -> None:
        self.likely, self.task, self.effort = likely, task, effort
        self.rng = np.random.default_rng(task.seed)
        self.pattern = find_pattern(task.pattern)
        self.joints = likely.plants[0].body.anatomy.size
        self.simulations = self.failed = 0

    def score_genes(self, genes: Floats, seconds: float) -> Floats:
        """(N) [m/s] fitness of genes (N, D) on one plant; diverged ones are worst."""
        commands = self.pattern.compute_commands(genes, self.joints, seconds)
        walks = simulate_walks(self.likely.draw(1, self.rng) * len(genes), commands)
        self.simulations += len(genes)
        self.failed += int(walks.failed.sum())
        with np.errstate(invalid="ignore"):
            fit = compute_fitness(walks, self.task.heading) / seconds
        return np.where(walks.failed, -np.inf, fit)


def synthesize_gaits(
    likely: LikelyPlants,
    task: GaitTask,
    effort: Effort = ONE_GAIT,
    *,
    start: Gait | None = None,
    progress: Progress = lambda what, share: None,
) -> list[Gait]:
    """Gaits for a robot that may be any of some plants, each a little otherwise.

    Args:
        start: a gait that one of the searches starts from.
        progress: called with what is done and how much of it.
    """
    search = GaitSearch(likely, task, effort)
    lives = _start_searches(search, start)
    rungs = effort.rungs
    total = sum(count * times * seconds for count, times, seconds in rungs)
    done = 0.0
    for count, generations, seconds in rungs:
        lives = sorted(lives, key=lambda life: -life[0])[:count]
        for k in range(len(lives)):
            for _ in range(generations):
                lives[k] = _run_generation(search, lives[k], seconds)
                done += seconds
                progress(f"{SECONDS * lives[k][0]:.2f} m in 10 s", done / total)
    spent = search.simulations, search.failed
    found = [
        Gait(task.pattern, state.mean, task.heading, 0.0, 0.0, 0.0, *spent)
        for _, state in lives
    ]
    return [evaluate_gait(likely, gait, task.seed) for gait in found]


def _start_searches(
    search: GaitSearch, start: Gait | None
) -> list[tuple[float, CmaState]]:
    """Where searches begin: the old gait, and the best of many random ones."""
    effort = search.effort
    genes, (count, _, seconds) = draw_first_genes(search), effort.rungs[0]
    scores = search.score_genes(genes, seconds)
    best = rank_best_first(scores)[:count]
    lives = [(float(scores[i]), start_search(genes[i], effort.step)) for i in best]
    if start is not None and start.pattern == search.pattern.name:
        lives[-1] = (np.inf, start_search(start.genes, effort.step_again))
    return lives


def draw_first_genes(search: GaitSearch) -> Floats:
    """(N, D) genes [1]; joints as far from the torso share a stance."""
    rng, joints, effort = search.rng, search.joints, search.effort
    size = effort.drawn, search.pattern.count_genes(joints)
    genes = effort.step * rng.normal(size=size)
    depth = count_ancestors(search.likely.plants[0].body.parent[0])
    shape = effort.drawn, depth.max() + 1
    stance = rng.uniform(-_STANCE, _STANCE, shape)[:, depth]
    return search.pattern.add_stance(genes, stance)


def _run_generation(
    search: GaitSearch, life: tuple[float, CmaState], seconds: float
) -> tuple[float, CmaState]:
    """One generation on a plant drawn anew; the score is a running mean."""
    score, state = life
    genes = ask(state, _CHILDREN, search.rng)
    scores = search.score_genes(genes, seconds)
    state = tell(state, genes, scores)
    best = float(np.sort(scores)[-4:].mean())
    if not np.isfinite(score) or state.generation < 4:
        return best, state
    return 0.8 * score + 0.2 * best, state


def evaluate_gait(likely: LikelyPlants, gait: Gait, seed: int) -> Gait:
    """A gait with what is predicted of it on plants that the robot may be."""
    drawn = likely.draw(_JUDGES, np.random.default_rng([seed, 1]))
    walks = walk_gait(drawn, gait)
    along, _ = project_on_heading(walks.position[:, -1], gait.heading)
    along = along[~walks.failed] if not walks.failed.all() else np.zeros(1)
    low, middle, high = map(float, np.quantile(along, [0.1, 0.5, 0.9]))
    return replace(
        gait,
        predicted=middle,
        low=low,
        high=high,
        simulations=gait.simulations + _JUDGES,
        failed=gait.failed + int(walks.failed.sum()),
    )
