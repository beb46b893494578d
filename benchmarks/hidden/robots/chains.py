"""Chains of 1 to 7 driven joints on a fixed base: a generator in, robots out."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.hidden.robots.robot import Rng, Robot, read_world

STEP = 0.0005  # [s] of the hidden robot; chosen: a quarter of a model's usual one


@dataclass(frozen=True)
class Link:
    """A body of a chain, its joint, and what drives it.

    Attributes:
        axis: of the joint, in MJCF.
        at: (3) [m] where it is attached to the link before it.
        to: (3) [m] where it ends.
        radius: [m] of its capsule.
        mass: [kg] of the capsule.
        swing: [rad or m] amplitude of its motions.
        home: [rad or m] in the middle of its motions.
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

    def write_joint(self) -> str:
        """MJCF of its joint."""
        kind = ' type="slide"' if self.slide else ""
        return f'<joint name="{self.joint}"{kind} axis="{self.axis}"/>'


@dataclass(frozen=True)
class Chain:
    """A chain of links, written by parts.

    Attributes:
        rate: [Hz] around which it moves.
        timestep: [s] of the model.
        tilt: [rad] by which the base is turned about y.
        linkage: whether the second of two links is the crank of a four-bar linkage.
    """

    name: str
    links: tuple[Link, ...]
    rate: float
    timestep: float
    integrator: str
    tilt: float = 0.0
    linkage: bool = False

    def write(self, actuators: str = "") -> str:
        """Its MJCF, with actuators."""
        turn = f' euler="0 {self.tilt:.6g} 0"' if self.tilt else ""
        return read_world(
            "base",
            name=self.name,
            timestep=self.timestep,
            integrator=self.integrator,
            turn=turn,
            bodies=self._write_linkage() if self.linkage else self._write_links(),
            loop=self._write_loop() if self.linkage else "",
            actuators=actuators and f"  <actuator>{actuators}</actuator>",
        )

    def _write_links(self) -> str:
        body = "".join(
            read_world(
                "link",
                joint=link.joint,
                written=link.write_joint(),
                at=_join(link.at),
                to=_join(link.to),
                radius=link.radius,
                mass=link.mass,
            )
            for link in self.links
        )
        return body + "      " + "</body>" * len(self.links) + "\n"

    def _write_linkage(self) -> str:
        """A leg whose knee is moved by a crank at the hip, through a rod."""
        thigh, crank = self.links
        long, arm, size, mass = -thigh.to[2], crank.to[0], thigh.radius, thigh.mass
        return read_world(
            "linkage",
            thigh=thigh.joint,
            crank=crank.joint,
            hip=thigh.write_joint(),
            turn=crank.write_joint(),
            end=-long,
            side=0.1 * long,
            arm=arm,
            sizes=[1.0 * size, 0.4 * size, 0.3 * size, 0.8 * size],
            masses=[1.0 * mass, crank.mass / mass * mass, 0.08 * mass, 0.4 * mass],
        )

    def _write_loop(self) -> str:
        anchor = f'anchor="0 0 {self.links[0].to[2]:.6g}" solref=".004 1"'
        connect = f'<connect body1="rod" body2="shank" {anchor}/>'
        return f"  <equality>\n    {connect}\n  </equality>\n"

    def add_drives(self, rng: Rng, style: str) -> Robot:
        """The robot with servo gains and torque limits that fit its size.

        Args:
            style: "position", "general", "motor" or "none", of its actuators.
        """
        torques, inertias = measure_loads(self)
        written = ""
        stiff = rng.uniform(2.5, 6.0)  # Hz of a servo's closed loop
        for link, torque, inertia in zip(self.links, torques, inertias, strict=True):
            kp = kv = 0.0
            if style in ("position", "general"):
                # a real drive's rotor makes it slower than the model says
                kp = 2.0 * inertia * (2 * np.pi * stiff) ** 2 + 2.0 * torque
                kv = 2 * rng.uniform(0.3, 0.8) * np.sqrt(kp * 2 * inertia)
            limit = 12 * torque if style != "none" and rng.random() < 0.6 else 0.0
            written += _write_actuator(link, style, kp, kv, limit)
        names = [link.joint for link in self.links]
        return Robot(
            self.name,
            self.write(written),
            load=dict(zip(names, torques, strict=True)),
            amplitude={link.joint: link.swing for link in self.links},
            center={link.joint: link.home for link in self.links},
            links=[f"b_{name}" for name in names],
            fine=STEP,
            rate=self.rate,
            inertia=dict(zip(names, inertias, strict=True)),
        )


