"""What a sensor makes of the truth: round to step (gain x true(t - delay) + bias)."""

from collections.abc import Mapping
from dataclasses import replace

from ...recording.data import Floats
from ..data.robot_summary import Channel, RobotSummary
from .by_target import SensorEffect
from .commands import STALE_STEPS
from .declaration import UNUSUAL, USUAL, ParameterSpec, Proposal, start_beside
from .places import SignalPlace
from .protocols import SensorMap

GAIN_RESOLUTION = 0.005  # of a gain, as well as sensors are calibrated; chosen


def has_scale(robot: RobotSummary, signal: Channel) -> bool:
    """Whether each column of a signal has a zero, and all have one scale.

    Directions and quaternions have none. The position of a robot that floats has none
    either, as nobody knows its zero.
    """
    model = robot.model
    if signal.width == 1:
        return True
    if signal.free_columns < signal.width or signal.kind != "body_position":
        return signal.free_columns == signal.width
    root = model.body_rootid[model.body(signal.target).id]
    return not (model.jnt_type[model.jnt_bodyid == root] == 0).any()


class SensorBias(SensorEffect, SensorMap[SignalPlace]):
    name = "sensor_bias"
    description = "The sensor's zero is off."
    equation = "reading = true + bias, of a vector signal one a column"
    source = "JCGM 200:2012 (VIM), instrumental bias"
    separate_by = "bring the joint to a mechanical stop of known angle"
    phrase = "{at} is off by {bias}"
    parameters = (ParameterSpec("bias", None, nominal=0.0, size=None),)

    def propose_at(self, robot: RobotSummary, signal: Channel) -> Proposal | None:
        """One for each column; those of a vector are called bias_x, bias_y, ...

        Usual at what is no velocity: the zero of a position is often off.
        """
        is_scalar, most = signal.width == 1, signal.max_abs
        if not has_scale(robot, signal):
            return None
        axes = "xyz"[: signal.width] if signal.width <= 3 else range(signal.width)
        bias = self.bound("bias", (-most, most), scale=0.1 * signal.spread, at=signal)
        each = tuple(replace(bias, name=f"bias_{x}") for x in axes)
        each = (bias,) if is_scalar else each
        usual = is_scalar and not _is_velocity(signal)
        return Proposal(each, start_beside(each, 0.3), USUAL if usual else UNUSUAL)

    def transform_reading(
        self, place: SignalPlace, values: Floats
    ) -> Mapping[str, Floats]:
        return {"bias": values}


class SensorGain(SensorEffect):
    name = "sensor_gain"
    description = "The sensor's scale is off."
    equation = "reading = gain true"
    source = "JCGM 200:2012 (VIM), sensitivity"
    separate_by = "bring the joint to two known angles"
    phrase = "{at} reads {gain} times what is true"
    parameters = (ParameterSpec("gain", "1", nominal=1.0, nonnegative=True),)

    def propose_at(self, robot: RobotSummary, signal: Channel) -> Proposal | None:
        if not has_scale(robot, signal):
            return None
        p = self.bound("gain", (0.3, 3.0), scale=0.05, resolution=GAIN_RESOLUTION)
        return Proposal((p,), start_beside((p,), 0.3))


class SensorDelay(SensorEffect):
    name = "sensor_delay"
    description = "The sensor says what was true a while ago."
    equation = "reading(t) = true(t - delay)"
    source = "MuJoCo sensor/delay (3.5)"
    separate_by = "let the joint swing with the motor off"
    phrase = "{at} comes {delay} late"
    parameters = (ParameterSpec("delay", "s", nominal=0.0, nonnegative=True),)

    def propose_at(self, robot: RobotSummary, signal: Channel) -> Proposal:
        """Usual at velocities: they are filtered, and so come late."""
        least = max(robot.contact_timing_error, STALE_STEPS * robot.timestep)
        p = self.bound("delay", (0.0, 0.3), scale=0.01, resolution=least)
        log_odds = USUAL if _is_velocity(signal) else UNUSUAL
        return Proposal((p,), ((0.005,), (0.03,)), log_odds)


def _is_velocity(signal: Channel) -> bool:
    """Whether a signal is a velocity."""
    return "velocity" in signal.kind


class Quantization(SensorEffect):
    """It makes readings jump, so that fits leave it out, and readings alone tell it."""

    name = "quantization"
    description = "The sensor knows only steps."
    equation = "reading = step round(true / step)"
    source = "JCGM 200:2012 (VIM), resolution"
    separate_by = "move slowly and look for a lattice of values"
    phrase = "{at} comes in steps of {step}"
    parameters = (ParameterSpec("step", None, nominal=0.0, nonnegative=True),)

    def propose_at(self, robot: RobotSummary, signal: Channel) -> Proposal | None:
        step = signal.quantum
        if signal.width > 1 or not step > 0:
            return None
        p = self.bound("step", (0.0, 2 * step), scale=0.1 * step, at=signal)
        return Proposal((p,), ((step,),))
