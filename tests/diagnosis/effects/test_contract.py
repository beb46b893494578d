"""The built-in effects are those of contract section 4: names, targets, parameters.

`CONTRACT` is a copy of the contract's table, so that this is checked without it. It is
no place where an effect of another package has to be written.
"""

import re

import pytest

from selfheal.diagnosis.effects import load_catalogue
from tests.support.paths import SHARED

CONTRACT_PAGE = SHARED / "contract.md"
CONTRACT = """
| group | effect: target; parameters [unit] |
|---|---|
| friction | `viscous_friction`: joint; damping [N m s/rad] |
| | `coulomb_friction`: joint; frictionloss [N m] |
| | `stribeck_friction`: joint; coulomb, static [N m], stribeck_velocity [rad/s] |
| | `load_dependent_friction`: joint; load_coefficient [1] (friction torque per transmitted torque) |
| | `asymmetric_friction`: joint; positive, negative [N m] |
| | `quadratic_damping`: joint; damping2 [N m s^2/rad^2] |
| transmission | `backlash`: joint; gap [rad], total width |
| | `compliance`: joint; stiffness [N m/rad], damping [N m s/rad] |
| | `cogging`: joint; amplitude [N m], poles [1] (periods a turn), phase [rad]: torque = amplitude sin(poles q + phase) |
| | `armature`: joint; armature [kg m^2] |
| | `joint_spring`: joint; stiffness [N m/rad], springref [rad] |
| | `joint_coupling`: joint (one of the two); stiffness [N m/rad], ratio [1]: torque = -stiffness (q - ratio q_other) |
| | `hard_stop`: joint; range [rad] (the angle of the stop) |
| actuator | `command_delay`: actuator; delay [s] |
| | `actuator_lag`: actuator; timeconst [s] |
| | `torque_saturation`: actuator; limit [N m] |
| | `speed_torque_limit`: actuator; stall_torque [N m], no_load_speed [rad/s] |
| | `rate_limit`: actuator; rate [rad/s] |
| | `servo_gain`: actuator; kp, kv in the actuator's own units (only where re-fitting them was not open) |
| | `integral_action`: actuator; ki [N m/(rad s)], imax [N m] |
| body | `payload`: body; mass [kg], position [m] in the body frame |
| | `com_shift`: body; x, y, z [m], change, in the body frame |
| | `link_length`: body; length [m], the new absolute length |
| | `mount_shift`: body; x, y, z [m], change of where it is attached to its parent |
| | `limb_loss`: body (the part lost) |
| | `joint_jam`: joint; angle [rad] |
| world | `slope`: world; tilt [rad], azimuth [rad] of the downhill direction from +x towards +y |
| | `fluid_drag`: world or body; density [kg/m^3] or viscosity [Pa s] |
| | `wind`: world; vx, vy, vz [m/s] |
| | `ground_friction`: world or geom; friction [1] |
| | `ground_compliance`: world or geom; timeconst [s], dampratio [1] |
| measurement | reading = round to step (gain x true(t - delay) + bias) |
| | `sensor_bias`: bias [signal's unit] |
| | `sensor_gain`: gain [1] |
| | `sensor_delay`: delay [s] |
| | `quantization`: step [signal's unit] |
"""  # noqa: E501
OWN_UNITS = {"servo_gain": ("kp", "kv")}  # in words, and not in brackets
BEYOND = {"hard_stop": {"timeconst"}}  # parameters that the contract does not name


def _entries(table: str) -> dict[str, tuple[str, str, str]]:
    """Group, target and parameters of each effect, as the table has them."""
    found, group = {}, ""
    for line in table.splitlines():
        own, _, said = line.strip("| ").rpartition(" | ")
        group = own or group
        if effect := re.fullmatch(r"`(\w+)`: (.*)", said):
            target, _, parameters = effect[2].partition("; ")
            if group == "measurement":
                target, parameters = "sensor", effect[2]
            found[effect[1]] = (group, target, parameters)
    return found


def _units(parameters: str) -> dict[str, str | None]:
    """Unit of each parameter; None: the signal's."""
    found: dict[str, str | None] = {}
    for names, unit in re.findall(r"((?:\w+, )*\w+) \[([^\]]+)\]", parameters):
        own = None if unit == "signal's unit" else unit
        found |= dict.fromkeys(names.split(", "), own)
    return found


ENTRIES = _entries(CONTRACT)
BUILT_IN = {
    name: effect
    for name, effect in load_catalogue().items()
    if type(effect).__module__.startswith("selfheal.")
}


def test_every_effect_of_the_contract_can_be_named():
    assert len(ENTRIES) == 35 and set(BUILT_IN) >= set(ENTRIES)


@pytest.mark.parametrize("name", sorted(ENTRIES))
def test_an_effect_is_as_the_contract_has_it(name):
    group, target, parameters = ENTRIES[name]
    effect = BUILT_IN[name]
    assert (effect.name, effect.group) == (name, group)
    kinds = set(re.findall(r"joint|actuator|body|geom|world|sensor", target))
    assert set(effect.target_kinds) <= kinds
    beyond = BEYOND.get(name, ())
    declared = {p.name: p.unit for p in effect.parameters if p.name not in beyond}
    if name in OWN_UNITS:
        assert tuple(declared) == OWN_UNITS[name] and ", ".join(declared) in parameters
    else:
        assert declared == _units(parameters)


def test_the_copy_is_the_contract():
    if not CONTRACT_PAGE.exists():
        pytest.skip("the contract is not beside this repository")
    assert _entries(CONTRACT_PAGE.read_text()) == ENTRIES
