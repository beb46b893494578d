"""The effects that are concealed: takes a robot, gives edits of its hidden self.

An implementation of its own of contract section 4: nothing of `selfheal.diagnosis` is
used, so that an error there cannot hide in the truth.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from _sealed_robots import GRAVITY, Draw, Robot
from _sealed_shapers import (
    cogging,
    delayed,
    integral,
    lagged,
    load_friction,
    slewed,
    speed_limit,
    steady,
    stribeck,
)
from _sealed_truth import Reading, Truth, scale_gain, stretch

Rng = np.random.Generator
Values = dict[str, float]
Sized = Callable[[float], Values]
PLAY = 1e-6  # [kg m^2] rotor inertia of a joint that is added; chosen: negligible
STOP = (0.002, 1.0)  # solref of stops and gaps: as hard as the fine step resolves


@dataclass(frozen=True)
class Effect:
    """One concealed effect.

    Attributes:
        name: of contract section 4.
        targets: where it can be on a robot; empty: nowhere.
        draw: gives a function from a size (about 1) to its parameters.
        install: puts it into the hidden robot.
        sizes: smallest and largest size that is still sane.
        units: of its parameters.
        zeroes: values that the given model must not state, "{}" being the target.
        density: [kg/m^3] of the medium that the given model states.
    """

    name: str
    targets: Callable[[Robot], Sequence[str]]
    draw: Callable[[Robot, str, Rng], Sized]
    install: Callable[[Truth, str, Values], None]
    units: Mapping[str, str]
    sizes: tuple[float, float] = (0.05, 20.0)
    zeroes: tuple[str, ...] = ()
    density: tuple[float, ...] = ()


# ---------------------------------------------------------------- where they can be


def _limbs(robot: Robot) -> bool:
    return robot.free == "torso"


def _joints(robot: Robot) -> list[str]:
    return [f"joint:{j}" for j in robot.joints]


def _driven(robot: Robot) -> list[str]:
    return [f"joint:{j}" for j in robot.actuators.values()]


def _passive(robot: Robot) -> list[str]:
    """Joints without a motor, or all where each has one."""
    free = [j for j in robot.joints if j not in robot.actuators.values()]
    return [f"joint:{j}" for j in free or robot.joints]


def _arm_joints(robot: Robot) -> list[str]:
    return [] if _limbs(robot) else _joints(robot)


def _arm_driven(robot: Robot) -> list[str]:
    arms = robot.drive != "none" and not _limbs(robot) and robot.name != "cartpole"
    return _driven(robot) if arms else []


def _actuators(robot: Robot) -> list[str]:
    return [f"actuator:{a}" for a in robot.actuators]


def _servos(robot: Robot) -> list[str]:
    return _actuators(robot) if robot.drive == "servo" else []


def _arm_servos(robot: Robot) -> list[str]:
    return [] if _limbs(robot) else _servos(robot)


def _hinged(robot: Robot) -> list[str]:
    """Coupled pairs: the joint that is named is the first of two hinges."""
    names = {"arm2_servo", "arm2_torque", "arm3", "double_pendulum"}
    return ["joint:" + robot.joints[-1]] if robot.name in names else []


def _signals(robot: Robot) -> list[str]:
    return [f"sensor:{j}_position" for j in robot.joints]


def _loads(robot: Robot) -> list[str]:
    if robot.free:
        return [f"body:{robot.free}"]
    return [f"body:{b}" for b in robot.links if b != "cart"]


def _eccentric(robot: Robot) -> list[str]:
    """Bodies whose center can be seen to move; on one link it is a sensor's bias."""
    return [] if robot.name == "pendulum" else _loads(robot)


def _tilting(robot: Robot) -> list[str]:
    return [] if robot.name == "pendulum" else ["world"]


def _airy(robot: Robot) -> list[str]:
    names = ("pendulum", "double_pendulum", "cartpole", "toss_box", "toss_stick")
    return ["world"] if robot.name in names else []


def _floor(robot: Robot) -> list[str]:
    return ["world"] if robot.contact else []


def _long(robot: Robot) -> list[str]:
    if _limbs(robot):
        return [f"body:{b}" for b in robot.links if b.endswith("lower")]
    names = ("arm2_servo", "arm2_torque", "arm3", "double_pendulum")
    return [f"body:{robot.links[0]}"] if robot.name in names else []


