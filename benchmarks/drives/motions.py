"""Excitations of the drives: a generator in, paths of the joints over time out."""

from collections.abc import Callable

import numpy as np

from benchmarks.drives.robots import Rng

TURN = 2 * np.pi
Path = Callable[[np.ndarray], np.ndarray]  # (T) [s] to (T) from -1 to 1


def make_sines(rng: Rng, rate: float, seconds: float) -> Path:
    """Four sines around a rate [Hz]; `seconds` [s] does not matter."""
    rates = rate * rng.uniform(0.25, 2.0, 4)
    phases, sizes = rng.uniform(0, TURN, 4), rng.uniform(0.4, 1.0, 4)
    sizes /= sizes.sum()
    return lambda t: np.sin(np.multiply.outer(t, TURN * rates) + phases) @ sizes


def make_chirp(rng: Rng, rate: float, seconds: float) -> Path:
    """A sine that becomes faster and smaller, around a rate [Hz], in `seconds` [s]."""
    low, high, phase = 0.25 * rate, 2.5 * rate, rng.uniform(0, TURN)

    def path(t: np.ndarray) -> np.ndarray:
        turns = low * t + 0.5 * (high - low) * t**2 / seconds
        fade = 1 - 0.6 * np.clip(t / seconds, 0, 1)  # fast ones smaller
        return fade * np.sin(TURN * turns + phase)

    return path


def _make_holds(rng: Rng, hold: float, seconds: float, levels: int) -> tuple:
    """Times (K) [s] at which a new level (K) begins."""
    count = int(seconds / hold * 2) + 4
    starts = np.cumsum(rng.uniform(0.6, 1.4, count) * hold)
    values = np.round(rng.uniform(-0.5, 0.5, count + 1) * levels) / levels * 2
    return starts, np.clip(values, -1, 1)


def make_steps(rng: Rng, rate: float, seconds: float) -> Path:
    """Steps between levels, each held for about a period of a rate [Hz]."""
    starts, values = _make_holds(rng, 1.0 / rate, seconds, 8)
    return lambda t: 0.7 * values[np.searchsorted(starts, t, side="right")]


def make_prbs(rng: Rng, rate: float, seconds: float) -> Path:
    """A binary sequence whose bits last a third of a period of a rate [Hz]."""
    bit = 0.33 / rate
    bits = rng.integers(0, 2, int(seconds / bit) + 3) * 2 - 1
    return lambda t: 0.35 * bits[np.minimum((t / bit).astype(int), len(bits) - 1)]


def make_point_to_point(rng: Rng, rate: float, seconds: float) -> Path:
    """Minimum-jerk moves of half a period of a rate [Hz], with rests between them."""
    starts, values = _make_holds(rng, 0.9 / rate, seconds, 1000)
    move = 0.5 / rate

    def path(t: np.ndarray) -> np.ndarray:
        k = np.searchsorted(starts, t, side="right")
        since = t - np.where(k > 0, starts[np.maximum(k - 1, 0)], -move)
        s = np.clip(since / move, 0, 1)
        rise = 10 * s**3 - 15 * s**4 + 6 * s**5
        before = values[np.maximum(k - 1, 0)]
        return before + (values[k] - before) * rise

    return path


MOTIONS: dict[str, Callable[[Rng, float, float], Path]] = {
    "sines": make_sines,
    "chirp": make_chirp,
    "steps": make_steps,
    "prbs": make_prbs,
    "points": make_point_to_point,
}


def draw_paths(
    rng: Rng, motion: str, rates: np.ndarray, seconds: float
) -> Callable[[np.ndarray], np.ndarray]:
    """Paths of several joints, each drawn anew.

    Args:
        rng: draws them.
        motion: name in `MOTIONS`.
        rates: (n) [Hz] of the joints.
        seconds: [s] that they last.

    Returns:
        A function of times (T) [s] that gives (T, n), from -1 to 1.
    """
    paths = [MOTIONS[motion](rng, float(rate), seconds) for rate in rates]
    return lambda t: np.stack([path(np.atleast_1d(t)) for path in paths], axis=1)
