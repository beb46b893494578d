"""The sealed benchmark's robots: takes a generator, gives the MJCF a user would have.

Every link hangs along -z of its frame, so that a length is a scale of that axis. All
sizes are drawn per case, chosen within 25 % around a desk-top device of that shape.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

GRAVITY = 9.81  # [m/s^2]
FAST = "implicitfast"
OPEN = 'contype="0" conaffinity="0"'  # a geom that is only drawn


@dataclass(frozen=True)
class Robot:
    """A given model and what the benchmark has to know of it.

    Attributes:
        name: of the shape.
        xml: the model as the user has it.
        joints: hinges and slides, whose position is recorded.
        actuators: joint that each actuator moves.
        drive: "servo" (goal positions), "torque" (recorded feedback) or "none".
        load: [N m or N] torque that is typical of each joint.
        amplitude: [rad or m] of each joint's motion.
        center: [rad or m] around which it moves.
        gains: (proportional, derivative) of the recorded feedback, by joint.
        links: bodies whose length, mass and attachment can be wrong.
        free: the body that floats, whose pose is recorded; "" if none.
        contact: True where a body touches the floor.
        step: [s] of the model as given.
        fine: [s] of the hidden robot's.
        window: [s] over which two simulations are compared.
    """

    name: str
    xml: str
    joints: Sequence[str]
    actuators: Mapping[str, str]
    drive: str
    load: Mapping[str, float]
    amplitude: Mapping[str, float]
    center: Mapping[str, float] = field(default_factory=dict)
    gains: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    links: Sequence[str] = ()
    free: str = ""
    contact: bool = False
    step: float = 0.001
    fine: float = 0.00025
    window: float = 0.5


@dataclass
class Draw:
    """Draws a model's numbers; those listed as zero are stated as 0.

    Attributes:
        rng: the generator.
        zero: "damping:j1" and the like.
        density: [kg/m^3] of the medium.
    """

    rng: np.random.Generator
    zero: frozenset[str] = frozenset()
    density: float = 0.0

    def about(self, value: float) -> float:
        """A number within 25 % of `value`, as a user would write it."""
        return float(f"{value * self.rng.uniform(0.75, 1.25):.3g}")

    def joint(self, name: str, damping: float, armature: float, friction: float) -> str:
        """The attributes of a joint."""
        values = {"damping": damping, "armature": armature, "frictionloss": friction}
        texts = [f'name="{name}"']
        for key, value in values.items():
            drawn = self.about(value)
            zero = f"{key}:{name}" in self.zero or value == 0
            texts += [] if zero else [f'{key}="{drawn:.4g}"']
        return " ".join(texts)

    def servo(self, name: str, joint: str, kp: float, kv: float) -> str:
        """A position servo."""
        kp, kv = self.about(kp), self.about(kv)
        return f'<position name="{name}" joint="{joint}" kp="{kp}" kv="{kv}"/>'

    def flip(self, chance: float) -> bool:
        """True with a chance."""
        return bool(self.rng.random() < chance)


def _model(
    draw: Draw, name: str, world: str, rest: str, step: float, integrator: str = FAST
) -> str:
    """A whole MJCF file."""
    medium = f' density="{draw.density:g}"' if draw.density else ""
    return f"""<mujoco model="{name}">
  <compiler angle="radian"/>
  <option timestep="{step:g}" integrator="{integrator}"{medium}/>
  <worldbody>
{world.rstrip()}
  </worldbody>
{rest.rstrip()}
</mujoco>
"""


def _link(length: float, mass: float, thick: float = 0.012) -> str:
    """Inertia and shape of a uniform rod that hangs from its origin."""
    inertia = mass * (length**2 / 12 + thick**2 / 4)
    along = mass * thick**2 / 2
    return (
        f'<inertial pos="0 0 {-length / 2:.5g}" mass="{mass:.4g}" '
        f'diaginertia="{inertia:.4g} {inertia:.4g} {along:.4g}"/>\n'
        f'      <geom type="capsule" size="{thick:g} {length / 2 - thick:.4g}" '
        f'pos="0 0 {-length / 2:.5g}" {OPEN}/>'
    )


def _actuators(texts: Sequence[str]) -> str:
    return "  <actuator>\n    " + "\n    ".join(texts) + "\n  </actuator>"


def pendulum(draw: Draw) -> Robot:
    """One link on a position servo."""
    length, mass = draw.about(0.16), draw.about(0.4)
    load = mass * GRAVITY * length / 2
    joint = draw.joint("j1", 0.02, 0.006, 0.01 if draw.flip(0.5) else 0)
    world = f"""    <!-- a weight on a light arm; zero is hanging -->
    <body name="link1" pos="0 0 0.5">
      <joint {joint} axis="0 1 0"/>
      {_link(length, mass, 0.02)}
    </body>"""
    rest = _actuators([draw.servo("m1", "j1", 12 * load, 0.5 * load)])
    return Robot(
        "pendulum",
        _model(draw, "pendulum", world, rest, 0.001, "RK4"),
        ("j1",),
        {"m1": "j1"},
        "servo",
        {"j1": load},
        {"j1": 1.3},
        links=("link1",),
        window=1.0,
    )


def _chain2(draw: Draw, joints: Sequence[str]) -> tuple[str, list[float]]:
    """Two links in a vertical plane, and the static torque each joint can see."""
    l1, l2 = draw.about(0.25), draw.about(0.2)
    m1, m2 = draw.about(0.7), draw.about(0.4)
    world = f"""    <body name="base" pos="0 0 0.8">
    <body name="link1">
      <joint {joints[0]} axis="0 1 0"/>
      {_link(l1, m1, 0.02)}
      <body name="link2" pos="0 0 {-l1:.4g}">
        <joint {joints[1]} axis="0 1 0"/>
        {_link(l2, m2, 0.015)}
      </body>
    </body>
    </body>"""
    low = m2 * GRAVITY * l2 / 2
    return world, [GRAVITY * (m1 * l1 / 2 + m2 * l1) + low, low]


def arm2_servo(draw: Draw) -> Robot:
    """A 2-joint arm on position servos."""
    dry = draw.flip(0.5)
    joints = [
        draw.joint("j1", 0.15, 0.02, 0.03 if dry else 0),
        draw.joint("j2", 0.05, 0.008, 0.01 if dry else 0),
    ]
    world, load = _chain2(draw, joints)
    servos = [
        draw.servo(f"m{i + 1}", f"j{i + 1}", 15 * load[i], 0.7 * load[i])
        for i in range(2)
    ]
    return Robot(
        "arm2_servo",
        _model(draw, "arm2", world, _actuators(servos), 0.001),
        ("j1", "j2"),
        {"m1": "j1", "m2": "j2"},
        "servo",
        {"j1": load[0] / 2, "j2": load[1]},
        {"j1": 0.9, "j2": 1.1},
        links=("link1", "link2"),
        window=1.0,
    )


def arm2_torque(draw: Draw) -> Robot:
    """A 2-joint arm whose recorded command is a feedback's torque."""
    joints = [draw.joint("j1", 0.12, 0.02, 0), draw.joint("j2", 0.05, 0.008, 0)]
    world, load = _chain2(draw, joints)
    motors = [f'<motor name="m{i}" joint="j{i}"/>' for i in (1, 2)]
    return Robot(
        "arm2_torque",
        _model(draw, "arm2", world, _actuators(motors), 0.001, "RK4"),
        ("j1", "j2"),
        {"m1": "j1", "m2": "j2"},
        "torque",
        {"j1": load[0] / 2, "j2": load[1]},
        {"j1": 0.9, "j2": 1.1},
        gains={
            "j1": (5 * load[0], 0.5 * load[0]),
            "j2": (5 * load[1], 0.4 * load[1]),
        },
        links=("link1", "link2"),
    )


