"""Held-out pieces: recordings in; pieces with estimated initial states, and errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from selfheal.recording import Episode, Recording

HORIZONS = {"0.5 s": 0.5, "2 s": 2.0, "whole": np.inf}  # [s] of the pieces
CALM = 0.3  # [s] in which the next piece may begin, where commands change least
BEFORE = 0.06  # [s] of earlier commands that no replay of a piece knows
WINDOW = 0.05  # [s] to either side, from which an initial state is estimated
LEAST = 4  # samples to either side, where 0.05 s hold fewer
WORST = 10.0  # standard deviations; an error beyond, or a diverged one, counts as this


@dataclass(frozen=True)
class Piece:
    """A stretch of an episode that is predicted open loop.

    Attributes:
        time: (T) [s], from 0.
        ctrl: (T, nu) commands.
        seen: (T, n) [rad or m] readings of the joints' positions.
        qpos: (n) [rad or m] estimated at time 0.
        qvel: (n) [rad/s or m/s] estimated at time 0.
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


def read_joints(episode: Episode, joints: Sequence[str], kind: str):
    """Readings (T, n) of joints, NaN where there is no such signal.

    Args:
        episode: with the signals.
        joints: their names.
        kind: of the contract.
    """
    found = np.full((len(episode.time), len(joints)), np.nan)
    for signal in episode.signals.values():
        if signal.kind == kind:
            found[:, joints.index(signal.target)] = signal.values
    return found


def estimate_state(
    time: np.ndarray, position: np.ndarray, speed: np.ndarray, at: int
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities at a sample: a cubic through the readings around it.

    Args:
        time: (T) [s].
        position: (T, n) [rad or m].
        speed: (T, n) [rad/s or m/s], NaN where not measured.
        at: number of the sample.

    Returns:
        (n) [rad or m] and (n) [rad/s or m/s].
    """
    near = np.flatnonzero(np.abs(time - time[at]) <= WINDOW + 1e-9)
    low = min(near[0], max(at - LEAST, 0))
    high = max(near[-1], min(at + LEAST, len(time) - 1)) + 1
    t = time[low:high] - time[at]
    powers = np.arange(4)
    rows = t[:, None] ** powers
    slopes = powers * t[:, None] ** np.maximum(powers - 1, 0)
    states = []
    for q, v in zip(position[low:high].T, speed[low:high].T, strict=True):
        fit = np.linalg.lstsq(rows, q, rcond=None)[0]
        if np.isfinite(v).all():
            # each kind of reading weighs as much as it scatters about its own cubic
            own = np.linalg.lstsq(rows, v, rcond=None)[0]
            a = 1 / max(np.std(q - rows @ fit), 1e-9)
            b = 1 / max(np.std(v - rows @ own), 1e-9)
            both = np.concatenate([a * rows, b * slopes])
            fit = np.linalg.lstsq(both, np.concatenate([a * q, b * v]), rcond=None)[0]
        states.append(fit[:2])
    qpos, qvel = np.array(states).T
    return qpos, qvel


def cut_pieces(
    recording: Recording, joints: Sequence[str], seconds: float
) -> list[Piece]:
    """Pieces of episodes, each beginning where commands have just been calm.

    What was commanded before a piece is not known to a replay; a piece begins where
    that matters least. An episode's first state is the stated one where there is one.

    Args:
        recording: that is cut.
        joints: names of the model's joints.
        seconds: [s] of a piece; infinite: whole episodes.
    """
    return [
        piece
        for episode in recording.episodes.values()
        for piece in _cut_episode(episode, joints, seconds)
    ]


def choose_evenly(pieces: Sequence[Piece], count: int) -> list[Piece]:
    """At most `count` of the pieces, evenly drawn."""
    chosen = np.unique(np.linspace(0, len(pieces) - 1, count).astype(int))
    return [pieces[i] for i in chosen]


def _cut_episode(episode: Episode, joints: Sequence[str], seconds: float):
    time, start = episode.time, 0
    position = read_joints(episode, joints, "joint_position")
    speed = read_joints(episode, joints, "joint_velocity")
    length = min(seconds, time[-1] - time[0])
    while time[start] + length <= time[-1] + 1e-9:
        rows = slice(start, int(np.searchsorted(time, time[start] + length + 1e-9)))
        if start == 0 and episode.qpos0 is not None and episode.qvel0 is not None:
            qpos, qvel = episode.qpos0, episode.qvel0
        else:
            qpos, qvel = estimate_state(time, position, speed, start)
        yield Piece(
            time[rows] - time[start], episode.ctrl[rows], position[rows], qpos, qvel,
            episode, start,
        )  # fmt: skip
        later = range(rows.stop, int(np.searchsorted(time, time[rows.stop - 1] + CALM)))
        if not later:
            return
        start = min(later, key=lambda k: _measure_change(episode, k))


def _measure_change(episode: Episode, at: int) -> float:
    """How much the commands moved just before a sample, over their spread."""
    first = int(np.searchsorted(episode.time, episode.time[at] - BEFORE))
    spread = episode.ctrl.std(0) + 1e-12
    moved = np.abs(episode.ctrl[first : at + 1] - episode.ctrl[at]) / spread
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


def measure_spread(recording: Recording, joints: Sequence[str]) -> np.ndarray:
    """Standard deviations (n) [rad or m] of the readings of joints' positions."""
    seen = [
        read_joints(e, joints, "joint_position") for e in recording.episodes.values()
    ]
    return np.nanstd(np.concatenate(seen), axis=0)


def cut_all_horizons(
    recording: Recording, joints: Sequence[str]
) -> Mapping[str, list[Piece]]:
    """The pieces of each of the `HORIZONS`."""
    return {name: cut_pieces(recording, joints, s) for name, s in HORIZONS.items()}
