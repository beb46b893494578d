"""Monitor: predicted and sensed in, when they stopped fitting and which sensor says so.

Windows of a quarter of a gait's cycle. A channel's residual (sensed less predicted) is
compared with what it was, at the same quarter, while the robot was known to be whole.
Each channel has a CUSUM (Page 1954) of the log likelihood ratio of "as before" against
"six times as wide", which sees a sensor that is far off. One more sums the misfit of
all channels, against "two spreads more than before"; it sees many that are a bit off.
And one for each channel counts windows in which it stands perfectly still, against
"always", which sees a dead sensor. By Lorden (1971) such a sum passes h by chance at
most once in exp(h) windows, which sets h from the nominal rate of false alarms.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..body.body import Floats
from ..engine.walk import SAMPLE, Channels
from .belief import DEGREES_OF_FREEDOM, compute_log_t
from .probes import classify_channels

QUARTERS = 4  # windows a cycle
FALSE_ALARMS = 1.0  # an hour, nominal; chosen
_FALSE_POSES = 0.05  # chance of a false alarm in a series of poses; chosen
_WIDE = 6.0  # of the alternative; chosen
_SHIFT, _MOST = 2.0, 4.0  # of the common misfit's alternative, and of a window; chosen
# Chosen on development seeds, for no false alarm in 0.9 hours: seconds in which a walk
# from rest becomes regular; how much wider the spread is taken than it was seen, for
# windows that follow each other are alike.
_START, _INFLATE = 6.0, 2.5
# Chosen: no spread is taken for less [deg, mm, mm a window, 1].
_LEAST = {"tilt": 0.5, "angle": 0.5, "clearance": 3.0, "speed": 3.0, "touch": 0.08}


@dataclass(frozen=True)
class Alarm:
    """What the monitor says.

    Attributes:
        time: when it was raised [s].
        since: when the misfit seems to have begun [s].
        sensor: the signal that fits worst.
        p_value: chance that a whole robot raises this alarm or a clearer one by then.
    """

    time: float
    since: float
    sensor: str
    p_value: float


@dataclass(frozen=True)
class MonitorTrace:
    """What a monitor saw.

    Attributes:
        time: (W) end of each window [s].
        sums: (W, 2 C + 1) CUSUM of each channel's misfit, of each channel's standing
            still, of all together [nats].
        threshold: an alarm is raised when a sum passes it [nats].
        alarm: the first, or None.
    """

    time: Floats
    sums: Floats
    threshold: float
    alarm: Alarm | None


@dataclass(frozen=True)
class Baseline:
    """How residuals were while the robot was whole.

    Attributes:
        mean: (QUARTERS, C) and
        spread: (C) of the windows' residuals.
        still: (QUARTERS, C) cycles in which a channel stood still in this quarter, of
        cycles: so many.
        common: mean and spread of the misfit of all channels in a window.
        cycle: [s] of the gait.
    """

    mean: Floats
    spread: Floats
    still: Floats
    cycles: int
    common: tuple[float, float]
    cycle: float


def compute_window_means(sensed: Floats, cycle: float) -> Floats:
    """Mean of each channel in windows of a quarter cycle.

    The last two channels are a position [mm], which depends on the heading. In place of
    the first a window has the length of the way travelled in it, in place of the second
    zero.

    Args:
        sensed: (S, C) channels.
        cycle: of the gait [s].

    Returns:
        (W, C) means.
    """
    edges = _find_window_edges(len(sensed), cycle)
    rows = [sensed[a:b].mean(axis=0) for a, b in pairwise(edges)]
    out = np.array(rows).reshape(len(rows), sensed.shape[1])
    place = sensed[np.maximum(edges - 1, 0), -2:]
    way = np.linalg.norm(np.diff(place, axis=0), axis=1)
    out[:, -2], out[:, -1] = way[: len(out)], 0.0
    return out


def _find_window_edges(samples: int, cycle: float) -> np.ndarray:
    """Where windows begin and end, in samples; a cycle need not be whole samples."""
    count = int(np.floor(samples * SAMPLE / cycle * QUARTERS))
    return np.round(np.arange(count + 1) * cycle / QUARTERS / SAMPLE).astype(int)


def learn_baseline(
    sensed: Floats, predicted: Floats, cycle: float, channels: Channels
) -> Baseline:
    """How residuals are while the robot is whole.

    Args:
        sensed: (S, C), and
        predicted: (S, C) channels of a walk of several cycles.
        cycle: [s].
    """
    skip = _count_skipped_windows(cycle)
    measured = compute_window_means(sensed, cycle)
    gap = (measured - compute_window_means(predicted, cycle))[skip:]
    full = len(gap) // QUARTERS * QUARTERS
    folded = gap[:full].reshape(-1, QUARTERS, gap.shape[1])
    mean = folded.mean(axis=0)
    freedom = max(1, (len(folded) - 1) * QUARTERS)
    spread = np.sqrt(((folded - mean) ** 2).sum(axis=(0, 1)) / freedom)
    least = np.array([_LEAST[kind] for kind in classify_channels(channels.names)])
    # few cycles say little of the spread and of the mean
    spread = _INFLATE * np.maximum(spread, least) * np.sqrt(1 + 1 / len(folded))
    # each cycle against the others, as a new one will be against all
    n = len(folded)
    apart = (folded - mean) * (n / max(1, n - 1)) / spread
    misfit = -compute_log_t(apart).sum(axis=2).ravel()
    common = float(misfit.mean()), float(_INFLATE * max(misfit.std(), 0.5))
    calm = _find_still_windows(sensed, cycle)[skip:][:full].reshape(folded.shape)
    return Baseline(mean, spread, calm.sum(axis=0), n, common, cycle)


def _find_still_windows(sensed: Floats, cycle: float) -> np.ndarray:
    """(W, C) whether a channel has one and the same value in a window."""
    edges = _find_window_edges(len(sensed), cycle)
    return np.array([np.ptp(sensed[a:b], axis=0) == 0 for a, b in pairwise(edges)])


def _score_stillness(still: np.ndarray, known: Baseline) -> Floats:
    """(W, C) [nats] how unlikely it is that a channel of a whole robot stands still.

    Of a channel that changes in every window, as a noisy one does, each window counts.
    Of another only the quarter of each cycle in which it changes most often does: a
    foot that does not lift once is still in several quarters. The learned windows are
    few, so those in which it stood still just before count as learned too (the
    predictive of Jeffreys' prior): the second is less of a surprise than the first.

    Args:
        still: (W, C) of windows that begin at a cycle's first quarter.

    Returns:
        0 where a window does not count, -inf where a channel does not stand still.
    """
    noisy, quarter = known.still.max(axis=0) == 0, known.still.argmin(axis=0)
    before = known.still.min(axis=0)
    of = known.cycles * np.where(noisy, QUARTERS, 1)
    out, lately = np.where(still, 0.0, -np.inf), np.zeros(still.shape[1])
    for k, now in enumerate(still):
        counts = now & (noisy | (quarter == k % QUARTERS))
        rare = np.log((of + lately + 1) / (before + lately + 0.5))
        out[k, counts] = rare[counts]
        lately = np.where(now, lately + counts, 0.0)
    return out


def _count_skipped_windows(cycle: float, start: float = _START) -> int:
    """Windows at the start that are not looked at, whole cycles: it gets going."""
    return QUARTERS * int(np.ceil(start / cycle))


def compute_threshold(cycle: float, channels: Channels) -> float:
    """[nats] that keeps false alarms at the nominal rate, all channels together."""
    windows = 3600 / (cycle / QUARTERS)
    return float(np.log(windows * (2 * len(channels.names) + 1) / FALSE_ALARMS))


@dataclass(frozen=True)
class PoseReadings:
    """Poses at rest, one after the other.

    Attributes:
        measured: (W, C) channels without the place; NaN = not read.
        predicted: (W, C).
        scale: (C) by which a right prediction is off.
    """

    measured: Floats
    predicted: Floats
    scale: Floats


def watch_poses(readings: PoseReadings, channels: Channels) -> Alarm | None:
    """Watch poses of which none was learned from: the alarm, its time in poses.

    A pose falls to another rest or it does not, so one reading can be enough: each is
    tested by itself, with Bonferroni's correction for all readings of the series.
    """
    from scipy.stats import t

    z = np.abs(readings.measured - readings.predicted) / readings.scale
    read = int((~np.isnan(z)).sum())
    chance = read * 2 * t.sf(np.nan_to_num(z), DEGREES_OF_FREEDOM)
    over = np.flatnonzero((chance < _FALSE_POSES).any(axis=1))
    if not len(over):
        return None
    worst = int(np.argmin(chance[over[0]]))
    sensor, p_value = channels.sensors[worst], float(chance[over[0], worst])
    return Alarm(float(over[0]) + 1, float(over[0]), sensor, p_value)


def watch_walk(
    sensed: Floats,
    predicted: Floats,
    known: Baseline,
    channels: Channels,
    after: float = 0.0,
) -> MonitorTrace:
    """Watch a walk that began at rest as the baseline's did.

    Args:
        sensed: (S, C), and
        predicted: (S, C) channels.
        known: from a walk of the same gait.
        after: [s] before which nothing is looked at, the walk's start in any case.
    """
    skip = _count_skipped_windows(known.cycle, max(after, _START))
    measured = compute_window_means(sensed, known.cycle)
    gap = (measured - compute_window_means(predicted, known.cycle))[skip:]
    phase = np.arange(len(gap)) % QUARTERS
    z = (gap - known.mean[phase]) / known.spread
    each = compute_log_t(z / _WIDE) - np.log(_WIDE) - compute_log_t(z)
    middle, width = known.common
    common = np.minimum((-compute_log_t(z).sum(axis=1) - middle) / width, _MOST)
    dead = _score_stillness(_find_still_windows(sensed, known.cycle)[skip:], known)
    ratios = [each, dead, _SHIFT * common - _SHIFT**2 / 2]
    sums = _accumulate_cusum(np.column_stack(ratios))
    end = (np.arange(len(gap)) + 1 + skip) * known.cycle / QUARTERS
    limit, step = compute_threshold(known.cycle, channels), known.cycle / QUARTERS
    alarm = _find_alarm(end, sums, limit, channels, step, -compute_log_t(z))
    return MonitorTrace(end, sums, limit, alarm)


def _accumulate_cusum(ratio: Floats) -> Floats:
    """(W, K) sums of log likelihood ratios (W, K), never below 0 (Page 1954)."""
    sums, run = np.zeros_like(ratio), np.zeros(ratio.shape[1])
    for k, step in enumerate(ratio):
        run = np.maximum(0.0, run + step)
        sums[k] = run
    return sums


def _find_alarm(
    end: Floats,
    sums: Floats,
    limit: float,
    channels: Channels,
    step: float,
    misfit: Floats,
) -> Alarm | None:
    """The first time any sum (W, K) passes the threshold.

    Args:
        end: (W) end of each window, which is `step` long.
        sums: of the channels, and perhaps of all together.
        step: see `end`.
        misfit: (W, C) of each channel, to say which is worst.
    """
    over = np.flatnonzero((sums > limit).any(axis=1))
    if not len(over):
        return None
    at = over[0]
    highest = int(np.argmax(sums[at]))
    zero = np.flatnonzero(sums[:at, highest] == 0)
    first = int(zero[-1]) + 1 if len(zero) else 0
    worst = int(np.argmax(misfit[first : at + 1].sum(axis=0)))
    count = misfit.shape[1]
    sensor = channels.sensors[highest % count if highest < 2 * count else worst]
    chance = sums.shape[1] * (at + 1) * np.exp(-sums[at, highest])
    begun = end[first] - step
    return Alarm(float(end[at]), float(begun), sensor, float(min(1.0, chance)))