def arm3(draw: Draw) -> Robot:
    """A 3-joint arm that also turns about the vertical, on position servos."""
    l2, l3 = draw.about(0.22), draw.about(0.18)
    m1, m2, m3 = draw.about(0.8), draw.about(0.5), draw.about(0.35)
    j1 = draw.joint("j1", 0.15, 0.02, 0.02)
    j2 = draw.joint("j2", 0.15, 0.02, 0)
    j3 = draw.joint("j3", 0.05, 0.008, 0)
    world = f"""    <body name="link1" pos="0 0 0.6">
      <joint {j1} axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{m1}" diaginertia="1.2e-3 1.2e-3 1.5e-3"/>
      <geom type="cylinder" size="0.05 0.03" {OPEN}/>
      <body name="link2" pos="0.04 0 0">
        <joint {j2} axis="0 1 0"/>
      {_link(l2, m2, 0.02)}
        <body name="link3" pos="0 0 {-l2:.4g}">
          <joint {j3} axis="0 1 0"/>
      {_link(l3, m3, 0.015)}
        </body>
      </body>
    </body>"""
    low = m3 * GRAVITY * l3 / 2
    load = [1.0, GRAVITY * (m2 * l2 / 2 + m3 * l2) + low, low]
    stiff = [12.0, 15 * load[1], 15 * load[2]]
    servos = [
        draw.servo(f"m{i + 1}", f"j{i + 1}", stiff[i], 0.06 * stiff[i])
        for i in range(3)
    ]
    return Robot(
        "arm3",
        _model(draw, "arm3", world, _actuators(servos), 0.001),
        ("j1", "j2", "j3"),
        {"m1": "j1", "m2": "j2", "m3": "j3"},
        "servo",
        {"j1": 0.6, "j2": load[1] / 2, "j3": load[2]},
        {"j1": 0.9, "j2": 0.7, "j3": 0.9},
        {"j2": 0.7, "j3": 0.4},
        links=("link2", "link3"),
        window=1.0,
    )


