"""Watching a recording: a body and a recording in, when they stopped fitting out."""

from dataclasses import asdict

import numpy as np

from ..body.body import Anatomy, Bodies, Floats
from ..engine.plant import build_rated_plant
from ..engine.walk import (
    PERIOD,
    SAMPLE,
    compute_channels,
    list_channels,
    simulate_walks,
)
from ..errors import InputError
from ..recording import Episode, Recording, find_single_columns
from ..robot.read_channels import read_channels
from .monitor import (
    QUARTERS,
    PoseReadings,
    learn_baseline,
    watch_poses,
    watch_walk,
)
from .phased_run import Document
from .probes import REST_SCALES, Probe, approximate_values, classify_channels

_LEAST = 3  # cycles to learn from, at least
_PRESENT = 0.5  # share of a signal's samples without which it is not looked at; chosen


def watch_recording(
    body: Bodies,
    recording: Recording,
    *,
    learn: float | None = None,
    cycle: float | None = None,
) -> list[Document]:
    """When each episode of a recording stopped fitting a body.

    An episode over time is learned from at its start, where the robot is taken for
    whole, and watched after it. Episodes that hold one reading at rest each are
    watched in their order, as one.

    Args:
        recording: signals as `robot.base.Walker` names them.
        learn: [s] at the start of each episode; None = a third of it.
        cycle: [s] in which the commands repeat; None = found in them.

    Returns:
        For each: `id`, `alarm` (time, since, sensor, p_value or None), and how it was
        watched.

    Raises:
        InputError: nothing that can be compared, or too short.
    """
    moving = {k: e for k, e in recording.episodes.items() if not _is_at_rest(e)}
    found = [_watch_episode(body, recording, k, learn, cycle) for k in moving]
    resting = [k for k in recording.episodes if k not in moving]
    if resting:
        found.append(_watch_rest_episodes(body, recording, resting))
    return found


def _is_at_rest(episode: Episode) -> bool:
    """Whether an episode has readings at its last sample only."""
    signals = episode.signals.values()
    return all(np.isnan(s.values[:-1].astype(float)).all() for s in signals)


def _resample_commands(episode: Episode, anatomy: Anatomy, where: str) -> Floats:
    """(T, P) [rad] the commands at every `PERIOD` from the episode's beginning.

    Raises:
        RecordingError: a servo of the body has no command.
    """
    columns = _find_servo_columns(episode, anatomy, where)
    begin, held = _find_begin(episode), round(SAMPLE / PERIOD)
    rows = round((episode.time[-1] - begin) / SAMPLE) * held
    middle = begin + (np.arange(rows) + 0.5) * PERIOD
    row = np.searchsorted(episode.time, middle, side="right") - 1
    return episode.ctrl[np.maximum(row, 0)][:, columns]


def _find_begin(episode: Episode) -> float:
    """When an episode begins [s]: one step before its first sample."""
    return float(2 * episode.time[0] - episode.time[1])


def _resample_channel(grid: Floats, time: Floats, column: Floats) -> Floats:
    """A channel on a grid of times; NaN where most samples of it are missing."""
    known = np.isfinite(column)
    if known.mean() < _PRESENT:
        return np.full(len(grid), np.nan)
    return np.interp(grid, time[known], column[known])


def _find_servo_columns(episode: Episode, anatomy: Anatomy, where: str) -> list[int]:
    """(P) columns of the commands; errors as `find_single_columns`."""
    servos = [f"{joint}_servo" for joint in anatomy.joints]
    return find_single_columns(episode.ctrl_names, servos, where)


def _watch_episode(
    body: Bodies,
    recording: Recording,
    name: str,
    learn: float | None,
    cycle: float | None,
) -> Document:
    """One episode over time."""
    episode, where = recording.episodes[name], f"{recording.file}, episode {name!r}"
    commands = _resample_commands(episode, body.anatomy, where)
    time, measured = read_channels(recording, body.anatomy, name)
    begin = _find_begin(episode)
    grid = np.arange(1, round((time[-1] - begin) / SAMPLE) + 1) * SAMPLE
    columns = [_resample_channel(begin + grid, time, c) for c in measured.T]
    now = np.stack(columns, axis=1)
    plants = [build_rated_plant(body)]
    predicted = compute_channels(simulate_walks(plants, commands[None]), plants)[0]
    blind = np.isnan(now).any(axis=0)
    now[:, blind] = predicted[:, blind] = 0.0
    period = cycle or _find_period(commands)
    seconds = grid[-1] / 3 if learn is None else learn
    rows = round(seconds / SAMPLE)
    if seconds < (_LEAST + 2) * period or rows >= len(grid) - QUARTERS:
        raise InputError(
            f"{where}: {grid[-1]:.1f} s, of which {seconds:.1f} s to learn from; it "
            f"takes {(_LEAST + 2) * period:.1f} s ({_LEAST + 2} cycles of "
            f"{period:.1f} s) and more to watch"
        )
    channels = list_channels(body.anatomy)
    known = learn_baseline(now[:rows], predicted[:rows], period, channels)
    seen = watch_walk(now, predicted, known, channels, after=seconds)
    alarm = seen.alarm and asdict(seen.alarm)
    if alarm:
        alarm |= {key: alarm[key] + begin for key in ("time", "since")}
    return {
        "id": name,
        "alarm": alarm,
        "learned": float(seconds),
        "watched": float(grid[-1] - seconds),
        "cycle": float(period),
    }


def _find_period(commands: Floats) -> float:
    """Seconds in which commands repeat best, of 0.5 s to 6 s; 1 s if they do not."""
    lags = np.arange(round(0.5 / PERIOD), min(round(6 / PERIOD), len(commands) // 2))
    late = commands[len(commands) // 10 :]  # the start is another
    spread = late.std(axis=0).sum()
    if not len(lags) or spread == 0:
        return 1.0
    gap = np.array([np.abs(late[k:] - late[:-k]).mean(axis=0).sum() for k in lags])
    # the first lag that is nearly as good as the best: not a multiple of it
    good = np.flatnonzero(gap < gap.min() + 0.1 * spread)
    first = good[: 1 + int(np.argmax(np.diff([*good, 10**9]) > 1))]
    best = int(first[np.argmin(gap[first])])
    return float(lags[best] * PERIOD) if gap[best] < 0.3 * spread else 1.0


def _watch_rest_episodes(
    body: Bodies, recording: Recording, names: list[str]
) -> Document:
    """Episodes of one reading at rest each."""
    anatomy = body.anatomy
    channels, plants = list_channels(anatomy), [build_rated_plant(body)]
    measured, expected = [], []
    for name in names:
        where = f"{recording.file}, episode {name!r}"
        episode = recording.episodes[name]
        measured.append(read_channels(recording, anatomy, name)[1][-1, :-2])
        target = episode.ctrl[-1, _find_servo_columns(episode, anatomy, where)]
        guessed = approximate_values(plants, Probe("", target[None], target))[0]
        expected.append(guessed[anatomy.size :])
    scale = np.array([REST_SCALES[k] for k in classify_channels(channels.names)[:-2]])
    readings = PoseReadings(np.array(measured), np.array(expected), scale)
    alarm = watch_poses(readings, channels)
    at = None if alarm is None else names[round(alarm.time) - 1]
    return {
        "id": f"{names[0]} to {names[-1]}",
        "alarm": alarm and asdict(alarm),
        "episode": at,
        "watched": len(names),
    }
