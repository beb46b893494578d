"""Robots whose shape is fixed: takes a generator, gives the MJCF a user would have.

Every link hangs along -z of its frame, so that a length is a scale of that axis. All
sizes are drawn per case, chosen within 25 % around a desk-top device of that shape.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.hidden.robots.robot import (
    DRAWN_ONLY,
    GRAVITY,
    NumberDraw,
    Robot,
    write_actuators,
    write_link,
)


def make_pendulum(numbers: NumberDraw) -> Robot:
    """One link on a position servo."""
    length, mass = numbers.draw_about(0.16), numbers.draw_about(0.4)
    load = mass * GRAVITY * length / 2
    joint = numbers.write_joint(
        "j1", 0.02, 0.006, 0.01 if numbers.draw_flag(0.5) else 0
    )
    world = f"""    <!-- a weight on a light arm; zero is hanging -->
    <body name="link1" pos="0 0 0.5">
      <joint {joint} axis="0 1 0"/>
      {write_link(length, mass, 0.02)}
    </body>"""
    rest = write_actuators([numbers.write_servo("m1", "j1", 12 * load, 0.5 * load)])
    return Robot(
        "pendulum",
        numbers.write_model("pendulum", world, rest, 0.001, "RK4"),
        {"j1": load},
        {"j1": 1.3},
        links=("link1",),
        window=1.0,
    )


def _write_chain(numbers: NumberDraw, joints: Sequence[str]) -> tuple[str, list[float]]:
    """Two links in a vertical plane, and the static torque each joint can see."""
    l1, l2 = numbers.draw_about(0.25), numbers.draw_about(0.2)
    m1, m2 = numbers.draw_about(0.7), numbers.draw_about(0.4)
    world = f"""    <body name="base" pos="0 0 0.8">
    <body name="link1">
      <joint {joints[0]} axis="0 1 0"/>
      {write_link(l1, m1, 0.02)}
      <body name="link2" pos="0 0 {-l1:.4g}">
        <joint {joints[1]} axis="0 1 0"/>
        {write_link(l2, m2, 0.015)}
      </body>
    </body>
    </body>"""
    low = m2 * GRAVITY * l2 / 2
    return world, [GRAVITY * (m1 * l1 / 2 + m2 * l1) + low, low]


def make_arm2_servo(numbers: NumberDraw) -> Robot:
    """A 2-joint arm on position servos."""
    dry = numbers.draw_flag(0.5)
    joints = [
        numbers.write_joint("j1", 0.15, 0.02, 0.03 if dry else 0),
        numbers.write_joint("j2", 0.05, 0.008, 0.01 if dry else 0),
    ]
    world, load = _write_chain(numbers, joints)
    servos = [
        numbers.write_servo(f"m{i + 1}", f"j{i + 1}", 15 * load[i], 0.7 * load[i])
        for i in range(2)
    ]
    return Robot(
        "arm2_servo",
        numbers.write_model("arm2", world, write_actuators(servos), 0.001),
        {"j1": load[0] / 2, "j2": load[1]},
        {"j1": 0.9, "j2": 1.1},
        links=("link1", "link2"),
        window=1.0,
    )


def make_arm2_torque(numbers: NumberDraw) -> Robot:
    """A 2-joint arm whose recorded command is a feedback's torque."""
    joints = [
        numbers.write_joint("j1", 0.12, 0.02, 0),
        numbers.write_joint("j2", 0.05, 0.008, 0),
    ]
    world, load = _write_chain(numbers, joints)
    motors = [f'<motor name="m{i}" joint="j{i}"/>' for i in (1, 2)]
    return Robot(
        "arm2_torque",
        numbers.write_model("arm2", world, write_actuators(motors), 0.001, "RK4"),
        {"j1": load[0] / 2, "j2": load[1]},
        {"j1": 0.9, "j2": 1.1},
        gains={
            "j1": (5 * load[0], 0.5 * load[0]),
            "j2": (5 * load[1], 0.4 * load[1]),
        },
        links=("link1", "link2"),
    )


