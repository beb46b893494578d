"""Robots described in a file: a TOML or an MJCF in; what the robot knows of its parts.

What answers is a recording, a Python class, or a simulation of a body that the file
describes and that is hidden from who identifies it.
"""

import fnmatch
import re
from dataclasses import field
from pathlib import Path
from typing import Annotated, cast

import numpy as np
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from ..body.body import Anatomy, Bodies, Floats, count_centers_in_torso
from ..body.genome import HINGE_NAMES, UP, build_bodies, encode_tree
from ..documents import read_toml
from ..engine.channels import SENSOR_KINDS, list_channels
from ..errors import InputError, UnknownNameError
from ..files import check_file
from ..printable import join_names, quote_name
from ..recording import read
from ..schema import is_tree
from .actions import SWING, list_actions_2006
from .base import Robot
from .driver import drive_by_class
from .replay import replay
from .simulated import SimulatedRobot

_STRICT = ConfigDict(extra="forbid")
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Size = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Angle = Annotated[float, Field(ge=-180, le=180)]
SIDES = ("left", "front", "right", "back")  # of a part, in the order of placements
MOST_PARTS = 20  # chosen: a table of pairs of joints is then 210 actions


@checked(frozen=True, config=_STRICT)
class Housing:
    """A box at a part's joint, such as its motor's.

    Attributes:
        size: along the part, across it, and up [m].
        center: along the part [m].
        mass: [kg].
    """

    size: tuple[_Positive, _Positive, _Positive]
    mass: _Positive
    center: _Number = 0.0


@checked(frozen=True, config=_STRICT)
class PartKind:
    """Parts that are alike.

    Attributes:
        length: [m].
        radius: [m].
        mass: of the rod [kg].
        joints: that move them; empty: named as the parts.
        hinge: a name of `HINGE_NAMES`: where a positive angle moves the outer end.
        bend: how far a part leaves its parent downward, at zero angle [deg].
        foot: whether its tip has a touch sensor.
        housing: at the joint.
    """

    names: Annotated[list[str], Field(min_length=1)]
    length: _Positive
    radius: _Positive
    mass: _Positive
    joints: list[str] = field(default_factory=list)
    hinge: str = "up"
    bend: _Angle = 0.0
    foot: bool = False
    housing: Housing | None = None


@checked(frozen=True, config=_STRICT)
class Torso:
    """The part that all others are attached to.

    Attributes:
        size: along x (forward), y (left) and z (up) [m].
        mass: [kg].
        rim: half widths of the rectangle where parts attach, and its height over the
            torso's center [m]; without: the torso's edge.
        fixed: whether it is bolted to the world.
    """

    size: tuple[_Positive, _Positive, _Positive]
    mass: _Positive
    rim: tuple[_Positive, _Positive, _Number] | None = None
    fixed: bool = False


@checked(frozen=True, config=_STRICT)
class Actions:
    """Poses that the robot can hold.

    Attributes:
        swing: one or two joints go down by it, all others up [deg].
        targets: of the joints, a row each pose, instead [deg].
    """

    swing: Annotated[float, Field(gt=0, le=90)] = 30.0
    targets: list[list[_Angle]] = field(default_factory=list)


@checked(frozen=True, config=_STRICT)
class Description:
    """A robot as its file describes it.

    Attributes:
        sensors: as `engine.channels` names them; a `*` stands for all parts, or those
            whose names fit.
        body: of a simulated robot: by part, what it is attached to and at which side of
            that, as "torso left" or, a fifth along that side, "torso left 0.2".
        driver: FILE.py:CLASS of the real one, beside the description.
        ordered: whether a part's parent is the torso or a part listed before it.
    """

    name: str
    torso: Torso
    parts: Annotated[list[PartKind], Field(min_length=1)]
    sensors: list[str] = field(default_factory=lambda: ["tilt", "clearance"])
    actions: Actions = field(default_factory=Actions)
    body: dict[str, str] = field(default_factory=dict)
    driver: str = ""
    ordered: bool = True


def make_anatomy(described: Description) -> Anatomy:
    """What a described robot knows of its parts.

    Raises:
        InputError: names or numbers that do not fit together.
    """
    rows = [(kind, name) for kind in described.parts for name in kind.names]
    names = [name for _, name in rows]
    joints = [j for kind in described.parts for j in _name_joints(kind)]
    for what, given in (("part", names), ("joint", joints)):
        if twice := {n for n in given if given.count(n) > 1}:
            raise InputError(f"two {what}s are named {quote_name(min(twice))}")
    if len(names) > MOST_PARTS:
        raise InputError(f"{len(names)} parts; would fit: at most {MOST_PARTS}")
    kinds = [kind for kind, _ in rows]
    boxes = [kind.housing for kind in kinds]
    half = np.array(described.torso.size) / 2
    bends = np.radians([kind.bend for kind in kinds])
    anatomy = Anatomy(
        name=described.name,
        parts=tuple(names),
        joints=tuple(joints),
        torso_half=half,
        torso_mass=described.torso.mass,
        rim=np.array(described.torso.rim or (half[0], half[1], 0.0)),
        length=np.array([kind.length for kind in kinds]),
        radius=np.array([kind.radius for kind in kinds]),
        mass=np.array([kind.mass for kind in kinds]),
        block_half=np.array([b.size if b else (0.0, 0, 0) for b in boxes]) / 2,
        block_center=np.array([b.center if b else 0.0 for b in boxes]),
        block_mass=np.array([b.mass if b else 0.0 for b in boxes]),
        feet=tuple(i + 1 for i, kind in enumerate(kinds) if kind.foot),
        hinges=_list_hinges(kinds),
        bends=tuple(bends.tolist()) if bends.any() else (),
        fixed=described.torso.fixed,
        ordered=described.ordered,
        sensors=_list_sensors(described.sensors, names),
    )
    list_channels(anatomy)  # refuses what does not fit
    return anatomy


