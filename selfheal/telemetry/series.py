"""Smoothed columns: takes a recording, gives values and slopes on a common grid."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..recording import Recording
from ..recording.data import Floats

# [s] standard deviation of the kernel that smooths every column alike, and of a log
# that is sampled seldom in its sampling times; chosen: passes 5 Hz, and leaves little
# of an encoder's noise in an acceleration
KERNEL_SECONDS, KERNEL_SAMPLES = 0.025, 1.5
GRID_SECONDS = 0.01  # least step of the common grid; chosen: half a kernel
EDGE_KERNELS = 2.5  # kept away from ends and gaps; chosen: 1 % of a kernel's weight
BLOCK_SECONDS = 1.0  # of a block that is held out; chosen: longer than motions remember
MAX_GAP_STEPS = 4.0  # sampling times without a reading; chosen: readings get lost
MIN_SAMPLES = 12  # of an episode; chosen: a kernel's width at both ends
MAX_ROWS = 30_000  # of the common grid; chosen: 5 minutes, some seconds of work


@dataclass(frozen=True, eq=False)
class Series:
    """All columns of a recording on one grid of N rows.

    Attributes:
        step: of the grid [s].
        kernel: standard deviation of the kernel [s].
        episode: (N) number of the episode of each row.
        block: (N) number of the block, about `BLOCK_SECONDS` long.
        ids: of the episodes.
        signals: (N, d, 3) of each signal: smoothed value [unit], slope [unit/s],
            curvature [unit/s^2]; NaN where nothing was read nearby.
        ctrl: (N, 3) of each actuator's command, the same.
    """

    step: float
    kernel: float
    episode: np.ndarray
    block: np.ndarray
    ids: tuple[str, ...]
    signals: Mapping[str, Floats]
    ctrl: Mapping[str, Floats]

    def shift(self, values: Floats, rows: int) -> Floats:
        """Values (N, ...) as they were so many rows earlier in the same episode."""
        out = np.full_like(values, np.nan)
        n = len(values)
        if abs(rows) >= n:
            return out
        to = slice(rows, n) if rows >= 0 else slice(0, n + rows)
        of = slice(0, n - rows) if rows >= 0 else slice(-rows, n)
        same = self.episode[to] == self.episode[of]
        out[to] = np.where(
            same.reshape(-1, *[1] * (values.ndim - 1)), values[of], np.nan
        )
        return out


def build_series(recording: Recording) -> Series:
    """Smooth every column of a recording, and put it on a common grid."""
    episodes = {
        name: e for name, e in recording.episodes.items() if e.time.size >= MIN_SAMPLES
    }
    gaps = [float(np.median(np.diff(e.time))) for e in episodes.values()]
    lengths = sum(float(e.time[-1] - e.time[0]) for e in episodes.values())
    step = max([GRID_SECONDS, lengths / MAX_ROWS, *gaps])
    sigma = max(KERNEL_SECONDS, KERNEL_SAMPLES * max(gaps, default=0.0))
    names = sorted({n for e in episodes.values() for n in e.signals})
    widths = {
        n: e.signals[n].values.reshape(e.time.size, -1).shape[1]
        for e in episodes.values()
        for n in e.signals
    }
    signals: dict[str, list[Floats]] = {n: [] for n in names}
    commands: dict[str, list[Floats]] = {}
    number, block, first = [], [], 0
    for i, e in enumerate(episodes.values()):
        at = np.arange(e.time[0], e.time[-1], step)
        number.append(np.full(at.size, i))
        count = max(1, round((at[-1] - at[0]) / BLOCK_SECONDS))
        block.append(first + np.arange(at.size) * count // at.size)
        first += count
        for n in names:
            held = e.signals.get(n)
            if held is None:
                signals[n].append(np.full((at.size, widths[n], 3), np.nan))
                continue
            values = held.values.reshape(e.time.size, -1)
            if held.kind == "body_orientation":
                values = align_signs(values)
            signals[n].append(_smooth(e.time, values, at, sigma, held=False))
        for k, n in enumerate(e.ctrl_names):
            smooth = _smooth(e.time, e.ctrl[:, [k]], at, sigma, held=True)
            commands.setdefault(n, []).append(smooth[:, 0])
    empty = np.zeros(0, int)
    return Series(
        step,
        sigma,
        np.concatenate(number) if number else empty,
        np.concatenate(block) if block else empty,
        tuple(episodes),
        {n: np.concatenate(parts) for n, parts in signals.items()},
        {n: np.concatenate(parts) for n, parts in commands.items()},
    )


def _smooth(
    time: Floats, values: Floats, at: Floats, sigma: float, *, held: bool
) -> Floats:
    """Values (T, d) at `time`, their slopes and curvatures at `at` (n): (n, d, 3).

    A derivative of a Gaussian kernel gives each: all of them, and all columns, are
    seen through the same kernel, so that what is linear between them stays so.

    Args:
        time: (T) [s].
        values: (T, d) [unit].
        at: (n) [s].
        sigma: standard deviation of the kernel [s].
        held: whether a value holds until the next, as commands do.
    """
    from scipy.ndimage import gaussian_filter1d

    gap = float(np.median(np.diff(time)))
    fine = min(gap, sigma / 4)
    grid = np.arange(time[0], time[-1] + fine / 2, fine)
    out = np.full((at.size, values.shape[1], 3), np.nan)
    for c in range(values.shape[1]):
        read = np.isfinite(values[:, c])
        if read.sum() < MIN_SAMPLES:
            continue
        t, y = time[read], values[read, c]
        if held:
            fitted = y[np.clip(np.searchsorted(t, grid, side="right") - 1, 0, None)]
        else:
            fitted = np.interp(grid, t, y)
        after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
        open_ = (t[after] - t[after - 1]) > MAX_GAP_STEPS * gap
        open_ |= (grid < t[0]) | (grid > t[-1])
        edge = EDGE_KERNELS * sigma
        bad = np.concatenate([[time[0] - fine], grid[open_], [time[-1] + fine]])
        near = np.clip(np.searchsorted(bad, at), 1, bad.size - 1)
        far = np.minimum(at - bad[near - 1], bad[near] - at) > edge
        for order in range(3):
            smooth = gaussian_filter1d(fitted, sigma / fine, order=order)
            column = np.interp(at, grid, smooth / fine**order)
            out[:, c, order] = np.where(far, column, np.nan)
    return out


def align_signs(quaternion: Floats) -> Floats:
    """Quaternions (T, 4) with each on the side of the one before; q and -q are one."""
    read = np.flatnonzero(np.isfinite(quaternion).all(axis=1))
    known = quaternion[read]
    turns = np.sign((known[1:] * known[:-1]).sum(axis=1))
    out = quaternion.copy()
    signs = np.cumprod(np.concatenate([[1.0], np.where(turns < 0, -1.0, 1.0)]))
    out[read] = known * signs[: len(read), None]
    return out
