"""What an effect sees of a simulation at one step, and what it may change there."""

from collections.abc import Mapping
from dataclasses import dataclass

from ...recording.data import Floats


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
            unit]; None where no effect has `writes_forcerange`.
        integral_errors: (N) of each integrating servo by its id, to be added to
            [rad s or m s].
        timestep: of the simulation [s].
        gainprm: (N, nactuator, 10) MuJoCo's actuator_gainprm; None where no effect has
            `reads_actuators`, as the next two.
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
