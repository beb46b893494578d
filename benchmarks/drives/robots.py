"""Random robots on a fixed base, of 1 to 7 driven joints: seeds in, MJCF out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

Rng = np.random.Generator


@dataclass(frozen=True)
class Link:
    """A body of a chain, its joint, and what drives it.

    Attributes:
        joint: its name.
        axis: of the joint, in MJCF.
        at: (3) [m] where it is attached to the link before it.
        to: (3) [m] where it ends.
        radius: [m] of its capsule.
        mass: [kg] of the capsule.
        swing: [rad or m] amplitude of its motions.
        home: [rad or m] in the middle of its motions.
        slide: whether the joint is a slide.
        kp: [N m/rad or N/m] of its servo; 0: a motor.
        kv: [N m s/rad or N s/m] of its servo.
        limit: [N m or N] of what drives it, 0: none.
        goals: (2) [rad or m] least and largest goal of its servo; () none.
        range: (2) [rad or m] stops of the joint; () none.
        friction: [N m or N] that the model states.
        damping: [N m s/rad or N s/m] that the model states.
        armature: [kg m^2 or kg] that the model states.
    """

    joint: str
    axis: str
    at: tuple[float, float, float]
    to: tuple[float, float, float]
    radius: float
    mass: float
    swing: float
    home: float = 0.0
    slide: bool = False
    kp: float = 0.0
    kv: float = 0.0
    limit: float = 0.0
    goals: tuple[float, ...] = ()
    range: tuple[float, ...] = ()
    friction: float = 0.0
    damping: float = 0.0
    armature: float = 0.0


@dataclass(frozen=True)
class Robot:
    """A chain of links as its model has it.

    Attributes:
        name: of its sort.
        links: from the base outwards.
        rate: [Hz] around which it moves.
        timestep: [s] of the model.
        integrator: of the model.
        style: of its actuators' MJCF: "position", "general", "motor" or "none".
        tilt: [rad] by which the base is turned about y.
        linkage: whether the second of two links is the crank of a four-bar linkage.
    """

    name: str
    links: tuple[Link, ...]
    rate: float
    timestep: float
    integrator: str
    style: str
    tilt: float = 0.0
    linkage: bool = False

    @property
    def is_servo(self) -> bool:
        """Whether goals are commanded."""
        return self.style in ("position", "general")

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the driven joints."""
        return tuple(link.joint for link in self.links)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators, in the order of the joints."""
        if self.style == "none":
            return ()
        return tuple(f"m_{link.joint}" for link in self.links)

    @property
    def home(self) -> np.ndarray:
        """(n) [rad or m] middle of the motions."""
        return np.array([link.home for link in self.links])

    @property
    def swings(self) -> np.ndarray:
        """(n) [rad or m] amplitudes of the motions."""
        return np.array([link.swing for link in self.links])


def _join(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def write_mjcf(
    robot: Robot,
    *,
    actuated: bool = True,
    timestep: float = 0.0,
    mount: tuple[float, ...] = (),
) -> str:
    """MJCF of a robot.

    Args:
        robot: that is written.
        actuated: whether with its actuators.
        timestep: [s] in place of the robot's own, 0: that.
        mount: stiffness [N m/rad] and damping [N m s/rad] of what the base stands on.
    """
    body = _write_linkage(robot) if robot.linkage else _write_chain(robot, mount)
    lines = [_write_actuator(robot, i) for i in range(len(robot.actuators))]
    driven = "  <actuator>\n" + "".join(lines) + "  </actuator>\n" if actuated else ""
    return (
        f'<mujoco model="{robot.name}">\n'
        '  <compiler angle="radian"/>\n'
        f'  <option timestep="{timestep or robot.timestep:g}" '
        f'integrator="{robot.integrator}"/>\n'
        '  <default><geom contype="0" conaffinity="0"/></default>\n'
        f"{body}{driven}</mujoco>\n"
    )


def _write_joint(link: Link) -> str:
    kind = ' type="slide"' if link.slide else ""
    more = f' range="{_join(link.range)}"' if link.range else ""
    stated = {"frictionloss": link.friction, "damping": link.damping,
              "armature": link.armature}  # fmt: skip
    more += "".join(f' {key}="{value:.6g}"' for key, value in stated.items() if value)
    return f'<joint name="{link.joint}"{kind} axis="{link.axis}"{more}/>'


def _write_chain(robot: Robot, mount: tuple[float, ...]) -> str:
    body, ends = "", len(robot.links)
    if mount:
        stiffness, damping = mount
        body, ends = (
            f'    <body name="mount"><joint name="mount" axis="0 1 0" '
            f'stiffness="{stiffness:.6g}" damping="{damping:.6g}"/>\n'
            '    <geom type="box" size=".02 .02 .02" mass=".1"/>\n'
        ), ends + 1  # fmt: skip
    for i, link in enumerate(robot.links):
        pad = "  " * (i + 2)
        turn = f' euler="0 {robot.tilt:.6g} 0"' if robot.tilt and not i else ""
        body += (
            f'{pad}<body name="b_{link.joint}" pos="{_join(link.at)}"{turn}>\n'
            f"{pad}  {_write_joint(link)}\n"
            f'{pad}  <geom type="capsule" fromto="0 0 0 {_join(link.to)}" '
            f'size="{link.radius:.6g}" mass="{link.mass:.8g}"/>\n'
        )
    body += "".join("  " * (i + 2) + "</body>\n" for i in reversed(range(ends)))
    return f"  <worldbody>\n{body}  </worldbody>\n"


def _write_linkage(robot: Robot) -> str:
    """A leg whose knee is moved by a crank at the hip, through a rod."""
    thigh, crank = robot.links
    long, arm, mass = -thigh.to[2], crank.to[0], thigh.mass

    def bar(to: str, size: float, share: float) -> str:
        return (
            f'<geom type="capsule" fromto="{to}" size="{size * thigh.radius:.6g}" '
            f'mass="{share * mass:.8g}"/>'
        )

    return f"""  <worldbody>
    <body name="b_{thigh.joint}">
      {_write_joint(thigh)}
      {bar(f"0 0 0 0 0 {-long:.6g}", 1.0, 1.0)}
      <body name="b_{crank.joint}" pos="0 {0.1 * long:.6g} 0">
        {_write_joint(crank)}
        {bar(f"0 0 0 {arm:.6g} 0 0", 0.4, crank.mass / mass)}
        <body name="rod" pos="{arm:.6g} 0 0">
          <joint name="rod" axis="0 1 0"/>
          {bar(f"0 0 0 0 0 {-long:.6g}", 0.3, 0.08)}
        </body>
      </body>
      <body name="shank" pos="0 0 {-long:.6g}">
        <joint name="knee" axis="0 1 0"/>
        {bar(f"0 0 0 0 0 {-long:.6g}", 0.8, 0.4)}
      </body>
    </body>
  </worldbody>
  <equality>
    <connect body1="rod" body2="shank" anchor="0 0 {-long:.6g}" solref=".004 1"/>
  </equality>