def _mounted(robot: Robot) -> list[str]:
    if _limbs(robot):
        return [f"body:{b}" for b in robot.links if b.endswith("upper")]
    names = ("arm2_servo", "arm2_torque", "double_pendulum")
    return ["body:link2"] if robot.name in names else []


def _lost(robot: Robot) -> list[str]:
    return [f"body:{b}" for b in robot.links if "lower" in b] if _limbs(robot) else []


def _jammed(robot: Robot) -> list[str]:
    multiple = robot.name in ("arm2_servo", "arm3", "quadruped")
    return _joints(robot)[1:] if multiple else []


# ---------------------------------------------------------------- their sizes


def _name(target: str) -> str:
    return target.partition(":")[2]


def _joint_of(robot: Robot, target: str) -> str:
    """The joint of a joint, actuator or joint position signal."""
    kind, _, name = target.partition(":")
    if kind == "actuator":
        return robot.actuators[name]
    return name.removesuffix("_position")


def _load(robot: Robot, target: str) -> float:
    return robot.load[_joint_of(robot, target)]


def _speed(robot: Robot, target: str) -> float:
    """Typical speed of a joint [rad/s]: its motion once a second."""
    return 2 * math.pi * robot.amplitude[_joint_of(robot, target)] / 2


def _number(key: str, value: float, signed: bool = False):
    """One parameter that starts from a plain number."""

    def draw(robot: Robot, target: str, rng: Rng) -> Sized:
        sign = rng.choice([-1.0, 1.0]) if signed else 1.0
        return lambda size: {key: sign * size * value}

    return draw


def _stated(robot: Robot, target: str, key: str) -> float:
    """Smallest value of a joint that no refit of the given one may reach."""
    joint = mujoco.MjSpec.from_string(robot.xml).joint(_name(target))
    return 1.35 * float(np.ravel(getattr(joint, key))[0])


def _damping(robot: Robot, target: str, rng: Rng) -> Sized:
    base = _load(robot, target) / _speed(robot, target)
    least = _stated(robot, target, "damping")
    return lambda size: {"damping": least + 0.15 * size * base}


def _dry(robot: Robot, target: str, rng: Rng) -> Sized:
    least, base = _stated(robot, target, "frictionloss"), _load(robot, target)
    return lambda size: {"frictionloss": least + 0.12 * size * base}


def _damping2(robot: Robot, target: str, rng: Rng) -> Sized:
    base = _load(robot, target) / _speed(robot, target) ** 2
    return lambda size: {"damping2": 0.15 * size * base}


def _stribeck(robot: Robot, target: str, rng: Rng) -> Sized:
    ratio, slow = rng.uniform(2.0, 3.5), rng.uniform(0.05, 0.2)
    base = 0.08 * _load(robot, target)

    def values(size: float) -> Values:
        coulomb = size * base
        static = ratio * coulomb
        return {
            "coulomb": coulomb,
            "static": static,
            "stribeck_velocity": slow * _speed(robot, target) / 4,
        }

    return values


def _asymmetric(robot: Robot, target: str, rng: Rng) -> Sized:
    base, uneven = 0.1 * _load(robot, target), rng.uniform(2.0, 4.0)
    pair = rng.permutation([1.0, uneven])
    return lambda s: {"positive": s * base * pair[0], "negative": s * base * pair[1]}


def _compliance(robot: Robot, target: str, rng: Rng) -> Sized:
    base, lossy = 15 * _load(robot, target), rng.uniform(0.002, 0.008)
    return lambda s: {"stiffness": base / s, "damping": lossy * base / s}


def _ripple(robot: Robot, target: str, rng: Rng) -> Sized:
    poles, phase = float(rng.integers(6, 25)), rng.uniform(0, 2 * math.pi)
    if robot.name == "cartpole" and target == "joint:j1":
        poles *= 4
    base = 0.15 * _load(robot, target)
    return lambda s: {"amplitude": s * base, "poles": poles, "phase": phase}


