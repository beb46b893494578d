"""How large the readings' noise is: takes a fit's residuals, gives what it leaves."""

from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..data.local_polynomial import ar1_error_factors, choose_half_width
from ..data.robot_summary import repeat_by_column
from ..simulation.simulator import Simulator
from .least_squares import Fit
from .problem import Problem

# of `_slow`: lags [samples] whose differences are compared; memories that are tried, of
# which the longest is none of a noise; how far off [1] what is made of them may be; and
# how much more noise [1] there may be about a parabola than was found there; chosen
LAGS, MEMORIES = np.array([1, 2, 3, 4, 6, 8]), np.linspace(0.1, 0.98, 45)
ASTRAY, ROOM = 0.03, 1.3
JUMPS = 0.7  # of the scatter, less than which a fit does not leave if that is noise
SLOW, ALIKE = 1.2, 0.1  # times the scatter's variance, a noise that is not white; a
# difference [1] of noises that is none; chosen
RARELY = 10  # windows of which the worst one makes no column loud; chosen
ABOVE = 2.0  # times the noise that an unexplained residual must be, to be one; chosen
LEFT = 1.3  # times the noise, beside names that may stand for others; chosen


def update_noise_model(problem: Problem, residuals: Floats) -> Simulator:
    """The problem's world, knowing of its readings' noise what residuals (R) tell.

    The same one where that is what it knew before.
    """
    simulator = problem.simulator
    if problem.regime.has_single_readings:
        return simulator
    variance, memory = _fit_variograms(problem, residuals)
    scatter = np.concatenate([c.scatter for c in simulator.channels])
    left = residual_rms(problem, residuals) / np.sqrt(_noise_share_kept(problem))
    # where commands jump, so do torques: about a parabola that is no noise
    white = np.where(left < JUMPS * scatter, left, scatter)
    noise = np.fmax(white, np.sqrt(variance))
    signals = tuple(
        replace(c, ar1=memory[c.columns], noise=noise[c.columns])
        for c in simulator.channels
    )
    pairs = [(a, b) for s, t in zip(signals, simulator.channels, strict=True)
             for a, b in ((s.noise, t.noise), (s.ar1, t.ar1))]  # fmt: skip
    if all(np.allclose(a, b, rtol=ALIKE, equal_nan=True) for a, b in pairs):
        return simulator
    return simulator.with_channels(signals)


def _noise_share_kept(problem: Problem) -> float:
    """Share of the readings' noise that is left where uncertain starts take theirs."""
    readings = np.isfinite(problem.segments.readings).sum()
    starts = 2 * problem.simulator.compiler.nominal.nv * len(problem.segments)
    return float(max(1 - starts / max(readings, 1), 0.5))


def _fit_variograms(problem: Problem, residuals: Floats) -> tuple[Floats, Floats]:
    """Variance (C) [its unit^2] and memory (C) of slow noise; 0 where there is none.

    A parabola through neighbors takes most of a slow noise for motion. What a fit
    leaves tells it: differences k samples apart have half the variance w + s (1 - a^k)
    + q k^2, where w is white noise, s one of first order with memory a, and q what is
    left of the motion: a variogram of nugget, exponential and drift (Cressie 1993,
    2.3), by least squares of its relative errors.
    """
    from scipy.optimize import nnls

    known, simulator = np.isfinite(problem.segments.readings), problem.simulator
    x, window = residuals.reshape(known.shape), problem.segments.segment_of_sample
    of_lags = np.empty((len(LAGS), known.shape[1]))
    for i, k in enumerate(LAGS):
        both = (window[k:] == window[:-k])[:, None] & known[k:] & known[:-k]
        squares = np.where(both, (x[k:] - x[:-k]) ** 2, 0.0).sum(axis=0)
        of_lags[i] = squares / 2 / np.maximum(both.sum(axis=0), 1)
    parts = np.array([[LAGS**0, 1 - a**LAGS, LAGS**2] for a in MEMORIES])
    _, m = choose_half_width(simulator.episodes[0].sample_steps * simulator.timestep)
    scatter = np.concatenate([c.scatter for c in simulator.channels]) / problem.sigma
    variance, memory = np.zeros((2, known.shape[1]))
    for c in np.flatnonzero(of_lags.all(axis=0)):
        tries = [nnls((p / of_lags[:, c]).T, np.ones(len(LAGS))) for p in parts]
        best = int(np.argmin([error for _, error in tries[:-1]]))
        (white, slow, _), error = tries[best]
        near = white + slow * ar1_error_factors(MEMORIES[best], m)[2]
        predicted = error < ASTRAY * np.sqrt(len(LAGS)) and error < tries[-1][1]
        predicted = predicted and near < ROOM * scatter[c] ** 2
        if predicted and white + slow > SLOW * scatter[c] ** 2:
            variance[c], memory[c] = white + slow, MEMORIES[best]
    return variance * problem.sigma**2, memory


