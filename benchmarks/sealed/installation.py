"""How an effect comes into the hidden robot: takes it, a target and parameters."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.sealed import targets as at
from benchmarks.sealed.hidden_robot import Reading, Truth, scale_gain, stretch
from benchmarks.sealed.magnitudes import Values
from benchmarks.sealed.mjcf import GRAVITY
from benchmarks.sealed.shapers import integral, speed_limit, steady

PLAY = 1e-6  # [kg m^2] rotor inertia of a joint that is added; chosen: negligible
STOP = (0.002, 1.0)  # solref of stops and gaps: as hard as the fine step resolves


def joint_at(truth: Truth, target: str) -> Any:
    return truth.spec.joint(at.name_of(target))


def set_value(key: str) -> Callable[[Truth, str, Values], None]:
    """A value of the joint, under MJCF's own name."""

    def install(truth: Truth, target: str, values: Values) -> None:
        joint = joint_at(truth, target)
        if key == "damping2":
            joint.damping[1] = values[key]
        elif key == "damping":
            joint.damping[0] = values[key]
        else:
            setattr(joint, key, values[key])

    return install


def uneven(truth: Truth, target: str, values: Values) -> None:
    """Dry friction of another level in each direction: a symmetric one and a push."""
    positive, negative = values["positive"], values["negative"]
    joint_at(truth, target).frictionloss = (positive + negative) / 2
    truth.forces.append(steady(at.name_of(target), (negative - positive) / 2))


def add_hinge(truth: Truth, target: str, suffix: str, **settings: Any) -> None:
    """A joint between the motor's joint and the link."""
    joint = joint_at(truth, target)
    name = f"{joint.name}_{suffix}"
    joint.parent.add_joint(
        name=name, type=joint.type, axis=joint.axis, pos=joint.pos, **settings
    )
    truth.plays[joint.name] = name


def backlash(truth: Truth, target: str, values: Values) -> None:
    half = values["gap"] / 2
    add_hinge(
        truth,
        target,
        "play",
        range=[-half, half],
        limited=1,
        armature=PLAY,
        solref_limit=STOP,
    )


def flexible(truth: Truth, target: str, values: Values) -> None:
    add_hinge(truth, target, "flex", armature=PLAY)
    flex = truth.spec.joint(truth.plays[at.name_of(target)])
    flex.stiffness[0], flex.damping[0] = values["stiffness"], values["damping"]


def sprung(truth: Truth, target: str, values: Values) -> None:
    joint = joint_at(truth, target)
    joint.stiffness[0], joint.springref = values["stiffness"], values["springref"]


def coupled(truth: Truth, target: str, values: Values) -> None:
    """A tendon: it also pulls at the other joint."""
    mine = at.name_of(target)
    other = truth.robot.joints[truth.robot.joints.index(mine) - 1]
    tendon = truth.spec.add_tendon(name="belt", springlength=[0.0, 0.0])
    tendon.wrap_joint(mine, 1.0)
    tendon.wrap_joint(other, -values["ratio"])
    tendon.stiffness[0] = values["stiffness"]


def stopped(truth: Truth, target: str, values: Values) -> None:
    joint, angle = joint_at(truth, target), values["range"]
    above = angle > truth.robot.center.get(joint.name, 0.0)
    joint.range = [-10.0, angle] if above else [angle, 10.0]
    joint.limited, joint.solref_limit = 1, (0.005, 1.0)


def shaped(make: Callable[..., Any], key: str) -> Callable[[Truth, str, Values], None]:
    """A shaper of an actuator's command."""

    def install(truth: Truth, target: str, values: Values) -> None:
        chain = truth.shapers.setdefault(at.name_of(target), [])
        chain.append(lambda fine: make(values[key], fine))

    return install


def saturated(truth: Truth, target: str, values: Values) -> None:
    actuator = truth.spec.actuator(at.name_of(target))
    actuator.forcerange = [-values["limit"], values["limit"]]
    actuator.forcelimited = 1


