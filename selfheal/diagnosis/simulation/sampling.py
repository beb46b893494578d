"""Samples: takes true signals on a grid of steps, gives readings at sample times."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...recording import find_controls, find_output
from ...recording.actuator_laws import list_control_gains
from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.commands import CommandGrid
from ..effects.places import ControlsPlace
from ..effects.protocols import CommandFilter
from .batch import Hypotheses
from .commands import compute_commands
from .system import RecordedSystem

if TYPE_CHECKING:
    from mujoco import MjModel

# [steps] by which times differ that are the same; chosen: far above the rounding of a
# time of hours, far below a step
SAMPLE_TIME_TOLERANCE = 1e-6
MIN_READING_STEP = 1e-12  # [unit] of a rounded reading; chosen: against division by 0


def find_sampled_steps(
    segments: Segments,
    reading_changes: Mapping[str, Mapping[str, Floats]],
    *,
    step: float,
) -> np.ndarray:
    """Steps (K) of segments beside which a sample lies, under any hypothesis.

    Args:
        reading_changes: as `Hypotheses` has them; their delays (n) shift the samples.
        step: of the simulation [s].
    """
    delays = [c["delay"] for c in reading_changes.values() if "delay" in c]
    late = np.unique(np.concatenate([np.zeros(1), *delays])) / step
    low = np.floor(
        np.unique(segments.sample_steps) - late[:, None] + SAMPLE_TIME_TOLERANCE
    ).astype(int)
    last = int(segments.lengths.max()) + 1
    return np.unique(np.clip([low, low + 1], 0, last))


def sample_signals(
    system: RecordedSystem,
    predicted: Floats,
    hypotheses: Hypotheses,
    segments: Segments,
    commands: Floats,
) -> Floats:
    """Signals at the samples' times, as the sensors would read them.

    A sensor reads y = gain s(t - delay) + bias of a true signal s, rounded to a
    multiple of its step where a hypothesis says so.

    Args:
        predicted: (n, W, K, C) true signals at each step [each channel's unit].
        segments: W of them, with M samples.
        commands: (n, W, K, nu) that were used [each control's unit].

    Returns:
        (n, M, C) readings [each channel's unit].
    """
    out = np.empty((len(predicted), len(segments.sample_steps), predicted.shape[-1]))
    for c in system.channels:
        change = hypotheses.reading_changes.get(c.name, {})
        delay = change.get("delay", np.zeros(1))[:, None] / system.timestep
        at = segments.sample_steps[None] - delay
        value = _interpolate(predicted[..., c.columns], segments, at)
        if c.kind == "body_orientation" and "delay" in change:
            value /= np.linalg.norm(value, axis=-1, keepdims=True)
        if c.kind == "joint_torque":
            model = hypotheses.models[0]
            a = model.actuator(c.target).id
            if not (model.actuator_dyntype[a] or model.actuator_delay[a]):
                controls = find_controls(model, a)
                used = _interpolate(commands[..., controls], segments, at)
                sent = _find_commands(system, hypotheses, segments, at, controls)
                _correct_torques(value[..., 0], hypotheses.models, a, sent - used)
        gain = change.get("gain", np.ones(1))[:, None, None]
        bias = change.get("bias", np.zeros((1, 1)))[:, None]
        value = gain * value + bias
        if "step" in change:
            step = np.maximum(change["step"], MIN_READING_STEP)[:, None, None]
            value = step * np.round(value / step)
        out[:, :, c.columns] = value
    return out


def _correct_torques(
    torque: Floats, models: Sequence["MjModel"], a: int, change: Floats
) -> None:
    """Change torques, in place, to those of the commands that hold at the samples.

    The simulation used the mean command of each step, or of half a step earlier.

    Args:
        torque: (n, M) of an actuator [N m or N]; changed.
        models: (n) of the hypotheses.
        a: id of the actuator.
        change: (n, M, c) of its controls, from the commands that were used.
    """
    out = find_output(models[0], a)
    for i, model in enumerate(models):
        gear = float(model.actuator_gear[out, 0])
        gains = gear * list_control_gains(model, a)
        torque[i] += (gains * change[i]).sum(axis=-1)
        if model.actuator_forcelimited[a]:
            low, high = np.sort(gear * model.actuator_forcerange[a])
            torque[i] = np.clip(torque[i], low, high)


def _find_commands(
    system: RecordedSystem,
    hypotheses: Hypotheses,
    segments: Segments,
    at: Floats,
    controls: Sequence[int],
) -> Floats:
    """Commands (1 or n, M, c) of controls that reach the actuators at the samples.

    Args:
        at: (1 or n, M) time of each sample in its segment [steps].
    """
    filtered = {
        control
        for term in hypotheses.terms
        for place in term.places
        if isinstance(place, ControlsPlace) and isinstance(term.effect, CommandFilter)
        for control in place.controls
    }
    if filtered.isdisjoint(controls):
        return _find_sent_commands(system, segments, at, controls)
    grid = CommandGrid(system.timestep)
    reaching = compute_commands(system, hypotheses, segments, grid)
    reaching = reaching.reshape(-1, len(segments), *reaching.shape[1:])
    return _interpolate(reaching[..., controls], segments, at)


def _find_sent_commands(
    system: RecordedSystem, segments: Segments, at: Floats, controls: Sequence[int]
) -> Floats:
    """Commands (1 or n, M, c) of controls that were sent last before the samples.

    Args:
        at: (1 or n, M) time of each sample in its segment [steps].
    """
    out = np.empty((*at.shape, len(controls)))
    for i, episode in enumerate(system.episodes):
        rows = np.flatnonzero(segments.episode[segments.segment_of_sample] == i)
        times = (
            segments.first_step[segments.segment_of_sample[rows]]
            + at[:, rows]
            + SAMPLE_TIME_TOLERANCE
        )
        k = np.searchsorted(episode.sample_steps, times, side="right") - 1
        out[:, rows] = episode.sent_ctrl[np.maximum(k, 0)][..., controls]
    return out


def _interpolate(grid: Floats, segments: Segments, at: Floats) -> Floats:
    """Interpolate between steps, linearly.

    Args:
        grid: (n, W, K, c) values at each step.
        segments: W of them, with M samples.
        at: (1 or n, M) time of each sample in its segment [steps].

    Returns:
        (n, M, c) values at the samples.
    """
    low = np.clip(np.floor(at).astype(int), 0, grid.shape[2] - 2)
    share = (at - low)[..., None]
    rows = np.arange(len(grid))[:, None]
    before, after = (
        grid[rows, segments.segment_of_sample[None], low + i] for i in (0, 1)
    )
    return before + share * (after - before)
