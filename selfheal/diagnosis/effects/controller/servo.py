"""What a servo does with its command: it feeds the goal's speed forward, it waits."""

import numpy as np

from ....recording import find_output
from ....recording.actuator_laws import find_goal, has_affine_force
from ....recording.data import Floats
from ..by_target import ActuatorEffect
from ..commands import change_columns
from ..declaration import ParameterSpec
from ..places import Place, add_keys

# [s] over which a servo takes the slope of its goal; chosen: a sample of commands at
# 50 Hz, which a grid of steps repeats
SLOPE_SECONDS = 0.02
NO_DYNAMICS = 0  # mjtDyn


class VelocityFeedforward(ActuatorEffect):
    name = "velocity_feedforward"
    description = "The servo adds a torque in proportion to the speed of its goal."
    equation = "tau = kp (ctrl + lead d ctrl/dt - q) - kv v"
    source = "Corke 2017, Robotics, Vision and Control, section 9.1: feedforward"
    separate_by = "ramp the command: feed-forward takes the lag away"
    phrase = "{at} feeds the speed of its goal forward, {lead} of it"
    parameters = (ParameterSpec("lead", "s", nominal=0.0, nonnegative=True),)

    def make_parameters(self, robot, actuator):
        return (self.make_parameter("lead", low=0.0, high=0.5, scale=0.01),)

    def make_initial_values(self, robot, actuator):
        """That which undoes the servo's own damping."""
        stiffness, damping = -robot.model.actuator_biasprm[actuator.id, 1:3]
        return ((float(damping / stiffness) or 0.02,),)

    def applies_to(self, robot, actuator):
        model, a = robot.model, actuator.id
        is_position = find_goal(model, a) >= 0 and has_affine_force(model, a)
        same = sum(other.dof == actuator.dof for other in robot.actuators)
        return is_position and (actuator.dof < 0 or same == 1)

    def transform_command(self, ctrl, step, place, values):
        return change_columns(
            ctrl, [place["goal"]], lambda u: u + values * _slope(u, step)
        )


def _slope(u: Floats, step: float) -> Floats:
    """Slope of commands u (1 or N, G) over the last `SLOPE_SECONDS` [unit/s]."""
    steps = max(1, round(SLOPE_SECONDS / step))
    before = np.concatenate([np.repeat(u[:, :1], steps, axis=1), u], axis=1)
    slope: Floats = (u - before[:, : u.shape[1]]) / (steps * step)
    return slope


class DeadBand(ActuatorEffect):
    """A dead zone of what a servo's error, or a motor's command, asks for."""

    name = "dead_band"
    description = "What is asked for below a width does nothing, and more acts less."
    equation = "tau = p - min(max(p, -width), width), p = kp (ctrl - q), or kp ctrl"
    source = "Tao, Kokotovic 1996, Adaptive Control of Systems, dead zone"
    separate_by = "command small steps about a pose without load"
    phrase = "{at} does nothing below {width} of what it is asked for"
    parameters = (ParameterSpec("width", "N m", nominal=0.0, nonnegative=True),)
    rarity = 1
    reads_actuators = True

    def make_parameters(self, robot, actuator):
        most = actuator.max_force
        return (
            self.make_parameter(
                "width", actuator, low=0.0, high=most, scale=0.1 * most
            ),
        )

    def make_initial_values(self, robot, actuator):
        return tuple((share * actuator.max_force,) for share in (0.03, 0.15))

    def applies_to(self, robot, actuator):
        model, a = robot.model, actuator.id
        is_motor = not model.actuator_biasprm[a, :3].any()
        asked = is_motor or find_goal(model, a) >= 0
        return bool(
            asked
            and has_affine_force(model, a)
            and model.actuator_dyntype[a] == NO_DYNAMICS
            and model.actuator_gaintype[a] == 0
            and model.actuator_gainprm[a, 0]
        )

    def find_place(self, model, finding):
        return _add_output(model, super().find_place(model, finding))

    def make_place(self, robot, actuator):
        return _add_output(robot.model, super().make_place(robot, actuator))

    def apply_forces(self, state, place, values):
        a, (control,) = place["actuator"], place["controls"]
        gain, bias = state.gainprm[:, a, 0], state.biasprm[:, a]
        length = state.actuator_length[:, place["output"]]
        asked = gain * state.ctrl[:, control] + bias[:, 0] + bias[:, 1] * length
        width = values[:, 0] / abs(place["gear"])
        state.ctrl[:, control] -= np.clip(asked, -width, width) / gain


def _add_output(model, place: Place) -> Place:
    """The place of an actuator with the index of its output."""
    return add_keys(place, output=find_output(model, place["actuator"]))