def cartpole(draw: Draw) -> Robot:
    """A cart on a rail with a pole that hangs; the command is the force on the cart."""
    length, cart, mass = draw.about(0.4), draw.about(0.8), draw.about(0.2)
    slide = draw.joint("j1", 1.0, 0, 0.5 if draw.flip(0.5) else 0)
    hinge = draw.joint("j2", 0.002, 0, 0)
    world = f"""    <geom name="rail" type="capsule" size="0.01 1" quat="1 0 1 0"
          {OPEN}/>
    <body name="cart">
      <joint {slide} type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{cart}" diaginertia="2e-3 2e-3 2e-3"/>
      <geom type="box" size="0.08 0.05 0.03" {OPEN}/>
      <body name="pole">
        <joint {hinge} axis="0 1 0"/>
      {_link(length, mass, 0.01)}
      </body>
    </body>"""
    rest = _actuators(['<motor name="m1" joint="j1"/>'])
    return Robot(
        "cartpole",
        _model(draw, "cartpole", world, rest, 0.001, "RK4"),
        ("j1", "j2"),
        {"m1": "j1"},
        "torque",
        {"j1": 4.0, "j2": mass * GRAVITY * length / 4},
        {"j1": 0.25, "j2": 1.0},
        gains={"j1": (60.0, 12.0)},
        links=("cart", "pole"),
    )


def double_pendulum(draw: Draw) -> Robot:
    """Two links that are let go and swing freely."""
    joints = [draw.joint("j1", 0.006, 0, 0), draw.joint("j2", 0.002, 0, 0)]
    world, load = _chain2(draw, joints)
    return Robot(
        "double_pendulum",
        _model(draw, "double_pendulum", world, "", 0.002, "RK4"),
        ("j1", "j2"),
        {},
        "none",
        {"j1": load[0] / 3, "j2": load[1] / 2},
        {"j1": 1.1, "j2": 1.1},
        links=("link1", "link2"),
        step=0.002,
        fine=0.0001,
    )


def _leg(draw: Draw, number: int, x: float, y: float, sizes: Sequence[float]) -> str:
    """Two links and a round foot below a corner of the torso."""
    upper, lower, mass = sizes
    rod = 'type="capsule" contype="0" conaffinity="0"'
    return f"""      <body name="leg{number}_upper" pos="{x:.4g} {y:.4g} 0">
        <joint {draw.joint(f"hip{number}", 0.05, 0.005, 0.02)} axis="0 1 0"/>
        <geom {rod} size="0.012 {upper / 2:.4g}" pos="0 0 {-upper / 2:.4g}"
              mass="{mass:.4g}"/>
        <body name="leg{number}_lower" pos="0 0 {-upper:.4g}">
          <joint {draw.joint(f"knee{number}", 0.05, 0.005, 0.02)} axis="0 1 0"/>
          <geom {rod} size="0.01 {lower / 2:.4g}" pos="0 0 {-lower / 2:.4g}"
                mass="{0.6 * mass:.4g}"/>
          <geom name="foot{number}" class="ground" size="0.015" pos="0 0 {-lower:.4g}"
                mass="0.02"/>
        </body>
      </body>
"""


