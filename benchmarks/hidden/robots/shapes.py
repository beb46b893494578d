"""Robots whose shape is fixed: takes a generator, gives the MJCF a user would have.

Every link hangs along -z of its frame, so that a length is a scale of that axis. All
sizes are drawn per case, chosen within 25 % around a desk-top device of that shape.
"""

from collections.abc import Callable, Mapping
from itertools import product

import numpy as np

from benchmarks.hidden.robots.robot import (
    GRAVITY,
    NumberDraw,
    Robot,
    read_world,
    write_actuators,
    write_link,
)


def make_pendulum(numbers: NumberDraw) -> Robot:
    """One link on a position servo."""
    length, mass = numbers.draw_about(0.16, 0.4)
    load = mass * GRAVITY * length / 2
    dry = 0.01 if numbers.draw_flag(0.5) else 0
    (joint,) = numbers.write_joints((0.02, 0.006, dry))
    link = write_link(length, mass, 0.02)
    world = read_world("pendulum", j1=joint, link1=link)
    rest = numbers.write_servos((12 * load, 0.5 * load))
    return Robot(
        "pendulum",
        numbers.write_model("pendulum", world, rest, 0.001, "RK4"),
        {"j1": load},
        {"j1": 1.3},
        links=("link1",),
        window=1.0,
    )


def _write_chain(
    numbers: NumberDraw, *joints: tuple[float, float, float]
) -> tuple[str, list[float]]:
    """Two links in a vertical plane, and the static torque each joint can see."""
    j1, j2 = numbers.write_joints(*joints)
    l1, l2, m1, m2 = numbers.draw_about(0.25, 0.2, 0.7, 0.4)
    links = {"link1": write_link(l1, m1, 0.02), "link2": write_link(l2, m2, 0.015)}
    world = read_world("chain", j1=j1, j2=j2, end=-l1, **links)
    low = m2 * GRAVITY * l2 / 2
    return world, [GRAVITY * (m1 * l1 / 2 + m2 * l1) + low, low]


def make_arm2_servo(numbers: NumberDraw) -> Robot:
    """A 2-joint arm on position servos."""
    dry = numbers.draw_flag(0.5)
    joints = (0.15, 0.02, 0.03 * dry), (0.05, 0.008, 0.01 * dry)
    world, load = _write_chain(numbers, *joints)
    rest = numbers.write_servos(*((15 * torque, 0.7 * torque) for torque in load))
    return Robot(
        "arm2_servo",
        numbers.write_model("arm2", world, rest, 0.001),
        {"j1": load[0] / 2, "j2": load[1]},
        {"j1": 0.9, "j2": 1.1},
        links=("link1", "link2"),
        window=1.0,
    )


def make_arm2_torque(numbers: NumberDraw) -> Robot:
    """A 2-joint arm whose recorded command is a feedback's torque."""
    world, load = _write_chain(numbers, (0.12, 0.02, 0), (0.05, 0.008, 0))
    motors = [f'<motor name="m{i}" joint="j{i}"/>' for i in (1, 2)]
    gains = (5 * load[0], 0.5 * load[0]), (5 * load[1], 0.4 * load[1])
    return Robot(
        "arm2_torque",
        numbers.write_model("arm2", world, write_actuators(motors), 0.001, "RK4"),
        {"j1": load[0] / 2, "j2": load[1]},
        {"j1": 0.9, "j2": 1.1},
        gains={"j1": gains[0], "j2": gains[1]},
        links=("link1", "link2"),
    )


def make_arm3(numbers: NumberDraw) -> Robot:
    """A 3-joint arm that also turns about the vertical, on position servos."""
    l2, l3, m1, m2, m3 = numbers.draw_about(0.22, 0.18, 0.8, 0.5, 0.35)
    joints = (0.15, 0.02, 0.02), (0.15, 0.02, 0), (0.05, 0.008, 0)
    j1, j2, j3 = numbers.write_joints(*joints)
    links = {"link2": write_link(l2, m2, 0.02), "link3": write_link(l3, m3, 0.015)}
    world = read_world("arm3", j1=j1, j2=j2, j3=j3, m1=m1, end=-l2, **links)
    low = m3 * GRAVITY * l3 / 2
    load = [1.0, GRAVITY * (m2 * l2 / 2 + m3 * l2) + low, low]
    stiff = [12.0, 15 * load[1], 15 * load[2]]
    rest = numbers.write_servos(*((kp, 0.06 * kp) for kp in stiff))
    return Robot(
        "arm3",
        numbers.write_model("arm3", world, rest, 0.001),
        {"j1": 0.6, "j2": load[1] / 2, "j3": load[2]},
        {"j1": 0.9, "j2": 0.7, "j3": 0.9},
        {"j2": 0.7, "j3": 0.4},
        links=("link2", "link3"),
        window=1.0,
    )