def _armature(robot: Robot, target: str, rng: Rng) -> Sized:
    typical = _load(robot, target) / GRAVITY * 0.1
    if robot.name == "cartpole" and target == "joint:j1":
        typical = 0.5
    least = _stated(robot, target, "armature")
    return lambda s: {"armature": least + 0.5 * s * typical}


def _spring(robot: Robot, target: str, rng: Rng) -> Sized:
    rest = rng.uniform(-0.4, 0.4) * robot.amplitude[_name(target)]
    base = 0.25 * _load(robot, target) / robot.amplitude[_name(target)]
    return lambda s: {"stiffness": s * base, "springref": rest}


def _coupling(robot: Robot, target: str, rng: Rng) -> Sized:
    ratio = rng.choice([-1, 1]) * rng.uniform(0.5, 1.2)
    base = 0.25 * _load(robot, target)
    return lambda s: {"stiffness": s * base, "ratio": ratio}


def _stop(robot: Robot, target: str, rng: Rng) -> Sized:
    joint = _name(target)
    side, reach = rng.choice([-1, 1]), robot.amplitude[joint]
    middle = robot.center.get(joint, 0.0)
    return lambda s: {"range": middle + side * reach * max(0.8 - 0.2 * s, 0.15)}


def _limit(robot: Robot, target: str, rng: Rng) -> Sized:
    load = _load(robot, target)
    return lambda s: {"limit": load * max(1.6 / (1 + 0.5 * s), 0.15)}


def _motor(robot: Robot, target: str, rng: Rng) -> Sized:
    load, speed = _load(robot, target), _speed(robot, target)
    stall = rng.uniform(2.0, 3.5)

    def values(size: float) -> Values:
        soft = 1 / (1 + 0.4 * size)
        return {
            "stall_torque": stall * load * (0.5 + soft),
            "no_load_speed": 3.0 * speed * soft,
        }

    return values


def _rate(robot: Robot, target: str, rng: Rng) -> Sized:
    speed = _speed(robot, target)
    return lambda s: {"rate": 2.0 * speed / (1 + s)}


def _kp(robot: Robot, target: str, rng: Rng) -> Sized:
    spec = mujoco.MjSpec.from_string(robot.xml)
    actuator, more = spec.actuator(_name(target)), rng.random() < 0.4
    given = float(actuator.gainprm[0])
    if more:
        return lambda s: {"kp": given * (1.4 + 0.5 * s)}
    return lambda s: {"kp": given * max(0.65 / (1 + 0.4 * s), 0.2)}


def _integral(robot: Robot, target: str, rng: Rng) -> Sized:
    load = _load(robot, target)
    return lambda s: {"ki": 10 * load * s, "imax": 0.6 * load}


def _payload(robot: Robot, target: str, rng: Rng) -> Sized:
    spec = mujoco.MjSpec.from_string(robot.xml)
    model = spec.compile()
    body = model.body(_name(target))
    mass = body.mass[0]
    if robot.free:
        place = rng.uniform(-0.03, 0.03, 3)
    else:
        place = np.array([0, 0, 2 * body.ipos[2] * rng.uniform(0.7, 1.0)])
    names = dict(zip(("position_x", "position_y", "position_z"), place, strict=True))
    return lambda s: {"mass": 0.35 * s * mass, **names}


def _shift(robot: Robot, target: str, rng: Rng) -> Sized:
    """A center of mass that moves across the link, where hinges can see it."""
    direction = rng.normal(size=3)
    if not robot.free:
        direction *= [1.0, 0.0, 0.3]
    direction /= np.linalg.norm(direction)
    scale = 0.012 if not robot.contact else 0.008
    return lambda s: dict(zip("xyz", s * scale * direction, strict=True))


def _slope(robot: Robot, target: str, rng: Rng) -> Sized:
    planar = not robot.free and robot.name != "arm3"
    azimuth = rng.choice([0.0, math.pi]) if planar else rng.uniform(-math.pi, math.pi)
    return lambda s: {"tilt": 0.04 * s, "azimuth": azimuth}


def _wind(robot: Robot, target: str, rng: Rng) -> Sized:
    azimuth = rng.uniform(-0.4, 0.4) + rng.choice([0, math.pi])
    speed = 3.0
    direction = [math.cos(azimuth), math.sin(azimuth) if robot.free else 0.0, 0.0]
    return lambda s: dict(
        zip(("vx", "vy", "vz"), [speed * s * d for d in direction], strict=True)
    )