def quadruped(draw: Draw) -> Robot:
    """A torso on four legs of two servos each, on the floor."""
    width, depth, mass = draw.about(0.12), draw.about(0.09), draw.about(1.4)
    sizes = draw.about(0.1), draw.about(0.1), draw.about(0.12)
    corners = [(1, width, depth), (2, width, -depth), (3, -width, depth)]
    corners.append((4, -width, -depth))
    legs = "".join(_leg(draw, n, x, y, sizes) for n, x, y in corners)
    height = sizes[0] * np.cos(0.45) + sizes[1] * np.cos(0.45) + 0.02
    world = f"""    <geom name="floor" class="ground" type="plane" size="3 3 0.1"/>
    <body name="torso" pos="0 0 {height:.4g}">
      <freejoint name="root"/>
      <geom type="box" size="{width:.4g} {depth:.4g} 0.03" mass="{mass}" {OPEN}/>
{legs}    </body>"""
    kp = draw.about(18.0)
    servos = [
        f'<position name="{j}{n}_servo" joint="{j}{n}" kp="{kp}" kv="0.5"/>'
        for n in range(1, 5)
        for j in ("hip", "knee")
    ]
    defaults = f"""  <default>
    <default class="ground">
      <geom friction="{draw.about(0.7)} 0.005 0.0001" condim="3"/>
    </default>
  </default>
"""
    joints = [f"{j}{n}" for n in range(1, 5) for j in ("hip", "knee")]
    amplitude = {j: 0.2 if j.startswith("hip") else 0.25 for j in joints}
    return Robot(
        "quadruped",
        _model(draw, "quadruped", world, defaults + _actuators(servos), 0.002),
        joints,
        {f"{j}_servo": j for j in joints},
        "servo",
        {j: 0.5 for j in joints},
        amplitude,
        {j: 0.45 if j.startswith("hip") else -0.9 for j in joints},
        links=[f"leg{n}_{p}" for n in range(1, 5) for p in ("upper", "lower")],
        free="torso",
        contact=True,
        step=0.002,
        fine=0.0004,
    )


def _toss(draw: Draw, name: str, geom: str, step: float = 0.001) -> Robot:
    world = f"""    <geom name="table" type="plane" size="3 3 0.1"
          friction="FRI 0.005 1e-4"/>
    <body name="{name}">
      <freejoint/>
      {geom}
    </body>"""
    world = world.replace("FRI", str(draw.about(0.4)))
    return Robot(
        f"toss_{name}",
        _model(draw, name, world, "", step, "RK4"),
        (),
        {},
        "none",
        {},
        {},
        links=(name,),
        free=name,
        contact=True,
        step=step,
        fine=0.0001,
    )


def toss_box(draw: Draw) -> Robot:
    """A box thrown on a table."""
    sides = " ".join(f"{draw.about(0.045):.4g}" for _ in range(3))
    mass = draw.about(0.3)
    geom = f'<geom type="box" size="{sides}" mass="{mass}" friction="0.1 0.005 1e-4"/>'
    return _toss(draw, "box", geom)


def toss_stick(draw: Draw) -> Robot:
    """A stick thrown on a table."""
    size = f"{draw.about(0.015):.4g} {draw.about(0.09):.4g}"
    mass = draw.about(0.15)
    geom = (
        f'<geom type="capsule" size="{size}" mass="{mass}" friction="0.1 0.005 1e-4"/>'
    )
    return _toss(draw, "stick", geom, 0.0005)


ROBOTS: Mapping[str, Callable[[Draw], Robot]] = {
    "pendulum": pendulum,
    "arm2_servo": arm2_servo,
    "arm2_torque": arm2_torque,
    "arm3": arm3,
    "cartpole": cartpole,
    "double_pendulum": double_pendulum,
    "quadruped": quadruped,
    "toss_box": toss_box,
    "toss_stick": toss_stick,
}
