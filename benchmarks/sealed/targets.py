"""Where an effect can be: takes a robot, gives targets of the contract."""

from typing import Any

import numpy as np

from benchmarks.sealed.mjcf import Robot


def get_name(target: str) -> str:
    """The name in a target, which is "KIND:NAME"."""
    return target.partition(":")[2]


def find_joint(robot: Robot, target: str) -> str:
    """The joint that a joint, an actuator or a joint position signal belongs to."""
    kind, _, name = target.partition(":")
    if kind == "actuator":
        return robot.actuators[name]
    return name.removesuffix("_position")


def measure_limb(link: Any) -> float:
    """Distance [m] from a link's joint to the next one, or to its foot."""
    ends = [b.pos for b in link.bodies] + [g.pos for g in link.geoms]
    return float(max(np.linalg.norm(p) for p in ends))


def find_contact_geoms(spec: Any) -> list[Any]:
    """The geoms of an MjSpec that can touch something."""
    closed = [g for g in spec.geoms if g.contype or g.conaffinity]
    return closed


def has_limbs(robot: Robot) -> bool:
    """Whether a robot is a torso on legs."""
    return robot.free == "torso"


def list_joints(robot: Robot) -> list[str]:
    """All joints whose position is recorded, as targets."""
    return [f"joint:{j}" for j in robot.joints]


def list_driven_joints(robot: Robot) -> list[str]:
    """The joints that an actuator moves, as targets."""
    return [f"joint:{j}" for j in robot.actuators.values()]


def list_arm_joints(robot: Robot) -> list[str]:
    """All joints as targets; none of a robot with legs."""
    return [] if has_limbs(robot) else list_joints(robot)


def list_driven_arm_joints(robot: Robot) -> list[str]:
    """The driven joints of arms and pendulums as targets; none of others."""
    arms = robot.drive != "none" and not has_limbs(robot) and robot.name != "cartpole"
    return list_driven_joints(robot) if arms else []


def list_actuators(robot: Robot) -> list[str]:
    """All actuators as targets."""
    return [f"actuator:{a}" for a in robot.actuators]


def list_servos(robot: Robot) -> list[str]:
    """All position servos as targets."""
    return list_actuators(robot) if robot.drive == "servo" else []


def list_arm_servos(robot: Robot) -> list[str]:
    """The position servos as targets; none of a robot with legs."""
    return [] if has_limbs(robot) else list_servos(robot)


def list_coupled_joints(robot: Robot) -> list[str]:
    """The last of two coupled hinges as target, where there are two."""
    names = {"arm2_servo", "arm2_torque", "arm3", "double_pendulum"}
    return ["joint:" + robot.joints[-1]] if robot.name in names else []


def list_position_signals(robot: Robot) -> list[str]:
    """The signals of all joint positions as targets."""
    return [f"sensor:{j}_position" for j in robot.joints]


def list_load_bodies(robot: Robot) -> list[str]:
    """The bodies that can carry a payload, as targets."""
    if robot.free:
        return [f"body:{robot.free}"]
    return [f"body:{b}" for b in robot.links if b != "cart"]


def list_shiftable_bodies(robot: Robot) -> list[str]:
    """The bodies whose center of mass can be seen to move, as targets."""
    return [] if robot.name == "pendulum" else list_load_bodies(robot)


def list_tiltable_worlds(robot: Robot) -> list[str]:
    """The world as target, where a slope is more than a bias of one sensor."""
    return [] if robot.name == "pendulum" else ["world"]


def list_drag_worlds(robot: Robot) -> list[str]:
    """The world as target, where bodies are fast enough to feel a medium."""
    names = ("pendulum", "double_pendulum", "cartpole", "toss_box", "toss_stick")
    return ["world"] if robot.name in names else []


def list_floors(robot: Robot) -> list[str]:
    """The world as target, where a body touches the floor."""
    return ["world"] if robot.contact else []


def list_long_links(robot: Robot) -> list[str]:
    """The links whose length shows in the motion, as targets."""
    if has_limbs(robot):
        return [f"body:{b}" for b in robot.links if b.endswith("lower")]
    names = ("arm2_servo", "arm2_torque", "arm3", "double_pendulum")
    return [f"body:{robot.links[0]}"] if robot.name in names else []


def list_mounted_links(robot: Robot) -> list[str]:
    """The links whose place on their parent shows in the motion, as targets."""
    if has_limbs(robot):
        return [f"body:{b}" for b in robot.links if b.endswith("upper")]
    names = ("arm2_servo", "arm2_torque", "double_pendulum")
    return ["body:link2"] if robot.name in names else []


def list_losable_links(robot: Robot) -> list[str]:
    """The lower legs as targets; none of a robot without legs."""
    return (
        [f"body:{b}" for b in robot.links if "lower" in b] if has_limbs(robot) else []
    )


def list_jammable_joints(robot: Robot) -> list[str]:
    """The joints that can jam while others still move, as targets."""
    multiple = robot.name in ("arm2_servo", "arm3", "quadruped")
    return list_joints(robot)[1:] if multiple else []
