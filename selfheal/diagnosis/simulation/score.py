"""Scores: takes a simulator and terms, gives open-loop errors as contracted."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments, cut_segments
from ..effects.base import Term
from .simulator import Simulator

# [s] of a segment where an episode's initial state is not given (contract, section 2)
REPLAY_SEGMENT = 0.5
BOOTSTRAP_DRAWS, BOOTSTRAP_SEED = 300, 0  # of an interval; chosen: its ends are steady
TINY = np.finfo(float).tiny
BOOTSTRAP_QUANTILES = (0.05, 0.95)  # of a 90 % interval (contract, section 2)


def cut_replay_segments(simulator: Simulator) -> Segments:
    """Cut episodes into segments of 0.5 s where their initial state is not given."""
    steps = max(1, round(REPLAY_SEGMENT / simulator.timestep))
    is_given = [episode.qpos0 is not None for episode in simulator.episodes]
    parts = [
        cut_segments(simulator.episodes, None if given else steps, only=i)
        for i, given in enumerate(is_given)
    ]
    return Segments.concatenate(parts)


def square_errors(
    simulator: Simulator,
    segments: Segments,
    terms: Sequence[Term],
    values: Floats,
) -> Floats:
    """Squared prediction errors of each sample and channel.

    Of an orientation's two signs, the one nearer to the reading counts.

    Args:
        values: (P) of the parameters of the terms, which the given model lacks.

    Returns:
        (M, S) [each channel's unit^2]; NaN where nothing was read, infinite where the
        simulation diverged.
    """
    predicted = simulator.simulate(terms, values[None], segments)[0]
    errors = predicted - segments.readings
    out = np.full((len(errors), len(simulator.channels)), np.nan)
    for s, c in enumerate(simulator.channels):
        x = errors[:, c.columns]
        if c.kind == "body_orientation":
            other = predicted[:, c.columns] + segments.readings[:, c.columns]
            is_nearer = (x**2).sum(1, keepdims=True) < (other**2).sum(1, keepdims=True)
            x = np.where(is_nearer, x, other)
        is_read = np.isfinite(segments.readings[:, c.columns]).all(axis=1)
        square = (x[is_read] ** 2).sum(axis=1)
        out[is_read, s] = np.where(np.isfinite(square), square, np.inf)
    return out


def sum_squared_errors(
    simulator: Simulator,
    segments: Segments,
    terms: Sequence[Term],
    values: Floats,
) -> Floats:
    """Sum the squared prediction errors over each episode.

    Args:
        simulator: with E episodes and S channels.
        values: (P) of the parameters of the terms, which the given model lacks.

    Returns:
        (E, S) [each channel's unit^2]; NaN where nothing was read, infinite where the
        simulation diverged.
    """
    squares = square_errors(simulator, segments, terms, values)
    episode = segments.episode[segments.segment_of_sample]
    out = np.full((len(simulator.episodes), squares.shape[1]), np.nan)
    for e in np.unique(episode):
        own = squares[episode == e]
        is_read = ~np.isnan(own).all(axis=0)
        out[e, is_read] = np.nansum(own[:, is_read], axis=0)
    return out


def log_errors(
    simulator: Simulator,
    segments: Segments,
    terms: Sequence[Term],
    values: Floats,
) -> Floats:
    """Logarithms of the errors of each segment, means over the channels.

    Minus the log predictive density per reading, of scales that nobody knows. What
    noise makes of an error is added to it, for less than that means nothing.

    Args:
        values: (P) of the parameters of the terms, which the given model lacks.

    Returns:
        (W) [nats] of root mean squares in standard deviations of each channel; infinite
        where the simulation diverged.
    """
    size = [(c.spread**2, np.nansum(c.noise**2) + TINY) for c in simulator.channels]
    spread, noise = np.array(size).T
    squares = square_errors(simulator, segments, terms, values)
    squares = ((squares + noise) / spread).T
    segment = segments.segment_of_sample
    total, count = (
        np.array([np.bincount(segment, x, len(segments)) for x in each])
        for each in (np.nan_to_num(squares, posinf=np.inf), ~np.isnan(squares))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        each = 0.5 * np.log(total / count)
    return np.asarray(np.nanmean(each, axis=0))


def count_readings(simulator: Simulator, segments: Segments) -> Floats:
    """Count the readings (E, S) of each channel in each episode."""
    episode = segments.episode[segments.segment_of_sample]
    out = np.zeros((len(simulator.episodes), len(simulator.channels)))
    for s, c in enumerate(simulator.channels):
        is_read = np.isfinite(segments.readings[:, c.columns]).all(axis=1)
        out[:, s] = np.bincount(episode[is_read], minlength=len(simulator.episodes))
    return out


def normalize_errors(simulator: Simulator, squares: Floats, count: Floats) -> Floats:
    """Root mean square error of each channel over its standard deviation.

    Args:
        squares: (E, S) from `sum_squared_errors`.
        count: (E, S) from `count_readings`.

    Returns:
        (S) [1], all episodes together; NaN where nothing was read.
    """
    spread = np.array([c.spread for c in simulator.channels])
    total = np.nansum(squares, axis=0) / np.maximum(count.sum(axis=0), 1)
    return np.where(count.sum(axis=0) > 0, np.sqrt(total) / spread, np.nan)


def pool_errors(
    simulator: Simulator, squares: Floats, count: Floats
) -> dict[tuple[str, str], float]:
    """Root mean square errors of all signals of a kind, by kind and unit.

    Args:
        squares: (E, S) from `sum_squared_errors`.
        count: (E, S) from `count_readings`.
    """
    sums: dict[tuple[str, str], Floats] = {}
    each = np.nansum(squares, axis=0), count.sum(axis=0)
    for c, total, number in zip(simulator.channels, *each, strict=True):
        scale, unit = c.error_unit
        pooled = sums.setdefault((c.kind, unit), np.zeros(2))
        pooled += [scale**2 * total, number]
    return {key: float(np.sqrt(s / n)) for key, (s, n) in sums.items() if n}


def compute_score(simulator: Simulator, squares: Floats, count: Floats) -> float:
    """Score a prediction as the contract does: 0 is exact, 1 is no better than a mean.

    Args:
        squares: (E, S) from `sum_squared_errors`.
        count: (E, S) from `count_readings`.

    Returns:
        Root mean square of the position-like channels' normalized errors [1].
    """
    errors = normalize_errors(simulator, squares, count)
    is_scored = np.array([c.is_scored for c in simulator.channels])
    return float(np.sqrt(np.nanmean(errors[is_scored] ** 2)))


def bootstrap_interval(
    simulator: Simulator, squares: Floats, count: Floats, signal: int
) -> tuple[float, float, float]:
    """Bootstrap a channel's error over whole episodes (Efron 1979).

    Args:
        squares: (E, S) from `sum_squared_errors`.
        count: (E, S) from `count_readings`.

    Returns:
        Normalized error and the ends of its 90 % interval [1].
    """
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    draws = rng.integers(len(squares), size=(BOOTSTRAP_DRAWS, len(squares)))
    value = normalize_errors(simulator, squares, count)[signal]
    drawn = [normalize_errors(simulator, squares[d], count[d])[signal] for d in draws]
    low, high = (
        np.nanquantile(drawn, BOOTSTRAP_QUANTILES)
        if np.isfinite(value)
        else (value,) * 2
    )
    return float(value), float(low), float(high)


def compute_noise_floor(simulator: Simulator) -> Floats:
    """Noise (S) of each channel's readings over its standard deviation [1]."""
    out = []
    for c in simulator.channels:
        noise = np.where(np.isfinite(c.noise), c.noise, 0.0)
        out.append(np.sqrt((noise**2).sum()) / c.spread)
    return np.array(out)
