"""What a model says of the columns that a log of its robot may have."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..recording import (
    Target,
    find_controls,
    find_joint,
    find_output,
    list_controls,
    list_model_names,
)
from ..recording.actuator_laws import find_goal, find_speed_goal, get_servo_gains
from .log_map import COMMAND

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class Place:
    """Something in a model that a column may belong to.

    Attributes:
        kind: of a column there: one of the contract or "command".
        aliases: other names for it: an actuator's joint.
        unit: of the values in the recording.
        width: columns that it takes.
        low: least value that it can have [unit]; -inf where the model states none.
        high: largest one [unit].
        joint: number of the joint it belongs to; -1 if none.
    """

    kind: str
    name: str
    aliases: tuple[str, ...] = ()
    unit: str = ""
    width: int = 1
    low: float = -np.inf
    high: float = np.inf
    joint: int = -1


def list_places(model: "mujoco.MjModel") -> list[Place]:
    """Everything of a compiled model that a column may belong to, in its order."""
    names = list_model_names(model)
    found = list[Place]()
    for name, target in names.targets["joint"].items():
        low, high = target.range or (-np.inf, np.inf)
        position, joint = target.units["joint_position"], model.joint(name).id
        found += [
            Place("joint_position", name, (), position, 1, low, high, joint),
            Place("joint_velocity", name, (), f"{position}/s", joint=joint),
        ]
    for name, target in names.targets["actuator"].items():
        found += _list_actuator(model, name, target)
    found += [
        Place("sensor", name, (), target.units.get("sensor", "1"), target.width or 1)
        for name, target in names.targets["sensor"].items()
    ]
    bodies = [model.body(name) for name in names.targets["body"] if name != "world"]
    for body in sorted(bodies, key=lambda body: model.body_dofnum[body.id] != 6):
        found += [
            Place("body_position", body.name, (), "m", 3),
            Place("body_orientation", body.name, (), "quaternion", 4),
            Place("body_linear_velocity", body.name, (), "m/s", 3),
            Place("body_angular_velocity", body.name, (), "rad/s", 3),
        ]
    return found


def _list_actuator(
    model: "mujoco.MjModel", name: str, target: Target
) -> Iterator[Place]:
    """Commands and force of an actuator, and what else may be measured of it."""
    actuator = model.actuator(name).id
    joint = find_joint(model, actuator)
    aliases = (model.joint(joint).name,) if joint >= 0 else ()
    force = target.units.get("joint_torque", "")
    length = {"N m": "rad", "N": "m"}.get(force, "")
    units = _find_goal_units(model, actuator, length) if length else {}
    controls = list_controls(model)
    for c in find_controls(model, actuator):
        low, high = -np.inf, np.inf
        if model.actuator_ctrllimited[c]:
            low, high = model.actuator_ctrlrange[c]
        full, unit = controls[c].full_name, units.get(c, "")
        yield Place(COMMAND, full, aliases, unit, 1, low, high, joint)
    if force:
        yield Place("joint_torque", name, aliases, force, joint=joint)
    yield Place("supply_voltage", name, aliases, "V")
    yield Place("temperature", name, aliases, "degC")


def _find_goal_units(
    model: "mujoco.MjModel", actuator: int, length: str
) -> dict[int, str]:
    """Units of a servo's goals by their indices into ctrl; none of what is no servo."""
    import mujoco

    found, (gain, _) = dict[int, str](), get_servo_gains(model, actuator)
    integrates = model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_INTEGRATOR
    # another gain than stiffness makes the goal one of another unit
    if np.isclose(gain, -model.actuator_biasprm[actuator, 1]):
        unit = f"{length}/s" if integrates else length  # as of <intvelocity>
        found[find_goal(model, actuator)] = unit
    found[find_speed_goal(model, actuator)] = f"{length}/s"
    found.pop(-1, None)
    return found


def format_servo(model: "mujoco.MjModel", command: str) -> str:
    """MJCF of a position servo that takes the place of an actuator of another kind.

    Its gains are left open. It is as strong as the actuator, as far as the model says
    how strong that is. It has no gear, so that its goal is the joint's position.
    """
    controls = [control.full_name for control in list_controls(model)]
    column = controls.index(command)
    a = next(a for a in range(model.nactuator) if column in find_controls(model, a))
    joint = model.joint(find_joint(model, a)).name
    said = f'<position name="{model.actuator(a).name}" joint="{joint}" kp="KP" kv="KV"'
    limits = find_force_range(model, a)
    return (
        f'{said} forcerange="{limits[0]:g} {limits[1]:g}"/>' if limits else f"{said}/>"
    )


def find_force_range(
    model: "mujoco.MjModel", actuator: int
) -> tuple[float, float] | None:
    """Least and largest torque or force [N m or N] of an actuator of a joint, at it.

    None where the model states none.
    """
    gain = model.actuator_gear[find_output(model, actuator), 0]
    low, high = model.actuator_forcerange[actuator]
    if not model.actuator_forcelimited[actuator]:
        gain *= model.actuator_gainprm[actuator, 0]
        column = find_controls(model, actuator)[0]
        low, high = model.actuator_ctrlrange[column]
        if model.actuator_biastype[actuator] or not model.actuator_ctrllimited[column]:
            return None
    low, high = sorted((float(gain * low), float(gain * high)))
    return low, high


def group_places(places: Sequence[Place]) -> dict[str, list[Place]]:
    """Places by their kind, in the order of the model."""
    found = dict[str, list[Place]]()
    for place in places:
        found.setdefault(place.kind, []).append(place)
    return found