def _grip(robot: Robot, target: str, rng: Rng) -> Sized:
    spec = mujoco.MjSpec.from_string(robot.xml)
    spec.compile()
    given = max(float(g.friction[0]) for g in _ground(spec))
    if rng.random() < 0.35:
        return lambda s: {"friction": given * (1.35 + 0.4 * s)}
    return lambda s: {"friction": given * max(0.65 / (1 + 0.5 * s), 0.1)}


def _soft(robot: Robot, target: str, rng: Rng) -> Sized:
    ratio = rng.uniform(0.5, 1.0)
    return lambda s: {"timeconst": 0.02 * (1 + s), "dampratio": ratio}


def _length(robot: Robot, target: str, rng: Rng) -> Sized:
    spec = mujoco.MjSpec.from_string(robot.xml)
    length, sign = limb_length(spec.body(_name(target))), rng.choice([-1, 1])
    return lambda s: {"length": length * max(1 + sign * (0.06 + 0.08 * s), 0.4)}


def limb_length(link: Any) -> float:
    """Distance [m] from a link's joint to the next one, or to its foot."""
    ends = [b.pos for b in link.bodies] + [g.pos for g in link.geoms]
    return float(max(np.linalg.norm(p) for p in ends))


def _mount(robot: Robot, target: str, rng: Rng) -> Sized:
    if _limbs(robot):
        direction = rng.normal(size=3) * [1, 0.3, 1]
    else:
        direction = rng.normal(size=3) * [1, 0, 0.3]
    direction /= np.linalg.norm(direction)
    return lambda s: dict(zip("xyz", 0.012 * s * direction, strict=True))


def _none(robot: Robot, target: str, rng: Rng) -> Sized:
    return lambda s: {}


def _angle(robot: Robot, target: str, rng: Rng) -> Sized:
    joint = _name(target)
    angle = robot.center.get(joint, 0.0) + robot.amplitude[joint] * rng.uniform(-1, 1)
    return lambda s: {"angle": angle * 0.7}


# ---------------------------------------------------------------- how they are put in


def _joint(truth: Truth, target: str) -> Any:
    return truth.spec.joint(_name(target))


def _set(key: str) -> Callable[[Truth, str, Values], None]:
    """A value of the joint, under MJCF's own name."""

    def install(truth: Truth, target: str, values: Values) -> None:
        joint = _joint(truth, target)
        if key == "damping2":
            joint.damping[1] = values[key]
        elif key == "damping":
            joint.damping[0] = values[key]
        else:
            setattr(joint, key, values[key])

    return install


def _uneven(truth: Truth, target: str, values: Values) -> None:
    """Dry friction of another level in each direction: a symmetric one and a push."""
    positive, negative = values["positive"], values["negative"]
    _joint(truth, target).frictionloss = (positive + negative) / 2
    truth.forces.append(steady(_name(target), (negative - positive) / 2))


def _add_hinge(truth: Truth, target: str, suffix: str, **settings: Any) -> None:
    """A joint between the motor's joint and the link."""
    joint = _joint(truth, target)
    name = f"{joint.name}_{suffix}"
    joint.parent.add_joint(
        name=name, type=joint.type, axis=joint.axis, pos=joint.pos, **settings
    )
    truth.plays[joint.name] = name


def _backlash(truth: Truth, target: str, values: Values) -> None:
    half = values["gap"] / 2
    _add_hinge(
        truth,
        target,
        "play",
        range=[-half, half],
        limited=1,
        armature=PLAY,
        solref_limit=STOP,
    )


def _flexible(truth: Truth, target: str, values: Values) -> None:
    _add_hinge(truth, target, "flex", armature=PLAY)
    flex = truth.spec.joint(truth.plays[_name(target)])
    flex.stiffness[0], flex.damping[0] = values["stiffness"], values["damping"]


def _sprung(truth: Truth, target: str, values: Values) -> None:
    joint = _joint(truth, target)
    joint.stiffness[0], joint.springref = values["stiffness"], values["springref"]


