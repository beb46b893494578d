"""Windows whose residuals are to be small: takes hypotheses, gives residuals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..recording.data import Floats
from .memory import Answer
from .scene import by_column
from .state import start_of
from .terms import Term
from .windows import Windows
from .world import World

FAR = 300.0  # of a residual's standard deviations; a diverged sample is that far off
LINEAR = 0.1  # of a signal's spread, that a start's error may cause; chosen
GROWS = 2.0  # times what it causes in a shorter piece; chosen


@dataclass(frozen=True, eq=False)
class Problem:
    """Windows whose residuals are to be small.

    Attributes:
        world: that is simulated.
        windows: the pieces.
        sigma: (C) of each column's residual [its unit].
        whiten: of each window, what its uncertain start explains: (R_w, k), (k).
        centered: as `World.simulate` has it.
    """

    world: World
    windows: Windows
    sigma: Floats
    whiten: Sequence[tuple[Floats, Floats]] = field(default_factory=tuple)
    centered: bool = True

    @property
    def window_of(self) -> np.ndarray:
        """(R) window of each residual."""
        return np.repeat(self.windows.window, self.windows.readings.shape[1])

    def residuals(self, terms: Sequence[Term], values: Floats, **more) -> Floats:
        """(n, R) readings less prediction, in standard deviations; 0 where missing."""
        told = self.world.simulate(
            terms, values, self.windows, centered=self.centered, **more
        )
        apart = told - self.windows.readings
        apart = _aligned(apart, told, self) / self.sigma
        known = np.isfinite(self.windows.readings)
        lost = ~np.isfinite(apart)
        apart = np.where(lost, FAR, np.clip(np.where(lost, 0, apart), -FAR, FAR))
        flat = np.where(known, apart, 0.0).reshape(len(told), -1)
        return self._whitened(flat)

    def at(self, terms: Sequence[Term], values: Floats) -> Floats:
        """(R) residuals of one hypothesis."""
        return self.residuals(terms, values[None])[0]

    def _whitened(self, flat: Floats) -> Floats:
        if self.whiten:
            edges = np.searchsorted(self.window_of, np.arange(len(self.windows) + 1))
            for i, (u, shrink) in enumerate(self.whiten):
                part = flat[:, edges[i] : edges[i + 1]]
                part -= ((part @ u) * shrink) @ u.T
        return flat

    def carried(self, other: "Problem", jac: Floats) -> Floats:
        """A Jacobian (R, P) as in another problem, that weighs the same otherwise."""
        flat = jac.T.copy()
        edges = np.searchsorted(self.window_of, np.arange(len(self.windows) + 1))
        for i, (u, shrink) in enumerate(self.whiten):
            part = flat[:, edges[i] : edges[i + 1]]
            part += ((part @ u) * (shrink / (1 - shrink))) @ u.T
        plain = flat.reshape(len(flat), -1, len(self.sigma)) * self.sigma
        return other._whitened((plain / other.sigma).reshape(flat.shape)).T

    def recall(self, question: Sequence, work_out: Callable[[], Answer]) -> Answer:
        """What `work_out` gives of this problem, from memory if it is there.

        Args:
            question: what else the answer depends on.
            work_out: gives arrays.
        """

        def counting() -> Answer:
            before = counted[0]
            return *work_out(), np.array(counted[0] - before)

        windows, counted = self.windows, self.world.counted
        own = (windows.log, windows.start, windows.steps, windows.window, windows.at,
               self.sigma, list(self.whiten), self.centered)  # fmt: skip
        before = counted[0]
        *answer, simulated = self.world.memory.recall((*own, *question), counting)
        counted[0] = before + int(simulated)
        return tuple(answer)

    def of_step(self, terms: Sequence[Term], values: Floats, at: Floats) -> Floats:
        """(R) of residuals `at` (R) what the time step makes, as halving it tells.

        Half the step halves the error of a method of first order, so that it changes
        half of it (Richardson 1911); after an impact the two are as large.
        """
        finer = replace(self, world=self.world.halved, windows=self.windows.halved)
        return 2 * (at - finer.at(terms, values))

    def take(self, chosen: np.ndarray) -> "Problem":
        """The same with some of the windows."""
        whiten = tuple(self.whiten[i] for i in chosen) if self.whiten else ()
        # the same ones each time: what is held of them is found again
        kept = self.world.held.setdefault(self.windows, {})
        key = np.asarray(chosen).tobytes()
        if key not in kept:
            kept[key] = self.windows.take(chosen)
        return replace(self, windows=kept[key], whiten=whiten)

    def by_window(self, values: Floats) -> Floats:
        """Sum of (R) values over each window (W)."""
        count = len(self.windows)
        return np.bincount(self.window_of, values, minlength=count).astype(float)


def _aligned(apart: Floats, told: Floats, problem: Problem) -> Floats:
    """Differences of which those of orientations take the nearer of two signs."""
    for c in problem.world.signals:
        if c.kind == "body_orientation":
            read = problem.windows.readings[:, c.columns]
            dot = np.sum(told[..., c.columns] * read, axis=-1, keepdims=True)
            sign = np.where(dot < 0, -1.0, 1.0)
            apart[..., c.columns] = told[..., c.columns] * sign - read
    return apart


def start_errors(world: World, windows: Windows) -> Floats:
    """Initial states (1 + 2 nv, W, 2 nv) off by nothing, and by one error each."""
    nv = world.workshop.given.nv
    std = np.empty((len(windows), 2 * nv))
    for log in np.unique(windows.log):
        rows = np.flatnonzero(windows.log == log)
        std[rows] = start_of(world, int(log), windows.start[rows], {})[2]
    kick = np.zeros((2 * nv + 1, len(windows), 2 * nv))
    for i in range(2 * nv):
        kick[i + 1, :, i] = std[:, i]
    return kick


def is_told(
    problem: Problem, shorter: Problem, terms: Sequence[Term], values: Floats
) -> bool:
    """Whether the windows are short enough for their starts.

    What an error of the start causes in them stays linear and is not much more than it
    is in shorter ones; where it grows too fast, longer pieces say less, not more.
    """
    moved = [_moved_by_starts(p, terms, values) for p in (problem, shorter)]
    return moved[0] < min(LINEAR, GROWS * moved[1])


def _moved_by_starts(problem: Problem, terms: Sequence[Term], values: Floats) -> float:
    """Root mean square of what errors of the starts cause, of the signals' spreads."""
    kick = start_errors(problem.world, problem.windows)
    hypotheses = np.tile(values, (len(kick), 1))
    told = problem.world.simulate(
        terms, hypotheses, problem.windows, kick=kick, centered=problem.centered
    )
    spread = by_column(problem.world.signals, "spread")
    moved = ((told[1:] - told[0]) / spread) ** 2
    return float(np.sqrt(np.nanmean(moved.sum(axis=0))))


def whitened(problem: Problem, terms: Sequence[Term], values: Floats) -> Problem:
    """The same problem, in which what an uncertain start could cause costs less."""
    kick = start_errors(problem.world, problem.windows)
    plain = replace(problem, whiten=())
    told = plain.residuals(terms, np.tile(values, (len(kick), 1)), kick=kick)
    moved = (told[1:] - told[0]).T  # (R, 2 nv), of one standard deviation each
    edges = np.searchsorted(plain.window_of, np.arange(len(problem.windows) + 1))
    out = []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        u, s, _ = np.linalg.svd(moved[a:b], full_matrices=False)
        out.append((u, 1 - 1 / np.sqrt(1 + s**2)))
    return replace(problem, whiten=tuple(out))
