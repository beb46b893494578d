"""Windows whose residuals are to be small: takes hypotheses, gives residuals."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...errors import RecordingError
from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..data.segments import Segments
from ..data.state_estimate import estimate_initial_state
from ..effects.base import Term, remove_rounding
from ..simulation.dataset import (
    MIN_SEGMENTS,
    MIN_SNR,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
    list_unmeasured_joints,
)
from ..simulation.simulator import Simulator
from .regime import Regime, find_regime

FAR = 300.0  # of a residual's standard deviations; a diverged sample is that far off
# of an error, a move of a start that changes nothing but which roughness is met; chosen
HAIR = 0.1
BLOCKS = 24  # at most, of neighboring windows, each predicted from the others; chosen


@dataclass(frozen=True, eq=False)
class Problem:
    """Windows whose residuals are to be small.

    Attributes:
        world: that is simulated.
        windows: the pieces.
        sigma: (C) of each column's residual [its unit].
        whiten: of each window, what its uncertain start explains: (R_w, k), (k).
        shift: (W, 2 nv) of the states that were read, where the windows begin; None: 0.
        pull: (R) what the shift alone makes of the residuals, as far as it is linear.
        centered: as `World.simulate` has it.
    """

    simulator: Simulator
    segments: Segments
    sigma: Floats
    marginal_bases: Sequence[tuple[Floats, Floats]] = field(default_factory=tuple)
    initial_state_shift: Floats | None = None
    shift_response: Floats | None = None
    centered: bool = True

    @property
    def segment_of_residual(self) -> np.ndarray:
        """(R) window of each residual."""
        return np.repeat(
            self.segments.segment_of_sample, self.segments.readings.shape[1]
        )

    @property
    def regime(self) -> Regime:
        """What its data allow a fit to ask."""
        return find_regime(self.simulator.has_contact, self.segments.is_single_readings)

    def compute_residuals(
        self,
        terms: Sequence[Term],
        values: Floats,
        initial_state_offset: Floats | None = None,
    ) -> Floats:
        """(n, R) readings less prediction, in standard deviations; 0 where missing.

        `initial_state_offset`: (n, W, 2 nv) added to the starts.
        """
        values = remove_rounding(terms, values)
        if self.initial_state_shift is not None:
            more = (
                np.zeros((len(values), 1, 1))
                if initial_state_offset is None
                else initial_state_offset
            )
            initial_state_offset = self.initial_state_shift + more
        predicted = self.simulator.simulate(
            terms,
            values,
            self.segments,
            initial_state_offset=initial_state_offset,
            centered=self.centered,
        )
        apart = predicted - self.segments.readings
        apart = _align_quaternions(apart, predicted, self) / self.sigma
        known = np.isfinite(self.segments.readings)
        lost = ~np.isfinite(apart)
        apart = np.where(lost, FAR, np.clip(np.where(lost, 0, apart), -FAR, FAR))
        flat = np.where(known, apart, 0.0).reshape(len(predicted), -1)
        return self.marginalize(
            flat if self.shift_response is None else flat - self.shift_response
        )

    def residuals_at(self, terms: Sequence[Term], values: Floats) -> Floats:
        """(R) residuals of one hypothesis."""
        return self.compute_residuals(terms, values[None])[0]

    def draw_antithetic_offsets(self, count: int, rng: np.random.Generator) -> Floats:
        """Kicks (count, W, 2 nv) so small that they change nothing but roughness.

        Half of them are the others' opposites, so that their mean is no kick.
        """
        std = initial_state_std(self.simulator, self.segments)
        half = rng.choice([-HAIR, HAIR], size=(count // 2, *std.shape)) * std
        return np.concatenate([half, -half])

    def marginalize(self, flat: Floats) -> Floats:
        """Without what starts explain (Gauss-Newton, starts eliminated)."""
        if self.marginal_bases:
            edges = np.searchsorted(
                self.segment_of_residual, np.arange(len(self.segments) + 1)
            )
            for i, (u, shrink) in enumerate(self.marginal_bases):
                part = flat[:, edges[i] : edges[i + 1]]
                part -= ((part @ u) * shrink) @ u.T
        return flat

    def transfer_jacobian(self, other: "Problem", jac: Floats) -> Floats:
        """A Jacobian (R, P) as in another problem, that weighs the same otherwise."""
        flat = jac.T.copy()
        edges = np.searchsorted(
            self.segment_of_residual, np.arange(len(self.segments) + 1)
        )
        for i, (u, shrink) in enumerate(self.marginal_bases):
            part = flat[:, edges[i] : edges[i + 1]]
            part += ((part @ u) * (shrink / (1 - shrink))) @ u.T
        rows, width = len(self.segment_of_residual), len(self.sigma)
        plain = flat.reshape(len(flat), rows // width, width) * self.sigma
        return other.marginalize((plain / other.sigma).reshape(flat.shape)).T

    def timestep_error(
        self, terms: Sequence[Term], values: Floats, at: Floats
    ) -> Floats:
        """(R) of residuals `at` (R) what the time step makes, as halving it tells.

        Half the step halves the error of a method of first order, so that it changes
        half of it (Richardson 1911); after an impact the two are as large.
        """
        finer = replace(
            self,
            simulator=self.simulator.with_half_step,
            segments=self.segments.with_half_step,
        )
        return 2 * (at - finer.residuals_at(terms, values))

    def clock_error(self, terms: Sequence[Term], values: Floats, at: Floats) -> Floats:
        """(R) of residuals `at` (R) what commands make that act a little later."""
        return (
            replace(self, simulator=self.simulator.with_late_commands).residuals_at(
                terms, values
            )
            - at
        )

    def select(self, chosen: np.ndarray) -> "Problem":
        """The same with some of the windows."""
        if np.array_equal(chosen, np.arange(len(self.segments))):
            return self
        whiten = (
            tuple(self.marginal_bases[i] for i in chosen) if self.marginal_bases else ()
        )
        shift, pull = self.initial_state_shift, self.shift_response
        if shift is not None:
            shift = shift[chosen]
        if pull is not None:
            pull = pull.reshape(self.segments.readings.shape)
            pull = pull[self.segments.find_sample_rows(chosen)].ravel()
        segments = self.simulator.select_segments(self.segments, chosen)
        return replace(
            self,
            segments=segments,
            marginal_bases=whiten,
            initial_state_shift=shift,
            shift_response=pull,
        )

    @property
    def unmarginalized(self) -> "Problem":
        """The same, in which what starts could explain counts in full."""
        return replace(self, marginal_bases=(), shift_response=None)

    def sum_by_segment(self, values: Floats) -> Floats:
        """Sum of (R) values over each window (W)."""
        count = len(self.segments)
        return np.bincount(self.segment_of_residual, values, minlength=count).astype(
            float
        )


def _align_quaternions(apart: Floats, predicted: Floats, problem: Problem) -> Floats:
    """Differences of which those of orientations take the nearer of two signs."""
    for c in problem.simulator.channels:
        if c.kind == "body_orientation":
            read = problem.segments.readings[:, c.columns]
            dot = np.sum(predicted[..., c.columns] * read, axis=-1, keepdims=True)
            sign = np.where(dot < 0, -1.0, 1.0)
            apart[..., c.columns] = predicted[..., c.columns] * sign - read
    return apart


def build_initial_state_offsets(simulator: Simulator, segments: Segments) -> Floats:
    """Initial states (1 + 2 nv, W, 2 nv) off by nothing, and by one error each."""
    std = initial_state_std(simulator, segments)
    return unit_offsets(std.shape[1]) * std


def initial_state_std(simulator: Simulator, segments: Segments) -> Floats:
    """Standard deviations (W, 2 nv) of the states that were read."""
    std = np.empty((len(segments), 2 * simulator.compiler.nominal.nv))
    for episode in np.unique(segments.episode):
        rows = np.flatnonzero(segments.episode == episode)
        std[rows] = estimate_initial_state(
            simulator, int(episode), segments.first_step[rows], {}
        )[2]
    return std


def unit_offsets(width: int) -> Floats:
    """(1 + width, 1, width): nothing, and one of each."""
    return np.concatenate([np.zeros((1, width)), np.eye(width)])[:, None]


def build_problem(dataset: Dataset, seconds: float) -> Problem:
    """Windows of the fitted recordings, weighted by the given model's error."""
    simulator = dataset.training
    segments = cut_readable_segments(simulator, seconds)
    apart = simulator.simulate([], np.zeros((1, 0)), segments)[0] - segments.readings
    sigma = np.sqrt(
        np.nanmean(np.where(np.isfinite(apart), apart, np.nan) ** 2, axis=0)
    )
    spread = repeat_by_column(simulator.channels, "spread")
    sigma = np.clip(np.where(np.isfinite(sigma), sigma, spread), 1e-9 * spread, spread)
    return Problem(simulator, segments, sigma)


