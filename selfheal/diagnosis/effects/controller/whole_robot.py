"""One value for all motors of a robot: a shift of clocks, a torque constant."""

import numpy as np

from ....recording.actuator_laws import has_affine_force
from ..by_target import WorldEffect
from ..commands import SAME_INSTANT_STEPS, change_columns, delay_column
from ..declaration import ParameterSpec
from ..places import Place

MAX_SHIFT = 0.3  # [s]; chosen: as long as the longest delay of one command
TORQUE_SIGNAL = "joint_torque"  # kind of what a motor's current is reported as


class ClockShift(WorldEffect):
    """One delay of all commands against all readings, of either sign."""

    name = "clock_shift"
    group = "actuator"
    description = (
        "The clocks of commands and readings are apart, or all commands come late by "
        "the same time."
    )
    equation = "u(t) = ctrl(t - shift), at all actuators"
    source = "Furgale, Rehder, Siegwart 2013: temporal calibration"
    separate_by = "log a command that is read back on the same bus"
    phrase = "commands act {shift} late against the readings, at all actuators alike"
    parameters = (ParameterSpec("shift", "s", nominal=0.0),)
    looks_ahead = MAX_SHIFT

    def propose_terms(self, robot):
        """One term of a robot with several actuators; of one it is a late command."""
        place = self._make_place(robot.model)
        if robot.model.nactuator < 2 or not place["controls"]:
            return []
        least = SAME_INSTANT_STEPS * robot.timestep
        parameter = self.make_parameter(
            "shift", low=-MAX_SHIFT, high=MAX_SHIFT, scale=0.01,
            resolution=max(robot.contact_timing_error, least),
        )  # fmt: skip
        starts = ((0.005,), (0.02,), (0.06,), (-0.02,))
        return [self.make_term((parameter,), starts, place)]

    def find_place(self, model, finding) -> Place:
        return self._make_place(model)

    @staticmethod
    def _make_place(model) -> Place:
        return {"controls": tuple(range(model.nu))}

    def transform_command(self, ctrl, step, place, values):
        return change_columns(
            ctrl, place["controls"], lambda u: delay_column(u, values / step)
        )


class TorqueConstant(WorldEffect):
    """One gain of all motors, of which their reported torques know nothing.

    A drive reports the torque that it commands: its current times the constant that it
    takes for true.
    """

    name = "torque_constant"
    group = "actuator"
    description = (
        "All motors give more or less torque than the drives take for true, and report."
    )
    equation = "tau = gain tau_stated, and tau_read = tau_stated"
    source = "MuJoCo actuator/dcmotor, motorconst"
    separate_by = "hold a known weight and compare the torque that is reported"
    phrase = "all motors give {gain} times the torque that the model says"
    parameters = (ParameterSpec("gain", "1", nominal=1.0, nonnegative=True),)
    rarity = 1

    def propose_terms(self, robot):
        """One term, where motors share their constant or report their torque."""
        model, place = robot.model, self.find_place(robot.model, {})
        reported = any(c.kind == TORQUE_SIGNAL for c in robot.channels)
        affine = [has_affine_force(model, a) for a in range(model.nactuator)]
        if not (affine and all(affine) and (len(affine) > 1 or reported)):
            return []
        parameter = self.make_parameter("gain", low=0.1, high=10.0, scale=0.2)
        return [self.make_term((parameter,), ((0.7,), (1.4,)), place)]

    def find_place(self, model, finding) -> Place:
        return {"kind": TORQUE_SIGNAL}

    def edit_model(self, model, place, values):
        if place.get("there"):
            return  # a patched model's motors have it
        model.actuator_gainprm[:, :3] *= values[0]
        model.actuator_biasprm[:, :3] *= values[0]
        limited = model.actuator_forcelimited > 0
        model.actuator_forcerange[limited] *= values[0]

    def transform_reading(self, place, values):
        return {"gain": 1 / np.maximum(values[:, 0], 1e-9)}