def make_cartpole(numbers: NumberDraw) -> Robot:
    """A cart on a rail with a pole that hangs; the command is the force on the cart."""
    length, cart, mass = numbers.draw_about(0.4, 0.8, 0.2)
    dry = 0.5 if numbers.draw_flag(0.5) else 0
    j1, j2 = numbers.write_joints((1.0, 0, dry), (0.002, 0, 0))
    pole = write_link(length, mass, 0.01)
    world = read_world("cartpole", j1=j1, j2=j2, cart=cart, pole=pole)
    rest = write_actuators(['<motor name="m1" joint="j1"/>'])
    return Robot(
        "cartpole",
        numbers.write_model("cartpole", world, rest, 0.001, "RK4"),
        {"j1": 4.0, "j2": mass * GRAVITY * length / 4},
        {"j1": 0.25, "j2": 1.0},
        gains={"j1": (60.0, 12.0)},
        links=("cart", "pole"),
    )


def make_double_pendulum(numbers: NumberDraw) -> Robot:
    """Two links that are let go and swing freely."""
    world, load = _write_chain(numbers, (0.006, 0, 0), (0.002, 0, 0))
    return Robot(
        "double_pendulum",
        numbers.write_model("double_pendulum", world, "", 0.002, "RK4"),
        {"j1": load[0] / 3, "j2": load[1] / 2},
        {"j1": 1.1, "j2": 1.1},
        links=("link1", "link2"),
        fine=0.0001,
    )


def _write_leg(
    numbers: NumberDraw, number: int, corner: tuple[float, float], sizes: list[float]
) -> str:
    """Two links and a round foot below a corner of the torso."""
    upper, lower, mass = sizes
    hip = numbers.write_joint(f"hip{number}", 0.05, 0.005, 0.02)
    knee = numbers.write_joint(f"knee{number}", 0.05, 0.005, 0.02)
    rods = {"half": upper / 2, "middle": -upper / 2, "end": -upper, "mass": mass}
    rods |= {"lower_half": lower / 2, "lower_middle": -lower / 2, "foot": -lower}
    place = {"x": corner[0], "y": corner[1], "lower_mass": 0.6 * mass}
    return read_world("leg", n=number, hip=hip, knee=knee, **rods, **place)


def make_quadruped(numbers: NumberDraw) -> Robot:
    """A torso on four legs of two servos each, on the floor."""
    width, depth, mass = numbers.draw_about(0.12, 0.09, 1.4)
    sizes = numbers.draw_about(0.1, 0.1, 0.12)
    corners = product((width, -width), (depth, -depth))
    legs = "".join(_write_leg(numbers, n, c, sizes) for n, c in enumerate(corners, 1))
    height = sizes[0] * np.cos(0.45) + sizes[1] * np.cos(0.45) + 0.02
    torso = {"width": width, "depth": depth, "mass": mass, "height": height}
    world = read_world("quadruped", legs=legs, **torso)
    kp, friction = numbers.draw_about(18.0, 0.7)
    joints = [f"{j}{n}" for n in range(1, 5) for j in ("hip", "knee")]
    servos = [
        f'<position name="{j}_servo" joint="{j}" kp="{kp}" kv="0.5"/>' for j in joints
    ]
    rest = read_world("ground", friction=friction) + write_actuators(servos)
    return Robot(
        "quadruped",
        numbers.write_model("quadruped", world, rest, 0.002),
        dict.fromkeys(joints, 0.5),
        {j: 0.2 if j.startswith("hip") else 0.25 for j in joints},
        {j: 0.45 if j.startswith("hip") else -0.9 for j in joints},
        links=[f"leg{n}_{p}" for n in range(1, 5) for p in ("upper", "lower")],
        fine=0.0004,
    )


def _make_toss(numbers: NumberDraw, name: str, geom: str, step: float) -> Robot:
    """A body with one geom that is thrown on a table."""
    (friction,) = numbers.draw_about(0.4)
    world = read_world("toss", name=name, geom=geom, friction=friction)
    xml = numbers.write_model(name, world, "", step, "RK4")
    return Robot(f"toss_{name}", xml, fine=0.0001)


def make_toss_box(numbers: NumberDraw) -> Robot:
    """A box thrown on a table."""
    *sides, mass = numbers.draw_about(0.045, 0.045, 0.045, 0.3)
    size = " ".join(f"{side:.4g}" for side in sides)
    geom = f'<geom type="box" size="{size}" mass="{mass}" friction="0.1 0.005 1e-4"/>'
    return _make_toss(numbers, "box", geom, 0.001)


def make_toss_stick(numbers: NumberDraw) -> Robot:
    """A stick thrown on a table."""
    radius, half, mass = numbers.draw_about(0.015, 0.09, 0.15)
    size = f'type="capsule" size="{radius:.4g} {half:.4g}"'
    geom = f'<geom {size} mass="{mass}" friction="0.1 0.005 1e-4"/>'
    return _make_toss(numbers, "stick", geom, 0.0005)


ROBOTS: Mapping[str, Callable[[NumberDraw], Robot]] = {
    "pendulum": make_pendulum,
    "arm2_servo": make_arm2_servo,
    "arm2_torque": make_arm2_torque,
    "arm3": make_arm3,
    "cartpole": make_cartpole,
    "double_pendulum": make_double_pendulum,
    "quadruped": make_quadruped,
    "toss_box": make_toss_box,
    "toss_stick": make_toss_stick,
}


def make_blank_robot(name: str) -> Robot:
    """A robot of a shape with some numbers, to ask which effects fit it."""
    return ROBOTS[name](NumberDraw(np.random.default_rng(0)))