def check_enough_segments(simulator: Simulator, problem: Problem) -> None:
    """Refuse what could only be answered with "nothing", for want of evidence.

    Raises:
        RecordingError: too short, or nothing moved.
    """
    if len(problem.segments) < MIN_SEGMENTS and (
        lost := list_unmeasured_joints(simulator)
    ):
        raise RecordingError(
            f"no signal tells the position of {', '.join(lost)}, so that an episode is "
            f"one piece, and {len(simulator.episodes)} are too few to decide anything; "
            "would "
            f"fit: record it, or at least {MIN_SEGMENTS} episodes beside what is held "
            "out"
        )
    if len(problem.segments) < MIN_SEGMENTS:
        raise RecordingError(
            f"{len(problem.segments)} pieces of {SHORT_SEGMENT} s are too few to "
            f"decide anything; would fit: at least {MIN_SEGMENTS}, better 40, beside "
            "what is held out"
        )
    loud = [
        c.name for c in simulator.channels
        if c.is_scored and not c.spread < MIN_SNR * np.sqrt(np.nansum(c.noise**2))
    ]  # fmt: skip
    if not loud:
        raise RecordingError(
            "no position-like signal moves by more than its noise; would fit: a "
            "recording in which the robot moves"
        )


def assign_blocks(problem: Problem) -> np.ndarray:
    """(W) block of each window: neighbors in time share one."""
    return (
        np.arange(len(problem.segments))
        * min(BLOCKS, len(problem.segments))
        // len(problem.segments)
    )
