"""What a sensor makes of the truth: round to step (gain x true(t - delay) + bias)."""

from collections.abc import Mapping
from dataclasses import replace

from ...recording.data import Floats
from ..data.robot_summary import Channel, RobotSummary
from .by_target import SensorEffect
from .commands import STALE_STEPS
from .declaration import UNUSUAL, USUAL, Parameters, ParameterSpec, Starts
from .places import SignalPlace
from .protocols import SensorMap

GAIN_RESOLUTION = 0.005  # of a gain, as well as sensors are calibrated; chosen


def has_vector_offset(robot: RobotSummary, signal: Channel) -> bool:
    """Whether each column of a vector signal has a zero, and all have one scale.

    Directions and quaternions have none. The position of a robot that floats has none
    either, as nobody knows its zero.
    """
    model = robot.model
    if signal.free_columns < signal.width or signal.width == 1:
        return False
    if signal.kind != "body_position":
        return True
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

    def make_parameters(self, robot: RobotSummary, signal: Channel) -> Parameters:
        """One for each column; those of a vector are called bias_x, bias_y, ..."""
        few = signal.width <= 3
        axes = tuple("xyz"[: signal.width] if few else range(signal.width))
        bias = self.bound(
            "bias",
            signal,
            low=-signal.max_abs,
            high=signal.max_abs,
            scale=0.1 * signal.spread,
        )
        return tuple(
            replace(bias, name=f"bias_{x}" if signal.width > 1 else "bias")
            for x in axes
        )

    def applies_to(self, robot: RobotSummary, signal: Channel) -> bool:
        return super().applies_to(robot, signal) or has_vector_offset(robot, signal)

    def find_log_odds(self, robot: RobotSummary, signal: Channel) -> float:
        """Usual at what is no velocity: the zero of a position is often off."""
        return USUAL if signal.width == 1 and not _is_velocity(signal) else UNUSUAL

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

    def make_parameters(self, robot: RobotSummary, signal: Channel) -> Parameters:
        return (
            self.bound(
                "gain", low=0.3, high=3.0, scale=0.05, resolution=GAIN_RESOLUTION
            ),
        )

    def applies_to(self, robot: RobotSummary, signal: Channel) -> bool:
        return super().applies_to(robot, signal) or has_vector_offset(robot, signal)


class SensorDelay(SensorEffect):
    name = "sensor_delay"
    description = "The sensor says what was true a while ago."
    equation = "reading(t) = true(t - delay)"
    source = "MuJoCo sensor/delay (3.5)"
    separate_by = "let the joint swing with the motor off"
    phrase = "{at} comes {delay} late"
    parameters = (ParameterSpec("delay", "s", nominal=0.0, nonnegative=True),)

    def make_parameters(self, robot: RobotSummary, signal: Channel) -> Parameters:
        least = max(robot.contact_timing_error, STALE_STEPS * robot.timestep)
        return (self.bound("delay", low=0.0, high=0.3, scale=0.01, resolution=least),)

    def make_initial_values(self, robot: RobotSummary, signal: Channel) -> Starts:
        return ((0.005,), (0.03,))

    def applies_to(self, robot: RobotSummary, signal: Channel) -> bool:
        return True

    def find_log_odds(self, robot: RobotSummary, signal: Channel) -> float:
        """Usual at velocities: they are filtered, and so come late."""
        return USUAL if _is_velocity(signal) else UNUSUAL


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

    def make_parameters(self, robot: RobotSummary, signal: Channel) -> Parameters:
        step = signal.quantum
        return (self.bound("step", signal, low=0.0, high=2 * step, scale=0.1 * step),)

    def make_initial_values(self, robot: RobotSummary, signal: Channel) -> Starts:
        return ((signal.quantum,),)

    def applies_to(self, robot: RobotSummary, signal: Channel) -> bool:
        return super().applies_to(robot, signal) and signal.quantum > 0
