"""Least-squares problems of the diagnosis whose right answer is known."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np

from selfheal.diagnosis.data.segments import Segments, cut_segments
from selfheal.diagnosis.effects.base import Effect, Term
from selfheal.diagnosis.effects.declaration import Parameter
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.effects.places import Place
from selfheal.diagnosis.effects.protocols import JointForce
from selfheal.diagnosis.estimation.multiple_shooting import build_initial_state_offsets
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.selection.hypotheses import NamedEffect
from selfheal.diagnosis.selection.search_state import Evidence
from tests.support.recorded_robots import Bench

NOISE = 1e-3  # standard deviation of a reading [its unit]
STEPS = 150  # of a segment


def make_problem(
    bench: Bench,
    terms: Sequence[Term] = (),
    values: Sequence[float] | np.ndarray = (),
    noise: float = NOISE,
) -> Problem:
    """Segments whose readings are what the terms predict, and white noise.

    Args:
        terms: what the robot has that its model lacks.
        values: (P) of the terms.
        noise: standard deviation of a reading [its unit].
    """
    segments = cut_segments(bench.simulator.episodes, STEPS)
    predicted = bench.simulator.leapfrog.simulate(
        terms, np.array([values], float), segments
    )[0]
    rng = np.random.default_rng(7)
    readings = predicted + noise * rng.normal(size=predicted.shape)
    sigma = np.full(predicted.shape[1], max(noise, NOISE))
    return Problem(bench.simulator, replace(segments, readings=readings), sigma)


def list_nominal_terms(bench: Bench) -> tuple[Term, ...]:
    """The terms by which the model's own numbers are fitted."""
    return tuple(build_nominal_terms(bench.robot))


def with_contact(problem: Problem) -> Problem:
    """The problem of a robot that is said to touch something."""
    return replace(problem, simulator=replace(problem.simulator, has_contact=True))


ProblemType = TypeVar("ProblemType", bound=Problem)


def as_type(problem: Problem, kind: type[ProblemType]) -> ProblemType:
    """The problem as one of a class with other methods."""
    return kind(**{f.name: getattr(problem, f.name) for f in fields(Problem)})


def make_misread_problem(
    bench: Bench, term: Term, values: np.ndarray, speeds: np.ndarray
) -> Problem:
    """Segments whose initial speeds differ from those read.

    Args:
        term: what it has that its model lacks.
        values: (P) of the term.
        speeds: (W, 2) by how much, in standard deviations of the initial speed.
    """
    problem = make_problem(bench, (term,), values)
    offset = build_initial_state_offsets(bench.simulator, problem.segments)
    offset = offset.sum(axis=0)[None]
    offset[..., :2] = 0
    offset[..., 2:] *= speeds
    predicted = bench.simulator.leapfrog.simulate(
        (term,), values[None], problem.segments, initial_state_offset=offset
    )[0]
    noise = NOISE * np.random.default_rng(0).normal(size=predicted.shape)
    segments = replace(problem.segments, readings=predicted + noise)
    return replace(problem, segments=segments)


class ExactClockProblem(Problem):
    """A problem whose commands act exactly when their recording says."""

    @property
    def with_late_commands(self):
        return self


class MeasuredStatesProblem(Problem):
    """A problem whose initial states are linearized once and not searched."""

    @property
    def regime(self):
        return replace(super().regime, state_iterations=0)


@dataclass(frozen=True, eq=False)
class LoggedProblem(Problem):
    """A problem that remembers at which values its residuals were computed.

    Attributes:
        batches: (n, P) values of each batch.
    """

    batches: list[np.ndarray] = field(default_factory=list)

    def compute_residuals(self, terms, values, initial_state_offset=None):
        self.batches.append(np.array(values))
        return super().compute_residuals(terms, values, initial_state_offset)


def make_pose_problem(bench: Bench, count: int) -> Problem:
    """Segments of a single reading each, as of a robot that holds a pose."""
    width = sum(c.width for c in bench.simulator.channels)
    ones = np.ones(count, int)
    segments = Segments(
        0 * ones, 0 * ones, STEPS * ones, np.arange(count), 1.0 * STEPS * ones,
        np.full((count, width), np.nan),
    )  # fmt: skip
    segments.readings[:, :2] = 0.0
    return Problem(bench.simulator, segments, np.ones(width))


def name_effect(term: Term) -> NamedEffect:
    """The term as an effect that a hypothesis names, with evidence for it."""
    return NamedEffect(term, Evidence(1.0, 1e-3, 1.0), ())


class Explosion(Effect, JointForce[Place]):
    """An effect whose forces are so large that the simulation diverges."""

    name = "explosion"
    group = "test"

    def propose_terms(self, scene):
        size = Parameter("size", "1", 0.0, 0.0, 30.0, 3.0)
        return [Term(self, ("world",), (Place(),), (size,), ((20.0,), (15.0,)))]

    def apply_forces(self, moment, place, values):
        moment.applied_force[:] += 10 ** values[:, :1] - 1
