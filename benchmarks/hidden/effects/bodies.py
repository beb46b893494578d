"""What bodies, the world and sensors can have: mass, shape, ground, wrong readings."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.hidden.effects.base import (
    Draw,
    Install,
    Sized,
    Values,
    draw_nothing,
    draw_number,
    draw_signed,
)
from benchmarks.hidden.robots.robot import GRAVITY, Rng, Robot, get_name
from benchmarks.hidden.truth import HiddenRobot, SensorModel, stretch_body

# ---------------------------------------------------------------- bodies


def _draw_payload(robot: Robot, target: str, rng: Rng) -> Sized:
    """Mass and place of a payload: at a link's end, or near a free body's center."""
    body = robot.model.body(get_name(target))
    mass = body.mass[0]
    if robot.free:
        place = rng.uniform(-0.03, 0.03, 3)
    else:
        place = np.array([0, 0, 2 * body.ipos[2] * rng.uniform(0.7, 1.0)])
    names = dict(zip(("position_x", "position_y", "position_z"), place, strict=True))
    return lambda s: {"mass": 0.35 * s * mass, **names}


def _install_payload(truth: HiddenRobot, target: str, v: Values) -> None:
    """A small massive ball fixed to the body."""
    place = [v.get(f"position_{c}", 0.0) for c in "xyz"]
    child = truth.spec.body(get_name(target)).add_body(name="payload", pos=place)
    child.explicitinertial, child.mass = True, v["mass"]
    child.inertia = np.full(3, 0.4 * v["mass"] * 0.01**2)


def _draw_com_shift(robot: Robot, target: str, rng: Rng) -> Sized:
    """A center of mass that moves across the link, where hinges can see it."""
    direction = rng.normal(size=3)
    if not robot.free:
        direction *= [1.0, 0.0, 0.3]
    direction /= np.linalg.norm(direction)
    scale = 0.012 if not robot.contact else 0.008
    return lambda s: dict(zip("xyz", s * scale * direction, strict=True))


def _install_com_shift(truth: HiddenRobot, target: str, v: Values) -> None:
    body = truth.spec.body(get_name(target))
    body.ipos = body.ipos + [v[c] for c in "xyz"]


def measure_limb(link: Any) -> tuple[float, int]:
    """How far [m] a link's next joint, or its foot, is, and along which axis mostly."""
    ends = [b.pos for b in link.bodies] + [g.pos for g in link.geoms]
    far = max(ends, key=np.linalg.norm)
    return float(np.linalg.norm(far)), int(np.argmax(np.abs(far)))


def _draw_length(robot: Robot, target: str, rng: Rng) -> Sized:
    """Length of a link, shorter or longer than the given one."""
    length, _ = measure_limb(robot.read_spec().body(get_name(target)))
    sign = rng.choice([-1, 1])
    return lambda s: {"length": length * max(1 + sign * (0.06 + 0.08 * s), 0.4)}


def _install_length(truth: HiddenRobot, target: str, v: Values) -> None:
    """A link of another length, stretched with its mass and inertia."""
    link = truth.spec.body(get_name(target))
    length, axis = measure_limb(link)
    factors = np.ones(3)
    factors[axis] = v["length"] / length
    stretch_body(link, factors)


def _draw_mount_shift(robot: Robot, target: str, rng: Rng) -> Sized:
    """Shift of a link's place on its parent, in a random direction."""
    direction = rng.normal(size=3) * ([1, 0.3, 1] if robot.legged else [1, 0, 0.3])
    direction /= np.linalg.norm(direction)
    return lambda s: dict(zip("xyz", 0.012 * s * direction, strict=True))


def _install_mount_shift(truth: HiddenRobot, target: str, v: Values) -> None:
    body = truth.spec.body(get_name(target))
    body.pos = body.pos + [v[c] for c in "xyz"]


def _install_limb_loss(truth: HiddenRobot, target: str, v: Values) -> None:
    """A body without mass and without contacts."""
    body = truth.spec.body(get_name(target))
    body.mass = 1e-4
    body.inertia = np.full(3, 1e-7)
    body.ipos = np.zeros(3)
    for geom in body.geoms:
        geom.contype = geom.conaffinity = 0


# ---------------------------------------------------------------- world


def _draw_slope(robot: Robot, target: str, rng: Rng) -> Sized:
    """Tilt of the floor and its direction; along the plane of planar robots."""
    planar = not robot.free and robot.name != "arm3"
    azimuth = rng.choice([0.0, math.pi]) if planar else rng.uniform(-math.pi, math.pi)
    return lambda s: {"tilt": 0.04 * s, "azimuth": azimuth}


