"""Laws of actuators: takes a compiled model, says how commands become a force."""

from typing import TYPE_CHECKING

import numpy as np

from .controls import find_controls
from .data import Floats

if TYPE_CHECKING:
    import mujoco

PID = 5  # mjtGain


def has_affine_force(model: "mujoco.MjModel", actuator: int) -> bool:
    """Whether an actuator's force is affine in length and velocity, as MJCF states it.

    That of a muscle, of a DC motor, of a <pid> and of a user's own law is not.
    """
    types = model.actuator_gaintype[actuator], model.actuator_biastype[actuator]
    return bool(max(types) <= 1)  # mjtGain: fixed, affine; mjtBias: none, affine


def is_pid(model: "mujoco.MjModel", actuator: int) -> bool:
    """Whether an actuator has the law of MuJoCo's <pid>.

    Its force is kp (pos - l) + kv (vel - dl/dt) + ff + ki s, where ds/dt = pos - l. A
    control that it does not have counts as 0.
    """
    return bool(model.actuator_gaintype[actuator] == PID)


def list_control_gains(model: "mujoco.MjModel", actuator: int) -> Floats:
    """Force per unit (c) of each of an actuator's c controls [actuator's units].

    That is an affine law's gain where the law is no other that is known here.
    """
    count = int(model.actuator_ctrlnum[actuator])
    if not is_pid(model, actuator):
        return np.full(count, model.actuator_gainprm[actuator, 0])
    kp, kv = get_servo_gains(model, actuator)
    gains = {"pos": kp, "vel": kv, "ff": 1.0}
    return np.array([gains[name] for name in _list_inputs(model, actuator)])


def get_servo_gains(model: "mujoco.MjModel", actuator: int) -> tuple[float, float]:
    """A servo's kp and kv [actuator's units]; of a motor kp is its gain."""
    bias = model.actuator_biasprm[actuator]
    kp = -bias[1] if is_pid(model, actuator) else model.actuator_gainprm[actuator, 0]
    return float(kp), -float(bias[2])


def find_goal(model: "mujoco.MjModel", actuator: int) -> int:
    """Index into ctrl of the position that an actuator is to hold; -1: it holds none.

    The unit may be any.
    """
    controls = find_controls(model, actuator)
    if is_pid(model, actuator):
        names = _list_inputs(model, actuator)
        return controls[names.index("pos")] if "pos" in names else -1
    is_servo = model.actuator_biasprm[actuator, 1] < 0
    return controls[0] if is_servo and has_affine_force(model, actuator) else -1


def find_speed_goal(model: "mujoco.MjModel", actuator: int) -> int:
    """Index into ctrl of the speed that an actuator is to hold; -1: it holds none.

    MuJoCo's <velocity> has a gain that is its damping, and no stiffness.
    """
    controls, (gain, damping) = (
        find_controls(model, actuator),
        get_servo_gains(model, actuator),
    )
    if is_pid(model, actuator):
        names = _list_inputs(model, actuator)
        return controls[names.index("vel")] if "vel" in names else -1
    holds = gain > 0 and np.isclose(damping, gain)
    is_stiff = model.actuator_biasprm[actuator, 1] != 0
    is_servo = holds and not is_stiff and has_affine_force(model, actuator)
    return controls[0] if is_servo else -1


def _list_inputs(model: "mujoco.MjModel", actuator: int) -> list[str]:
    """MuJoCo's names of what the controls of a <pid> command."""
    import mujoco

    count = int(model.actuator_ctrlnum[actuator])
    return [mujoco.mj_actuatorInputName(model, actuator, k) for k in range(count)]