def _join(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _write_actuator(link: Link, style: str, kp: float, kv: float, limit: float) -> str:
    if style == "none":
        return ""
    head = f'name="m_{link.joint}" joint="{link.joint}"'
    more = f' forcerange="{-limit:.6g} {limit:.6g}"' if limit else ""
    if style == "motor":
        return f"\n    <motor {head}{more}/>"
    if style == "position":
        return f'\n    <position {head} kp="{kp:.6g}" kv="{kv:.6g}"{more}/>'
    gains = f'gainprm="{kp:.6g}" biasprm="0 {-kp:.6g} {-kv:.6g}"'
    return f'\n    <general {head} biastype="affine" {gains}{more}/>'


def measure_loads(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Typical torques and inertias of the joints along their motions.

    Returns:
        (n) [N m or N] and (n) [kg m^2 or kg].
    """
    model = mujoco.MjModel.from_xml_string(chain.write())
    data = mujoco.MjData(model)
    at = [model.joint(link.joint).dofadr[0] for link in chain.links]
    home, swings = np.array([(link.home, link.swing) for link in chain.links]).T
    rng, weights, inertias = np.random.default_rng(0), [], []
    for _ in range(30):
        data.qpos[at] = home + swings * rng.uniform(-1, 1, len(at))
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        weights.append(np.abs(data.qfrc_bias[at]))
        inertias.append(np.diag(full)[at])
    inertia = np.mean(inertias, 0)
    pull = swings * (2 * np.pi * chain.rate) ** 2
    return np.mean(weights, 0) + 0.5 * inertia * pull, inertia


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
        links.append(Link(name, axis, before, to, 0.12 * length, mass, swing, home))
        before = to
    return links


def _make_scara(rng: Rng, size: float, heavy: float) -> list[Link]:
    first, second = size * rng.uniform(0.8, 1.2, 2)
    drop, links, before = 0.4 * size, list[Link](), (0.0, 0.0, 0.0)
    ends = (first, 0, 0), (second, 0, 0), (0, 0, -drop), (0.1 * size, 0, -0.1 * size)
    names = ("shoulder", "elbow", "lift", "roll")
    thickness, masses = (0.1, 0.08, 0.04, 0.04), (1.0, 0.6, 0.25, 0.12)
    motions = (0.9, 0.0), (0.9, 0.4), (0.2 * size, 0.0), (1.2, 0.0)  # swing, home
    for i, (name, to, motion) in enumerate(zip(names, ends, motions, strict=True)):
        shape = AXES["z"], before, to, thickness[i] * size, masses[i] * heavy
        links.append(Link(name, *shape, *motion, slide=name == "lift"))
        before = to
    return links


AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
TURNS = ("y", "yy", "xyy", "zyyx", "zyyyz", "zyyzyz", "zyzyzyz")  # of 1 to 7 joints
SORTS = {1: "pendulum", 2: "double_pendulum", 3: "leg", 4: "scara"}
NAMES = {3: ["hip_roll", "hip_pitch", "knee"]}
# length [m] and mass [kg] of a first link, rate [Hz] of its motions: bus servos, legs,
# industrial arms
SIZES = ((0.09, 0.12, 1.0), (0.25, 1.6, 0.8), (0.45, 7.0, 0.4))


def draw_chain(rng: Rng, count: int, style: str) -> Robot:
    """A random robot.

    Args:
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
        axes = [AXES[axis] for axis in TURNS[count - 1]]
        links = _make_links(rng, axes, size, heavy, names)
    if style == "servo":
        style = ("position", "general")[rng.integers(2)]
    chain = Chain(
        name,
        tuple(links),
        rate * rng.uniform(0.8, 1.3),
        float(rng.choice([0.001, 0.002, 0.002])),
        str(rng.choice(["implicitfast", "implicitfast", "Euler"])),
        float(rng.choice([0.0, 0.0, 0.2])),
    )
    return chain.add_drives(rng, style)


def draw_linkage(rng: Rng) -> Robot:
    """A random leg with a four-bar linkage, of two servos."""
    long, mass = rng.uniform(0.2, 0.35), rng.uniform(0.8, 2.5)
    arm = rng.uniform(0.18, 0.3) * long
    thigh = Link("hip", "0 1 0", (0, 0, 0), (0, 0, -long), 0.08 * long, mass, 0.5, 0.2)
    sizes = 0.03 * long, 0.07 * mass, 0.5
    crank = Link("crank", "0 1 0", (0, 0, 0), (arm, 0, 0), *sizes)
    rate, step = rng.uniform(0.5, 1.0), float(rng.choice([0.001, 0.002]))
    chain = Chain("linkage", (thigh, crank), rate, step, "implicitfast", linkage=True)
    return chain.add_drives(rng, "position")