def _install_slope(truth: HiddenRobot, target: str, v: Values) -> None:
    """Gravity as a tilted floor has it."""
    tilt, way = v["tilt"], v["azimuth"]
    down = np.array([math.sin(tilt) * math.cos(way), math.sin(tilt) * math.sin(way)])
    truth.spec.option.gravity = GRAVITY * np.r_[down, -math.cos(tilt)]


def _install_medium(truth: HiddenRobot, target: str, v: Values) -> None:
    truth.spec.option.density = v["density"]


def _draw_wind(robot: Robot, target: str, rng: Rng) -> Sized:
    azimuth = rng.uniform(-0.4, 0.4) + rng.choice([0, math.pi])
    way = [math.cos(azimuth), math.sin(azimuth) if robot.free else 0.0, 0.0]
    return lambda s: dict(
        zip(("vx", "vy", "vz"), (3.0 * s * d for d in way), strict=True)
    )


def _install_wind(truth: HiddenRobot, target: str, v: Values) -> None:
    truth.spec.option.wind = [v[c] for c in ("vx", "vy", "vz")]


def _list_contact_geoms(spec: mujoco.MjSpec) -> list[Any]:
    return [g for g in spec.geoms if g.contype or g.conaffinity]


def _draw_ground_friction(robot: Robot, target: str, rng: Rng) -> Sized:
    """Sliding friction of the ground, below the given one or, in 35 %, above it."""
    given = max(float(g.friction[0]) for g in _list_contact_geoms(robot.read_spec()))
    if rng.random() < 0.35:
        return lambda s: {"friction": given * (1.35 + 0.4 * s)}
    return lambda s: {"friction": given * max(0.65 / (1 + 0.5 * s), 0.1)}


def _install_ground_friction(truth: HiddenRobot, target: str, v: Values) -> None:
    geoms = _list_contact_geoms(truth.spec)
    highest = max(g.friction[0] for g in geoms)
    for geom in geoms:
        geom.friction[0] *= v["friction"] / highest


def _draw_ground_compliance(robot: Robot, target: str, rng: Rng) -> Sized:
    ratio = rng.uniform(0.5, 1.0)
    return lambda s: {"timeconst": 0.02 * (1 + s), "dampratio": ratio}


def _install_ground_compliance(truth: HiddenRobot, target: str, v: Values) -> None:
    for geom in _list_contact_geoms(truth.spec):
        geom.solref = [v["timeconst"], v["dampratio"]]


# ---------------------------------------------------------------- sensors


def _draw_sensor_gain(robot: Robot, target: str, rng: Rng) -> Sized:
    """Gain of a joint position signal, below or above 1."""
    sign = rng.choice([-1, 1])
    return lambda s: {"gain": max(1 + sign * 0.05 * s, 0.3)}


def _mistake(field: str) -> Install:
    """What sets a field of a signal's `SensorModel`; a delay in whole fine steps."""

    def install(truth: HiddenRobot, target: str, v: Values) -> None:
        now = truth.readings.get(get_name(target), SensorModel())
        if field == "delay":
            v[field] = round(v[field] / truth.robot.fine) * truth.robot.fine
        truth.readings[get_name(target)] = replace(now, **{field: v[field]})

    return install


def _install_vector_bias(truth: HiddenRobot, target: str, v: Values) -> None:
    bias = tuple(v.get(f"bias_{c}", 0.0) for c in "xyz")
    truth.readings[get_name(target)] = SensorModel(bias=bias)


PHYSICS: Mapping[str, tuple[Draw, Install]] = {
    "payload": (_draw_payload, _install_payload),
    "com_shift": (_draw_com_shift, _install_com_shift),
    "slope": (_draw_slope, _install_slope),
    "fluid_drag": (draw_number("density", 60.0), _install_medium),
    "ground_friction": (_draw_ground_friction, _install_ground_friction),
    "sensor_bias": (draw_signed("bias", 0.02), _mistake("bias")),
    "sensor_gain": (_draw_sensor_gain, _mistake("gain")),
    "sensor_delay": (draw_number("delay", 0.01), _mistake("delay")),
    "link_length": (_draw_length, _install_length),
    "mount_shift": (_draw_mount_shift, _install_mount_shift),
    "limb_loss": (draw_nothing, _install_limb_loss),
    "wind": (_draw_wind, _install_wind),
    "ground_compliance": (_draw_ground_compliance, _install_ground_compliance),
    "quantization": (draw_number("step", 0.01), _mistake("step")),
    "vector_bias": (draw_nothing, _install_vector_bias),
}
