"""Where an effect can be: takes a robot, gives targets of the contract."""

from typing import Any

import numpy as np

from benchmarks.sealed.mjcf import Robot


def name_of(target: str) -> str:
    return target.partition(":")[2]


def joint_of(robot: Robot, target: str) -> str:
    """The joint of a joint, actuator or joint position signal."""
    kind, _, name = target.partition(":")
    if kind == "actuator":
        return robot.actuators[name]
    return name.removesuffix("_position")


def limb_length(link: Any) -> float:
    """Distance [m] from a link's joint to the next one, or to its foot."""
    ends = [b.pos for b in link.bodies] + [g.pos for g in link.geoms]
    return float(max(np.linalg.norm(p) for p in ends))


def ground(spec: Any) -> list[Any]:
    closed = [g for g in spec.geoms if g.contype or g.conaffinity]
    return closed


def limbs(robot: Robot) -> bool:
    return robot.free == "torso"


def joints(robot: Robot) -> list[str]:
    return [f"joint:{j}" for j in robot.joints]


def driven(robot: Robot) -> list[str]:
    return [f"joint:{j}" for j in robot.actuators.values()]


def passive(robot: Robot) -> list[str]:
    """Joints without a motor, or all where each has one."""
    free = [j for j in robot.joints if j not in robot.actuators.values()]
    return [f"joint:{j}" for j in free or robot.joints]


def arm_joints(robot: Robot) -> list[str]:
    return [] if limbs(robot) else joints(robot)


def arm_driven(robot: Robot) -> list[str]:
    arms = robot.drive != "none" and not limbs(robot) and robot.name != "cartpole"
    return driven(robot) if arms else []


def actuators(robot: Robot) -> list[str]:
    return [f"actuator:{a}" for a in robot.actuators]


def servos(robot: Robot) -> list[str]:
    return actuators(robot) if robot.drive == "servo" else []


def arm_servos(robot: Robot) -> list[str]:
    return [] if limbs(robot) else servos(robot)


def hinged(robot: Robot) -> list[str]:
    """Coupled pairs: the joint that is named is the first of two hinges."""
    names = {"arm2_servo", "arm2_torque", "arm3", "double_pendulum"}
    return ["joint:" + robot.joints[-1]] if robot.name in names else []


def signals(robot: Robot) -> list[str]:
    return [f"sensor:{j}_position" for j in robot.joints]


def loads(robot: Robot) -> list[str]:
    if robot.free:
        return [f"body:{robot.free}"]
    return [f"body:{b}" for b in robot.links if b != "cart"]


def eccentric(robot: Robot) -> list[str]:
    """Bodies whose center can be seen to move; on one link it is a sensor's bias."""
    return [] if robot.name == "pendulum" else loads(robot)


def tilting(robot: Robot) -> list[str]:
    return [] if robot.name == "pendulum" else ["world"]


def airy(robot: Robot) -> list[str]:
    names = ("pendulum", "double_pendulum", "cartpole", "toss_box", "toss_stick")
    return ["world"] if robot.name in names else []


def floor(robot: Robot) -> list[str]:
    return ["world"] if robot.contact else []


def long(robot: Robot) -> list[str]:
    if limbs(robot):
        return [f"body:{b}" for b in robot.links if b.endswith("lower")]
    names = ("arm2_servo", "arm2_torque", "arm3", "double_pendulum")
    return [f"body:{robot.links[0]}"] if robot.name in names else []


def mounted(robot: Robot) -> list[str]:
    if limbs(robot):
        return [f"body:{b}" for b in robot.links if b.endswith("upper")]
    names = ("arm2_servo", "arm2_torque", "double_pendulum")
    return ["body:link2"] if robot.name in names else []


def lost(robot: Robot) -> list[str]:
    return [f"body:{b}" for b in robot.links if "lower" in b] if limbs(robot) else []


def jammed(robot: Robot) -> list[str]:
    multiple = robot.name in ("arm2_servo", "arm3", "quadruped")
    return joints(robot)[1:] if multiple else []
