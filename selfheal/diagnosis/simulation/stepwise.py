"""Rollouts step by step: takes effects that act at every step, gives true signals."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.places import Place
from ..effects.protocols import JointForce, StepState
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

if TYPE_CHECKING:
    from mujoco.batch import Batch

UNLIMITED_FORCE = 1e9  # [N m or N] of an actuator without a limit; chosen: none has it


class Action(NamedTuple):
    """An effect that acts at every step: where, and its values (N, p)."""

    effect: JointForce
    place: Place
    values: Floats


def list_actions(hypotheses: Hypotheses, count: int) -> list[Action]:
    """What acts at every step of simulations of each hypothesis in `count` segments."""
    return [
        Action(
            t.effect,
            place.renumber(hypotheses.variant),
            np.repeat(values, count, axis=0),
        )
        for t, values in zip(hypotheses.terms, hypotheses.term_values, strict=True)
        if isinstance(t.effect, JointForce)
        for place in t.places
    ]


@allow_divergence()
def run_stepwise(
    hypotheses: Hypotheses,
    segments: Segments,
    initial: BatchState,
    commands: Floats,
    sensors: SensorReader,
    sampled_steps: np.ndarray,
) -> Floats:
    """Simulate with effects that act at every step, as `simulate_batch` does without.

    Args:
        initial: states of the N = n W simulations.
        commands: (N, K, nu), as they reach the actuators at K steps.
        sampled_steps: (S) those whose readings matter.

    Returns:
        (N, K, C) true signals at each step [each channel's unit]; NaN in a simulation
        that diverged.
    """
    actions, step = list_actions(hypotheses, len(segments)), hypotheses.timestep
    begin = np.tile(segments.first_step * step, len(hypotheses.models))
    batch = make_batch(hypotheses, initial)
    forces = EffectForces(batch, actions, initial.integral_errors, step)
    if hypotheses.centered:
        _center_first_step(batch, forces, commands, begin, initial)
    return _run_steps(
        batch, forces, commands, begin, sensors,
        sampled_steps if hypotheses.centered else None,
    )  # fmt: skip


def _center_first_step(
    batch: "Batch",
    forces: "EffectForces",
    commands: Floats,
    begin: Floats,
    initial: BatchState,
) -> None:
    """Begin with velocities of half a step before the positions, by a first step.

    Args:
        batch: of B simulations, in their initial states; changed.
        forces: of the effects, as they are before the first step.
        commands: (B, K, nu).
        begin: (B) time at which each simulation begins in its episode [s].
    """
    ctrl = set_commands(batch, commands[:, 0])
    forces.apply(batch.bind("qpos"), batch.bind("qvel"), ctrl, begin)
    batch.step()
    shift_velocity_back(batch, initial)
    forces.reset_integral_errors()


def _run_steps(
    batch: "Batch",
    forces: "EffectForces",
    commands: Floats,
    begin: Floats,
    sensors: SensorReader,
    centered_steps: np.ndarray | None,
) -> Floats:
    """Simulate a batch step by step, and let effects act before each.

    Args:
        batch: of B simulations, in their initial states.
        commands: (B, K, nu), as they reach the actuators.
        begin: (B) time at which each simulation begins in its episode [s].
        centered_steps: sampled steps, of which velocities are restored as those of
            whole steps; None: the simulation is no leapfrog.

    Returns:
        (B, K, C) true signals at each step.
    """
    fields = sorted({"qpos", "qvel", *sensors.needs})
    bound = {name: batch.bind(name) for name in fields}
    commands = commands.swapaxes(0, 1).copy()
    ctrl = set_commands(batch, commands[0])
    recorded = {
        k: np.empty((len(commands), *v.shape), v.dtype) for k, v in bound.items()
    }
    before_step = ("qpos", "qvel")  # what a step leaves as after it
    after_step = [name for name in fields if name not in before_step]
    for k, command in enumerate(commands):
        ctrl[:] = command
        for name in before_step:
            recorded[name][k] = bound[name]
        forces.apply(bound["qpos"], bound["qvel"], ctrl, begin + k * forces.timestep)
        batch.step()
        for name in after_step:
            recorded[name][k] = bound[name]
    if centered_steps is not None:
        restore_whole_steps(batch, recorded, commands, sensors, centered_steps)
    predicted = sensors.read_all(recorded)
    predicted[:, find_diverged(batch)] = np.nan
    return predicted.swapaxes(0, 1)


class EffectForces:
    """Writes into a batch what effects do at each step."""

    def __init__(
        self,
        batch: "Batch",
        actions: Sequence[Action],
        integral_errors: Mapping[int, Floats],
        timestep: float,
    ) -> None:
        """Bind the batch's arrays that effects read and write.

        Args:
            integral_errors: (B) [rad s] by actuator, as the simulations begin.
            timestep: of the simulation [s].
        """
        self.actions, self.timestep = actions, timestep
        self._initial_errors = integral_errors
        self.reset_integral_errors()
        self._applied = batch.bind("qfrc_applied")
        self._torque, self._bias = batch.bind("qfrc_actuator"), batch.bind("qfrc_bias")
        self.frictionloss = batch.expand("dof_frictionloss")
        self._nominal_frictionloss = self.frictionloss.copy()
        needs = {name for action in actions for name in action.effect.needs}
        self._batch = batch
        self._law: dict[str, Floats] = {}
        if "actuator_length" in needs:
            fields = ("actuator_gainprm", "actuator_biasprm")
            gainprm, biasprm = (batch.expand(name) for name in fields)
            length = batch.bind("actuator_length")
            self._law = {
                "gainprm": gainprm, "biasprm": biasprm, "actuator_length": length
            }  # fmt: skip
        self._forcerange: Floats | None = None
        if "forcerange" in needs:
            limited = batch.expand("actuator_forcelimited")
            self._forcerange = batch.expand("actuator_forcerange")
            unlimited = [-np.inf, np.inf]
            wide = np.where(limited[..., None] > 0, self._forcerange, unlimited)
            self._nominal_forcerange = np.clip(wide, -UNLIMITED_FORCE, UNLIMITED_FORCE)
            limited[:] = 1

    def reset_integral_errors(self) -> None:
        """Set the integrated errors to what they were as the simulations began."""
        self._errors = {a: e.copy() for a, e in self._initial_errors.items()}

    def apply(self, qpos: Floats, qvel: Floats, ctrl: Floats, time: Floats) -> None:
        """Let every effect act on a state.

        Args:
            qpos: (B, nq).
            qvel: (B, nv).
            ctrl: (B, nu) commands.
            time: (B) in each episode [s].
        """
        self._applied[:] = 0
        self.frictionloss[:] = self._nominal_frictionloss
        if self._forcerange is not None:
            self._forcerange[:] = self._nominal_forcerange
        if self._law:  # lengths of this state, not of the step before
            self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
        state = StepState(
            time, qpos, qvel, ctrl, self._torque, self._bias, self._applied,
            self.frictionloss, self._forcerange, self._errors, self.timestep,
            **self._law,
        )  # fmt: skip
        for action in self.actions:
            action.effect.apply_forces(state, action.place, action.values)