"""


def _write_actuator(robot: Robot, index: int) -> str:
    link, name = robot.links[index], robot.actuators[index]
    head = f'name="{name}" joint="{link.joint}"'
    more = f' forcerange="{-link.limit:.6g} {link.limit:.6g}"' if link.limit else ""
    more += f' ctrlrange="{_join(link.goals)}"' if link.goals else ""
    if robot.style == "motor":
        return f"    <motor {head}{more}/>\n"
    if robot.style == "position":
        gains = f'kp="{link.kp:.6g}" kv="{link.kv:.6g}"'
        return f"    <position {head} {gains}{more}/>\n"
    gains = f'gainprm="{link.kp:.6g}" biasprm="0 {-link.kp:.6g} {-link.kv:.6g}"'
    return f'    <general {head} biastype="affine" {gains}{more}/>\n'


# ---------------------------------------------------------------- sorts of robots


def _make_links(
    rng: Rng, axes: Sequence[str], size: float, heavy: float, names: Sequence[str]
) -> list[Link]:
    """A chain whose links become shorter, thinner and lighter outwards."""
    links, before = [], (0.0, 0.0, 0.0)
    for i, (axis, name) in enumerate(zip(axes, names, strict=True)):
        share = 1 - 0.6 * i / max(len(axes) - 1, 3)
        length = size * share * rng.uniform(0.8, 1.2)
        mass = heavy * share**2 * rng.uniform(0.6, 1.4)
        side = 0.15 * length * rng.uniform(-1, 1)
        to = (0.1 * length, side, -length)
        swing = rng.uniform(0.4, 0.9)
        home = rng.uniform(-0.4, 0.4)
        links.append(
            Link(name, axis, before, to, 0.12 * length, mass, swing, home)
        )  # fmt: skip
        before = to
    return links


def _make_scara(rng: Rng, size: float, heavy: float) -> list[Link]:
    first, second = size * rng.uniform(0.8, 1.2, 2)
    drop = 0.4 * size
    return [
        Link("shoulder", "0 0 1", (0, 0, 0), (first, 0, 0), 0.1 * size, heavy, 0.9),
        Link("elbow", "0 0 1", (first, 0, 0), (second, 0, 0), 0.08 * size,
             0.6 * heavy, 0.9, 0.4),
        Link("lift", "0 0 1", (second, 0, 0), (0, 0, -drop), 0.04 * size,
             0.25 * heavy, 0.2 * size, 0.0, slide=True),
        Link("roll", "0 0 1", (0, 0, -drop), (0.1 * size, 0, -0.1 * size),
             0.04 * size, 0.12 * heavy, 1.2),
    ]  # fmt: skip


AXES = {
    1: ["0 1 0"],
    2: ["0 1 0", "0 1 0"],
    3: ["1 0 0", "0 1 0", "0 1 0"],
    4: ["0 0 1", "0 1 0", "0 1 0", "1 0 0"],
    5: ["0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1"],
    6: ["0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"],
    7: ["0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1"],
}
SORTS = {1: "pendulum", 2: "double_pendulum", 3: "leg", 4: "scara"}
NAMES = {3: ["hip_roll", "hip_pitch", "knee"]}
# length [m] and mass [kg] of a first link, rate [Hz] of its motions: bus servos, legs,
# industrial arms
SIZES = ((0.09, 0.12, 1.0), (0.25, 1.6, 0.8), (0.45, 7.0, 0.4))


def draw_robot(rng: Rng, count: int, style: str) -> Robot:
    """A random robot.

    Args:
        rng: draws it.
        count: of its joints, 1 to 7.
        style: "servo", "motor" or "none", of its actuators.
    """
    size, heavy, rate = SIZES[rng.integers(3)]
    size, heavy = size * rng.uniform(0.8, 1.25), heavy * rng.uniform(0.7, 1.4)
    name = SORTS.get(count, f"arm{count}")
    if name == "scara" and rng.random() < 0.5:
        links = _make_scara(rng, size, heavy)
    else:
        name = "arm4" if name == "scara" else name
        names = NAMES.get(count, [f"j{i + 1}" for i in range(count)])
        links = _make_links(rng, AXES[count], size, heavy, names)
    if style == "servo":
        style = ("position", "general")[rng.integers(2)]
    robot = Robot(
        name,
        tuple(links),
        rate * rng.uniform(0.8, 1.3),
        float(rng.choice([0.001, 0.002, 0.002])),
        str(rng.choice(["implicitfast", "implicitfast", "Euler"])),
        style,
        float(rng.choice([0.0, 0.0, 0.2])),
    )
    return _size_drives(robot, rng)


def draw_linkage(rng: Rng) -> Robot:
    """A random leg with a four-bar linkage, of two servos."""
    long, mass = rng.uniform(0.2, 0.35), rng.uniform(0.8, 2.5)
    arm = rng.uniform(0.18, 0.3) * long
    thigh = Link("hip", "0 1 0", (0, 0, 0), (0, 0, -long), 0.08 * long, mass, 0.5, 0.2)
    crank = Link("crank", "0 1 0", (0, 0, 0), (arm, 0, 0), 0.03 * long, 0.07 * mass,
                 0.5)  # fmt: skip
    rate, step = rng.uniform(0.5, 1.0), float(rng.choice([0.001, 0.002]))
    robot = Robot("linkage", (thigh, crank), rate, step, "implicitfast", "position",
                  linkage=True)  # fmt: skip
    return _size_drives(robot, rng)


def _size_drives(robot: Robot, rng: Rng) -> Robot:
    """The robot with servo gains and torque limits that fit its size."""
    torques, inertias = measure_loads(robot)
    links = []
    stiff = rng.uniform(2.5, 6.0)  # Hz of a servo's closed loop
    for link, torque, inertia in zip(robot.links, torques, inertias, strict=True):
        kp = kv = 0.0
        if robot.is_servo:
            # a real drive's rotor makes it slower than the model says
            kp = 2.0 * inertia * (2 * np.pi * stiff) ** 2 + 2.0 * torque
            kv = 2 * rng.uniform(0.3, 0.8) * np.sqrt(kp * 2 * inertia)
        limit = 12 * torque if robot.actuators and rng.random() < 0.6 else 0.0
        links.append(replace(link, kp=kp, kv=kv, limit=limit))
    return replace(robot, links=tuple(links))


def measure_loads(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Typical torques and inertias of the joints along their motions.

    Returns:
        (n) [N m or N] and (n) [kg m^2 or kg].
    """
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot, actuated=False))
    data: Any = mujoco.MjData(model)
    at = [model.joint(name).dofadr[0] for name in robot.joints]
    rng, weights, inertias = np.random.default_rng(0), [], []
    for _ in range(30):
        data.qpos[at] = robot.home + robot.swings * rng.uniform(-1, 1, len(at))
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        weights.append(np.abs(data.qfrc_bias[at]))
        inertias.append(np.diag(full)[at])
    inertia = np.mean(inertias, 0)
    pull = robot.swings * (2 * np.pi * robot.rate) ** 2
    return np.mean(weights, 0) + 0.5 * inertia * pull, inertia
