"""Forces of effects: takes a batch, writes into it what effects do at each step."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from ...recording.data import Floats
from ..effects.places import Place
from ..effects.protocols import JointForce, StepState
from .batch import (
    Hypotheses,
)

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


class EffectForces:
    """Writes into a batch what effects do at each step."""

    def __init__(
        self,
        batch: "Batch",
        actions: Sequence[Action],
        integral_errors: Mapping[int, Floats],
        begin: Floats,
        timestep: float,
    ) -> None:
        """Bind the batch's arrays that effects read and write.

        Args:
            integral_errors: (B) [rad s] by actuator, as the simulations begin.
            begin: (B) time at which each simulation begins in its episode [s].
            timestep: of the simulation [s].
        """
        self.actions, self._begin, self._timestep = actions, begin, timestep
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
                "gainprm": gainprm,
                "biasprm": biasprm,
                "actuator_length": length,
            }
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

    def apply(self, ctrl: Floats, step: int) -> None:
        """Let every effect act on the batch's state.

        Args:
            ctrl: (B, nu) commands; changed.
            step: number of the step since the simulations began.
        """
        self._applied[:] = 0
        self.frictionloss[:] = self._nominal_frictionloss
        if self._forcerange is not None:
            self._forcerange[:] = self._nominal_forcerange
        if self._law:  # lengths of this state, not of the step before
            self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
        state = StepState(
            time=self._begin + step * self._timestep,
            qpos=self._batch.bind("qpos"),
            qvel=self._batch.bind("qvel"),
            ctrl=ctrl,
            actuator_torque=self._torque,
            bias_torque=self._bias,
            applied_force=self._applied,
            frictionloss=self.frictionloss,
            forcerange=self._forcerange,
            integral_errors=self._errors,
            timestep=self._timestep,
            **self._law,
        )
        for action in self.actions:
            action.effect.apply_forces(state, action.place, action.values)
