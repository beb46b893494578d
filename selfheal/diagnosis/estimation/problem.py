"""Problems: takes segments and weights, gives residuals of hypotheses.

The residuals of hypothesis x in a segment with initial state s0 are

    r = (y_hat(x, s0) - y) / sigma,

with readings y and their prediction y_hat. What errors of s0 can explain is removed
from them where initial states are marginalized (`marginalization`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ...errors import RecordingError
from ...printable import join_names
from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..data.segments import Segments
from ..effects.base import Term
from ..effects.terms import remove_rounding
from ..simulation.dataset import (
    FITTED_SEGMENTS,
    MIN_SEGMENTS,
    MIN_SNR,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
    list_unmeasured_joints,
)
from ..simulation.simulator import Simulator
from .regime import Regime, find_regime
from .settings import FIT


@dataclass(frozen=True, eq=False)
class Problem:
    """Segments whose residuals are to be minimized, and how they are weighted.

    R residuals are those of M samples in C columns, a sample's columns in a row.

    Attributes:
        simulator: predicts the readings.
        segments: W of them.
        sigma: (C) standard deviation of each column's residual [unit of the column].
        marginal_bases: of each segment, directions U (R_w, k) that errors of its
            initial state can explain, and the share (k) [1] of each that is removed.
            Without any, initial states are taken as certain.
        initial_state_shift: (W, 2 nv) from the initial states that were read to those
            that are used [rad or m, and per s]; None: 0.
        shift_response: (R) [standard deviations] linear response of the residuals to
            that shift, which is subtracted: the shift is an error like any other.
        state_slopes: of each segment, slopes (R_w, 2 nv) of the predictions in its
            initial state [unit of the column per rad or m, and per s]; kept in contact.
        centered: whether steps are a leapfrog's (`Simulator.leapfrog`).
    """

    simulator: Simulator
    segments: Segments
    sigma: Floats
    marginal_bases: Sequence[tuple[Floats, Floats]] = field(default_factory=tuple)
    initial_state_shift: Floats | None = None
    shift_response: Floats | None = None
    state_slopes: Sequence[Floats] = ()
    centered: bool = True

    @property
    def segment_of_residual(self) -> np.ndarray:
        """(R) number of each residual's segment."""
        return np.repeat(
            self.segments.segment_of_sample, self.segments.readings.shape[1]
        )

    @property
    def regime(self) -> Regime:
        """What the data allow a fit to ask."""
        return find_regime(self.simulator.has_contact, self.segments.is_single_readings)

    def predict(
        self, terms: Sequence[Term], values: Floats, initial_state_offset: Floats | None
    ) -> Floats:
        """Predict the readings (n, M, C) [each channel's unit] of hypotheses.

        Args:
            terms: effects beside the given model, P parameters in all.
            values: (n, P) a row a hypothesis [units of the parameters].
            initial_state_offset: (n, W, 2 nv) as `Simulator.simulate` has it.
        """
        simulator = self.simulator.leapfrog if self.centered else self.simulator
        return simulator.simulate(
            terms, values, self.segments, initial_state_offset=initial_state_offset
        )

    def compute_residuals(
        self,
        terms: Sequence[Term],
        values: Floats,
        initial_state_offset: Floats | None = None,
    ) -> Floats:
        """Residuals of hypotheses: prediction less reading, over sigma.

        They are clipped at `FIT.max_residual`, which a diverged sample counts. Then
        what errors of the initial states explain is removed.

        Args:
            terms: effects beside the given model, P parameters in all.
            values: (n, P) a row a hypothesis [units of the parameters].
            initial_state_offset: (n, W, 2 nv) added to the initial states [rad or m,
                and per s].

        Returns:
            (n, R) [standard deviations]; 0 where a reading is missing.
        """
        values = remove_rounding(terms, values)
        if self.initial_state_shift is not None:
            if initial_state_offset is None:
                initial_state_offset = np.zeros((len(values), 1, 1))
            initial_state_offset = self.initial_state_shift + initial_state_offset
        predicted = self.predict(terms, values, initial_state_offset)
        self._subtract_readings(predicted)
        predicted /= self.sigma
        has_diverged, limit = ~np.isfinite(predicted), FIT.max_residual
        np.clip(predicted, -limit, limit, out=predicted)
        predicted[has_diverged] = limit
        predicted[:, ~np.isfinite(self.segments.readings)] = 0.0
        residuals = predicted.reshape(len(predicted), -1)
        if self.shift_response is not None:
            residuals -= self.shift_response
        self._marginalize(residuals)
        return residuals

    def residuals_at(self, terms: Sequence[Term], values: Floats) -> Floats:
        """(R) residuals of one hypothesis with values (P); see `compute_residuals`."""
        return self.compute_residuals(terms, values[None])[0]

    def _subtract_readings(self, predicted: Floats) -> None:
        """Subtract the readings from predictions (n, M, C) [unit of each column].

        Quaternions q and -q are the same orientation: the nearer one counts.
        """
        for c in self.simulator.channels:
            if c.kind == "body_orientation":
                q, read = (
                    predicted[..., c.columns],
                    self.segments.readings[:, c.columns],
                )
                dot = np.sum(q * read, axis=-1, keepdims=True)
                predicted[..., c.columns] = np.where(dot < 0, -q, q)
        predicted -= self.segments.readings

    def draw_antithetic_offsets(self, count: int, rng: np.random.Generator) -> Floats:
        """Draw perturbations of the initial states, in pairs of opposite sign.

        They are so small that only the roughness of the residuals changes. Their mean
        is zero (antithetic variates, Hammersley and Morton 1956).

        Returns:
            (2 K, W, 2 nv) for a count of 2 K [rad or m, and per s].
        """
        std = initial_state_std(self.simulator, self.segments)
        size = FIT.antithetic_offset
        half = rng.choice([-size, size], size=(count // 2, *std.shape)) * std
        return np.concatenate([half, -half])

    def _marginalize(self, residuals: Floats) -> None:
        """Remove from residuals (n, R) what errors of the initial states explain.

        (I - U diag(share) U') r in each segment; see `marginalize_initial_states`.
        """
        if not self.marginal_bases:
            return
        for rows, (u, share) in zip(
            self._segment_rows, self.marginal_bases, strict=True
        ):
            part = residuals[:, rows]
            part -= ((part @ u) * share) @ u.T

    def transfer_jacobian(self, other: "Problem", jacobian: Floats) -> Floats:
        """Express a Jacobian (R, P) in the residuals of another problem.

        The other problem has the same segments and weights them otherwise. Here
        marginalization is undone, which multiplies by I + U diag(share / (1 - share))
        U', and so is the division by sigma; there both are done.
        """
        columns = jacobian.T.copy()
        if self.marginal_bases:
            for rows, (u, share) in zip(
                self._segment_rows, self.marginal_bases, strict=True
            ):
                part = columns[:, rows]
                part += ((part @ u) * (share / (1 - share))) @ u.T
        each = columns.reshape(len(columns), *self.segments.readings.shape)
        each *= self.sigma
        each /= other.sigma
        other._marginalize(columns)
        return columns.T

    @property
    def _segment_rows(self) -> list[slice]:
        """Residuals of each segment (W)."""
        edges = np.searchsorted(
            self.segment_of_residual, np.arange(len(self.segments) + 1)
        )
        return [slice(a, b) for a, b in pairwise(edges)]

    @property
    def with_half_step(self) -> "Problem":
        """The problem simulated in steps half as long."""
        return replace(
            self,
            simulator=self.simulator.with_half_step,
            segments=self.segments.with_finer_steps(2),
        )

    @property
    def with_late_commands(self) -> "Problem":
        """The problem whose commands act a fraction of a step later."""
        return replace(self, simulator=self.simulator.with_late_commands)

    def select(self, chosen: np.ndarray) -> "Problem":
        """The problem in segments `chosen` (w)."""
        if np.array_equal(chosen, np.arange(len(self.segments))):
            return self
        bases, slopes = (
            tuple(each[i] for i in chosen) if each else ()
            for each in (self.marginal_bases, self.state_slopes)
        )
        shift, response = self.initial_state_shift, self.shift_response
        if shift is not None:
            shift = shift[chosen]
        if response is not None:
            response = response.reshape(self.segments.readings.shape)
            response = response[self.segments.find_sample_rows(chosen)].ravel()
        return replace(
            self,
            segments=self.simulator.select_segments(self.segments, chosen),
            marginal_bases=bases,
            initial_state_shift=shift,
            shift_response=response,
            state_slopes=slopes,
        )

    @property
    def unmarginalized(self) -> "Problem":
        """The problem whose initial states are those used now, and certain."""
        return replace(self, marginal_bases=(), shift_response=None)

    @property
    def native(self) -> "Problem":
        """The problem as MuJoCo steps the given model.

        Initial states and the response to their errors, which no time step changes
        much, are those of this problem.
        """
        simulator = self.simulator
        return replace(
            self,
            simulator=simulator.native,
            segments=self.segments.with_finer_steps(simulator.coarsening),
            centered=False,
        )

    @property
    def with_measured_states(self) -> "Problem":
        """The problem whose initial states are those that were read, and certain."""
        return replace(self.unmarginalized, initial_state_shift=None, state_slopes=())

    def split_by_segment(self, values: Floats) -> list[Floats]:
        """Each segment's part of values (R, ...) of the residuals."""
        edges = np.arange(1, len(self.segments))
        return np.split(values, np.searchsorted(self.segment_of_residual, edges))

    def sum_by_segment(self, values: Floats) -> Floats:
        """(W) sums over each segment of values (R) of the residuals."""
        count = len(self.segments)
        sums = np.bincount(self.segment_of_residual, values, minlength=count)
        return sums.astype(float)


def initial_state_std(simulator: Simulator, segments: Segments) -> Floats:
    """(W, 2 nv) standard deviations of the initial states [rad or m, and per s]."""
    std = np.empty((len(segments), 2 * simulator.compiler.nominal.nv))
    for episode in np.unique(segments.episode):
        rows = np.flatnonzero(segments.episode == episode)
        first = segments.first_step[rows]
        std[rows] = simulator.complete_state(int(episode), first).std
    return std


def build_problem(dataset: Dataset, seconds: float) -> Problem:
    """Pose a problem of the training data, weighted by the given model's error.

    Args:
        seconds: length of the segments [s].
    """
    simulator = dataset.training
    segments = cut_readable_segments(simulator, seconds)
    predicted = simulator.simulate([], np.zeros((1, 0)), segments)[0]
    errors = predicted - segments.readings
    count = np.isfinite(errors).sum(axis=0)
    squares = np.where(np.isfinite(errors), errors, 0.0) ** 2
    spread = repeat_by_column(simulator.channels, "spread")
    sigma = np.sqrt(squares.sum(axis=0) / np.maximum(count, 1))
    least = FIT.min_residual_std_share * spread
    sigma = np.clip(np.where(count, sigma, spread), least, spread)
    return Problem(simulator, segments, sigma)


def build_longer_problems(dataset: Dataset, problem: Problem) -> list[Problem]:
    """The training data in longer and longer segments, as long as these are several.

    Args:
        problem: in short segments, whose weights are used.
    """
    longer = []
    for seconds in FITTED_SEGMENTS:
        segments = cut_readable_segments(dataset.training, seconds)
        if len(segments) < min(FIT.min_long_segments, len(problem.segments)):
            break
        longer.append(Problem(dataset.training, segments, problem.sigma))
    return longer


def check_enough_segments(simulator: Simulator, problem: Problem) -> None:
    """Refuse recordings that are too few, too short or too still for a diagnosis.

    Raises:
        RecordingError: whose message says what would fit.
    """
    if len(problem.segments) < MIN_SEGMENTS and (
        unmeasured := list_unmeasured_joints(simulator)
    ):
        has_base = (simulator.compiler.nominal.jnt_type == 0).any()  # mjtJoint: free
        welded = "; or no free joint, if the robot hangs or is bolted down"
        raise RecordingError(
            f"no signal tells the position of {join_names(unmeasured)}, so that an "
            f"episode is one piece, and {len(simulator.episodes)} are too few to "
            f"decide anything; would fit: record it, or at least {MIN_SEGMENTS} "
            f"episodes beside what is held out{welded * bool(has_base)}"
        )
    if len(problem.segments) < MIN_SEGMENTS:
        raise RecordingError(
            f"{len(problem.segments)} pieces of {SHORT_SEGMENT} s are too few to "
            f"decide anything; would fit: at least {MIN_SEGMENTS}, better 40, beside "
            "what is held out"
        )
    if not any(
        c.is_scored and not c.spread < MIN_SNR * np.sqrt(np.nansum(c.noise**2))
        for c in simulator.channels
    ):
        raise RecordingError(
            "no position-like signal moves by more than its noise; would fit: a "
            "recording in which the robot moves"
        )


def assign_blocks(problem: Problem) -> np.ndarray:
    """(W) number of each segment's block; neighbors in time share one."""
    count = len(problem.segments)
    return np.arange(count) * min(FIT.max_blocks, count) // count


def list_block_rows(problem: Problem) -> list[np.ndarray]:
    """Numbers of the residuals of each block."""
    block = assign_blocks(problem)[problem.segment_of_residual]
    return [np.flatnonzero(block == b) for b in np.unique(block)]
