"""Smoothed columns: takes a recording, gives values and slopes on a common grid."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..recording import Episode, Recording
from ..recording.data import Floats

# [s] standard deviation of the kernel that smooths every column alike, and of a log
# that is sampled seldom in its sampling times; chosen: passes 5 Hz, and leaves little
# of an encoder's noise in an acceleration
KERNEL_SECONDS, KERNEL_SAMPLES = 0.025, 1.5
GRID_SECONDS = 0.01  # least step of the common grid; chosen: half a kernel
INDEPENDENT_KERNELS = 4.0  # between independent rows; the width of a Gaussian's overlap
EDGE_KERNELS = 2.5  # kept away from ends and gaps; chosen: 1 % of a kernel's weight
BLOCK_SECONDS = 1.0  # of a block that is held out; chosen: longer than motions remember
MAX_GAP_STEPS = 4.0  # sampling times without a reading; chosen: readings get lost
# a gap that parts an episode [s], and in sampling times; chosen: wider than a kernel
PART_SECONDS, PART_STEPS = 0.5, 10.0
FINEST = 50.0  # parts of a kernel on the grid of a column; chosen: bursts need no more
MIN_SAMPLES = 12  # of an episode; chosen: a kernel's width at both ends
MAX_ROWS = 30_000  # of the common grid; chosen: 5 minutes, some seconds of work


@dataclass(frozen=True, eq=False)
class Series:
    """All columns of a recording on one grid of N rows.

    Attributes:
        step: of the grid [s].
        kernel: standard deviation of the kernel [s].
        episode: (N) number of the episode of each row.
        block: (N) number of its block, about `BLOCK_SECONDS` long.
        ids: of the episodes, by number.
        signals: (N, d, 3) of each signal: smoothed value [unit], slope [unit/s],
            curvature [unit/s^2]; NaN where nothing was read nearby.
        ctrl: (N, 3) of each command, the same.
    """

    step: float
    kernel: float
    episode: np.ndarray
    block: np.ndarray
    ids: tuple[str, ...]
    signals: Mapping[str, Floats]
    ctrl: Mapping[str, Floats]

    @property
    def episodes(self) -> tuple[str, ...]:
        """Each id once."""
        return tuple(dict.fromkeys(self.ids))

    @property
    def numbers(self) -> dict[str, list[int]]:
        """Numbers of the parts of each id."""
        return {k: [i for i, n in enumerate(self.ids) if n == k] for k in self.episodes}

    def name_episodes(self, rows: np.ndarray) -> np.ndarray:
        """Id (n) of the episode of some rows (n)."""
        return np.array(self.ids)[self.episode[rows]]

    def select(self, numbers: Collection[int]) -> np.ndarray:
        """Rows (n) of the episodes of some numbers."""
        return np.flatnonzero(np.isin(self.episode, [*numbers]))

    def count_rows(self, seconds: float) -> int:
        """Steps of the grid in a time [s]."""
        return round(seconds / self.step)

    @property
    def independent_seconds(self) -> float:
        """From one row that is independent to the next [s]."""
        return INDEPENDENT_KERNELS * self.kernel


def build_series(recording: Recording) -> Series:
    """Smooth every column of a recording, and put it on a common grid.

    An episode is parted at its gaps: its parts count as episodes of one id.
    """
    parts = [(n, e, r) for n, e in recording.episodes.items() for r in _list_parts(e)]
    gaps = [float(np.median(np.diff(e.time[rows]))) for _, e, rows in parts]
    seconds = sum(float(np.ptp(e.time[rows])) for _, e, rows in parts)
    step = max([GRID_SECONDS, seconds / MAX_ROWS, *gaps])
    kernel = max(KERNEL_SECONDS, KERNEL_SAMPLES * max(gaps, default=0.0))
    widths = {
        n: s.values.reshape(e.time.size, -1).shape[1]
        for e in recording.episodes.values()
        for n, s in e.signals.items()
    }
    actuators = next(iter(recording.episodes.values())).ctrl_names
    signals = {n: [np.zeros((0, widths[n], 3))] for n in sorted(widths)}
    commands = {n: [np.zeros((0, 3))] for n in actuators}
    number, block, first = [np.zeros(0, int)], [np.zeros(0, int)], 0
    for i, (_, e, rows) in enumerate(parts):
        time = e.time[rows]
        at = np.arange(time[0], time[-1], step)
        count = max(1, round((at[-1] - at[0]) / BLOCK_SECONDS))
        number.append(np.full(at.size, i))
        block.append(first + np.arange(at.size) * count // at.size)
        first += count
        for n, pieces in signals.items():
            values = np.full((time.size, widths[n]), np.nan)
            if s := e.signals.get(n):
                values = s.values.reshape(e.time.size, -1)[rows]
            if s and s.kind == "body_orientation":
                values = align_signs(values)
            pieces.append(_smooth(time, values, at, kernel, held=False))
        for n, led in commands.items():
            sent = e.ctrl[rows][:, [e.ctrl_names.index(n)]]
            led.append(_smooth(time, sent, at, kernel, held=True)[:, 0])
    ids = tuple(name for name, _, _ in parts)
    read = {n: np.concatenate(pieces) for n, pieces in signals.items()}
    ctrl = {n: np.concatenate(pieces) for n, pieces in commands.items()}
    episode, blocks = np.concatenate(number), np.concatenate(block)
    return Series(step, kernel, episode, blocks, ids, read, ctrl)


def _list_parts(episode: Episode) -> list[slice]:
    """Rows of an episode between its gaps, where they are enough."""
    if episode.time.size < MIN_SAMPLES:
        return []
    steps = np.diff(episode.time)
    torn = steps > max(PART_SECONDS, PART_STEPS * float(np.median(steps)))
    ends = [0, *(np.flatnonzero(torn) + 1).tolist(), episode.time.size]
    every = [slice(a, b) for a, b in pairwise(ends)]
    return [rows for rows in every if rows.stop - rows.start >= MIN_SAMPLES]


def _smooth(
    time: Floats, values: Floats, at: Floats, sigma: float, *, held: bool
) -> Floats:
    """Values (T, d) at `time`, their slopes and curvatures at `at` (n): (n, d, 3).

    A derivative of a Gaussian kernel, of deviation `sigma` [s], gives each: all of
    them, and all columns, are seen through the same kernel, so that what is linear
    between them stays so. A `held` value holds until the next, as commands do.
    """
    from scipy.ndimage import gaussian_filter1d

    gap = float(np.median(np.diff(time)))
    fine = float(np.clip(gap, sigma / FINEST, sigma / 4))
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