def _coupled(truth: Truth, target: str, values: Values) -> None:
    """A tendon: it also pulls at the other joint."""
    mine = _name(target)
    other = truth.robot.joints[truth.robot.joints.index(mine) - 1]
    tendon = truth.spec.add_tendon(name="belt", springlength=[0.0, 0.0])
    tendon.wrap_joint(mine, 1.0)
    tendon.wrap_joint(other, -values["ratio"])
    tendon.stiffness[0] = values["stiffness"]


def _stopped(truth: Truth, target: str, values: Values) -> None:
    joint, angle = _joint(truth, target), values["range"]
    above = angle > truth.robot.center.get(joint.name, 0.0)
    joint.range = [-10.0, angle] if above else [angle, 10.0]
    joint.limited, joint.solref_limit = 1, (0.005, 1.0)


def _shaped(make: Callable[..., Any], key: str) -> Callable[[Truth, str, Values], None]:
    """A shaper of an actuator's command."""

    def install(truth: Truth, target: str, values: Values) -> None:
        chain = truth.shapers.setdefault(_name(target), [])
        chain.append(lambda fine: make(values[key], fine))

    return install


def _saturated(truth: Truth, target: str, values: Values) -> None:
    actuator = truth.spec.actuator(_name(target))
    actuator.forcerange = [-values["limit"], values["limit"]]
    actuator.forcelimited = 1


def _weak(truth: Truth, target: str, values: Values) -> None:
    truth.spec.actuator(_name(target)).forcerange = [-1.0, 1.0]
    truth.spec.actuator(_name(target)).forcelimited = 1
    joint = _joint_of(truth.robot, target)
    limits = values["stall_torque"], values["no_load_speed"]
    truth.forces.append(speed_limit(_name(target), joint, *limits))


def _gain(truth: Truth, target: str, values: Values) -> None:
    actuator = truth.spec.actuator(_name(target))
    scale_gain(actuator, "kp", values["kp"] / float(actuator.gainprm[0]))


def _integrating(truth: Truth, target: str, values: Values) -> None:
    joint = _joint_of(truth.robot, target)
    truth.forces.append(integral(_name(target), joint, values["ki"], values["imax"]))


def _loaded(truth: Truth, target: str, values: Values) -> None:
    place = [values[f"position_{c}"] for c in "xyz"]
    child = truth.spec.body(_name(target)).add_body(name="payload", pos=place)
    child.explicitinertial, child.mass = True, values["mass"]
    child.inertia = np.full(3, 0.4 * values["mass"] * 0.01**2)


def _shifted(truth: Truth, target: str, values: Values) -> None:
    body = truth.spec.body(_name(target))
    body.ipos = body.ipos + [values[c] for c in "xyz"]


def _tilted(truth: Truth, target: str, values: Values) -> None:
    tilt, way = values["tilt"], values["azimuth"]
    down = np.array([math.sin(tilt) * math.cos(way), math.sin(tilt) * math.sin(way)])
    truth.spec.option.gravity = GRAVITY * np.r_[down, -math.cos(tilt)]


def _medium(truth: Truth, target: str, values: Values) -> None:
    truth.spec.option.density = values["density"]


def _blown(truth: Truth, target: str, values: Values) -> None:
    truth.spec.option.wind = [values[c] for c in ("vx", "vy", "vz")]


def _ground(spec: Any) -> list[Any]:
    closed = [g for g in spec.geoms if g.contype or g.conaffinity]
    return closed


def _slippery(truth: Truth, target: str, values: Values) -> None:
    geoms = _ground(truth.spec)
    highest = max(g.friction[0] for g in geoms)
    for geom in geoms:
        geom.friction[0] *= values["friction"] / highest


def _yielding(truth: Truth, target: str, values: Values) -> None:
    for geom in _ground(truth.spec):
        geom.solref = [values["timeconst"], values["dampratio"]]


def _longer(truth: Truth, target: str, values: Values) -> None:
    link = truth.spec.body(_name(target))
    stretch(link, np.array([1.0, 1.0, values["length"] / limb_length(link)]))


def _moved(truth: Truth, target: str, values: Values) -> None:
    body = truth.spec.body(_name(target))
    body.pos = body.pos + [values[c] for c in "xyz"]


