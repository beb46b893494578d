"""Windows whose residuals are to be small: takes hypotheses, gives residuals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..recording.data import Floats
from .memory import Arrays
from .scene import repeat_by_column
from .state import estimate_initial_state
from .terms import Term, remove_rounding
from .windows import Segments
from .world import Simulator

FAR = 300.0  # of a residual's standard deviations; a diverged sample is that far off
LINEAR = 0.1  # of a signal's spread, that a start's error may cause; chosen
# rounds in which starts are sought, the shares of a step tried at once, and of the
# squared residuals what a step of starts may leave that is not linear; chosen
SOUGHT, SHORTER, BENT = 5, (1.0, 0.5, 0.2), 0.01
# times the median of a reading's squared residual, above which a window's start is
# sought at other speeds, and how many errors from the speed read; and how many errors a
# start may be away from what was read, before it is sought from there again; chosen
ODD, SPEEDS, AWAY = 4.0, 2.0, 3.0
# of an error, a move of a start that changes nothing but which roughness is met; chosen
HAIR = 0.1
GROWS = 2.0  # times what it causes in a shorter piece; chosen


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
    def is_nonsmooth(self) -> bool:
        """Whether something touches as the robot moves, so that readings jump."""
        return self.simulator.has_contact and not self.segments.is_single_readings

    def compute_residuals(
        self, terms: Sequence[Term], values: Floats, kick: Floats | None = None
    ) -> Floats:
        """(n, R) readings less prediction, in standard deviations; 0 where missing.

        `kick`: (n, W, 2 nv) added to the starts.
        """
        values = remove_rounding(terms, values)
        if self.initial_state_shift is not None:
            more = np.zeros((len(values), 1, 1)) if kick is None else kick
            kick = self.initial_state_shift + more
        told = self.simulator.simulate(
            terms, values, self.segments, kick=kick, centered=self.centered
        )
        apart = told - self.segments.readings
        apart = _align_quaternions(apart, told, self) / self.sigma
        known = np.isfinite(self.segments.readings)
        lost = ~np.isfinite(apart)
        apart = np.where(lost, FAR, np.clip(np.where(lost, 0, apart), -FAR, FAR))
        flat = np.where(known, apart, 0.0).reshape(len(told), -1)
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

    def load_or_compute(
        self, question: Sequence, work_out: Callable[[], Arrays]
    ) -> Arrays:
        """What `work_out` gives of this problem, from memory if it is there.

        Args:
            question: what else the answer depends on.
            work_out: gives arrays.
        """

        def counting() -> Arrays:
            before = counted[0]
            return *work_out(), np.array(counted[0] - before)

        windows, counted = self.segments, self.simulator.simulated_count
        noise = [(c.noise, c.ar1) for c in self.simulator.channels]
        own = (windows.episode, windows.first_step, windows.lengths, windows.segment_of_sample, windows.sample_steps,
               noise, self.sigma, list(self.marginal_bases), self.initial_state_shift, self.shift_response,
               self.centered)  # fmt: skip
        before = counted[0]
        *answer, simulated = self.simulator.checkpoint.load_or_compute(
            (*own, *question), counting
        )
        counted[0] = before + int(simulated)
        return tuple(answer)

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
        windows = self.simulator.select_segments(self.segments, chosen)
        return replace(
            self,
            segments=windows,
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


def _align_quaternions(apart: Floats, told: Floats, problem: Problem) -> Floats:
    """Differences of which those of orientations take the nearer of two signs."""
    for c in problem.simulator.channels:
        if c.kind == "body_orientation":
            read = problem.segments.readings[:, c.columns]
            dot = np.sum(told[..., c.columns] * read, axis=-1, keepdims=True)
            sign = np.where(dot < 0, -1.0, 1.0)
            apart[..., c.columns] = told[..., c.columns] * sign - read
    return apart


def build_initial_state_offsets(world: Simulator, windows: Segments) -> Floats:
    """Initial states (1 + 2 nv, W, 2 nv) off by nothing, and by one error each."""
    std = initial_state_std(world, windows)
    return unit_offsets(std.shape[1]) * std


def initial_state_std(world: Simulator, windows: Segments) -> Floats:
    """Standard deviations (W, 2 nv) of the states that were read."""
    std = np.empty((len(windows), 2 * world.compiler.nominal.nv))
    for log in np.unique(windows.episode):
        rows = np.flatnonzero(windows.episode == log)
        std[rows] = estimate_initial_state(
            world, int(log), windows.first_step[rows], {}
        )[2]
    return std


def unit_offsets(width: int) -> Floats:
    """(1 + width, 1, width): nothing, and one of each."""
    return np.concatenate([np.zeros((1, width)), np.eye(width)])[:, None]


def is_horizon_informative(
    problem: Problem, shorter: Problem, terms: Sequence[Term], values: Floats
) -> bool:
    """Whether the windows are short enough for their starts.

    What an error of the start causes in them stays linear and is not much more than it
    is in shorter ones; where it grows too fast, longer pieces say less, not more.
    """
    moved = [_initial_state_sensitivity(p, terms, values) for p in (problem, shorter)]
    return moved[0] < min(LINEAR, GROWS * moved[1])


def _initial_state_sensitivity(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> float:
    """Root mean square of what errors of the starts cause, of the signals' spreads."""
    kick = build_initial_state_offsets(problem.simulator, problem.segments)
    hypotheses = np.tile(values, (len(kick), 1))
    told = problem.simulator.simulate(
        terms, hypotheses, problem.segments, kick=kick, centered=problem.centered
    )
    spread = repeat_by_column(problem.simulator.channels, "spread")
    moved = ((told[1:] - told[0]) / spread) ** 2
    return float(np.sqrt(np.nanmean(moved.sum(axis=0))))