def make_arm3(numbers: NumberDraw) -> Robot:
    """A 3-joint arm that also turns about the vertical, on position servos."""
    l2, l3 = numbers.draw_about(0.22), numbers.draw_about(0.18)
    m1, m2, m3 = (
        numbers.draw_about(0.8),
        numbers.draw_about(0.5),
        numbers.draw_about(0.35),
    )
    j1 = numbers.write_joint("j1", 0.15, 0.02, 0.02)
    j2 = numbers.write_joint("j2", 0.15, 0.02, 0)
    j3 = numbers.write_joint("j3", 0.05, 0.008, 0)
    world = f"""    <body name="link1" pos="0 0 0.6">
      <joint {j1} axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{m1}" diaginertia="1.2e-3 1.2e-3 1.5e-3"/>
      <geom type="cylinder" size="0.05 0.03" {DRAWN_ONLY}/>
      <body name="link2" pos="0.04 0 0">
        <joint {j2} axis="0 1 0"/>
      {write_link(l2, m2, 0.02)}
        <body name="link3" pos="0 0 {-l2:.4g}">
          <joint {j3} axis="0 1 0"/>
      {write_link(l3, m3, 0.015)}
        </body>
      </body>
    </body>"""
    low = m3 * GRAVITY * l3 / 2
    load = [1.0, GRAVITY * (m2 * l2 / 2 + m3 * l2) + low, low]
    stiff = [12.0, 15 * load[1], 15 * load[2]]
    servos = [
        numbers.write_servo(f"m{i + 1}", f"j{i + 1}", stiff[i], 0.06 * stiff[i])
        for i in range(3)
    ]
    return Robot(
        "arm3",
        numbers.write_model("arm3", world, write_actuators(servos), 0.001),
        {"j1": 0.6, "j2": load[1] / 2, "j3": load[2]},
        {"j1": 0.9, "j2": 0.7, "j3": 0.9},
        {"j2": 0.7, "j3": 0.4},
        links=("link2", "link3"),
        window=1.0,
    )


def make_cartpole(numbers: NumberDraw) -> Robot:
    """A cart on a rail with a pole that hangs; the command is the force on the cart."""
    length, cart, mass = (
        numbers.draw_about(0.4),
        numbers.draw_about(0.8),
        numbers.draw_about(0.2),
    )
    slide = numbers.write_joint("j1", 1.0, 0, 0.5 if numbers.draw_flag(0.5) else 0)
    hinge = numbers.write_joint("j2", 0.002, 0, 0)
    world = f"""    <geom name="rail" type="capsule" size="0.01 1" quat="1 0 1 0"
          {DRAWN_ONLY}/>
    <body name="cart">
      <joint {slide} type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{cart}" diaginertia="2e-3 2e-3 2e-3"/>
      <geom type="box" size="0.08 0.05 0.03" {DRAWN_ONLY}/>
      <body name="pole">
        <joint {hinge} axis="0 1 0"/>
      {write_link(length, mass, 0.01)}
      </body>
    </body>"""
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
    joints = [
        numbers.write_joint("j1", 0.006, 0, 0),
        numbers.write_joint("j2", 0.002, 0, 0),
    ]
    world, load = _write_chain(numbers, joints)
    return Robot(
        "double_pendulum",
        numbers.write_model("double_pendulum", world, "", 0.002, "RK4"),
        {"j1": load[0] / 3, "j2": load[1] / 2},
        {"j1": 1.1, "j2": 1.1},
        links=("link1", "link2"),
        fine=0.0001,
    )


