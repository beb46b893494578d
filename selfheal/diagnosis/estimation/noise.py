"""Noise of the readings: takes residuals, gives a noise model and what it would leave.

Noise is autoregressive of first order, AR(1): e[t] = a e[t-1] + w[t] with white w
(Box and Jenkins 1970).
"""

from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..data.local_polynomial import ar1_error_factors, choose_half_width
from ..data.robot_summary import repeat_by_column
from ..simulation.simulator import Simulator
from .fit import Fit
from .problem import Problem
from .settings import FIT


def update_noise_model(problem: Problem, residuals: Floats) -> Simulator:
    """The problem's simulator with the noise that residuals (R) show.

    Noise that is autocorrelated is larger than the scatter about local polynomials.
    Where residuals are much smaller than that scatter, the scatter is motion.

    Returns:
        A simulator whose channels have new standard deviations and AR(1) coefficients;
        the same object where they hardly change.
    """
    simulator = problem.simulator
    if not problem.regime.estimates_noise:
        return simulator
    variance, ar1 = _fit_variograms(problem, residuals)
    scatter = np.concatenate([c.scatter for c in simulator.channels])
    rms = residual_rms(problem, residuals) / np.sqrt(_noise_share_left(problem))
    white = np.where(rms < FIT.min_scatter_ratio * scatter, rms, scatter)
    rounding = repeat_by_column(simulator.channels, "rounding_noise")
    noise = np.maximum(np.fmax(white, np.sqrt(variance)), rounding)
    channels = tuple(
        replace(c, ar1=ar1[c.columns], noise=noise[c.columns])
        for c in simulator.channels
    )
    is_same = all(
        np.allclose(a, b, rtol=FIT.same_noise_tolerance, equal_nan=True)
        for new, old in zip(channels, simulator.channels, strict=True)
        for a, b in ((new.noise, old.noise), (new.ar1, old.ar1))
    )
    return simulator if is_same else simulator.with_channels(channels)


def _noise_share_left(problem: Problem) -> float:
    """Share of the noise variance [1] left in residuals by estimated initial states.

    1 - W 2 nv / n of n readings, as of any linear regression.
    """
    readings = np.isfinite(problem.segments.readings).sum()
    states = 2 * problem.simulator.compiler.nominal.nv * len(problem.segments)
    return float(max(1 - states / max(readings, 1), FIT.min_noise_share))


def _fit_variograms(problem: Problem, residuals: Floats) -> tuple[Floats, Floats]:
    """Variance and AR(1) coefficient of autocorrelated noise, by the variogram.

    Half the mean squared difference of residuals k samples apart is

        gamma(k) = w + s (1 - a^k) + q k^2

    with the variance w of white noise, the variance s of AR(1) noise with coefficient
    a, and q of a drift that the fit leaves: nugget, exponential and drift (Cressie
    1993, section 2.3). Relative errors are minimized over w, s, q >= 0 for each a.

    Args:
        residuals: (R) [standard deviations].

    Returns:
        Variance w + s (C) [square of the column's unit] and a (C) [1]; 0 in columns
        without autocorrelated noise.
    """
    from scipy.optimize import nnls

    simulator = problem.simulator
    lags = np.array(FIT.variogram_lags)
    coefficients = np.linspace(*FIT.ar1_range, FIT.ar1_count)
    gamma = _compute_variograms(problem, residuals, lags)
    models = np.array([[lags**0, 1 - a**lags, lags**2] for a in coefficients])
    _, m = choose_half_width(simulator.episodes[0].sample_steps * simulator.timestep)
    scatter = np.concatenate([c.scatter for c in simulator.channels]) / problem.sigma
    variance, ar1 = np.zeros((2, gamma.shape[1]))
    for c in np.flatnonzero(gamma.all(axis=0)):
        fits = [nnls((x / gamma[:, c]).T, np.ones(len(lags))) for x in models]
        best = int(np.argmin([error for _, error in fits[:-1]]))
        (w, s, _), error = fits[best]
        about_polynomial = w + s * ar1_error_factors(coefficients[best], m)[2]
        is_noise = (
            error < FIT.max_variogram_error * np.sqrt(len(lags))
            and error < fits[-1][1]
            and about_polynomial < FIT.max_short_noise_ratio * scatter[c] ** 2
        )
        if is_noise and w + s > FIT.min_noise_excess * scatter[c] ** 2:
            variance[c], ar1[c] = w + s, coefficients[best]
    return variance * problem.sigma**2, ar1


def _compute_variograms(
    problem: Problem, residuals: Floats, lags: np.ndarray
) -> Floats:
    """Empirical variogram of each column within segments, by the method of moments.

    Args:
        residuals: (R) [standard deviations].
        lags: (L) [samples].

    Returns:
        (L, C) half the mean squared difference [variances].
    """
    is_read = np.isfinite(problem.segments.readings)
    x, segment = residuals.reshape(is_read.shape), problem.segments.segment_of_sample
    gamma = np.empty((len(lags), is_read.shape[1]))
    for i, k in enumerate(lags):
        is_same_segment = segment[k:] == segment[:-k]
        is_pair = is_same_segment[:, None] & is_read[k:] & is_read[:-k]
        squares = np.where(is_pair, (x[k:] - x[:-k]) ** 2, 0.0).sum(axis=0)
        gamma[i] = squares / 2 / np.maximum(is_pair.sum(axis=0), 1)
    return gamma