def weak(truth: Truth, target: str, values: Values) -> None:
    truth.spec.actuator(at.name_of(target)).forcerange = [-1.0, 1.0]
    truth.spec.actuator(at.name_of(target)).forcelimited = 1
    joint = at.joint_of(truth.robot, target)
    limits = values["stall_torque"], values["no_load_speed"]
    truth.forces.append(speed_limit(at.name_of(target), joint, *limits))


def gain(truth: Truth, target: str, values: Values) -> None:
    actuator = truth.spec.actuator(at.name_of(target))
    scale_gain(actuator, "kp", values["kp"] / float(actuator.gainprm[0]))


def integrating(truth: Truth, target: str, values: Values) -> None:
    joint = at.joint_of(truth.robot, target)
    truth.forces.append(
        integral(at.name_of(target), joint, values["ki"], values["imax"])
    )


def loaded(truth: Truth, target: str, values: Values) -> None:
    place = [values[f"position_{c}"] for c in "xyz"]
    child = truth.spec.body(at.name_of(target)).add_body(name="payload", pos=place)
    child.explicitinertial, child.mass = True, values["mass"]
    child.inertia = np.full(3, 0.4 * values["mass"] * 0.01**2)


def shifted(truth: Truth, target: str, values: Values) -> None:
    body = truth.spec.body(at.name_of(target))
    body.ipos = body.ipos + [values[c] for c in "xyz"]


def tilted(truth: Truth, target: str, values: Values) -> None:
    tilt, way = values["tilt"], values["azimuth"]
    down = np.array([math.sin(tilt) * math.cos(way), math.sin(tilt) * math.sin(way)])
    truth.spec.option.gravity = GRAVITY * np.r_[down, -math.cos(tilt)]


def medium(truth: Truth, target: str, values: Values) -> None:
    truth.spec.option.density = values["density"]


def blown(truth: Truth, target: str, values: Values) -> None:
    truth.spec.option.wind = [values[c] for c in ("vx", "vy", "vz")]


def slippery(truth: Truth, target: str, values: Values) -> None:
    geoms = at.ground(truth.spec)
    highest = max(g.friction[0] for g in geoms)
    for geom in geoms:
        geom.friction[0] *= values["friction"] / highest


def yielding(truth: Truth, target: str, values: Values) -> None:
    for geom in at.ground(truth.spec):
        geom.solref = [values["timeconst"], values["dampratio"]]


def longer(truth: Truth, target: str, values: Values) -> None:
    link = truth.spec.body(at.name_of(target))
    stretch(link, np.array([1.0, 1.0, values["length"] / at.limb_length(link)]))


def moved(truth: Truth, target: str, values: Values) -> None:
    body = truth.spec.body(at.name_of(target))
    body.pos = body.pos + [values[c] for c in "xyz"]


def gone(truth: Truth, target: str, values: Values) -> None:
    body = truth.spec.body(at.name_of(target))
    body.mass = 1e-4
    body.inertia = np.full(3, 1e-7)
    body.ipos = np.zeros(3)
    for geom in body.geoms:
        geom.contype = geom.conaffinity = 0


def stuck(truth: Truth, target: str, values: Values) -> None:
    joint, angle = at.name_of(target), values["angle"]
    lock = truth.spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
    lock.data[:5] = [angle, 0, 0, 0, 0]
    lock.objtype, lock.solref = mujoco.mjtObj.mjOBJ_JOINT, STOP
    truth.pinned[joint] = angle


def reading(key: str, field: str) -> Callable[[Truth, str, Values], None]:
    def install(truth: Truth, target: str, values: Values) -> None:
        now = truth.readings.get(at.name_of(target), Reading())
        value = values[key]
        if field == "delay":
            value = round(value / truth.robot.fine) * truth.robot.fine
            values[key] = value
        truth.readings[at.name_of(target)] = replace(now, **{field: value})

    return install