def _name_joints(kind: PartKind) -> list[str]:
    """Names of the joints of parts."""
    if kind.joints and len(kind.joints) != len(kind.names):
        raise InputError(
            f"{len(kind.joints)} joints of {len(kind.names)} parts, the first of them "
            f"{quote_name(kind.names[0])}; would fit: one each, or none"
        )
    return kind.joints or kind.names


def _list_hinges(kinds: list[PartKind]) -> tuple[int, ...]:
    """Kinds of hinges of all parts; none where all lift."""
    for kind in kinds:
        if kind.hinge not in HINGE_NAMES:
            raise UnknownNameError("hinge", kind.hinge, HINGE_NAMES)
    found = tuple(HINGE_NAMES.index(kind.hinge) for kind in kinds)
    return () if set(found) == {UP} else found


def _list_sensors(given: list[str], parts: list[str]) -> tuple[str, ...]:
    """Sensors by name, a `*` as all parts that fit it."""
    found = dict[str, None]()
    for sensor in given:
        kind, _, pattern = sensor.partition(":")
        if "*" not in pattern:
            found[sensor] = None
            continue
        fitting = fnmatch.filter(parts, pattern)
        if not fitting:
            raise UnknownNameError(f"part of sensor {kind}", pattern, parts)
        found |= dict.fromkeys(f"{kind}:{part}" for part in fitting)
    if not found:
        raise InputError(f"a robot needs a sensor: {join_names([*SENSOR_KINDS])}")
    return tuple(found)


def list_actions(described: Description, anatomy: Anatomy) -> Floats:
    """(A, P) joint targets that a described robot offers [rad]."""
    rows = described.actions.targets
    if any(len(row) != anatomy.size for row in rows):
        raise InputError(
            f"a row of actions.targets has no {anatomy.size} angles, one each joint"
        )
    if rows:
        return np.radians(np.unique(np.array(rows), axis=0))
    scale = np.radians(described.actions.swing) / SWING
    return list_actions_2006(anatomy.size) * scale


def _parse_place(part: str, place: str) -> tuple[str, str, float]:
    """What a part is attached to, at which side, and how far along it [1]."""
    match = re.fullmatch(r"(.+?) (\w+)(?: (0?\.\d+))?", place)
    if match is None:
        raise InputError(
            f"body: {part} = {quote_name(place)}; would fit: torso left, or torso left "
            "0.2 for a place near the side's beginning, clockwise as seen from above"
        )
    return match[1], match[2], float(match[3] or 0.5)


def build_truth(described: Description, anatomy: Anatomy) -> Bodies | None:
    """The body that a description has, None where it has none.

    Raises:
        InputError: a part is missing, or its parent does not come before it.
    """
    if not described.body:
        return None
    parent, placement = [], []
    if missing := {*anatomy.parts} ^ {*described.body}:
        raise InputError(f"body and parts differ in {join_names(sorted(missing))}")
    for i, part in enumerate(anatomy.parts):
        on, side, share = _parse_place(part, described.body[part])
        places = ("torso", *anatomy.parts[: i if anatomy.ordered else anatomy.size])
        if on not in places:
            raise UnknownNameError(f"place of {part}", on, places)
        if side not in SIDES:
            raise UnknownNameError(f"side of {on}", side, SIDES)
        parent.append(places.index(on))
        placement.append((SIDES.index(side) + share) / 4)
    genomes = encode_tree(anatomy, np.array(parent), np.array(placement))
    if not is_tree(genomes.parent)[0]:
        raise InputError("a part of the body hangs on itself in the end")
    body = build_bodies(anatomy, genomes)
    if count_centers_in_torso(body)[0]:
        raise InputError("the body has a part within the torso")
    return body


def open_description(path: str, seed: int, recordings: Path | None) -> Robot:
    """The robot of a description.

    Args:
        path: of a TOML, or of an MJCF as `body.mjcf.load` reads it.
        recordings: a file that it answers from, or None.

    Raises:
        InputError: it does not fit, or nothing answers.
    """
    if path.endswith(".xml"):
        from ..body.mjcf import load

        check_file(path)
        body = load(path)
        truth: Bodies | None = body
        anatomy, actions = body.anatomy, list_actions_2006(body.anatomy.size)
        driver = ""
    else:
        described = read_toml(path, Description)
        try:
            anatomy = make_anatomy(described)
            actions = list_actions(described, anatomy)
            truth, driver = build_truth(described, anatomy), described.driver
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
    if recordings is not None:
        return cast(Robot, replay(path, read(recordings), anatomy, truth))
    if driver:
        return cast(Robot, drive_by_class(path, anatomy, actions, driver, truth))
    if truth is not None:
        return cast(Robot, SimulatedRobot(path, truth, seed, offers=actions))
    raise InputError(
        f"{path}: nothing answers for this robot; would fit: --recordings FILE.h5, "
        'driver = "FILE.py:CLASS" in the file, or a [body] that is simulated'
    )