def expected_noise(problem: Problem) -> float:
    """Squared residuals [1] that the readings' noise alone would leave."""
    count = np.isfinite(problem.segments.readings).sum(axis=0)
    return float((count * _normalized_noise(problem) ** 2).sum())


def expected_noise_by_segment(problem: Problem) -> Floats:
    """(W) squared residuals [1] that the noise alone would leave in each segment."""
    squares = np.isfinite(problem.segments.readings) * _normalized_noise(problem) ** 2
    return problem.sum_by_segment(squares.ravel())


def _normalized_noise(problem: Problem) -> Floats:
    """(C) noise of each column [standard deviations of its residuals]."""
    noise = np.concatenate([c.noise for c in problem.simulator.channels])
    return np.nan_to_num(noise) / problem.sigma


def noise_ratio(fit: Fit) -> float:
    """Root mean square of a fit's residuals over that of the readings' noise [1]."""
    return normalize_rms(fit.problem, fit.residuals)


def normalize_rms(problem: Problem, residuals: Floats) -> float:
    """Root mean square of residuals (R) over that of the readings' noise [1]."""
    expected = max(expected_noise(problem), FIT.min_expected_noise)
    return float(np.sqrt((residuals**2).sum() / expected))


def expected_cost(fit: Fit) -> float:
    """Squared residuals [1] that noise and the time step's error would leave."""
    error = fit.timestep_error()
    return expected_noise(fit.problem) + float(error @ error)


def worst_channel_ratio(fit: Fit) -> float:
    """Root mean square residual over what is expected, in the worst scored column [1].

    Expected are the noise and the time step's error. Among many columns one that is
    wrong hardly shows in the sum of all. It is wrong throughout: the worst tenth of the
    segments does not count. In contact the median segment counts, for each may be wrong
    by an impact. Single readings do not tell the noise: 0.
    """
    problem = fit.problem
    if not problem.regime.estimates_noise:
        return 0.0
    error = fit.timestep_error()
    noise = _normalized_noise(problem)
    is_tested = repeat_by_column(problem.simulator.channels, "is_scored") & (noise > 0)
    squares, squared_errors = (
        r.reshape(-1, len(is_tested))[:, is_tested] ** 2 for r in (fit.residuals, error)
    )
    is_read = np.isfinite(problem.segments.readings)[:, is_tested]
    expected = is_read * noise[is_tested] ** 2 + squared_errors
    segment, count = problem.segments.segment_of_sample, len(problem.segments)
    pick = _median_ratio if problem.regime.has_rough_cost else _trimmed_ratio
    ratios = []
    for column in zip(squares.T, expected.T, strict=True):
        actual, usual = (np.bincount(segment, x, count).astype(float) for x in column)
        ratios.append(pick(actual, usual))
    return float(np.sqrt(max([0.0, *ratios])))


def _median_ratio(squares: Floats, expected: Floats) -> float:
    """Median over segments (W) of squares over expected ones; 0 without any."""
    is_read = expected > 0
    if not is_read.any():
        return 0.0
    return float(np.median(squares[is_read] / expected[is_read]))


def _trimmed_ratio(squares: Floats, expected: Floats) -> float:
    """Sum of squares over that of expected ones (W), without the worst segments."""
    size = len(squares)
    outliers = min(
        -(-size // FIT.segments_per_outlier),
        (size - 1) // FIT.min_segments_per_outlier,
    )
    kept = np.argsort(squares - expected)[: size - outliers]
    return float(squares[kept].sum() / max(expected[kept].sum(), FIT.tiny))


def robust_noise(problem: Problem, residuals: Floats) -> float:
    """Squared residuals that errors of the size of most of these (R) would leave [1].

    By the median absolute value of each column (Huber 1981, section 5.2). Of single
    readings nothing else tells the noise.
    """
    is_read = np.isfinite(problem.segments.readings)
    columns = zip(residuals.reshape(is_read.shape).T, is_read.T, strict=True)
    sizes = [np.abs(r[read]) for r, read in columns if read.any()]
    return float(sum(len(r) * (FIT.mad_to_std * np.median(r)) ** 2 for r in sizes))


def residual_rms(problem: Problem, residuals: Floats) -> Floats:
    """(C) root mean squares [unit of each column] of residuals (R)."""
    is_read = np.isfinite(problem.segments.readings)
    squares = (residuals.reshape(is_read.shape) ** 2).sum(axis=0)
    return np.sqrt(squares / np.maximum(is_read.sum(axis=0), 1)) * problem.sigma