def expected_noise(problem: Problem) -> float:
    """Squared residuals that the readings' noise alone would leave."""
    return float(_noise_by_column(problem).sum())


def expected_noise_by_segment(problem: Problem) -> Floats:
    """The same in each window (W)."""
    of_each = np.isfinite(problem.segments.readings) * _normalized_noise(problem) ** 2
    return problem.sum_by_segment(of_each.ravel())


def _noise_by_column(problem: Problem) -> Floats:
    """The same in each column (C)."""
    count = np.isfinite(problem.segments.readings).sum(axis=0)
    return count * _normalized_noise(problem) ** 2


def _normalized_noise(problem: Problem) -> Floats:
    """Noise (C) of each column, in standard deviations of its residuals."""
    noise = np.concatenate([
        np.maximum(np.nan_to_num(c.noise), c.quantum / np.sqrt(12))
        for c in problem.simulator.channels
    ])  # fmt: skip
    return noise / problem.sigma


def noise_ratio(problem: Problem, residuals: Floats) -> float:
    """Root mean square of residuals (R) over what the readings' noise would leave."""
    return float(np.sqrt((residuals**2).sum() / max(expected_noise(problem), 1e-12)))


def expected_cost(problem: Problem, found: Fit) -> float:
    """Squared residuals that the readings' noise and the time step would leave."""
    of_step = problem.timestep_error(found.terms, found.values, found.residuals)
    return expected_noise(problem) + float(of_step @ of_step)


def worst_channel_ratio(problem: Problem, found: Fit) -> float:
    """Root mean square in the worst scored column over what noise and time step leave.

    Among many columns one that is wrong hardly shows in the sum of all. It is wrong
    throughout: a tenth of the windows, its worst ones, do not count; nor half of them
    where something touches, for each may be wrong by impacts. Of poses nothing tells
    the noise: 0.
    """
    if problem.regime.has_single_readings:
        return 0.0
    of_step = problem.timestep_error(found.terms, found.values, found.residuals)
    scored = repeat_by_column(problem.simulator.channels, "is_scored") & (
        _normalized_noise(problem) > 0
    )
    squares, steps = (
        r.reshape(-1, len(scored))[:, scored] ** 2 for r in (found.residuals, of_step)
    )
    known = np.isfinite(problem.segments.readings)[:, scored]
    usual = known * _normalized_noise(problem)[scored] ** 2 + steps
    window, size = problem.segments.segment_of_sample, len(problem.segments)
    odd = min(-(-size // RARELY), (size - 1) // 3)
    ratios = [0.0]
    for left, ours in zip(squares.T, usual.T, strict=True):
        left, ours = (np.bincount(window, x, size) for x in (left, ours))
        if problem.regime.has_rough_cost:
            read = ours > 0
            ratios.append(np.median(left[read] / ours[read]) if read.any() else 0.0)
            continue
        kept = np.argsort(left - ours)[: size - odd]
        ratios.append(left[kept].sum() / max(ours[kept].sum(), 1e-300))
    return float(np.sqrt(max(ratios)))


def robust_noise(problem: Problem, residuals: Floats) -> float:
    """Squared residuals that errors of the size of most of these (R) would leave.

    Of single readings nothing else tells the noise. By the median (Huber 1981, 5.2).
    """
    known = np.isfinite(problem.segments.readings)
    columns = zip(residuals.reshape(known.shape).T, known.T, strict=True)
    of_each = [np.abs(r[there]) for r, there in columns if there.any()]
    return float(sum(len(r) * (1.4826 * np.median(r)) ** 2 for r in of_each))


def residual_rms(problem: Problem, residuals: Floats) -> Floats:
    """Root mean squares (C) [its unit] of residuals (R) in each column."""
    known = np.isfinite(problem.segments.readings)
    squares = (residuals.reshape(known.shape) ** 2).sum(axis=0)
    return np.sqrt(squares / np.maximum(known.sum(axis=0), 1)) * problem.sigma
