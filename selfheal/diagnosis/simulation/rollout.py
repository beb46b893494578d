"""Rollouts: takes models, initial states and commands, gives true signals."""

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.protocols import JointForce
from .batch import (
    BatchState,
    Hypotheses,
    allow_divergence,
    find_diverged,
    make_batch,
    restore_whole_steps,
    shift_velocity_back,
)
from .sensors import SensorReader
from .stepwise import run_stepwise


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
    if any(isinstance(t.effect, JointForce) for t in hypotheses.terms):
        return run_stepwise(
            hypotheses, segments, initial, commands, sensors, sampled_steps
        )
    return _run_rollout(hypotheses, initial, commands, sensors, sampled_steps)


@allow_divergence()
def _run_rollout(
    hypotheses: Hypotheses,
    initial: BatchState,
    commands: Floats,
    sensors: SensorReader,
    sampled_steps: np.ndarray,
) -> Floats:
    """Simulate without Python in between; arguments as of `simulate_batch`."""
    variant = hypotheses.variant
    steps = commands.shape[1]
    batch = make_batch(hypotheses, initial)
    fields = sorted({"qpos", "qvel", *sensors.needs})
    first_velocity = initial.qvel
    if hypotheses.centered:
        batch.rollout(1, commands[:, :1] if variant.model.nu else None, record=["qvel"])
        first_velocity = shift_velocity_back(batch, initial)
    recorded = batch.rollout(
        steps, commands if variant.model.nu else None, record=fields
    )
    # a step leaves position and velocity after it, and all else as before it
    for name, first in (("qpos", initial.qpos), ("qvel", first_velocity)):
        recorded[name] = np.concatenate(
            [first[:, None], recorded[name][:, :-1]], axis=1
        )
    if hypotheses.centered:
        by_step = {name: values.swapaxes(0, 1) for name, values in recorded.items()}
        restore_whole_steps(
            batch, by_step, commands.swapaxes(0, 1), sensors, sampled_steps
        )
    predicted = sensors.read_all(recorded)
    predicted[find_diverged(batch)] = np.nan
    return predicted
