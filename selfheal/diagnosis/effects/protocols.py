"""The ways in which an effect may act, each one method; it names one or two as bases.

An edit of the model, a filter of commands, a force at joints, a map of sensors. Two
more are for what MuJoCo can do itself: a joint that is added, and edits of the text.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar, runtime_checkable

from ...recording.data import Floats
from .commands import CommandGrid
from .places import Place

if TYPE_CHECKING:
    from mujoco import MjModel, MjSpec

    from ...mjcf.edit import Edit

P_contra = TypeVar("P_contra", bound=Place, contravariant=True)


@dataclass
class StepState:
    """What an effect may read and write at one step of N simulations.

    Attributes:
        time: (N) since each episode began [s].
        qpos: (N, nq) positions at the step's beginning [rad or m].
        qvel: (N, nv) velocities [rad/s or m/s].
        ctrl: (N, nu) commands of the step, as they reach the actuators, to be changed.
        actuator_torque: (N, nv) of all actuators, of the step before [N m or N].
        bias_torque: (N, nv) MuJoCo's qfrc_bias, of the step before [N m or N].
        applied_force: (N, nv) of effects, to be added to [N m or N].
        frictionloss: (N, nv) dry friction of the step, to be changed [N m or N].
        forcerange: (N, nactuator, 2) of the actuators, to be changed [actuator's
            unit]; None where no effect names it in `Effect.needs`.
        integral_errors: (N) of each integrating servo by its id, to be added to
            [rad s or m s].
        timestep: of the simulation [s].
        gainprm: (N, nactuator, 10) MuJoCo's actuator_gainprm; None where no effect
            needs it, as the next two.
        biasprm: (N, nactuator, 10) MuJoCo's actuator_biasprm.
        actuator_length: (N, outputs) MuJoCo's actuator_length.
    """

    time: Floats
    qpos: Floats
    qvel: Floats
    ctrl: Floats
    actuator_torque: Floats
    bias_torque: Floats
    applied_force: Floats
    frictionloss: Floats
    forcerange: Floats | None
    integral_errors: Mapping[int, Floats]
    timestep: float
    gainprm: Floats | None = None
    biasprm: Floats | None = None
    actuator_length: Floats | None = None


@runtime_checkable
class ModelEdit(Protocol[P_contra]):
    """An edit of numbers of the model."""

    @abstractmethod
    def edit_model(self, model: "MjModel", place: P_contra, values: Floats) -> None:
        """Change fields of a compiled model.

        Args:
            place: where the effect acts, in that model.
            values: (p) of the parameters.
        """


@runtime_checkable
class CommandFilter(Protocol[P_contra]):
    """A filter of commands on their way to the actuators."""

    @abstractmethod
    def transform_command(
        self, ctrl: Floats, grid: CommandGrid, place: P_contra, values: Floats
    ) -> Floats:
        """Commands as they reach the actuators.

        Args:
            ctrl: (1 or N, G, nu) as they were sent, on a grid.
            place: where the effect acts; nothing but its `controls` may change.
            values: (N, p) of the parameters.

        Returns:
            (N, G, nu) on the same grid. What is given at a time may depend on commands
            until `commands.MAX_LOOK_AHEAD` after it.
        """


@runtime_checkable
class JointForce(Protocol[P_contra]):
    """A force at joints, or a change of friction and limits, at every step."""

    needs: frozenset[str]

    @abstractmethod
    def apply_forces(self, state: StepState, place: P_contra, values: Floats) -> None:
        """Add forces, or change friction and limits, at one step.

        Args:
            state: of N simulations, to be read and changed.
            place: where the effect acts, in the simulated model.
            values: (N, p) of the parameters.
        """


@runtime_checkable
class SensorMap(Protocol[P_contra]):
    """A map from what is true to what a sensor reads."""

    @abstractmethod
    def transform_reading(
        self, place: P_contra, values: Floats
    ) -> Mapping[str, Floats]:
        """What the sensors of a place make of true signals, from values (N, p).

        Returns:
            Of the keys "bias" (N, width) [signal's unit], "gain" (N) [1], "delay" (N)
            [s] and "step" (N) [signal's unit] those that it changes.
        """


@runtime_checkable
class JointAddition(Protocol[P_contra]):
    """An edit of the model before it is compiled: one more joint, on a spring or stop.

    Its place is an `AddedJointPlace`.
    """

    @abstractmethod
    def edit_spec(self, spec: "MjSpec", place: P_contra) -> None:
        """Add the joint."""

    @abstractmethod
    def compute_deflection(self, values: Floats, load: float) -> float:
        """Rest position [rad or m] of the added joint.

        Args:
            values: (p) of the parameters.
            load: torque or force that it bears [N m or N].
        """


@runtime_checkable
class TextForm(Protocol[P_contra]):
    """Edits of the MJCF's text with the effect's native form."""

    @abstractmethod
    def edit_text(
        self, model: "MjModel", place: P_contra, values: Floats
    ) -> "Sequence[Edit]":
        """Edits after which plain MuJoCo does what the effect does.

        Args:
            model: compiled, as given or with the joints that effects add.
            place: where the effect acts, in that model.
            values: (p) of the parameters.
        """
