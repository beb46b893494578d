"""The contract's score: open loop on held-out episodes, as anyone would replay them."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments, cut_segments
from ..effects.base import Term
from .simulator import Simulator

PIECE = 0.5  # [s] where the initial state is not given (contract section 2)


def cut_replay_segments(simulator: Simulator) -> Segments:
    """Whole episodes where their initial state is given, pieces of 0.5 s elsewhere."""
    steps = max(1, round(PIECE / simulator.timestep))
    whole = [episode.qpos0 is not None for episode in simulator.episodes]
    parts = [
        cut_segments(simulator.episodes, None if given else steps, only=i)
        for i, given in enumerate(whole)
    ]
    return Segments.concatenate(parts)


def sum_squared_errors(
    simulator: Simulator, segments: Segments, terms: Sequence[Term], values: Floats,
    *, centered: bool = False,
) -> Floats:  # fmt: skip
    """Squared errors (E, S) summed over each episode, of each signal; NaN unread.

    `centered`: as `World.simulate` has it.
    """
    predicted = simulator.simulate(terms, values[None], segments, centered=centered)[0]
    apart = predicted - segments.readings
    out = np.full((len(simulator.episodes), len(simulator.channels)), np.nan)
    episode = segments.episode[segments.segment_of_sample]
    for s, c in enumerate(simulator.channels):
        x = apart[:, c.columns]
        if c.kind == "body_orientation":
            other = predicted[:, c.columns] + segments.readings[:, c.columns]
            nearer = (x**2).sum(1, keepdims=True) < (other**2).sum(1, keepdims=True)
            x = np.where(nearer, x, other)
        read = np.isfinite(segments.readings[:, c.columns]).all(axis=1)
        square = np.where(read, (x**2).sum(axis=1), 0.0)
        square = np.where(read & ~np.isfinite(square), np.inf, square)
        for e in range(len(simulator.episodes)):
            rows = (episode == e) & read
            if rows.any():
                out[e, s] = square[rows].sum()
    return out


def count_readings(simulator: Simulator, segments: Segments) -> Floats:
    """Readings (E, S) of each signal in each episode."""
    episode = segments.episode[segments.segment_of_sample]
    out = np.zeros((len(simulator.episodes), len(simulator.channels)))
    for s, c in enumerate(simulator.channels):
        read = np.isfinite(segments.readings[:, c.columns]).all(axis=1)
        out[:, s] = np.bincount(episode[read], minlength=len(simulator.episodes))
    return out


def normalize_errors(simulator: Simulator, squares: Floats, count: Floats) -> Floats:
    """Error (S) of each signal over its standard deviation, all episodes together."""
    spread = np.array([c.spread for c in simulator.channels])
    total = np.nansum(squares, axis=0) / np.maximum(count.sum(axis=0), 1)
    return np.where(count.sum(axis=0) > 0, np.sqrt(total) / spread, np.nan)


def compute_score(simulator: Simulator, squares: Floats, count: Floats) -> float:
    """The contract's number: root mean square over the position-like signals."""
    each = normalize_errors(simulator, squares, count)
    scored = np.array([c.is_scored for c in simulator.channels])
    return float(np.sqrt(np.nanmean(each[scored] ** 2)))


def bootstrap_interval(
    simulator: Simulator, squares: Floats, count: Floats, signal: int
) -> tuple[float, float, float]:
    """A signal's error and its 90 % interval, by a bootstrap of whole episodes."""
    rng = np.random.default_rng(0)
    draws = rng.integers(len(squares), size=(300, len(squares)))
    value = normalize_errors(simulator, squares, count)[signal]
    each = [normalize_errors(simulator, squares[d], count[d])[signal] for d in draws]
    low, high = (
        np.nanquantile(each, [0.05, 0.95]) if np.isfinite(value) else (value,) * 2
    )
    return float(value), float(low), float(high)


def compute_noise_floor(simulator: Simulator) -> Floats:
    """Normalized noise (S) of each signal's readings; NaN where unknown."""
    out = []
    for c in simulator.channels:
        noise = np.where(np.isfinite(c.noise), c.noise, 0.0)
        out.append(np.sqrt((noise**2).sum()) / c.spread)
    return np.array(out)