def _write_leg(
    numbers: NumberDraw, number: int, x: float, y: float, sizes: Sequence[float]
) -> str:
    """Two links and a round foot below a corner of the torso."""
    upper, lower, mass = sizes
    rod = 'type="capsule" contype="0" conaffinity="0"'
    hip = numbers.write_joint(f"hip{number}", 0.05, 0.005, 0.02)
    knee = numbers.write_joint(f"knee{number}", 0.05, 0.005, 0.02)
    return f"""      <body name="leg{number}_upper" pos="{x:.4g} {y:.4g} 0">
        <joint {hip} axis="0 1 0"/>
        <geom {rod} size="0.012 {upper / 2:.4g}" pos="0 0 {-upper / 2:.4g}"
              mass="{mass:.4g}"/>
        <body name="leg{number}_lower" pos="0 0 {-upper:.4g}">
          <joint {knee} axis="0 1 0"/>
          <geom {rod} size="0.01 {lower / 2:.4g}" pos="0 0 {-lower / 2:.4g}"
                mass="{0.6 * mass:.4g}"/>
          <geom name="foot{number}" class="ground" size="0.015" pos="0 0 {-lower:.4g}"
                mass="0.02"/>
        </body>
      </body>
"""


def make_quadruped(numbers: NumberDraw) -> Robot:
    """A torso on four legs of two servos each, on the floor."""
    width, depth, mass = (
        numbers.draw_about(0.12),
        numbers.draw_about(0.09),
        numbers.draw_about(1.4),
    )
    sizes = numbers.draw_about(0.1), numbers.draw_about(0.1), numbers.draw_about(0.12)
    corners = [(1, width, depth), (2, width, -depth), (3, -width, depth)]
    corners.append((4, -width, -depth))
    legs = "".join(_write_leg(numbers, n, x, y, sizes) for n, x, y in corners)
    height = sizes[0] * np.cos(0.45) + sizes[1] * np.cos(0.45) + 0.02
    world = f"""    <geom name="floor" class="ground" type="plane" size="3 3 0.1"/>
    <body name="torso" pos="0 0 {height:.4g}">
      <freejoint name="root"/>
      <geom type="box" size="{width:.4g} {depth:.4g} 0.03" mass="{mass}" {DRAWN_ONLY}/>
{legs}    </body>"""
    kp = numbers.draw_about(18.0)
    servos = [
        f'<position name="{j}{n}_servo" joint="{j}{n}" kp="{kp}" kv="0.5"/>'
        for n in range(1, 5)
        for j in ("hip", "knee")
    ]
    defaults = f"""  <default>
    <default class="ground">
      <geom friction="{numbers.draw_about(0.7)} 0.005 0.0001" condim="3"/>
    </default>
  </default>
"""
    joints = [f"{j}{n}" for n in range(1, 5) for j in ("hip", "knee")]
    amplitude = {j: 0.2 if j.startswith("hip") else 0.25 for j in joints}
    return Robot(
        "quadruped",
        numbers.write_model(
            "quadruped", world, defaults + write_actuators(servos), 0.002
        ),
        {j: 0.5 for j in joints},
        amplitude,
        {j: 0.45 if j.startswith("hip") else -0.9 for j in joints},
        links=[f"leg{n}_{p}" for n in range(1, 5) for p in ("upper", "lower")],
        fine=0.0004,
    )


def _make_toss(numbers: NumberDraw, name: str, geom: str, step: float = 0.001) -> Robot:
    world = f"""    <geom name="table" type="plane" size="3 3 0.1"
          friction="FRI 0.005 1e-4"/>
    <body name="{name}">
      <freejoint/>
      {geom}
    </body>"""
    world = world.replace("FRI", str(numbers.draw_about(0.4)))
    return Robot(
        f"toss_{name}",
        numbers.write_model(name, world, "", step, "RK4"),
        fine=0.0001,
    )


def make_toss_box(numbers: NumberDraw) -> Robot:
    """A box thrown on a table."""
    sides = " ".join(f"{numbers.draw_about(0.045):.4g}" for _ in range(3))
    mass = numbers.draw_about(0.3)
    geom = f'<geom type="box" size="{sides}" mass="{mass}" friction="0.1 0.005 1e-4"/>'
    return _make_toss(numbers, "box", geom)


def make_toss_stick(numbers: NumberDraw) -> Robot:
    """A stick thrown on a table."""
    size = f"{numbers.draw_about(0.015):.4g} {numbers.draw_about(0.09):.4g}"
    mass = numbers.draw_about(0.15)
    geom = (
        f'<geom type="capsule" size="{size}" mass="{mass}" friction="0.1 0.005 1e-4"/>'
    )
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