def marginalize_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Problem:
    """The same problem, in which what an uncertain start could cause costs less.

    Starts are eliminated from the least squares, each believed to be as read but for
    its error. After an impact what they cause is not linear: there they are first moved
    to where, with these values, they are likeliest (Bock 1983, multiple shooting).
    """
    std = initial_state_std(problem.simulator, problem.segments)
    std = np.maximum(std, 1e-300)  # without noise; then no start moves
    plain = replace(problem.unmarginalized, initial_state_shift=None)
    off = (
        np.zeros_like(std)
        if problem.initial_state_shift is None
        else problem.initial_state_shift / std
    )
    begun = off.any(axis=1)  # elsewhere than from what was read
    told, cost, bent = _search_initial_states(plain, terms, values, off, std)
    known = off, std, told, cost
    each = cost / np.maximum(
        problem.sum_by_segment(np.ones(len(problem.segment_of_residual))), 1
    )
    is_odd = bent & (each > ODD * np.median(each))
    is_far = begun & (is_odd | ((off**2).sum(axis=1) > AWAY**2))
    if is_far.any():
        far = np.flatnonzero(is_far)
        _keep_likelier(plain, terms, values, known, far, np.zeros_like(off[far]))
    if is_odd.any():
        odd = np.flatnonzero(is_odd)
        others = _try_other_speeds(plain, terms, values, std, odd)
        _keep_likelier(plain, terms, values, known, odd, others)
    whiten = []
    for _, moved in told:
        u, s, _ = np.linalg.svd(moved, full_matrices=False)
        whiten.append((u, 1 - 1 / np.sqrt(1 + s**2)))
    plain = replace(plain, marginal_bases=tuple(whiten))
    if not off.any():
        return plain
    pull = [moved @ o for (_, moved), o in zip(told, off, strict=True)]
    return replace(
        plain, initial_state_shift=off * std, shift_response=np.concatenate(pull)
    )


