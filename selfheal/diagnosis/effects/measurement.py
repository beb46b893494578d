"""What a sensor makes of the truth: round to step (gain x true(t - delay) + bias)."""

from dataclasses import replace

from ..scene import Channel, Scene
from ..terms import Effect, Parameter, Term

# of a step, a delay that is how recordings are made: who records a simulation, or a
# control loop, reads what was computed a moment ago; chosen
STALE = 0.5
TRUE_TO = 0.005  # of a gain, as well as sensors are calibrated; chosen


class OfSensor(Effect):
    """What all of them share: a signal that is compared."""

    group = "measurement"

    def parameter(self, scene, signal) -> Parameter:
        """Its number at a signal; `signal` is a `scene.Channel`."""
        raise NotImplementedError

    def parameters(self, scene, signal) -> tuple[Parameter, ...]:
        """Its numbers at a signal."""
        return (self.parameter(scene, signal),)

    def starts(self, scene, signal) -> tuple[tuple[float, ...], ...]:
        """Values to begin a search at."""
        every = self.parameters(scene, signal)
        return (tuple(p.absent + 0.3 * p.scale for p in every),)

    def fits(self, scene, signal) -> bool:
        """Whether it could be at this signal."""
        return signal.width == 1

    def terms(self, scene):
        """At every signal."""
        return [
            Term(
                self,
                (f"sensor:{signal.name}",),
                ({"signal": signal.name, "kind": signal.kind},),
                self.parameters(scene, signal),
                self.starts(scene, signal),
            )
            for signal in scene.signals
            if self.fits(scene, signal)
        ]

    def is_usual(self, term):
        """Of positions a zero is often off; speeds are filtered, and so come late."""
        speed = "velocity" in term.places[0]["kind"]
        one = len(term.parameters) == 1
        return super().is_usual(term) and one and speed == self.of_speeds

    def measure(self, place, values):
        return {self.parameter_name: values[:, 0]}

    parameter_name = ""
    of_speeds = False  # whether it is usual at velocities, rather than at the others


def is_vector(scene: Scene, signal: Channel) -> bool:
    """Whether a signal's columns have each a zero, and a scale together.

    Those of a direction or a quaternion have none, and of where a robot that floats is
    nobody knows the zero.
    """
    model = scene.model
    if signal.freedom < signal.width or signal.width == 1:
        return False
    if signal.kind != "body_position":
        return True
    root = model.body_rootid[model.body(signal.target).id]
    return not (model.jnt_type[model.jnt_bodyid == root] == 0).any()


class SensorBias(OfSensor):
    name = "sensor_bias"
    common = True
    parameter_name = vector = "bias"
    says = "The sensor's zero is off."
    equation = "reading = true + bias, of a vector signal one a column"
    source = "JCGM 200:2012 (VIM), instrumental bias"
    separate_by = "bring the joint to a mechanical stop of known angle"

    def parameter(self, scene, signal):
        return Parameter(
            "bias", signal.unit, 0.0, -signal.reach, signal.reach, 0.1 * signal.spread
        )

    def parameters(self, scene, signal):
        """One a column; of a vector they are called bias_x, bias_y, ..."""
        one = self.parameter(scene, signal)
        if signal.width == 1:
            return (one,)
        axes = "xyz"[: signal.width] if signal.width <= 3 else range(signal.width)
        return tuple(replace(one, name=f"bias_{x}") for x in axes)

    def fits(self, scene, signal):
        return super().fits(scene, signal) or is_vector(scene, signal)

    def measure(self, place, values):
        return {"bias": values}


class SensorGain(OfSensor):
    name = "sensor_gain"
    parameter_name = "gain"
    says = "The sensor's scale is off."
    equation = "reading = gain true"
    source = "JCGM 200:2012 (VIM), sensitivity"
    separate_by = "bring the joint to two known angles"

    def parameter(self, scene, signal):
        return Parameter("gain", "1", 1.0, 0.3, 3.0, 0.05, least=TRUE_TO)

    def fits(self, scene, signal):
        return super().fits(scene, signal) or is_vector(scene, signal)


class SensorDelay(OfSensor):
    name = "sensor_delay"
    common = True
    of_speeds = True
    parameter_name = "delay"
    says = "The sensor says what was true a while ago."
    equation = "reading(t) = true(t - delay)"
    source = "MuJoCo sensor/delay (3.5)"
    separate_by = "let the joint swing with the motor off"
    regime = "fast"

    def parameter(self, scene, signal):
        least = max(scene.vague, STALE * scene.step)
        return Parameter("delay", "s", 0.0, 0.0, 0.3, 0.01, least=least)

    def starts(self, scene, signal):
        return ((0.005,), (0.03,))

    def fits(self, scene, signal):
        return True


class Quantization(OfSensor):
    name = "quantization"
    parameter_name = "step"
    says = "The sensor knows only steps."
    equation = "reading = step round(true / step)"
    source = "JCGM 200:2012 (VIM), resolution"
    separate_by = "move slowly and look for a lattice of values"
    regime = "slow"
    rounds = True

    def fits(self, scene, signal):
        return super().fits(scene, signal) and signal.lattice > 0

    def parameter(self, scene, signal):
        step = signal.lattice
        return Parameter("step", signal.unit, 0.0, 0.0, 2 * step, 0.1 * step)

    def starts(self, scene, signal):
        return ((signal.lattice,),)
