"""The effects that are concealed, by the names of contract section 4.

An implementation of its own: nothing of `selfheal.diagnosis` is used, so that an error
there cannot hide in the truth.
"""

from collections.abc import Mapping, Sequence

from benchmarks.hidden.effects.base import Effect
from benchmarks.hidden.effects.bodies import BODY_EFFECTS
from benchmarks.hidden.effects.drives import DRIVE_EFFECTS, PLACED_EFFECTS
from benchmarks.hidden.effects.joints import JOINT_EFFECTS

BY_NAME: Mapping[str, Effect] = {
    effect.name: effect for effect in (*JOINT_EFFECTS, *DRIVE_EFFECTS, *BODY_EFFECTS)
}
PLACED: Mapping[str, Effect] = {effect.name: effect for effect in PLACED_EFFECTS}
# seeds draw them by turns: a changed order is another benchmark
# fmt: off
_ORDER = (
    "viscous_friction", "coulomb_friction", "stribeck_friction",
    "load_dependent_friction", "asymmetric_friction", "quadratic_damping", "backlash",
    "compliance", "armature", "joint_spring", "command_delay", "actuator_lag",
    "torque_saturation", "speed_torque_limit", "servo_gain", "payload", "com_shift",
    "slope", "fluid_drag", "ground_friction", "sensor_bias", "sensor_gain",
    "sensor_delay", "link_length", "mount_shift", "limb_loss", "cogging",
    "joint_coupling", "hard_stop", "rate_limit", "integral_action", "joint_jam", "wind",
    "ground_compliance", "quantization",
)
# fmt: on
EFFECTS: Sequence[Effect] = [BY_NAME[name] for name in _ORDER]
