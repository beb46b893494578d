"""Drives as configurations: takes actuators.yaml's content, gives files' texts.

Fields and units are those of Isaac Lab 2.3 (isaaclab.actuators) and of mjlab 1.6
(mjlab.actuator).
"""

import re
import textwrap
from collections.abc import Iterable, Mapping

from ...printable import make_printable
from .actuators import Actuators, JointDrive

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
    "stiffness": "stiffness",
    "damping": "damping",
    "armature": "armature",
    "static_friction": "friction",
    "dynamic_friction": "dynamic_friction",
    "viscous_damping": "viscous_friction",
}
_MJLAB_FIELDS = (
    "stiffness",
    "damping",
    "effort_limit",
    "armature",
    "frictionloss",
    "viscous_damping",
)
_MJLAB_CLASSES = {
    "position": "BuiltinPositionActuatorCfg",
    "velocity": "BuiltinVelocityActuatorCfg",
    "effort": "BuiltinMotorActuatorCfg",
}


def format_yaml(actuators: Actuators) -> str:
    """The text of actuators.yaml."""
    import yaml

    about = f"{_ABOUT.format(model=make_printable(actuators['model']))} {_YAML_HELP}"
    head = textwrap.wrap(about, _WIDTH, initial_indent="# ", subsequent_indent="# ")
    body = yaml.safe_dump(dict(actuators), sort_keys=False, allow_unicode=True)
    return "\n".join([*head, body])


def format_isaac_lab(actuators: Actuators) -> str:
    """The text of actuators_isaaclab.py: groups of joints that have the same fields."""
    groups: dict[tuple[str, ...], list[str]] = {}
    fields = {n: _make_isaac_fields(j) for n, j in actuators["joints"].items()}
    for name, joint in actuators["joints"].items():
        delay = str(joint.get("delay", ""))  # one for each group
        groups.setdefault((delay, *fields[name]), []).append(name)
    code = [
        "from isaaclab.actuators import DelayedPDActuatorCfg, ImplicitActuatorCfg\n",
        f"{_STEP.format(**actuators)}\n\nACTUATORS = {{",
    ]
    for number, ((delay, *own), names) in enumerate(groups.items()):
        kind = "DelayedPDActuatorCfg" if delay else "ImplicitActuatorCfg"
        lines = {"joint_names_expr": repr(_escape(names))}
        for field in own:
            values = {re.escape(n): fields[n][field] for n in names}
            same = len(set(values.values())) == 1
            lines[field] = repr(next(iter(values.values())) if same else values)
        lines |= _format_delay(delay, "min_delay", "max_delay")
        code.append(f'    "group_{number}": {_format_call(kind, lines)}')
    return _finish(actuators, _ISAAC_HELP, [*code, "}"])


def _make_isaac_fields(joint: JointDrive) -> dict[str, object]:
    """Fields of a joint as Isaac Lab names them; gains that it lacks are 0."""
    values: dict[str, object] = {"stiffness": 0.0, "damping": 0.0}
    if "frictionloss" in joint:
        for key in ("static_friction", "dynamic_friction"):
            values[key] = joint["frictionloss"]
    values |= joint
    fields = {new: values[k] for k, new in _ISAAC_FIELDS.items() if k in values}
    if "effort_limit" in joint:  # an explicit drive clips by itself
        name = "effort_limit" if "delay" in joint else "effort_limit_sim"
        fields[name] = joint["effort_limit"]
    return fields


def format_mjlab(actuators: Actuators) -> str:
    """The text of actuators_mjlab.py: groups of joints that have the same values."""
    groups: dict[tuple[str, tuple[tuple[str, str], ...]], list[str]] = {}
    left = []
    for name, joint in actuators["joints"].items():
        control = joint.get("control")
        if control == "effort" and "effort_limit" not in joint:
            left.append(f"joint {name}: a motor of mjlab needs an effort_limit")
        elif control is not None:
            values: dict[str, object] = {**joint}
            if "dynamic_friction" in joint:  # MuJoCo has one dry friction
                values["frictionloss"] = joint["dynamic_friction"]
            fields = {k: repr(values[k]) for k in _MJLAB_FIELDS if k in values}
            delay = str(joint.get("delay", ""))
            fields |= _format_delay(delay, "delay_min_lag", "delay_max_lag")
            key = _MJLAB_CLASSES[control], tuple(fields.items())
            groups.setdefault(key, []).append(name)
    kinds = ", ".join(sorted({kind for kind, _ in groups}))
    code = [f"from mjlab.actuator import {kinds}\n"] if kinds else []
    code.append(f"{_STEP.format(**actuators)}\n\nACTUATORS = (")
    for (kind, pairs), joints in groups.items():
        names = {"target_names_expr": repr(tuple(_escape(joints)))}
        code.append(f"    {_format_call(kind, names | dict(pairs))}")
    return _finish(actuators, _MJLAB_HELP, [*code, ")"], left)


def _escape(names: Iterable[str]) -> list[str]:
    """Regular expressions that fit names, and nothing else."""
    return [re.escape(name) for name in names]


def _format_call(kind: str, fields: Mapping[str, str]) -> str:
    """The call of a class as an entry of a container, a field a line."""
    lines = (f"        {field}={shown}," for field, shown in fields.items())
    return "\n".join([f"{kind}(", *lines, "    ),"])


def _format_delay(delay: str, low: str, high: str) -> dict[str, str]:
    """The two fields of a delay [s], in time steps; none without one."""
    steps = f"round({delay} / PHYSICS_DT)"
    return {low: steps, high: steps} if delay else {}


def _finish(
    actuators: Actuators, use: str, code: list[str], left: Iterable[str] = ()
) -> str:
    """A Python file's text: how to use it, the code, what it leaves out."""
    about = [_ABOUT.format(model=make_printable(actuators["model"])), use]
    head = ["\n".join(textwrap.wrap(text, _WIDTH - 2)) for text in about]
    comments = textwrap.indent("\n\n".join(head), "# ", lambda line: True)
    comments = comments.replace("# \n", "#\n")
    gone = [f"# left out: {make_printable(t)}" for t in (*actuators["left_out"], *left)]
    return "\n".join([comments, "", *code, *gone, ""])
