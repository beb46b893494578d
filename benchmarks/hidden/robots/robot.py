"""A robot as its user has it: takes MJCF and typical numbers, and reads the rest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

Rng = np.random.Generator
GRAVITY = 9.81  # [m/s^2]
FAST = "implicitfast"
DRAWN_ONLY = 'contype="0" conaffinity="0"'  # a geom that is only drawn


@dataclass(frozen=True)
class Robot:
    """A given model and what a suite has to know of it.

    Attributes:
        xml: the model as the user has it.
        load: [N m or N] torque that is typical of each joint.
        amplitude: [rad or m] of each joint's motion.
        center: [rad or m] around which it moves.
        gains: (proportional, derivative) of the recorded feedback, by joint.
        links: bodies whose length, mass and attachment can be wrong.
        fine: [s] step of the hidden robot.
        window: [s] over which two simulations are compared.
        rate: [Hz] around which it moves.
        inertia: [kg m^2 or kg] that is typical of each joint.
    """

    name: str
    xml: str
    load: Mapping[str, float] = field(default_factory=dict)
    amplitude: Mapping[str, float] = field(default_factory=dict)
    center: Mapping[str, float] = field(default_factory=dict)
    gains: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    links: Sequence[str] = ()
    fine: float = 0.00025
    window: float = 0.5
    rate: float = 1.0
    inertia: Mapping[str, float] = field(default_factory=dict)

    def read_spec(self) -> Any:
        """A new MjSpec of the given model."""
        return mujoco.MjSpec.from_string(self.xml)

    @cached_property
    def model(self) -> Any:
        """The given model, compiled."""
        return mujoco.MjModel.from_xml_string(self.xml)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Hinges and slides."""
        free = mujoco.mjtJoint.mjJNT_FREE
        every = (self.model.joint(j) for j in range(self.model.njnt))
        return tuple(joint.name for joint in every if joint.type[0] != free)

    @cached_property
    def actuators(self) -> Mapping[str, str]:
        """What each actuator moves: a joint, or "" where it acts at a site."""
        model, on_joint = self.model, mujoco.mjtTrn.mjTRN_JOINT
        return {
            model.actuator(a).name: model.joint(model.actuator_trnid[a, 0]).name
            if model.actuator_trntype[a] == on_joint
            else ""
            for a in range(model.nactuator)
        }

    @cached_property
    def drive(self) -> str:
        """What is commanded: "servo" (goal positions), "torque" or "none"."""
        if not self.model.nactuator:
            return "none"
        return "servo" if self.model.actuator_biasprm[:, 1].any() else "torque"

    @cached_property
    def free(self) -> str:
        """The body that floats, whose pose is recorded; "" if none."""
        model = self.model
        if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
            return model.body(model.jnt_bodyid[0]).name
        return ""

    @cached_property
    def contact(self) -> bool:
        """Whether a body can touch something."""
        return bool(self.model.geom_contype.any())

    @property
    def legged(self) -> bool:
        """Whether it is a torso on legs."""
        return bool(self.free and self.joints)

    def is_slide(self, joint: str) -> bool:
        """Whether a joint is a slide, in m and N."""
        return bool(self.model.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_SLIDE)

    def find_joint(self, target: str) -> str:
        """The joint that a joint, an actuator or a joint position signal belongs to."""
        kind, _, name = target.partition(":")
        if kind == "actuator":
            return self.actuators[name]
        return name.removesuffix("_position")

    def find_actuator(self, joint: str) -> str:
        """The actuator that moves a joint."""
        return next(a for a, moved in self.actuators.items() if moved == joint)


def get_name(target: str) -> str:
    """The name in a target, which is "KIND:NAME"."""
    return target.partition(":")[2]


def draw_log_uniform(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


@dataclass
class NumberDraw:
    """Draws a model's numbers; those listed as zero are stated as 0.

    Attributes:
        zero: "damping:j1" and the like.
        density: [kg/m^3] of the medium.
    """

    rng: Rng
    zero: frozenset[str] = frozenset()
    density: float = 0.0

    def draw_about(self, *values: float) -> list[float]:
        """Numbers within 25 % of others, as a user would write them."""
        return [float(f"{v * self.rng.uniform(0.75, 1.25):.3g}") for v in values]

    def write_joint(self, name: str, *values: float) -> str:
        """The attributes of a joint: damping, armature and dry friction, drawn."""
        texts = [f'name="{name}"']
        keys = ("damping", "armature", "frictionloss")
        for key, value, drawn in zip(
            keys, values, self.draw_about(*values), strict=True
        ):
            if value and f"{key}:{name}" not in self.zero:
                texts.append(f'{key}="{drawn:.4g}"')
        return " ".join(texts)

    def write_joints(self, *joints: tuple[float, float, float]) -> list[str]:
        """The attributes of j1, j2 and so on."""
        return [
            self.write_joint(f"j{i}", *values) for i, values in enumerate(joints, 1)
        ]

    def write_servos(self, *gains: tuple[float, float]) -> str:
        """Position servos of j1, j2 and so on, with drawn gains."""
        drawn = [self.draw_about(*each) for each in gains]
        return write_actuators(
            [
                f'<position name="m{i}" joint="j{i}" kp="{kp}" kv="{kv}"/>'
                for i, (kp, kv) in enumerate(drawn, 1)
            ]
        )

    def draw_flag(self, chance: float) -> bool:
        """True with a chance."""
        return bool(self.rng.random() < chance)

    def write_model(
        self, name: str, world: str, rest: str, step: float, integrator: str = FAST
    ) -> str:
        """A whole MJCF file.

        Args:
            world: bodies and geoms of the world, as MJCF.
            rest: defaults and actuators, as MJCF.
            step: [s] of the simulation.
        """
        medium = f' density="{self.density:g}"' if self.density else ""
        return f"""<mujoco model="{name}">
  <compiler angle="radian"/>
  <option timestep="{step:g}" integrator="{integrator}"{medium}/>
  <worldbody>
{world.rstrip()}
  </worldbody>
{rest.rstrip()}
</mujoco>
"""


def read_world(shape: str, **values: object) -> str:
    """MJCF of the folder `drawn`, or a part of it, with values put in."""
    file = Path(__file__).parent / "drawn" / f"{shape}.xml"
    return file.read_text().format(**values)


def write_link(length: float, mass: float, radius: float = 0.012) -> str:
    """Inertia and shape of a uniform rod that hangs from its origin.

    Args:
        length: [m].
        mass: [kg].
        radius: [m].
    """
    inertia = mass * (length**2 / 12 + radius**2 / 4)
    along = mass * radius**2 / 2
    return (
        f'<inertial pos="0 0 {-length / 2:.5g}" mass="{mass:.4g}" '
        f'diaginertia="{inertia:.4g} {inertia:.4g} {along:.4g}"/>\n'
        f'      <geom type="capsule" size="{radius:g} {length / 2 - radius:.4g}" '
        f'pos="0 0 {-length / 2:.5g}" {DRAWN_ONLY}/>'
    )


def write_actuators(texts: Sequence[str]) -> str:
    """The element `actuator` around some actuators."""
    return "  <actuator>\n    " + "\n    ".join(texts) + "\n  </actuator>"
