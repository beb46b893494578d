"""Changed actuators as edits of text: takes two models, gives MJCF attributes."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...mjcf.edit import Edit, Rename, Set, format_number
from ...recording import find_controls, find_output
from .model_source import (
    Attributes,
    ModelSource,
    differs,
    edit_attributes,
    name_or_id,
)

if TYPE_CHECKING:
    from mujoco import MjModel

# attributes of the kinds of actuators that a <general> one does not have
SHORT = dict.fromkeys(
    "kp kv gain dampratio timeconst inheritrange diameter area bias".split()
)
DYNAMICS = {1: "integrator", 2: "filter", 3: "filterexact"}  # mjtDyn
AFFINE = 1  # mjtGain, mjtBias


def edit_actuators(
    source: ModelSource, old: "MjModel", new: "MjModel", before: Sequence[Edit]
) -> Iterator[Edit]:
    """Edits of the actuators that differ between two models.

    Args:
        old: compiled, as the text states it.
        new: compiled, as the text is to be.
        before: edits that come first, and may make an actuator a <general> one.
    """
    general = {e.name for e in before if isinstance(e, Rename)}
    for a in range(new.nactuator):
        name = name_or_id(old.actuator, a)
        given = source.actuator_tag(old.actuator(a).name, a)
        tag = "general" if name in general else given
        attributes = _edit_force_law(tag, old, new, a)
        to = "general" if "gainprm" in attributes else tag
        if to == tag and differs(old.actuator_dynprm[a, 0], new.actuator_dynprm[a, 0]):
            attribute = "dynprm" if tag == "general" else "timeconst"
            attributes[attribute] = format_number(new.actuator_dynprm[a, 0])
        gear = new.actuator_gear[out := find_output(new, a)]
        if differs(old.actuator_gear[out], gear):
            attributes["gear"] = format_number(gear[: np.flatnonzero(gear)[-1] + 1])
        ranges = [m.actuator_forcerange[a] for m in (old, new)]
        limited = [m.actuator_forcelimited[a] for m in (old, new)]
        if differs(*limited) or differs(*ranges):
            attributes["forcelimited"] = "true"
            attributes["forcerange"] = format_number(ranges[1])
        for control in find_controls(new, a):
            fields = {"actuator_ctrlrange": "ctrlrange"}
            attributes |= edit_attributes(old, new, control, fields)
        attributes |= _keep_inherited_range(source, old, new, a, to != given)
        if attributes and to != tag:
            yield Rename("actuator", name, to, attributes)
        elif attributes:
            yield Set("actuator", name, attributes)


def _edit_force_law(tag: str, old: "MjModel", new: "MjModel", a: int) -> Attributes:
    """Attributes of gain and bias where they differ, in the form that the tag has.

    A tag that has no such form gets those of <general>.
    """
    gain, bias = new.actuator_gainprm[a, :3], new.actuator_biasprm[a, :3]
    before = [old.actuator_gainprm[a, :3], old.actuator_biasprm[a, :3]]
    if not differs(before, [gain, bias]):
        return {}
    if tag == "pid":
        integral = {"ki": format_number(gain[0])} if gain[0] else {}
        kp, kv = format_number(-bias[1]), format_number(-bias[2])
        return {"kp": kp, "kv": kv, "dampratio": None, **integral}
    if tag == "general":
        return {"gainprm": format_number(gain), "biasprm": format_number(bias)}
    is_servo = not differs([gain[0], *bias[:2]], [-bias[1], 0, bias[1]])
    if tag in ("position", "intvelocity") and is_servo:
        kp, kv = format_number(gain[0]), format_number(-bias[2])
        return {"kp": kp, "kv": kv, "dampratio": None}
    if tag == "velocity" and not differs([gain[0], *bias[:2]], [-bias[2], 0, 0]):
        return {"kv": format_number(gain[0])}
    attributes: Attributes = {
        **SHORT,
        "gaintype": "affine" if new.actuator_gaintype[a] == AFFINE else "fixed",
        "gainprm": format_number(gain),
        "biastype": "affine" if bias.any() else "none",
        "biasprm": format_number(bias),
    }
    if kind := DYNAMICS.get(int(new.actuator_dyntype[a])):
        dynprm = format_number(new.actuator_dynprm[a, 0])
        attributes |= {"dyntype": kind, "dynprm": dynprm}
    return attributes


def _keep_inherited_range(
    source: ModelSource, old: "MjModel", new: "MjModel", a: int, general: bool
) -> Attributes:
    """Attributes that keep the range that an actuator took from its joint.

    Args:
        general: whether it becomes a <general> one, which inherits no range.
    """
    joint = int(new.actuator_trnid[a, 0])
    if not source.spec.actuators[a].inheritrange:
        return {}
    if not general and not differs(old.jnt_range[joint], new.jnt_range[joint]):
        return {}
    which = "act" if new.actuator_actlimited[a] else "ctrl"
    row = a if which == "act" else find_controls(new, a)[0]
    value = format_number(getattr(new, f"actuator_{which}range")[row])
    return {f"{which}range": value, "inheritrange": None if general else "0"}
