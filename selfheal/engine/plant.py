"""Plants: one way that a robot, its servos and its world may be, as numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, scale_parts
from ..body.changes import follow_with_play, limit_rate, list_subtree
from ..body.damage import Damage
from ..body.mjcf import Physics
from ..errors import InputError

# Rated limits of the robot of 2006 (overview.txt, 3.1 and 2.2): 200 oz in, 60 deg/s,
# hips -96 to 74 degrees, knees -96 to 94.
RATED_TORQUE, RATED_SPEED = 1.41, np.radians(60.0)
_RANGE = {"hip": np.radians([-96.0, 74.0]), "knee": np.radians([-96.0, 94.0])}
# Servos that give way: published_body.xml's. A step of 10 ms walks within 2.4 mm of
# one of 2 ms (median of 48 gaits of 5 s) and is five times as fast.
WALKING = Physics(timestep=0.01, kp=40.0, kv=0.6)
# scale of a part that is gone: MuJoCo needs some size and mass; chosen
_LOST_SCALE = 0.02


@dataclass(frozen=True)
class Plant:
    """A robot with its servos on a floor.

    Attributes:
        body: a batch of one.
        torque: (P) largest of each motor [N m].
        speed: (P) fastest that each set point moves [rad/s].
        low: (P) and
        high: (P) ends of each joint's range [rad].
        delay: of every command [s].
        backlash: play of every joint, total width [rad].
        offset: (P) of every servo's zero [rad].
        jam: (P) angle at which a joint stands still [rad], NaN where it moves.
        slope: (2) tilt of the ground, downhill azimuth [rad].
        gain: by name, the factor on what a sensor reads, 0 of a dead one; 1 where a
            name is not there.
    """

    body: Bodies
    physics: Physics
    torque: Floats
    speed: Floats
    low: Floats
    high: Floats
    delay: float
    backlash: float
    offset: Floats
    jam: Floats
    slope: Floats
    gain: Mapping[str, float]


def check_can_walk(anatomy: Anatomy) -> None:
    """Refuse a robot that no plant can be built of.

    Raises:
        InputError: it is bolted down, or its parts stand in another order.
    """
    if anatomy.fixed or not anatomy.ordered:
        why = "is bolted down" if anatomy.fixed else "lists parts before parents"
        raise InputError(
            f"robot {anatomy.name!r} {why}; would fit: one with a free torso, its "
            "actuators in the order of its parts, parents first"
        )


def build_rated_plant(body: Bodies) -> Plant:
    """The plant as its maker states it: rated servos, no play, level ground.

    Raises:
        InputError: it cannot walk, or its parts stand in another order.
    """
    check_can_walk(body.anatomy)
    joints = body.anatomy.joints
    ends = np.array([_RANGE["knee" if "knee" in j else "hip"] for j in joints])
    zero = np.zeros(len(joints))
    return Plant(
        body=body,
        physics=WALKING,
        torque=zero + RATED_TORQUE,
        speed=zero + RATED_SPEED,
        low=ends[:, 0],
        high=ends[:, 1],
        delay=0.0,
        backlash=0.0,
        offset=zero,
        jam=zero + np.nan,
        slope=np.zeros(2),
        gain={},
    )


def list_lost_parts(body: Bodies, part: int) -> list[int]:
    """A part (0..P-1) and all that hangs on it."""
    nodes = list_subtree([-1, *body.parent[0]], part + 1)  # node 0 is the torso
    return [node - 1 for node in nodes]


def apply_damages(plant: Plant, *damages: Damage) -> Plant:
    """The plant after these damages, in order."""
    for damage in damages:
        plant = _apply_damage(plant, damage)
    return plant


def _apply_damage(plant: Plant, damage: Damage) -> Plant:
    """The plant after one damage."""
    anatomy, value, name = plant.body.anatomy, damage.value, damage.name
    if damage.kind in ("part_scale", "limb_loss"):
        part = anatomy.parts.index(name)
        scale, least = np.ones((1, anatomy.size)), _LOST_SCALE / plant.body.thickness
        if damage.kind == "part_scale":
            scale[0, part] = max(value, least[0, part])
        else:
            lost = list_lost_parts(plant.body, part)
            scale[0, lost] = least[0, lost]
        plant = replace(plant, body=scale_parts(plant.body, scale))
    elif damage.kind == "joint_jam":
        jam = _replace_element(plant.jam, anatomy.joints.index(name), value)
        plant = replace(plant, jam=jam)
    elif damage.kind == "weak_motor":
        joint = anatomy.joints.index(name.removesuffix("_servo"))
        torque, speed = (
            _replace_element(values, joint, values[joint] * value)
            for values in (plant.torque, plant.speed)
        )
        plant = replace(plant, torque=torque, speed=speed)
    elif damage.kind in ("sensor_dead", "weak_sensor"):
        factor = plant.gain.get(name, 1.0) * value  # a dead one's value is 0
        plant = replace(plant, gain={**plant.gain, name: factor})
    elif damage.kind == "slope":
        plant = replace(plant, slope=np.array([value, damage.azimuth]))
    elif damage.kind == "ground_friction":
        plant = replace(plant, physics=replace(plant.physics, friction=value))
    return plant


def list_gone_targets(body: Bodies, damages: Sequence[Damage]) -> set[str]:
    """Targets of damages that can change nothing more after some damages."""
    gone, anatomy = set[str](), body.anatomy
    for damage in damages:
        if damage.kind == "limb_loss":
            for k in list_lost_parts(body, anatomy.parts.index(damage.name)):
                part, joint = anatomy.parts[k], anatomy.joints[k]
                gone |= {f"body:{part}", f"sensor:{part}_touch", f"joint:{joint}"}
                gone |= {f"actuator:{joint}_servo", f"sensor:{joint}_position"}
        elif damage.kind == "joint_jam":
            gone |= {damage.target, f"actuator:{damage.name}_servo"}
        elif damage.kind == "sensor_dead":
            gone.add(damage.target)
    return gone


def list_motions(plants: Sequence[Plant]) -> tuple[list[Plant], list[int]]:
    """Plants (M) that move differently, and which of them each of N moves as.

    Plants made from one by `apply_damages` share what no damage changed.
    """
    moving = [f.name for f in fields(Plant) if f.name != "gain"]
    keys = [tuple(id(getattr(plant, name)) for name in moving) for plant in plants]
    different = dict[tuple[int, ...], Plant]()
    for key, plant in zip(keys, plants, strict=True):
        different.setdefault(key, plant)
    place = {key: k for k, key in enumerate(different)}
    return list(different.values()), [place[key] for key in keys]


def _replace_element(values: Floats, index: int, value: float) -> Floats:
    """A copy with one element changed."""
    out = values.copy()
    out[index] = value
    return out


def compute_set_points(
    plants: list[Plant], commands: Floats, period: float, start: Floats
) -> Floats:
    """Where servos are sent: commands late, within range, at most at the motors' speed.

    Args:
        commands: (N, T, P) [rad], each held for a period.
        period: [s].
        start: (N, P) set points before the first command [rad].

    Returns:
        (N, T, P) [rad]. Play is taken up between motor and joint: the joint's set
        point follows the motor's by half the play at either side. A joint that is
        jammed goes to its angle at the motor's speed and stays there.
    """
    columns = ("speed", "low", "high", "offset", "jam")
    speed, low, high, offset, jam = (
        np.stack([getattr(p, c) for p in plants]) for c in columns
    )
    play = np.array([[p.backlash] for p in plants])
    late = [round(p.delay / period) for p in plants]
    rows = zip(commands, late, start, strict=True)
    delayed = [
        np.concatenate([np.tile(s, (k, 1)), c[: len(c) - k]]) for c, k, s in rows
    ]
    late_commands = np.stack(delayed)
    wanted = np.clip(late_commands, low[:, None], high[:, None]) + offset[:, None]
    wanted = np.where(np.isnan(jam)[:, None], wanted, jam[:, None])
    motor = limit_rate(wanted.swapaxes(0, 1), speed * period, start)
    joint = follow_with_play(motor, play, start)
    return np.ascontiguousarray(joint.swapaxes(0, 1))
