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


@dataclass(frozen=True)
class Robot:
    """A chain of links as its model has it.

    Attributes:
        name: of its sort.
        links: from the base outwards.
        rate: [Hz] around which it moves.
        timestep: [s] of the model.
        integrator: of the model.
        style: of its actuators' MJCF: "position", "general" or "motor".
        tilt: [rad] by which the base is turned about y.
    """

    name: str
    links: tuple[Link, ...]
    rate: float
    timestep: float
    integrator: str
    style: str
    tilt: float = 0.0

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(link.joint for link in self.links)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators, in the order of the joints."""
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


def write_mjcf(robot: Robot, *, actuated: bool = True, timestep: float = 0.0) -> str:
    """MJCF of a robot.

    Args:
        robot: that is written.
        actuated: whether with its actuators.
        timestep: [s] in place of the robot's own, 0: that.
    """
    body = ""
    for i, link in enumerate(robot.links):
        pad = "  " * (i + 3)
        kind = ' type="slide"' if link.slide else ""
        turn = f' euler="0 {robot.tilt:.6g} 0"' if robot.tilt and not i else ""
        body += (
            f'{pad}<body name="b_{link.joint}" pos="{_join(link.at)}"{turn}>\n'
            f'{pad}  <joint name="{link.joint}"{kind} axis="{link.axis}"/>\n'
            f'{pad}  <geom type="capsule" fromto="0 0 0 {_join(link.to)}" '
            f'size="{link.radius:.6g}" mass="{link.mass:.8g}"/>\n'
        )
    for i in reversed(range(len(robot.links))):
        body += "  " * (i + 3) + "</body>\n"
    lines = [_write_actuator(robot, i) for i in range(len(robot.links))]
    driven = "  <actuator>\n" + "".join(lines) + "  </actuator>\n" if actuated else ""
    return (
        f'<mujoco model="{robot.name}">\n'
        '  <compiler angle="radian"/>\n'
        f'  <option timestep="{timestep or robot.timestep:g}" '
        f'integrator="{robot.integrator}"/>\n'
        '  <default><geom contype="0" conaffinity="0"/></default>\n'
        f"  <worldbody>\n{body}  </worldbody>\n{driven}</mujoco>\n"
    )


def _write_actuator(robot: Robot, index: int) -> str:
    link, name = robot.links[index], robot.actuators[index]
    head = f'name="{name}" joint="{link.joint}"'
    limit = f' forcerange="{-link.limit:.6g} {link.limit:.6g}"' if link.limit else ""
    if robot.style == "motor":
        return f"    <motor {head}{limit}/>\n"
    if robot.style == "position":
        gains = f'kp="{link.kp:.6g}" kv="{link.kv:.6g}"'
        return f"    <position {head} {gains}{limit}/>\n"
    gains = f'gainprm="{link.kp:.6g}" biasprm="0 {-link.kp:.6g} {-link.kv:.6g}"'
    return f'    <general {head} biastype="affine" {gains}{limit}/>\n'


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


def draw_robot(rng: Rng, count: int, *, servo: bool) -> Robot:
    """A random robot.

    Args:
        rng: draws it.
        count: of its joints, 1 to 7.
        servo: whether its actuators are servos, else they are motors.
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
    style = ("position", "general")[rng.integers(2)] if servo else "motor"
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


def _size_drives(robot: Robot, rng: Rng) -> Robot:
    """The robot with servo gains and torque limits that fit its size."""
    torques, inertias = measure_loads(robot)
    links = []
    stiff = rng.uniform(2.5, 6.0)  # Hz of a servo's closed loop
    for link, torque, inertia in zip(robot.links, torques, inertias, strict=True):
        kp = kv = 0.0
        if robot.style != "motor":
            # a real drive's rotor makes it slower than the model says
            kp = 2.0 * inertia * (2 * np.pi * stiff) ** 2 + 2.0 * torque
            kv = 2 * rng.uniform(0.3, 0.8) * np.sqrt(kp * 2 * inertia)
        limit = 12 * torque if rng.random() < 0.6 else 0.0
        links.append(replace(link, kp=kp, kv=kv, limit=limit))
    return replace(robot, links=tuple(links))


def measure_loads(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Typical torques and inertias of the joints along their motions.

    Returns:
        (n) [N m or N] and (n) [kg m^2 or kg].
    """
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot, actuated=False))
    data: Any = mujoco.MjData(model)
    rng, weights, inertias = np.random.default_rng(0), [], []
    for _ in range(30):
        data.qpos[:] = robot.home + robot.swings * rng.uniform(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        weights.append(np.abs(data.qfrc_bias))
        inertias.append(np.diag(full))
    inertia = np.mean(inertias, 0)
    pull = robot.swings * (2 * np.pi * robot.rate) ** 2
    return np.mean(weights, 0) + 0.5 * inertia * pull, inertia
