"""How columns move together: samples of a log in; slopes, lags and correlations out."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .base import Floats, Log, check_rows

_MAX_ROWS = 20_000  # of each stream that a guess looks at; chosen: minutes at 100 Hz
_MAX_CELLS = 20_000_000  # of all streams; chosen: 160 MB
_WINDOW = 0.15  # [s] over which speeds are integrated; chosen: above encoder noise
_MAX_LAG = 0.5  # [s] of a position behind its command; chosen
# [s] from lag to lag that is tried, and steps between those tried first, about the best
# of which all are tried; chosen: a robot's motion changes little in 30 ms
_LAG_STEP, _COARSE = 0.01, 3
_LARGEST = 1e40  # of a value that is no damage; chosen: the product of six is finite
# steps between rows that are read, all but a hundredth of which are smaller, by which
# a row of zeros jumps away from both its neighbors; chosen: no motion comes back so
_JUMP, _QUANTILE = 5.0, 0.99
_STEPS = 8  # of an encoder, from which their size is found; chosen
_GRID = 4000  # points at which columns of different clocks are compared; chosen


@dataclass
class Sample:
    """The first rows of a stream.

    Attributes:
        columns: (n) values by name; of columns of numbers.
        texts: names of columns of texts.
        time: (n) [s]; empty where it is not known.
    """

    columns: dict[str, Floats] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)
    time: Floats = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Relation:
    """A straight line through the values of two columns.

    Attributes:
        slope: of the second over the first [1 if their units are the same].
        correlation: -1 to 1.
        lag: [s] by which the second is later.
    """

    slope: float
    correlation: float
    lag: float = 0.0


def sample_log(log: Log) -> dict[str, Sample]:
    """The first rows of every stream of a log.

    Raises:
        InputError: it is damaged, or has no two rows.
    """
    parts = {s.name: {c: list[Floats]() for c in s.columns} for s in log.streams}
    rows, cells = dict.fromkeys(parts, 0), 0
    wanted = {s.name: list(s.columns) for s in log.streams}
    samples = {name: Sample() for name in parts}
    for name, piece in log.read(wanted):
        for column, values in piece.items():
            if values.dtype.kind == "O":
                if column not in samples[name].texts:
                    samples[name].texts.append(column)
                continue
            room = _MAX_ROWS - rows[name]
            numbers = np.array(values[:room], dtype=float)
            numbers[np.abs(numbers) > _LARGEST] = np.nan
            parts[name][column].append(numbers)
            cells += len(values)
        rows[name] += len(next(iter(piece.values()), ()))
        if cells > _MAX_CELLS or min(rows.values()) >= _MAX_ROWS:
            break
    check_rows(log.path, max(rows.values(), default=0))
    for name, sample in samples.items():
        for column, pieces in parts[name].items():
            if column not in sample.texts:
                sample.columns[column] = np.concatenate([np.empty(0), *pieces])
    return samples


def fit_line(x: Floats, y: Floats) -> Relation:
    """The line of y (n) over x (n), both with their means taken off."""
    valid = np.isfinite(x) & np.isfinite(y)
    if valid.sum() < 8:
        return Relation(0.0, 0.0)
    x, y = x[valid] - x[valid].mean(), y[valid] - y[valid].mean()
    spread = float(np.sqrt((x @ x) * (y @ y)))
    if not spread > 0:
        return Relation(0.0, 0.0)
    return Relation(float(x @ y / (x @ x)), float(x @ y) / spread)


def compare_speed(time: Floats, position: Floats, speed: Floats) -> Relation:
    """How a column of speeds fits the change of a column of positions.

    Args:
        time: (n) [s] increasing.
        position: (n) [rad], or any unit.
        speed: (n) [rad/s], or any unit.

    Returns:
        The line of the change of position over the integral of the speed, in windows.
    """
    valid = np.isfinite(time) & np.isfinite(position) & np.isfinite(speed)
    time, position, speed = time[valid], position[valid], speed[valid]
    if time.size < 8:
        return Relation(0.0, 0.0)
    steps = np.diff(time) * (speed[1:] + speed[:-1]) / 2
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    ends = np.searchsorted(time, time + _WINDOW)
    rows = np.flatnonzero(ends < time.size)
    ends = ends[rows]
    whole = time[ends] - time[rows] < 3 * _WINDOW  # no gap
    rows, ends = rows[whole], ends[whole]
    return fit_line(distance[ends] - distance[rows], position[ends] - position[rows])


def compare_command(
    command: tuple[Floats, Floats], position: tuple[Floats, Floats]
) -> Relation:
    """How a position follows a command.

    Args:
        command: (n) [s] and (n) in any unit; held from row to row.
        position: (N) [s] and (N) in any unit.

    Returns:
        The line of the position over the command at the lag that fits best.
    """
    (ct, c), (pt, p) = _drop_missing(*command), _drop_missing(*position)
    if min(ct.size, pt.size) < 8:
        return Relation(0.0, 0.0)
    start, end = max(ct[0], pt[0]), min(ct[-1], pt[-1])
    if not end - start > _WINDOW:
        return Relation(0.0, 0.0)
    grid = np.linspace(start, end, _GRID)
    held = c[np.searchsorted(ct, grid, side="right") - 1]

    def fit(step: int) -> Relation:
        lag = step * _LAG_STEP
        count = np.searchsorted(grid, end - lag, side="right")
        line = fit_line(held[:count], np.interp(grid[:count] + lag, pt, p))
        return replace(line, lag=lag)

    steps = int(np.ceil(min(_MAX_LAG, (end - start) / 4) / _LAG_STEP))
    found = max(map(fit, range(0, steps, _COARSE)), key=_get_strength)
    middle = round(found.lag / _LAG_STEP)
    near = range(max(middle - _COARSE + 1, 0), min(middle + _COARSE, steps))
    return max([found, *map(fit, near)], key=_get_strength)


def _get_strength(relation: Relation) -> float:
    return abs(relation.correlation)


def _drop_missing(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    valid = np.isfinite(time) & np.isfinite(values)
    return time[valid], values[valid]


def measure_share_inside(values: Floats, low: float, high: float) -> float:
    """Share of values within a range, a twentieth of it allowed on either side.

    Args:
        values: (n) [any unit].
        low: end of the range, -inf if it has none [the same].
        high: its other end [the same].
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0
    slack = 0.05 * (high - low) if np.isfinite(high - low) else 0.0
    return float(((finite >= low - slack) & (finite <= high + slack)).mean())


