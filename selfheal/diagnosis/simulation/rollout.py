"""Rollouts: takes models, initial states and commands, gives true signals."""

from typing import TYPE_CHECKING

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from .batch import (
    BatchState,
    Hypotheses,
    allow_divergence,
    find_diverged,
    make_batch,
    restore_whole_steps,
    set_commands,
    shift_velocity_back,
)
from .sensors import SensorReader
from .stepwise import EffectForces, list_actions

if TYPE_CHECKING:
    from mujoco.batch import Batch

BEFORE_STEP = ("qpos", "qvel")  # what a step leaves as after it; all else is before it


@allow_divergence()
def simulate_batch(
    hypotheses: Hypotheses,
    segments: Segments,
    initial: BatchState,
    commands: Floats,
    sensors: SensorReader,
    sampled_steps: np.ndarray,
) -> Floats:
    """Simulate N = n W rollouts, of n hypotheses in W segments.

    Args:
        commands: (N, K, nu), as they reach the actuators at K steps.
        sampled_steps: (S) those whose readings matter.

    Returns:
        (N, K, C) true signals at each step [each channel's unit]; NaN in a simulation
        that diverged.
    """
    actions, grid = list_actions(hypotheses, len(segments)), hypotheses.grid
    batch = make_batch(hypotheses, initial)
    forces = None
    if actions:
        begin = np.tile(segments.first_step * grid.step, len(hypotheses.models))
        errors = initial.integral_errors
        forces = EffectForces(batch, actions, errors, begin, grid.step)
    first = {"qpos": initial.qpos, "qvel": initial.qvel}
    if grid.is_centered:
        ctrl = set_commands(batch, commands[:, 0])
        if forces:
            forces.apply(ctrl, 0)
        batch.step()
        first["qvel"] = shift_velocity_back(batch, initial)
        if forces:
            forces.reset_integral_errors()
    fields = sorted({*BEFORE_STEP, *sensors.needs})
    if forces:
        recorded = _step(batch, forces, commands, fields)
    else:
        sent = commands if commands.shape[-1] else None
        found = batch.rollout(commands.shape[1], sent, record=fields)
        recorded = {name: values.swapaxes(0, 1) for name, values in found.items()}
        for name in BEFORE_STEP:
            recorded[name] = np.concatenate([first[name][None], recorded[name][:-1]])
    if grid.is_centered:
        restore_whole_steps(batch, recorded, commands, sensors, sampled_steps)
    predicted = sensors.read_all(recorded)
    predicted[:, find_diverged(batch)] = np.nan
    return predicted.swapaxes(0, 1)


def _step(
    batch: "Batch", forces: EffectForces, commands: Floats, fields: list[str]
) -> dict[str, Floats]:
    """Simulate step by step, and let effects act before each.

    Args:
        batch: of B simulations, in their initial states.
        commands: (B, K, nu).
        fields: to be recorded.

    Returns:
        (K, B, ...) of each field, at each step.
    """
    bound = {name: batch.bind(name) for name in fields}
    ctrl = set_commands(batch, commands[:, 0])
    steps = range(commands.shape[1])
    recorded = {k: np.empty((len(steps), *v.shape), v.dtype) for k, v in bound.items()}
    for k in steps:
        ctrl[:] = commands[:, k]
        for name in BEFORE_STEP:
            recorded[name][k] = bound[name]
        forces.apply(ctrl, k)
        batch.step()
        for name in fields:
            if name not in BEFORE_STEP:
                recorded[name][k] = bound[name]
    return recorded
