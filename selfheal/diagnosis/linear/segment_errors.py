"""Errors of predictions: takes a problem in segments, gives errors of hypotheses.

Segments are simulated from their beginnings where the states in them are not known:
joints are not read, or samples lie far apart beside what servos do. What errors of the
initial states explain is removed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..estimation.fit import Fit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.problem import Problem
from ..simulation.simulator import COMMAND_LATENESS
from .errors import ErrorModel, Errors
from .likelihood import estimate_scale

SCREENED_SEGMENTS = 8  # in which all candidates are tried; a third of a search's


@dataclass(frozen=True, eq=False)
class SegmentErrors(ErrorModel):
    """Residuals of predictions of segments, in their own standard deviations.

    Attributes:
        problem: of the residuals.
    """

    problem: Problem

    @property
    def derivative_step(self) -> float:
        """Of a derivative by a parameter [scales]."""
        return self.problem.regime.difference_step

    @property
    def is_rough(self) -> bool:
        """Whether things touch."""
        return self.problem.regime.has_rough_cost

    @property
    def rows(self) -> int:
        """How many samples."""
        return len(self.problem.segments.readings)

    @property
    def screening_share(self) -> float:
        """How many times as many segments there are as candidates are tried in."""
        return len(self.problem.segments) / SCREENED_SEGMENTS

    def compute_errors(self, terms: Sequence[Term], values: Floats) -> Errors:
        """Errors of n hypotheses with values (n, P) [units of the parameters]."""
        residuals = self.problem.compute_residuals(terms, values)
        noise = np.zeros((self.rows, 0, 0)) if len(values) == 1 else None
        return Errors(residuals, np.full(len(values), self._volume), noise)

    @property
    def _volume(self) -> float:
        """[nats] by which residuals are smaller than readings, for their density."""
        is_read = np.isfinite(self.problem.segments.readings)
        shares = [share for _, share in self.problem.marginal_bases]
        removed = np.log1p(-np.concatenate([*shares, np.zeros(0)])).sum()
        return float(removed - is_read.sum(axis=0) @ np.log(self.problem.sigma))

    def compute_nuisance(
        self, terms: Sequence[Term], values: Floats, errors: Errors
    ) -> Errors:
        """Changes (K, ...) at values (1, P) by what nobody knows, of one deviation.

        Commands that act half a step later, given states of half a step later and,
        where nothing touches, the error of the time step.
        """
        count = values.shape[1]
        jacobian = np.zeros((errors.values.size, count))
        fit = Fit(self.problem, tuple(terms), values[0], errors.values, jacobian)
        found = [0.5 / COMMAND_LATENESS * fit.clock_error()]
        if not self.problem.regime.has_rough_cost:
            found.append(fit.timestep_error())
        if (late := self._differentiate_given(errors.values)).any():
            found.append(late)
        return Errors(np.array(found), np.zeros(len(found)))

    def _differentiate_given(self, errors: Floats) -> Floats:
        """Change of errors (R C) where episodes begin at given states, half a step on.

        A robot that was simulated is there half a step, of its own, earlier or later.
        """
        problem, segments = self.problem, self.problem.segments
        simulator, out = problem.simulator, np.zeros_like(errors)
        rows = out.reshape(self.rows, -1)
        readings = np.nan_to_num(segments.readings / problem.sigma)
        predicted = errors.reshape(rows.shape) + readings
        half = 0.5 / simulator.coarsening  # of a step
        for i in np.flatnonzero(segments.first_step == 0):
            own = np.flatnonzero(segments.segment_of_sample == i)
            if simulator.episodes[segments.episode[i]].qpos0 is None or len(own) < 2:
                continue
            steps = segments.sample_steps[own]
            slope = np.gradient(predicted[own], steps, axis=0)
            rows[own] = half * np.where(np.isfinite(segments.readings[own]), slope, 0.0)
        return out

    @property
    def follows(self) -> np.ndarray:
        """(R) whether a sample follows the one before it in the same segment."""
        segment = self.problem.segments.segment_of_sample
        return np.append(False, segment[1:] == segment[:-1])

    def thin(self, share: float) -> "tuple[SegmentErrors, np.ndarray]":
        """The errors of so many times fewer segments, and numbers of their samples."""
        segments = self.problem.segments
        chosen = np.unique(np.arange(0, len(segments), share).astype(int))
        part = SegmentErrors(self.problem.select(chosen))
        return part, segments.find_sample_rows(chosen)

    def adapt(self, terms: Sequence[Term], values: Floats) -> "SegmentErrors":
        """The errors with states and weights that suit a hypothesis's values (P)."""
        problem = self.problem
        errors = self.compute_errors(terms, values[None]).values[0]
        scale = estimate_scale(errors.reshape(self.rows, -1))
        noise = np.concatenate([c.noise for c in problem.simulator.channels])
        sigma = np.fmax(problem.sigma * scale, noise)  # noise may be unknown, NaN
        is_read = np.isfinite(problem.segments.readings).any(axis=0)
        weighted = replace(problem, sigma=np.where(is_read, sigma, problem.sigma))
        return SegmentErrors(marginalize_initial_states(weighted, terms, values))
