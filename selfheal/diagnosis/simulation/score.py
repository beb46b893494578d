"""The contract's score: open loop on held-out episodes, as anyone would replay them."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments, cut_segments
from ..effects.base import Term
from .simulator import Simulator

PIECE = 0.5  # [s] where the initial state is not given (contract section 2)


def cut_replay_segments(world: Simulator) -> Segments:
    """Whole episodes where their initial state is given, pieces of 0.5 s elsewhere."""
    steps = max(1, round(PIECE / world.timestep))
    whole = [log.qpos0 is not None for log in world.episodes]
    parts = [
        cut_segments(world.episodes, None if given else steps, only=i)
        for i, given in enumerate(whole)
    ]
    return Segments.concatenate(parts)


def sum_squared_errors(
    world: Simulator, pieces: Segments, terms: Sequence[Term], values: Floats,
    *, centered: bool = False,
) -> Floats:  # fmt: skip
    """Squared errors (E, S) summed over each episode, of each signal; NaN unread.

    `centered`: as `World.simulate` has it.
    """
    told = world.simulate(terms, values[None], pieces, centered=centered)[0]
    apart = told - pieces.readings
    out = np.full((len(world.episodes), len(world.channels)), np.nan)
    log = pieces.episode[pieces.segment_of_sample]
    for s, c in enumerate(world.channels):
        x = apart[:, c.columns]
        if c.kind == "body_orientation":
            other = told[:, c.columns] + pieces.readings[:, c.columns]
            nearer = (x**2).sum(1, keepdims=True) < (other**2).sum(1, keepdims=True)
            x = np.where(nearer, x, other)
        read = np.isfinite(pieces.readings[:, c.columns]).all(axis=1)
        square = np.where(read, (x**2).sum(axis=1), 0.0)
        square = np.where(read & ~np.isfinite(square), np.inf, square)
        for e in range(len(world.episodes)):
            rows = (log == e) & read
            if rows.any():
                out[e, s] = square[rows].sum()
    return out


def count_readings(world: Simulator, pieces: Segments) -> Floats:
    """Readings (E, S) of each signal in each episode."""
    log = pieces.episode[pieces.segment_of_sample]
    out = np.zeros((len(world.episodes), len(world.channels)))
    for s, c in enumerate(world.channels):
        read = np.isfinite(pieces.readings[:, c.columns]).all(axis=1)
        out[:, s] = np.bincount(log[read], minlength=len(world.episodes))
    return out


def normalize_errors(world: Simulator, squares: Floats, count: Floats) -> Floats:
    """Error (S) of each signal over its standard deviation, all episodes together."""
    spread = np.array([c.spread for c in world.channels])
    total = np.nansum(squares, axis=0) / np.maximum(count.sum(axis=0), 1)
    return np.where(count.sum(axis=0) > 0, np.sqrt(total) / spread, np.nan)


def compute_score(world: Simulator, squares: Floats, count: Floats) -> float:
    """The contract's number: root mean square over the position-like signals."""
    each = normalize_errors(world, squares, count)
    scored = np.array([c.is_scored for c in world.channels])
    return float(np.sqrt(np.nanmean(each[scored] ** 2)))


def bootstrap_interval(
    world: Simulator, squares: Floats, count: Floats, signal: int
) -> tuple[float, float, float]:
    """A signal's error and its 90 % interval, by a bootstrap of whole episodes."""
    rng = np.random.default_rng(0)
    draws = rng.integers(len(squares), size=(300, len(squares)))
    value = normalize_errors(world, squares, count)[signal]
    each = [normalize_errors(world, squares[d], count[d])[signal] for d in draws]
    low, high = (
        np.nanquantile(each, [0.05, 0.95]) if np.isfinite(value) else (value,) * 2
    )
    return float(value), float(low), float(high)


def compute_noise_floor(world: Simulator) -> Floats:
    """Normalized noise (S) of each signal's readings; NaN where unknown."""
    out = []
    for c in world.channels:
        noise = np.where(np.isfinite(c.noise), c.noise, 0.0)
        out.append(np.sqrt((noise**2).sum()) / c.spread)
    return np.array(out)
