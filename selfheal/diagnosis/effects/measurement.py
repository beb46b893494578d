"""What a sensor makes of the truth: round to step (gain x true(t - delay) + bias)."""

from dataclasses import replace

from ..data.robot_summary import Channel, RobotSummary
from .base import Effect, Parameter, Term

# of a step, a delay that is how recordings are made: who records a simulation, or a
# control loop, reads what was computed a moment ago; chosen
STALE = 0.5
TRUE_TO = 0.005  # of a gain, as well as sensors are calibrated; chosen


class SensorEffect(Effect):
    """What all of them share: a signal that is compared."""

    group = "measurement"

    def make_parameter(self, robot, signal) -> Parameter:
        """Its number at a signal; `signal` is a `scene.Channel`."""
        raise NotImplementedError

    def make_parameters(self, robot, signal) -> tuple[Parameter, ...]:
        """Its numbers at a signal."""
        return (self.make_parameter(robot, signal),)

    def make_initial_values(self, robot, signal) -> tuple[tuple[float, ...], ...]:
        """Values to begin a search at."""
        every = self.make_parameters(robot, signal)
        return (tuple(p.nominal + 0.3 * p.scale for p in every),)

    def applies_to(self, robot, signal) -> bool:
        """Whether it could be at this signal."""
        return signal.width == 1

    def propose_terms(self, robot):
        """At every signal."""
        return [
            Term(
                self,
                (f"sensor:{signal.name}",),
                ({"signal": signal.name, "kind": signal.kind},),
                self.make_parameters(robot, signal),
                self.make_initial_values(robot, signal),
            )
            for signal in robot.channels
            if self.applies_to(robot, signal)
        ]

    def is_usual(self, term):
        """Of positions a zero is often off; speeds are filtered, and so come late."""
        speed = "velocity" in term.places[0]["kind"]
        one = len(term.parameters) == 1
        return super().is_usual(term) and one and speed == self.is_for_velocities

    def transform_reading(self, place, values):
        return {self.parameter_name: values[:, 0]}

    parameter_name = ""
    is_for_velocities = (
        False  # whether it is usual at velocities, rather than at the others
    )


def has_vector_offset(robot: RobotSummary, signal: Channel) -> bool:
    """Whether a signal's columns have each a zero, and a scale together.

    Those of a direction or a quaternion have none, and of where a robot that floats is
    nobody knows the zero.
    """
    model = robot.model
    if signal.free_columns < signal.width or signal.width == 1:
        return False
    if signal.kind != "body_position":
        return True
    root = model.body_rootid[model.body(signal.target).id]
    return not (model.jnt_type[model.jnt_bodyid == root] == 0).any()


class SensorBias(SensorEffect):
    name = "sensor_bias"
    is_common = True
    parameter_name = vector_parameter = "bias"
    description = "The sensor's zero is off."
    equation = "reading = true + bias, of a vector signal one a column"
    source = "JCGM 200:2012 (VIM), instrumental bias"
    separate_by = "bring the joint to a mechanical stop of known angle"

    def make_parameter(self, robot, signal):
        return Parameter(
            "bias",
            signal.unit,
            0.0,
            -signal.max_abs,
            signal.max_abs,
            0.1 * signal.spread,
        )

    def make_parameters(self, robot, signal):
        """One a column; of a vector they are called bias_x, bias_y, ..."""
        one = self.make_parameter(robot, signal)
        if signal.width == 1:
            return (one,)
        axes = "xyz"[: signal.width] if signal.width <= 3 else range(signal.width)
        return tuple(replace(one, name=f"bias_{x}") for x in axes)

    def applies_to(self, robot, signal):
        return super().applies_to(robot, signal) or has_vector_offset(robot, signal)

    def transform_reading(self, place, values):
        return {"bias": values}


class SensorGain(SensorEffect):
    name = "sensor_gain"
    parameter_name = "gain"
    description = "The sensor's scale is off."
    equation = "reading = gain true"
    source = "JCGM 200:2012 (VIM), sensitivity"
    separate_by = "bring the joint to two known angles"

    def make_parameter(self, robot, signal):
        return Parameter("gain", "1", 1.0, 0.3, 3.0, 0.05, resolution=TRUE_TO)

    def applies_to(self, robot, signal):
        return super().applies_to(robot, signal) or has_vector_offset(robot, signal)


class SensorDelay(SensorEffect):
    name = "sensor_delay"
    is_common = True
    is_for_velocities = True
    parameter_name = "delay"
    description = "The sensor says what was true a while ago."
    equation = "reading(t) = true(t - delay)"
    source = "MuJoCo sensor/delay (3.5)"
    separate_by = "let the joint swing with the motor off"
    regime = "fast"

    def make_parameter(self, robot, signal):
        least = max(robot.contact_timing_error, STALE * robot.timestep)
        return Parameter("delay", "s", 0.0, 0.0, 0.3, 0.01, resolution=least)

    def make_initial_values(self, robot, signal):
        return ((0.005,), (0.03,))

    def applies_to(self, robot, signal):
        return True


class Quantization(SensorEffect):
    name = "quantization"
    parameter_name = "step"
    description = "The sensor knows only steps."
    equation = "reading = step round(true / step)"
    source = "JCGM 200:2012 (VIM), resolution"
    separate_by = "move slowly and look for a lattice of values"
    regime = "slow"
    rounds_readings = True

    def applies_to(self, robot, signal):
        return super().applies_to(robot, signal) and signal.quantum > 0

    def make_parameter(self, robot, signal):
        step = signal.quantum
        return Parameter("step", signal.unit, 0.0, 0.0, 2 * step, 0.1 * step)

    def make_initial_values(self, robot, signal):
        return ((signal.quantum,),)