def _gone(truth: Truth, target: str, values: Values) -> None:
    body = truth.spec.body(_name(target))
    body.mass = 1e-4
    body.inertia = np.full(3, 1e-7)
    body.ipos = np.zeros(3)
    for geom in body.geoms:
        geom.contype = geom.conaffinity = 0


def _stuck(truth: Truth, target: str, values: Values) -> None:
    joint, angle = _name(target), values["angle"]
    lock = truth.spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
    lock.data[:5] = [angle, 0, 0, 0, 0]
    lock.objtype, lock.solref = mujoco.mjtObj.mjOBJ_JOINT, STOP
    truth.pinned[joint] = angle


def _read(key: str, field: str) -> Callable[[Truth, str, Values], None]:
    def install(truth: Truth, target: str, values: Values) -> None:
        now = truth.readings.get(_name(target), Reading())
        value = values[key]
        if field == "delay":
            value = round(value / truth.robot.fine) * truth.robot.fine
            values[key] = value
        truth.readings[_name(target)] = replace(now, **{field: value})

    return install


def _sensor_gain(robot: Robot, target: str, rng: Rng) -> Sized:
    sign = rng.choice([-1, 1])
    return lambda s: {"gain": max(1 + sign * 0.05 * s, 0.3)}


TORQUE, ANGLE = "N m", "rad"
SHIFT = {"x": "m", "y": "m", "z": "m"}
EFFECTS: Sequence[Effect] = (
    Effect(
        "viscous_friction",
        _joints,
        _damping,
        _set("damping"),
        {"damping": "N m s/rad"},
    ),
    Effect(
        "coulomb_friction",
        _joints,
        _dry,
        _set("frictionloss"),
        {"frictionloss": TORQUE},
    ),
    Effect(
        "stribeck_friction",
        _arm_joints,
        _stribeck,
        lambda truth, target, v: truth.forces.append(stribeck(_name(target), **v)),
        {"coulomb": TORQUE, "static": TORQUE, "stribeck_velocity": "rad/s"},
        zeroes=("frictionloss:{}",),
    ),
    Effect(
        "load_dependent_friction",
        _arm_driven,
        _number("load_coefficient", 0.15),
        lambda truth, target, v: truth.forces.append(load_friction(_name(target), **v)),
        {"load_coefficient": "1"},
        sizes=(0.05, 4.0),
    ),
    Effect(
        "asymmetric_friction",
        _arm_joints,
        _asymmetric,
        _uneven,
        {"positive": TORQUE, "negative": TORQUE},
        zeroes=("frictionloss:{}",),
    ),
    Effect(
        "quadratic_damping",
        _arm_joints,
        _damping2,
        _set("damping2"),
        {"damping2": "N m s^2/rad^2"},
    ),
    Effect("backlash", _arm_driven, _number("gap", 0.02), _backlash, {"gap": ANGLE}),
    Effect(
        "compliance",
        _arm_driven,
        _compliance,
        _flexible,
        {"stiffness": "N m/rad", "damping": "N m s/rad"},
        sizes=(0.02, 10.0),
    ),
    Effect(
        "armature",
        _arm_joints,
        _armature,
        _set("armature"),
        {"armature": "kg m^2"},
        zeroes=("armature:{}?",),
    ),
    Effect(
        "joint_spring",
        _joints,
        _spring,
        _sprung,
        {"stiffness": "N m/rad", "springref": ANGLE},
    ),
    Effect(
        "command_delay",
        _actuators,
        _number("delay", 0.01),
        _shaped(delayed, "delay"),
        {"delay": "s"},
        sizes=(0.1, 10.0),
    ),
    Effect(
        "actuator_lag",
        _actuators,
        _number("timeconst", 0.02),
        _shaped(lagged, "timeconst"),
        {"timeconst": "s"},
        sizes=(0.05, 10.0),
    ),
    Effect("torque_saturation", _actuators, _limit, _saturated, {"limit": TORQUE}),
    Effect(
        "speed_torque_limit",
        _arm_servos,
        _motor,
        _weak,
        {"stall_torque": TORQUE, "no_load_speed": "rad/s"},
    ),
    Effect("servo_gain", _servos, _kp, _gain, {"kp": "N m/rad"}, sizes=(0.05, 6.0)),
    Effect(
        "payload",
        _loads,
        _payload,
        _loaded,
        {"mass": "kg", "position_x": "m", "position_y": "m", "position_z": "m"},
    ),
    Effect("com_shift", _eccentric, _shift, _shifted, SHIFT, sizes=(0.05, 4.0)),
    Effect(
        "slope",
        _tilting,
        _slope,
        _tilted,
        {"tilt": ANGLE, "azimuth": ANGLE},
        sizes=(0.05, 8.0),
    ),
    Effect(
        "fluid_drag",
        _airy,
        lambda r, t, g: lambda s: {"density": 60.0 * s},
        _medium,
        {"density": "kg/m^3"},
        sizes=(0.01, 20.0),
    ),
    Effect(
        "ground_friction", _floor, _grip, _slippery, {"friction": "1"}, sizes=(0.1, 10)
    ),
    Effect(
        "sensor_bias",
        _signals,
        _number("bias", 0.02, signed=True),
        _read("bias", "bias"),
        {"bias": ANGLE},
    ),
    Effect(
        "sensor_gain",
        _signals,
        _sensor_gain,
        _read("gain", "gain"),
        {"gain": "1"},
        sizes=(0.05, 8.0),
    ),
    Effect(
        "sensor_delay",
        _signals,
        _number("delay", 0.01),
        _read("delay", "delay"),
        {"delay": "s"},
        sizes=(0.1, 10.0),
    ),
    Effect("link_length", _long, _length, _longer, {"length": "m"}, sizes=(0.05, 5.0)),
    Effect("mount_shift", _mounted, _mount, _moved, SHIFT, sizes=(0.1, 4.0)),
    Effect("limb_loss", _lost, _none, _gone, {}, sizes=(1.0, 1.0)),
    # further names of the contract
    Effect(
        "cogging",
        _arm_joints,
        _ripple,
        lambda truth, target, v: truth.forces.append(cogging(_name(target), **v)),
        {"amplitude": TORQUE, "poles": "1", "phase": ANGLE},
    ),
    Effect(
        "joint_coupling",
        _hinged,
        _coupling,
        _coupled,
        {"stiffness": "N m/rad", "ratio": "1"},
    ),
    Effect(
        "hard_stop", _arm_joints, _stop, _stopped, {"range": ANGLE}, sizes=(0.05, 3.2)
    ),
    Effect("rate_limit", _servos, _rate, _shaped(slewed, "rate"), {"rate": "rad/s"}),
    Effect(
        "integral_action",
        _arm_servos,
        _integral,
        _integrating,
        {"ki": "N m/(rad s)", "imax": TORQUE},
    ),
    Effect("joint_jam", _jammed, _angle, _stuck, {"angle": ANGLE}, sizes=(1.0, 1.0)),
    Effect(
        "wind",
        _airy,
        _wind,
        _blown,
        {"vx": "m/s", "vy": "m/s", "vz": "m/s"},
        sizes=(0.02, 8.0),
        density=(1.2, 1.2, 1000.0),
    ),
    Effect(
        "ground_compliance",
        _floor,
        _soft,
        _yielding,
        {"timeconst": "s", "dampratio": "1"},
        sizes=(0.1, 8.0),
    ),
    Effect(
        "quantization",
        _signals,
        _number("step", 0.01),
        _read("step", "step"),
        {"step": ANGLE},
        sizes=(0.3, 6.0),
    ),
)
BY_NAME: Mapping[str, Effect] = {effect.name: effect for effect in EFFECTS}


def drawing(effect: Effect, target: str, rng: Rng) -> tuple[frozenset[str], float]:
    """What the given model must not state for an effect, and its medium's density."""
    zero = []
    for text in effect.zeroes:
        maybe = text.endswith("?")
        if not maybe or rng.random() < 0.5:
            zero.append(text.rstrip("?").format(_name(target)))
    density = float(rng.choice(effect.density)) if effect.density else 0.0
    return frozenset(zero), density


def blank(name: str) -> Robot:
    """A robot of a shape, to ask what effects fit it."""
    from _sealed_robots import ROBOTS

    return ROBOTS[name](Draw(np.random.default_rng(0)))
