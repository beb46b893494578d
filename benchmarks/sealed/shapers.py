"""What MuJoCo is not asked to do in the hidden robot: shapers of commands, and forces.

Each function gives a maker: called with the fine step [s], or with the compiled model,
it makes an object with the memory of one episode.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

from benchmarks.sealed.hidden_robot import CommandShaper, Force

Maker = Callable[[Any], Force]


def delay_command(delay: float, fine: float) -> CommandShaper:
    """The command of `delay` [s] ago; before the first, the first."""
    line: deque[float] = deque(maxlen=round(delay / fine) + 1)

    def shape(command: float, first: bool) -> float:
        if first:
            line.extend([command] * (line.maxlen or 1))
        line.append(command)
        return line[0]

    return shape


def lag_command(timeconst: float, fine: float) -> CommandShaper:
    """First-order lag: d command / dt = (sent - command) / timeconst."""
    share, state = 1 - math.exp(-fine / timeconst), [0.0]

    def shape(command: float, first: bool) -> float:
        if first:
            state[0] = command
        state[0] += share * (command - state[0])
        return state[0]

    return shape


def limit_rate(rate: float, fine: float) -> CommandShaper:
    """The command moves at most at `rate` [rad/s]."""
    most, state = rate * fine, [0.0]

    def shape(command: float, first: bool) -> float:
        if first:
            state[0] = command
        state[0] += min(max(command - state[0], -most), most)
        return state[0]

    return shape


def _find_addresses(model: Any, joint: str) -> tuple[int, int]:
    found = model.joint(joint)
    return int(found.qposadr[0]), int(found.dofadr[0])


def apply_torque(joint: str, torque: float) -> Maker:
    """A constant torque [N m]."""

    def make(model: Any) -> Force:
        dof = _find_addresses(model, joint)[1]

        def push(model: Any, data: Any, time: float) -> None:
            data.qfrc_applied[dof] += torque

        return push

    return make


def apply_stribeck(
    joint: str, coulomb: float, static: float, stribeck_velocity: float
) -> Maker:
    """Friction = coulomb + (static - coulomb) exp(-(v / stribeck_velocity)^2)."""

    def make(model: Any) -> Force:
        dof = _find_addresses(model, joint)[1]

        def push(model: Any, data: Any, time: float) -> None:
            ratio = float(data.qvel[dof]) / stribeck_velocity
            extra = (static - coulomb) * math.exp(-min(ratio * ratio, 700.0))
            model.dof_frictionloss[dof] = coulomb + extra

        return push

    return make


def apply_load_friction(joint: str, load_coefficient: float) -> Maker:
    """Friction = what there is + load_coefficient x |torque of the motor|."""

    def make(model: Any) -> Force:
        dof = _find_addresses(model, joint)[1]
        dry = float(model.dof_frictionloss[dof])

        def push(model: Any, data: Any, time: float) -> None:
            load = abs(float(data.qfrc_actuator[dof]))
            model.dof_frictionloss[dof] = dry + load_coefficient * load

        return push

    return make


def apply_cogging(joint: str, amplitude: float, poles: float, phase: float) -> Maker:
    """Torque = amplitude sin(poles q + phase)."""

    def make(model: Any) -> Force:
        place, dof = _find_addresses(model, joint)

        def push(model: Any, data: Any, time: float) -> None:
            angle = poles * float(data.qpos[place]) + phase
            data.qfrc_applied[dof] += amplitude * math.sin(angle)

        return push

    return make


def limit_by_speed(actuator: str, joint: str, stall: float, no_load: float) -> Maker:
    """Torque in the direction of motion falls from stall to 0 at the no-load speed."""

    def make(model: Any) -> Force:
        dof, index = _find_addresses(model, joint)[1], model.actuator(actuator).id

        def push(model: Any, data: Any, time: float) -> None:
            ratio = float(data.qvel[dof]) / no_load
            high = stall * min(max(1 - ratio, 0.0), 1.0)
            low = stall * min(max(1 + ratio, 0.0), 1.0)
            model.actuator_forcerange[index] = (-low, high)

        return push

    return make


def integrate_error(actuator: str, joint: str, ki: float, imax: float) -> Maker:
    """Torque = ki x integral of the servo's error, within imax; 0 at time 0."""

    def make(model: Any) -> Force:
        place, dof = _find_addresses(model, joint)
        control, sum_ = model.actuator_ctrladr[model.actuator(actuator).id], [0.0]
        fine = float(model.opt.timestep)

        def push(model: Any, data: Any, time: float) -> None:
            if time < 0:
                return
            error = float(data.ctrl[control]) - float(data.qpos[place])
            sum_[0] = min(max(sum_[0] + ki * error * fine, -imax), imax)
            data.qfrc_applied[dof] += sum_[0]

        return push

    return make