def _search_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats, off: Floats, std: Floats
) -> tuple[list[tuple[Floats, Floats]], Floats, np.ndarray]:
    """Move starts to where they are likeliest, as far as what they cause is not linear.

    Args:
        problem: without what starts explain.
        terms: of one hypothesis.
        values: (P) of it.
        off: (W, 2 nv) of the starts, in their errors; written to.
        std: (W, 2 nv) errors of what was read.

    Returns:
        Of each window: residuals (R_w), and what one error of each state adds to them
        (R_w, 2 nv). And what is left (W) of its squares with the likeliest start, that
        start's own errors included. And where (W) what starts cause is not linear.
    """
    told = [(np.zeros(0), np.zeros((0, 0)))] * len(off)
    cost, is_bent = np.zeros(len(off)), np.zeros(len(off), bool)
    active = np.arange(len(off))
    for last in range(SOUGHT + 1):
        part, start, unit = problem.select(active), off[active], std[active]
        own = _respond_to_offsets(part, terms, values, start, unit)
        for w, one in zip(active, own, strict=True):
            told[w] = one
        if last == SOUGHT or problem.segments.is_single_readings:
            break
        best = [
            _solve_initial_state(*one, o) for one, o in zip(own, start, strict=True)
        ]
        tries = start + np.array(SHORTER)[:, None, None] * (np.array(best) - start)
        rows = np.tile(values, (len(tries), 1))
        after = part.compute_residuals(terms, rows, tries * unit)
        costs = [part.sum_by_segment(x**2) for x in after] + (tries**2).sum(axis=2)
        before = np.array([r @ r for r, _ in own]) + (start**2).sum(axis=1)
        moves = zip(own, tries[0] - start, strict=True)
        linear = np.concatenate([r + moved @ move for (r, moved), move in moves])
        bent = part.sum_by_segment((after[0] - linear) ** 2) > BENT * before.mean()
        which = costs.argmin(axis=0), np.arange(len(active))
        gains = bent & (costs[which] < before)
        is_bent[active] |= bent
        straight = part.sum_by_segment(linear**2) + (tries[0] ** 2).sum(axis=1)
        cost[active] = np.where(bent, np.minimum(costs[which], before), straight)
        active = active[gains]
        if not len(active):
            break
        off[active] = tries[which][gains]
    return told, cost, is_bent


def _keep_likelier(problem, terms, values, known, which, begin: Floats) -> None:
    """Let some windows start where others led that begin elsewhere, if likelier.

    Args:
        problem, terms, values: as in `_sought`.
        known: `off` and `std` as there, and what it returned: all written to.
        which: windows (v).
        begin: (v, 2 nv), as `off`; written to.
    """
    off, std, told, cost = known
    again, new, _ = _search_initial_states(
        problem.select(which), terms, values, begin, std[which]
    )
    for i in np.flatnonzero(new < cost[which]):
        w = which[i]
        off[w], told[w], cost[w] = begin[i], again[i], new[i]


def _try_other_speeds(problem, terms, values, std, which) -> Floats:
    """Starts (v, 2 nv) of windows, in errors: the likeliest of some other speeds.

    A robot with dry friction sticks or slips by how fast it was; from one side of that
    no slope leads to the other.
    """
    width = std.shape[1]
    speeds = SPEEDS * np.eye(width)[width // 2 :, None]
    tries = np.concatenate([speeds, -speeds]).repeat(len(which), axis=1)
    part = problem.select(which)
    rows = np.tile(values, (len(tries), 1))
    after = part.compute_residuals(terms, rows, tries * std[which])
    costs = np.array([part.sum_by_segment(r**2) for r in after]) + (tries**2).sum(
        axis=2
    )
    return tries[costs.argmin(axis=0), np.arange(len(which))]


def _respond_to_offsets(
    problem: Problem, terms: Sequence[Term], values: Floats, off: Floats, std: Floats
) -> list[tuple[Floats, Floats]]:
    """What `_sought` returns first, of starts as they are; arguments as there."""
    count, width = off.shape
    each = unit_offsets(width)
    if problem.is_nonsmooth:  # else the residuals' own roughness would be in all slopes
        hair = np.full((1, 1, width), HAIR)
        each = np.concatenate([each, hair, -hair])
    rows = np.tile(values, (len(each), 1))
    told = problem.compute_residuals(terms, rows, (off + each) * std)
    edges = np.searchsorted(problem.segment_of_residual, np.arange(1, count))
    middle = slice(1 + width, None) if problem.is_nonsmooth else slice(1)
    return [
        (part[0], (part[1 : 1 + width] - part[middle].mean(axis=0)).T)
        for part in np.split(told, edges, axis=1)
    ]


def _solve_initial_state(r: Floats, moved: Floats, off: Floats) -> Floats:
    """A window's start, if all were linear; arguments as in `_answers`."""
    curvature = np.eye(len(off)) + moved.T @ moved
    return np.asarray(np.linalg.solve(curvature, moved.T @ (moved @ off - r)))
