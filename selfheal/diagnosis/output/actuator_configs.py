"""Drives as configurations: takes actuators.yaml's content, gives files' texts.

Fields and units are those of Isaac Lab 2.3 (isaaclab.actuators) and of mjlab 1.6
(mjlab.actuator).
"""

import re
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from ...printable import make_printable

_WIDTH = 88  # of a line
_ABOUT = (
    "Joints and drives of {model}, as `selfheal diagnose` left them. Values are those "
    "of the patched model, at the joint, in SI units."
)
_YAML_HELP = (
    "armature in kg m^2; frictionloss, static_friction, dynamic_friction and "
    "effort_limit in N m; stiffness in N m/rad; damping, of the drive, and "
    "viscous_damping, passive, in N m s/rad; delay in s. At a slide read N for N "
    "m and m for rad. gear: of a servo its command over the joint's goal, of "
    "control by effort the effort over the command. identified: what the "
    "diagnosis changed; all else the model states."
)
_ISAAC_HELP = (
    "For Isaac Lab 2.2 or later on Isaac Sim 5, where friction is an effort: "
    "ArticulationCfg(actuators=ACTUATORS, ...)."
)
_MJLAB_HELP = (
    "For mjlab 1.6 or later: EntityArticulationInfoCfg(actuators=ACTUATORS), and an "
    "MJCF without actuators, such as patched.xml without its <actuator>."
)
_STEP = "PHYSICS_DT = {timestep}  # [s] the physics time step of your simulation"
# fields of a joint in Isaac Lab and in mjlab, by their names in actuators.yaml
_ISAAC_FIELDS = {
    "stiffness": "stiffness", "damping": "damping", "armature": "armature",
    "static_friction": "friction", "dynamic_friction": "dynamic_friction",
    "viscous_damping": "viscous_friction",
}  # fmt: skip
_MJLAB_FIELDS = {
    "stiffness": "stiffness", "damping": "damping", "effort_limit": "effort_limit",
    "armature": "armature", "frictionloss": "frictionloss",
    "viscous_damping": "viscous_damping",
}  # fmt: skip
_MJLAB_CLASSES = {"position": "BuiltinPositionActuatorCfg",
                  "velocity": "BuiltinVelocityActuatorCfg",
                  "effort": "BuiltinMotorActuatorCfg"}  # fmt: skip


def format_yaml(actuators: Mapping[str, Any]) -> str:
    """The text of actuators.yaml."""
    import yaml

    about = f"{_ABOUT.format(model=make_printable(actuators['model']))} {_YAML_HELP}"
    head = textwrap.wrap(about, _WIDTH, initial_indent="# ", subsequent_indent="# ")
    body = yaml.safe_dump(dict(actuators), sort_keys=False, allow_unicode=True)
    return "\n".join([*head, body])


def format_isaac_lab(actuators: Mapping[str, Any]) -> str:
    """The text of actuators_isaaclab.py: groups of joints that have the same fields."""
    groups: dict[tuple[str, ...], list[str]] = {}
    fields = {n: _make_isaac_fields(j) for n, j in actuators["joints"].items()}
    for name, joint in actuators["joints"].items():
        delay = str(joint.get("delay", ""))  # one for each group
        groups.setdefault((delay, *fields[name]), []).append(name)
    lines = ["from isaaclab.actuators import DelayedPDActuatorCfg, ImplicitActuatorCfg",
             "", _STEP.format(**actuators), "", "ACTUATORS = {"]  # fmt: skip
    for number, ((delay, *own), names) in enumerate(groups.items()):
        kind = "DelayedPDActuatorCfg" if delay else "ImplicitActuatorCfg"
        lines.append(f'    "group_{number}": {kind}(')
        lines.append(f"        joint_names_expr={_escape(names)},")
        for field in own:
            values = {re.escape(n): fields[n][field] for n in names}
            same = len(set(values.values())) == 1
            shown = next(iter(values.values())) if same else values
            lines.append(f"        {field}={shown!r},")
        lines += _format_delay(delay, "min_delay", "max_delay")
        lines.append("    ),")
    return _finish(actuators, _ISAAC_HELP, [*lines, "}"])


def _make_isaac_fields(joint: Mapping[str, Any]) -> dict[str, float]:
    """Fields of a joint as Isaac Lab names them; gains that it lacks are 0."""
    dry = joint.get("frictionloss")
    both = {} if dry is None else {"static_friction": dry, "dynamic_friction": dry}
    values = {"stiffness": 0.0, "damping": 0.0, **both, **joint}
    fields = {new: values[k] for k, new in _ISAAC_FIELDS.items() if k in values}
    if "effort_limit" in joint:  # an explicit drive clips by itself
        name = "effort_limit" if "delay" in joint else "effort_limit_sim"
        fields[name] = joint["effort_limit"]
    return fields


def format_mjlab(actuators: Mapping[str, Any]) -> str:
    """The text of actuators_mjlab.py: groups of joints that have the same values."""
    groups: dict[str, list[str]] = {}  # names of joints by what follows them
    kinds, left = set(), []
    for name, joint in actuators["joints"].items():
        control = joint.get("control")
        has_limit = control != "effort" or "effort_limit" in joint
        if not has_limit:
            left.append(f"joint {name}: a motor of mjlab needs an effort_limit")
        if control is None or not has_limit:
            continue
        kinds.add(kind := _MJLAB_CLASSES[control])
        values = dict(joint)
        if "dynamic_friction" in joint:  # MuJoCo has one dry friction
            values["frictionloss"] = joint["dynamic_friction"]
        lines = [f"        {new}={values[k]!r},"
                 for k, new in _MJLAB_FIELDS.items() if k in values]  # fmt: skip
        delay = str(joint.get("delay", ""))
        lines += _format_delay(delay, "delay_min_lag", "delay_max_lag")
        groups.setdefault("\n".join([kind, *lines]), []).append(name)
    names = ", ".join(sorted(kinds))
    code = [f"from mjlab.actuator import {names}", ""] if kinds else []
    code += [_STEP.format(**actuators), "", "ACTUATORS = ("]
    for text, joints in groups.items():
        kind, _, rest = text.partition("\n")
        code += [f"    {kind}(", f"        target_names_expr={tuple(_escape(joints))},"]
        code += [rest, "    ),"]
    return _finish(actuators, _MJLAB_HELP, [*code, ")"], left)


def _escape(names: Iterable[str]) -> list[str]:
    """Regular expressions that fit names, and nothing else."""
    return [re.escape(name) for name in names]


def _format_delay(delay: str, low: str, high: str) -> list[str]:
    """Lines of the two fields of a delay, in time steps; none without one.

    Args:
        delay: as text [s].
        low: name of the field of the least delay.
    """
    steps = f"round({delay} / PHYSICS_DT)"
    return [f"        {field}={steps}," for field in (low, high)] if delay else []


def _finish(
    actuators: Mapping[str, Any], use: str, code: list[str], left: Iterable[str] = ()
) -> str:
    """A Python file's text: how to use it, the code, what it leaves out."""
    model = make_printable(actuators["model"])
    about = [_ABOUT.format(model=model), use]
    head = [line for text in about for line in ("#", *textwrap.wrap(text, _WIDTH - 2))]
    comments = [f"# {line}".rstrip() if line != "#" else line for line in head[1:]]
    gone = [f"# left out: {make_printable(t)}" for t in (*actuators["left_out"], *left)]
    return "\n".join([*comments, "", *code, *gone, ""])
