"""Initial states of segments: takes values, gives where each segment likeliest begins.

Multiple shooting (Bock and Plitt 1984) by Gauss-Newton steps: each segment's initial
state has a normal prior, which is what was read, with its standard deviation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.base import Term
from ..simulation.simulator import Simulator
from .jacobian import respond_to_initial_states
from .problem import Problem, initial_state_std
from .quadratic_model import update_broyden
from .settings import FIT

Linearization = tuple[Floats, Floats]  # residuals (R_w), their response (R_w, 2 nv)


def build_initial_state_offsets(simulator: Simulator, segments: Segments) -> Floats:
    """Offsets (1 + n, W, 2 nv): none, and errors of the initial states.

    The squared changes that they cause, in sum, are those by one standard deviation of
    each state. Many states are moved at once, by random signs (Hutchinson 1990).
    """
    std, count = initial_state_std(simulator, segments), FIT.state_draws
    errors = np.eye(std.shape[1])[:, None] * std
    if len(errors) > count:
        rng = np.random.default_rng(6)
        errors = rng.choice([-1.0, 1.0], (count, *std.shape)) * std / np.sqrt(count)
    return np.concatenate([np.zeros((1, *std.shape)), errors])


@dataclass(frozen=True, eq=False)
class StateEstimates:
    """Initial states of W segments, and the linearization there.

    Attributes:
        offset: (W, 2 nv) from the states that were read [standard deviations].
        linearizations: of each segment, residuals r (R_w) and their response S
            (R_w, 2 nv) to one standard deviation of each state.
        cost: (W) |r + S s|^2 + |offset + s|^2 at the best step s.
        is_nonlinear: (W) whether a step of the states does not act linearly.
    """

    offset: Floats
    linearizations: list[Linearization]
    cost: Floats
    is_nonlinear: np.ndarray

    def keep_best(
        self, chosen: np.ndarray, other: "StateEstimates"
    ) -> "StateEstimates":
        """These, and where they cost less others of some segments, by number."""
        offset, cost = self.offset.copy(), self.cost.copy()
        linearizations = list(self.linearizations)
        for i in np.flatnonzero(other.cost < cost[chosen]):
            w = chosen[i]
            offset[w], cost[w] = other.offset[i], other.cost[i]
            linearizations[w] = other.linearizations[i]
        return StateEstimates(offset, linearizations, cost, self.is_nonlinear)


@dataclass(frozen=True, eq=False)
class StateSearch:
    """A search for the likeliest initial states of W segments, at some values.

    Attributes:
        problem: whose initial states are as read and certain.
        values: (P) of the terms [units of the parameters].
        std: (W, 2 nv) standard deviations of the states [rad or m, and per s].
    """

    problem: Problem
    terms: Sequence[Term]
    values: Floats
    std: Floats

    def select(self, chosen: np.ndarray) -> "StateSearch":
        """The search in segments `chosen` (w)."""
        return replace(self, problem=self.problem.select(chosen), std=self.std[chosen])

    def run(self, start: Floats, responses: Sequence[Floats] = ()) -> StateEstimates:
        """Gauss-Newton iterations of all segments at once.

        Where the response is linear the states stay, for marginalization finds the
        minimum. In contact, where slopes are rough, responses are only updated from
        step to step (Broyden 1965).

        Args:
            start: (W, 2 nv) offsets to begin with [standard deviations].
            responses: of each segment (R_w, 2 nv) to one standard deviation of each
                state, near the values and offsets; none: by differences.
        """
        offset, problem = start.copy(), self.problem
        active = np.arange(len(offset))
        if responses:
            split = problem.split_by_segment(self._compute(offset[None])[0])
            known = list(zip(split, responses, strict=True))
        else:
            known = self._linearize(offset)
        cost, is_nonlinear = np.zeros(len(offset)), np.zeros(len(offset), bool)
        for _ in range(problem.regime.state_iterations):
            now = [known[w] for w in active]
            step = self.select(active)._step(now, offset[active])
            is_nonlinear[active] |= step.is_nonlinear
            cost[active] = step.cost
            better = np.flatnonzero(step.is_better)
            active = active[better]
            if not len(active):
                break
            moves = step.offset[better] - offset[active]
            offset[active] = step.offset[better]
            if problem.regime.is_nonsmooth:
                each = zip(better, moves, strict=True)
                new = [_update_response(now[i], step.residuals[i], m) for i, m in each]
            else:
                new = self.select(active)._linearize(offset[active])
            for w, linearization in zip(active, new, strict=True):
                known[w] = linearization
        return StateEstimates(offset, known, cost, is_nonlinear)

    def try_other_velocities(self) -> Floats:
        """The likeliest of some states with one velocity higher or lower than read.

        A robot with dry friction sticks or slips by how fast it was. From one side of
        that no slope leads to the other.

        Returns:
            (W, 2 nv) offsets [standard deviations].
        """
        count, width = self.std.shape
        velocities = FIT.velocity_offset * np.eye(width)[width // 2 :, None]
        tried = np.concatenate([velocities, -velocities]).repeat(count, axis=1)
        costs = self._sum_costs(self._compute(tried), tried)
        return tried[costs.argmin(axis=0), np.arange(count)]

    def _compute(self, offset: Floats) -> Floats:
        """(n, R) residuals with states off by (n, W, 2 nv) [standard deviations]."""
        rows = np.tile(self.values, (len(offset), 1))
        return self.problem.compute_residuals(self.terms, rows, offset * self.std)

    def _sum_costs(self, residuals: Floats, offset: Floats) -> Floats:
        """(n, W) costs of residuals (n, R) at offsets (n, W, 2 nv)."""
        each = [self.problem.sum_by_segment(r**2) for r in residuals]
        return np.array(each) + (offset**2).sum(axis=2)

    def _linearize(self, offset: Floats) -> list[Linearization]:
        """Residuals and response of each segment at its offset (W, 2 nv)."""
        return respond_to_initial_states(
            self.problem, self.terms, self.values, offset, self.std
        )

    def _step(self, known: Sequence[Linearization], offset: Floats) -> "_StateStep":
        """One Gauss-Newton step of each initial state (W, 2 nv), with a line search."""
        problem = self.problem
        best = [
            _solve_initial_state(r, response, o)
            for (r, response), o in zip(known, offset, strict=True)
        ]
        shares = np.array(FIT.state_step_shares)[:, None, None]
        tried = offset + shares * (np.array(best) - offset)
        residuals = self._compute(tried)
        costs = self._sum_costs(residuals, tried)
        before = np.array([r @ r for r, _ in known]) + (offset**2).sum(axis=1)
        each = zip(known, tried[0] - offset, strict=True)
        predicted = np.concatenate(
            [r + response @ step for (r, response), step in each]
        )
        error = problem.sum_by_segment((residuals[0] - predicted) ** 2)
        is_nonlinear = error > FIT.state_nonlinearity * before.mean()
        lowest = costs.argmin(axis=0), np.arange(len(offset))
        needed = (1 - FIT.min_state_step_gain) * before
        is_better = is_nonlinear & (costs[lowest] < needed)
        minimum = problem.sum_by_segment(predicted**2) + (tried[0] ** 2).sum(axis=1)
        cost = np.where(is_nonlinear, np.minimum(costs[lowest], before), minimum)
        there = [problem.split_by_segment(r) for r in residuals]
        chosen = [there[k][w] for w, k in enumerate(lowest[0])]
        return _StateStep(tried[lowest], chosen, cost, is_nonlinear, is_better)


@dataclass(frozen=True, eq=False)
class _StateStep:
    """A Gauss-Newton step of v initial states: (v, 2 nv) where to, and (v) each else.

    `residuals` (R_w) are those there. `cost` is the lowest one found or, where the
    response is linear, its minimum.
    """

    offset: Floats
    residuals: list[Floats]
    cost: Floats
    is_nonlinear: np.ndarray
    is_better: np.ndarray


def _update_response(
    linearization: Linearization, residuals: Floats, move: Floats
) -> Linearization:
    """The linearization at residuals (R_w) after a move (2 nv) [its deviations]."""
    before, response = linearization
    change = residuals - before
    return residuals, update_broyden(response, move, change, np.ones(len(move)))


def _solve_initial_state(residuals: Floats, response: Floats, offset: Floats) -> Floats:
    """The offset (2 nv) of lowest cost if the response S (R_w, 2 nv) is linear.

    (I + S'S) s = S'(S offset - r), of residuals r (R_w) there [standard deviations].
    """
    curvature = np.eye(len(offset)) + response.T @ response
    target = response.T @ (response @ offset - residuals)
    return np.asarray(np.linalg.solve(curvature, target))
