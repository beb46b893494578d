"""Where on a robot findings are: a model and a diagnosis in, places on bodies out."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats
from ..diagnosis.output.result import Diagnosis
from .picture import shorten_label

if TYPE_CHECKING:
    from mujoco import MjModel, mjtObj


@dataclass(frozen=True, eq=False)
class Mark:
    """A place of the robot that findings are about.

    Attributes:
        body: its number.
        point: (3) in the body's frame [m].
        name: of the joint, actuator, body, ... with the effects found there.
    """

    body: int
    point: Floats
    name: str


def find_marks(model: "MjModel", diagnosis: Diagnosis) -> tuple[list[Mark], list[str]]:
    """Where on the robot the findings are, and those that are nowhere on it.

    Args:
        diagnosis: with findings, and signals that say what they read.
    """
    reads = {signal.name: signal.reads for signal in diagnosis.signals}
    effects: dict[str, list[str]] = {}
    for finding in diagnosis.document["findings"]:
        words = finding["effect"].replace("_", " ")
        effects.setdefault(finding["target"], []).append(words)
    marks, elsewhere = [], []
    for target, found in effects.items():
        kind, _, name = target.partition(":")
        if kind == "sensor":  # a signal's name, of which a model knows nothing
            kind, _, element = reads.get(name, "").partition(":")
        else:
            element = name
        place, said = shorten_label(name or target), ", ".join(found)
        body, point = _find_point(model, *_find_element(model, kind, element))
        if body:
            marks.append(Mark(body, point, f"{place}: {said}"))
        else:
            elsewhere.append(f"{said} ({place})")
    return marks, elsewhere


def _find_element(
    model: "MjModel", kind: str, name: str
) -> tuple["mjtObj | None", int]:
    """Type and id of what a target names; None for the world."""
    import mujoco

    if kind not in ("joint", "actuator", "body", "geom", "sensor"):
        return None, 0
    kinds = mujoco.mjtObj.__members__
    return kinds[f"mjOBJ_{kind.upper()}"], int(getattr(model, kind)(name).id)


def _find_point(
    model: "MjModel", kind: "mjtObj | int | None", i: int
) -> tuple[int, Floats]:
    """Body that the i-th object of a type is on and where [m]; body 0: on none."""
    from mujoco import mjtObj, mjtTrn

    if kind == mjtObj.mjOBJ_SENSOR:
        return _find_point(model, model.sensor_objtype[i], int(model.sensor_objid[i]))
    if kind == mjtObj.mjOBJ_ACTUATOR:
        driven = {
            mjtTrn.mjTRN_JOINT: mjtObj.mjOBJ_JOINT,
            mjtTrn.mjTRN_JOINTINPARENT: mjtObj.mjOBJ_JOINT,
            mjtTrn.mjTRN_SITE: mjtObj.mjOBJ_SITE,
            mjtTrn.mjTRN_BODY: mjtObj.mjOBJ_BODY,
        }
        at = driven.get(mjtTrn(int(model.actuator_trntype[i])))
        return _find_point(model, at, int(model.actuator_trnid[i, 0]))
    if kind in (mjtObj.mjOBJ_BODY, mjtObj.mjOBJ_XBODY):
        return i, model.body_ipos[i]
    for own, field in (
        (mjtObj.mjOBJ_JOINT, "jnt"),
        (mjtObj.mjOBJ_GEOM, "geom"),
        (mjtObj.mjOBJ_SITE, "site"),
    ):
        if kind == own:
            body = getattr(model, f"{field}_bodyid")[i]
            return int(body), getattr(model, f"{field}_pos")[i]
    return 0, np.zeros(3)