def find_zero_rows(values: Floats) -> NDArray[np.bool_]:
    """Rows of zeros among readings: of a second publisher, or of a bus that was lost.

    There all columns are 0 at once, and jump there and back as no motion does.

    Args:
        values: (n, d) positions of one kind, NaN where nothing was read.

    Returns:
        (n) whether a row is such a one; none is where rows of zeros are a motion.
    """
    read = np.flatnonzero(np.isfinite(values).all(axis=1))
    is_zero = (values[read] == 0).all(axis=1)
    found, rows = np.zeros(len(values), bool), values[read[~is_zero]]
    if not is_zero.any() or len(rows) < 8:
        return found
    usual = np.quantile(np.abs(np.diff(rows, axis=0)), _QUANTILE, axis=0)
    is_far = np.abs(rows) > _JUMP * usual + 1e-12
    before = np.cumsum(~is_zero)[is_zero] - 1  # the row that was read before each
    sides = [is_far[np.clip(k, 0, len(rows) - 1)] for k in (before, before + 1)]
    jumps = (sides[0] & sides[1]).any(axis=1)
    if jumps.mean() > 0.5:
        found[read[is_zero]] = True
    return found


def find_step(values: Floats) -> float:
    """The step of an encoder in a column (n); 0 if it has none, or one of rounding."""
    levels = np.unique(np.round(values[np.isfinite(values)], 5))
    steps = np.diff(levels[1:-1])  # the ends may be where a column is clipped
    if steps.size < _STEPS:
        return 0.0
    step = float(steps.min())
    whole = steps[steps < 20 * step] / step
    if (
        step < 1e-3
        or whole.size < _STEPS
        or np.abs(whole - np.round(whole)).max() > 0.1
    ):
        return 0.0
    is_rounding = abs(np.log10(step) - round(np.log10(step))) < 1e-3
    return 0.0 if is_rounding else float(np.mean(steps / np.round(steps / step)))
