"""Lengths, our way: a robot that holds poses in, the lengths that explain it out.

A servo misses its target, by a zero that stays and by something new in every pose. A
pose is off by as much as its tilts and clearance change with its joints. So residuals
are weighed by least squares with each pose's own covariance, and zeros are found with
the lengths. The poses that come next are those after which the lengths can be expected
to be known best.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.random import Generator

from ..body.body import Bodies, Floats
from ..body.genome import LENGTH_RANGE, Genomes, build_bodies
from .crowding import run_generation
from .schema import PoseEvaluator, SearchPlan

# Servos of 2006 miss by 1.2 degrees on average (papers.md 1.1), chosen: by standard
# deviations of a degree that stays and one that is new in every pose [deg]; sensors
# [deg], [deg], [mm], a little more than they are read to.
_ZERO, _SERVO = 1.0, 1.0
_SENSORS = np.array([0.25, 0.25, 1.0])
# A reading that moves more than this with a joint or a length stands on an edge, and
# tells nothing: [deg/mm], [deg/mm], [mm/mm] and [deg/deg], [deg/deg], [mm/deg]. Chosen:
# twice what a leg of 20 cm can do that stands where it stood.
_EDGES = np.array([[0.3, 0.3, 2.0], [2.0, 2.0, 7.0]])
_SPREAD = 55.0  # [mm] standard deviation of lengths before anything is known
# Chosen: models, generations after each asking, and from where a gap counts no more
# (5 degrees); starts and steps of least squares, from where its gaps count less, what a
# failed simulation counts, steps of slopes [mm], [deg]; what a foot counts that touches
# otherwise (the logarithm of how seldom it does).
_MODELS, _GENERATIONS, _CAP = 60, 20, 0.5
_STARTS, _STEPS, _ROBUST, _FAILED = 5, 25, 2.0, 50.0
_NUDGE = (2.0, 1.0)
_TOUCH_COST = 2.0
_PLAUSIBLE_MODELS = 8  # bodies that might be it, for choosing poses; chosen

Ask = Callable[[int], Floats]


def estimate_lengths(
    plan: SearchPlan,
    like: Bodies,
    offers: Floats,
    ask: Ask,
    *,
    stages: Sequence[int],
    rng: Generator,
) -> tuple[Genomes, int]:
    """Find the lengths of a body whose tree is known.

    Args:
        plan: of `schema.make_lengths_plan`, for the tree and the sensors that count.
        offers: (A, P) poses that the robot can hold [rad].
        ask: has it hold one of them; the channels of `schema` (7) measured there.
        stages: how many poses are asked for before each estimation. All are chosen,
            by what is believed so far; at random where feet alone count.

    Returns:
        The best model (1), and the simulations, those for choosing poses included.
    """
    search = _LengthSearch(PoseEvaluator(like, replace(plan, cap=_CAP)), rng)
    tried, measured = list[int](), list[Floats]()
    for count in stages:
        new = search.choose_poses(offers, tried, count)
        tried += new
        measured += [ask(k) for k in new]
        search.update(offers[tried], np.array(measured))
    return search.build_genomes(search.best[None]), search.judge.spent


class _LengthSearch:
    """The search; a model is its lengths [mm], then its zeros [deg]."""

    def __init__(self, judge: PoseEvaluator, rng: Generator) -> None:
        """Nothing known yet."""
        self.judge, self.rng, self.size = judge, rng, judge.plan.genes
        self.genes = rng.random((_MODELS, self.size))
        self.smooth = [c for c in judge.columns if c < len(_SENSORS)]
        self.feet = [c for c in judge.columns if c >= len(_SENSORS)]
        self.best = np.zeros(0)

    def build_genomes(self, models: Floats) -> Genomes:
        """Bodies of models (N)."""
        low, high = LENGTH_RANGE
        genes = (models[:, : self.size] / 1000 - low) / (high - low)
        return self.judge.plan.decode(genes)

    def predict_channels(self, models: Floats, poses: Floats) -> Floats:
        """(N, n, 7) channels of N models in n poses."""
        bodies = build_bodies(self.judge.like.anatomy, self.build_genomes(models))
        targets = poses + np.radians(models[:, None, self.size :])
        return self.judge.simulate_poses(bodies, targets)

    def compute_slopes(self, models: Floats, poses: Floats) -> Floats:
        """(N, n, C, 2 P) slopes of the smooth channels that count."""
        step = np.repeat(_NUDGE, self.size)
        moved = models[:, None] + np.vstack([0 * step, np.diag(step)])
        shape = (*moved.shape[:2], len(poses), -1)
        seen = self.predict_channels(moved.reshape(-1, moved.shape[2]), poses)
        seen = np.nan_to_num(seen.reshape(shape)[..., self.smooth], nan=_FAILED)
        slope = (seen[:, 1:] - seen[:, :1]) / step[:, None, None]
        return slope.transpose(0, 2, 3, 1)

    def compute_covariance(self, slopes: Floats) -> Floats:
        """(..., C, C) of readings, from what servos and sensors miss by."""
        most = _EDGES[1, self.smooth][:, None]
        joints = np.clip(slopes[..., self.size :], -most, most)
        sensors = np.diag(_SENSORS[self.smooth] ** 2)
        return _SERVO**2 * joints @ joints.swapaxes(-1, -2) + sensors

    def compute_information(self, models: Floats, poses: Floats) -> Floats:
        """(N, n, 2 P, 2 P) what each pose tells if a model is right (Fisher's)."""
        slope = self.compute_slopes(models, poses)
        information = slope.swapaxes(-1, -2) @ np.linalg.solve(
            self.compute_covariance(slope), slope
        )
        most = np.repeat(_EDGES[:, self.smooth], self.size, axis=0).T
        edge = np.any(np.abs(slope) > most, axis=(-1, -2))
        return np.where(edge[..., None, None], 0.0, information)

    def choose_poses(
        self, offers: Floats, tried: Sequence[int], count: int
    ) -> list[int]:
        """The next poses, which leave the least expected error of a length."""
        left = np.setdiff1d(np.arange(len(offers)), tried)
        if not self.smooth or len(left) <= count:
            return self.rng.permutation(left)[:count].tolist()
        information = self.compute_information(
            self.draw_plausible_models(offers[list(tried)]), offers
        )
        sums = self.build_prior() + information[:, list(tried)].sum(axis=1)
        found = list[int]()
        for _ in range(count):
            spread = np.linalg.inv(sums[:, None] + information[:, left])
            lengths = np.diagonal(spread, axis1=-2, axis2=-1)[..., : self.size]
            place = int(np.argmin(np.sqrt(lengths).mean(axis=(0, 2))))
            found.append(int(left[place]))
            sums = sums + information[:, found[-1]]
            left = np.delete(left, place)
        return found

    def build_prior(self) -> Floats:
        """(2 P, 2 P) precision before any reading."""
        return np.diag(np.repeat([_SPREAD**-2, _ZERO**-2], self.size))

    def draw_plausible_models(self, poses: Floats) -> Floats:
        """Models that might be right: about the best, as far as poses leave it open."""
        low, high = self.list_bounds()
        if not len(poses):
            zeros = np.repeat([False, True], self.size)
            drawn = self.rng.normal(0, _ZERO, (_PLAUSIBLE_MODELS, len(low)))
            return np.where(zeros, drawn, self.rng.uniform(low, high, drawn.shape))
        information = self.compute_information(self.best[None], poses)[0].sum(axis=0)
        spread = np.linalg.inv(self.build_prior() + information)
        drawn = self.rng.multivariate_normal(self.best, spread, _PLAUSIBLE_MODELS)
        return np.clip(drawn, low, high)

    def list_bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest model."""
        low, high = 1000 * np.array(LENGTH_RANGE)
        far = 5 * _ZERO
        return np.repeat([low, -far], self.size), np.repeat([high, far], self.size)

    def update(self, poses: Floats, measured: Floats) -> None:
        """Crowding goes on with all poses so far; then least squares from its best."""
        score = partial(self.judge.compute_errors, poses, measured)
        found = score(self.genes)
        for _ in range(_GENERATIONS):
            self.genes, found = run_generation(self.genes, found, score, self.rng)
        order = np.argsort(found, kind="stable")[:_STARTS]
        low, high = LENGTH_RANGE
        starts = 1000 * (low + self.genes[order] * (high - low))
        models = [np.append(start, np.zeros(self.size)) for start in starts]
        if not self.smooth:
            self.best = models[0]
            return
        models += [self.best] if len(self.best) else []
        models = [self.fit_least_squares(model, poses, measured) for model in models]
        costs = [self.compute_cost(model, poses, measured) for model in models]
        self.best = models[int(np.argmin(costs))]

    def compute_weights(self, model: Floats, poses: Floats) -> Floats:
        """(n, C, C) that make gaps of a right model independent, of variance 1."""
        spread = self.compute_covariance(self.compute_slopes(model[None], poses)[0])
        return np.linalg.inv(np.linalg.cholesky(spread))

    def compute_residuals(
        self, model: Floats, poses: Floats, measured: Floats, weights: Floats
    ) -> Floats:
        """(M) what a model misses by, its zeros too."""
        seen = self.predict_channels(model[None], poses)[0] - measured
        seen = np.nan_to_num(seen[:, self.smooth], nan=_FAILED)
        zeros = model[self.size :] / _ZERO
        return np.append((weights @ seen[..., None]).ravel(), zeros)

    def fit_least_squares(
        self, start: Floats, poses: Floats, measured: Floats
    ) -> Floats:
        """The model at the foot of the hill where a model stands."""
        from scipy.optimize import least_squares

        low, high = self.list_bounds()
        weights = self.compute_weights(start, poses)
        zeros = np.eye(len(low))[self.size :] / _ZERO

        def slopes(x: Floats) -> Floats:
            rows = weights @ self.compute_slopes(x[None], poses)[0]
            return np.vstack([rows.reshape(-1, len(x)), zeros])

        found = least_squares(
            lambda x: self.compute_residuals(x, poses, measured, weights),
            np.clip(start, low + 1e-6, high - 1e-6),
            slopes,
            bounds=(low, high),
            x_scale=np.repeat([10.0, 1.0], self.size),
            loss="cauchy",
            f_scale=_ROBUST,
            max_nfev=_STEPS,
        )
        return found.x

    def compute_cost(self, model: Floats, poses: Floats, measured: Floats) -> float:
        """How badly a model explains all: robust squares, and feet that are wrong."""
        gap = self.compute_residuals(
            model, poses, measured, self.compute_weights(model, poses)
        )
        loss = _ROBUST**2 * np.log1p((gap / _ROBUST) ** 2).sum() / 2
        if self.feet:
            touch = self.predict_channels(model[None], poses)[0][:, self.feet]
            loss += _TOUCH_COST * np.abs(touch - measured[:, self.feet]).sum()
        return float(loss)
