"""One value for all motors of a robot: a shift of clocks, a torque constant."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ....recording.actuator_laws import has_affine_force
from ....recording.data import Floats
from ...data.robot_summary import RobotSummary
from ..base import Term
from ..by_target import WorldEffect
from ..commands import (
    MAX_LOOK_AHEAD,
    SAME_INSTANT_STEPS,
    CommandGrid,
    delay_commands,
)
from ..declaration import SELDOM, Finding, ParameterSpec, Proposal
from ..places import ControlsPlace, Place, SignalPlace
from ..protocols import CommandFilter, ModelEdit, SensorMap

if TYPE_CHECKING:
    from mujoco import MjModel

TORQUE_SIGNAL = "joint_torque"  # kind of what a motor's current is reported as


class ClockShift(WorldEffect, CommandFilter[ControlsPlace]):
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

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term of a robot with several actuators; of one it is a late command."""
        place = ControlsPlace(controls=tuple(range(robot.model.nu)))
        if robot.model.nactuator < 2 or not place.controls:
            return []
        least = SAME_INSTANT_STEPS * robot.timestep
        least = max(robot.contact_timing_error, least)
        bounds = (-MAX_LOOK_AHEAD, MAX_LOOK_AHEAD)
        p = self.bound("shift", bounds, scale=0.01, resolution=least)
        starts = ((0.005,), (0.02,), (0.06,), (-0.02,))
        return [self.make_term("world", place, Proposal((p,), starts))]

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        return ControlsPlace(controls=tuple(range(model.nu)))

    def transform_command(
        self, ctrl: Floats, grid: CommandGrid, place: ControlsPlace, values: Floats
    ) -> Floats:
        return delay_commands(ctrl, place.controls, values / grid.step)


class TorqueConstant(WorldEffect, ModelEdit[SignalPlace], SensorMap[SignalPlace]):
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
    log_odds = SELDOM

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term, where motors share their constant or report their torque."""
        model = robot.model
        reported = any(c.kind == TORQUE_SIGNAL for c in robot.channels)
        affine = [has_affine_force(model, a) for a in range(model.nactuator)]
        if not (affine and all(affine) and (len(affine) > 1 or reported)):
            return []
        p = self.bound("gain", (0.1, 10.0), scale=0.2)
        proposal = Proposal((p,), ((0.7,), (1.4,)))
        return [self.make_term("world", SignalPlace(kind=TORQUE_SIGNAL), proposal)]

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        return SignalPlace(kind=TORQUE_SIGNAL)

    def edit_model(self, model: "MjModel", place: SignalPlace, values: Floats) -> None:
        if place.is_patched:
            return  # a patched model's motors have it
        model.actuator_gainprm[:, :3] *= values[0]
        model.actuator_biasprm[:, :3] *= values[0]
        limited = model.actuator_forcelimited > 0
        model.actuator_forcerange[limited] *= values[0]

    def transform_reading(
        self, place: SignalPlace, values: Floats
    ) -> Mapping[str, Floats]:
        return {"gain": 1 / np.maximum(values[:, 0], 1e-9)}
