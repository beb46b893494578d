"""Held-out pieces: recordings in; pieces with estimated initial states, and errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.drives.joint_reader import JointReader
from selfheal.recording import Episode, Recording

HORIZONS = {"0.5 s": 0.5, "2 s": 2.0, "whole": np.inf}  # [s] of the pieces
CALM = 0.3  # [s] in which the next piece may begin, where commands change least
BEFORE = 0.06  # [s] of earlier commands that no replay of a piece knows
AFTER = 0.04  # [s] of later commands, which should not jump where a state is read
WINDOWS = (0.04, 0.08, 0.16)  # [s] to either side, in which a cubic is fitted
LEAST = 2  # samples to either side, where a window holds fewer
FITS = 1.15  # times the scatter in the shortest window, that a longer one may have
WORST = 10.0  # standard deviations; an error beyond, or a diverged one, counts as this


@dataclass(frozen=True)
class Piece:
    """A stretch of an episode that is predicted open loop.

    Attributes:
        time: (T) [s], from 0.
        ctrl: (T, nu) commands.
        seen: (T, n) [rad or m] readings of the joints' positions.
        qpos: (nq) [rad or m] estimated at time 0.
        qvel: (nv) [rad/s or m/s] estimated at time 0.
        episode: it is a part of.
        first: number of its first sample there.
    """

    time: np.ndarray
    ctrl: np.ndarray
    seen: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    episode: Episode
    first: int


def estimate_state(
    time: np.ndarray, position: np.ndarray, speed: np.ndarray, at: int
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities at a sample: a cubic through the readings around it.

    Of each joint the longest of the `WINDOWS` in which a cubic fits as well as in the
    shortest one.

    Args:
        time: (T) [s].
        position: (T, n) [rad or m].
        speed: (T, n) [rad/s or m/s], NaN where not measured.
        at: number of the sample.

    Returns:
        (n) [rad or m] and (n) [rad/s or m/s].
    """
    states = []
    for q, v in zip(position.T, speed.T, strict=True):
        fits = [_fit_cubic(time, q, v, at, window) for window in WINDOWS]
        allowed = FITS * fits[0][1]
        states.append([fit for fit, scatter in fits if scatter <= allowed][-1][:2])
    qpos, qvel = np.array(states).T
    return qpos, qvel


def _fit_cubic(
    time: np.ndarray, position: np.ndarray, speed: np.ndarray, at: int, window: float
) -> tuple[np.ndarray, float]:
    """Coefficients (4) of a cubic about a sample, and the scatter about it.

    Args:
        time: (T) [s].
        position: (T) [rad or m].
        speed: (T) [rad/s or m/s], or NaN.
        at: number of the sample.
        window: [s] to either side.
    """
    near = np.flatnonzero(np.abs(time - time[at]) <= window + 1e-9)
    low = min(near[0], max(at - LEAST, 0))
    high = max(near[-1], min(at + LEAST, len(time) - 1)) + 1
    t, q, v = time[low:high] - time[at], position[low:high], speed[low:high]
    powers = np.arange(4)
    rows = t[:, None] ** powers
    fit = np.linalg.lstsq(rows, q, rcond=None)[0]
    scatter = _measure_scatter(q - rows @ fit)
    if np.isfinite(v).all():
        # each kind of reading weighs as much as it scatters about its own cubic
        slopes = powers * t[:, None] ** np.maximum(powers - 1, 0)
        own = _measure_scatter(v - rows @ np.linalg.lstsq(rows, v, rcond=None)[0])
        a, b = 1 / scatter, 1 / own
        both, seen = [a * rows, b * slopes], [a * q, b * v]
        fit = np.linalg.lstsq(np.concatenate(both), np.concatenate(seen), rcond=None)[0]
    return fit, scatter


def _measure_scatter(rest: np.ndarray) -> float:
    """Standard deviation of residuals (T) of a cubic, its coefficients counted."""
    return float(np.sqrt(np.sum(rest**2) / max(len(rest) - 4, 1))) + 1e-9


def cut_pieces(
    recording: Recording, reader: JointReader, seconds: float
) -> list[Piece]:
    """Pieces of episodes, each beginning where commands have just been calm.

    What was commanded before a piece is not known to a replay; a piece begins where
    that matters least. An episode's first state is the stated one where there is one.

    Args:
        recording: that is cut.
        reader: of the joints.
        seconds: [s] of a piece; infinite: whole episodes.
    """
    return [
        piece
        for episode in recording.episodes.values()
        for piece in _cut_episode(episode, reader, seconds)
    ]


def choose_evenly(pieces: Sequence[Piece], count: int) -> list[Piece]:
    """At most `count` of the pieces, evenly drawn."""
    chosen = np.unique(np.linspace(0, len(pieces) - 1, count).astype(int))
    return [pieces[i] for i in chosen]


def _cut_episode(episode: Episode, reader: JointReader, seconds: float):
    time, start = episode.time, 0
    position, speed = reader.read_positions(episode), reader.read_speeds(episode)
    length = min(seconds, time[-1] - time[0])
    while time[start] + length <= time[-1] + 1e-9:
        rows = slice(start, int(np.searchsorted(time, time[start] + length + 1e-9)))
        if start == 0 and episode.qpos0 is not None and episode.qvel0 is not None:
            qpos, qvel = episode.qpos0, episode.qvel0
        else:
            read = estimate_state(time, position, speed, start)
            qpos, qvel = reader.complete_state(*read)
        yield Piece(
            time[rows] - time[start], episode.ctrl[rows], position[rows], qpos, qvel,
            episode, start,
        )  # fmt: skip
        later = range(rows.stop, int(np.searchsorted(time, time[rows.stop - 1] + CALM)))
        if not later:
            return
        start = min(later, key=lambda k: _measure_change(episode, k))


def _measure_change(episode: Episode, at: int) -> float:
    """How much the commands moved just around a sample, over their spread."""
    now = episode.time[at]
    rows = slice(*np.searchsorted(episode.time, [now - BEFORE, now + AFTER]))
    spread = episode.ctrl.std(0) + 1e-12
    moved = np.abs(episode.ctrl[rows] - episode.ctrl[at]) / spread
    return float(moved.sum(1).max()) if episode.ctrl.size else 0.0


def compute_error(
    pieces: Sequence[Piece], predicted: Sequence[np.ndarray], spread: np.ndarray
) -> float:
    """Normalized RMSE over the joints' positions, as contract section 2 has it.

    Args:
        pieces: whose readings are predicted.
        predicted: (T, n) [rad or m] of each piece.
        spread: (n) [rad or m] standard deviation of the readings.
    """
    errors = [
        np.nan_to_num((p - piece.seen) / spread, nan=WORST, posinf=WORST, neginf=WORST)
        for piece, p in zip(pieces, predicted, strict=True)
    ]
    clipped = np.clip(np.concatenate(errors), -WORST, WORST)
    return float(np.sqrt(np.mean(clipped**2)))


def measure_spread(recording: Recording, reader: JointReader) -> np.ndarray:
    """Standard deviations (n) [rad or m] of the readings of joints' positions."""
    seen = [reader.read_positions(e) for e in recording.episodes.values()]
    return np.concatenate(seen).std(0)


def cut_all_horizons(
    recording: Recording, reader: JointReader
) -> Mapping[str, list[Piece]]:
    """The pieces of each of the `HORIZONS`."""
    return {name: cut_pieces(recording, reader, s) for name, s in HORIZONS.items()}
