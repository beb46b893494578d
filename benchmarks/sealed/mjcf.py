"""How the sealed benchmark writes a robot down: takes numbers, gives pieces of MJCF."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

GRAVITY = 9.81  # [m/s^2]
FAST = "implicitfast"
DRAWN_ONLY = 'contype="0" conaffinity="0"'  # a geom that is only drawn


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
class NumberDraw:
    """Draws a model's numbers; those listed as zero are stated as 0.

    Attributes:
        rng: the generator.
        zero: "damping:j1" and the like.
        density: [kg/m^3] of the medium.
    """

    rng: np.random.Generator
    zero: frozenset[str] = frozenset()
    density: float = 0.0

    def draw_about(self, value: float) -> float:
        """A number within 25 % of `value`, as a user would write it."""
        return float(f"{value * self.rng.uniform(0.75, 1.25):.3g}")

    def write_joint(
        self, name: str, damping: float, armature: float, friction: float
    ) -> str:
        """The attributes of a joint."""
        values = {"damping": damping, "armature": armature, "frictionloss": friction}
        texts = [f'name="{name}"']
        for key, value in values.items():
            drawn = self.draw_about(value)
            zero = f"{key}:{name}" in self.zero or value == 0
            texts += [] if zero else [f'{key}="{drawn:.4g}"']
        return " ".join(texts)

    def write_servo(self, name: str, joint: str, kp: float, kv: float) -> str:
        """A position servo."""
        kp, kv = self.draw_about(kp), self.draw_about(kv)
        return f'<position name="{name}" joint="{joint}" kp="{kp}" kv="{kv}"/>'

    def draw_flag(self, chance: float) -> bool:
        """True with a chance."""
        return bool(self.rng.random() < chance)


def write_model(
    numbers: NumberDraw,
    name: str,
    world: str,
    rest: str,
    step: float,
    integrator: str = FAST,
) -> str:
    """A whole MJCF file.

    Args:
        numbers: whose medium is stated.
        name: of the model.
        world: bodies and geoms of the world, as MJCF.
        rest: defaults and actuators, as MJCF.
        step: [s] of the simulation.
        integrator: as MJCF calls it.
    """
    medium = f' density="{numbers.density:g}"' if numbers.density else ""
    return f"""<mujoco model="{name}">
  <compiler angle="radian"/>
  <option timestep="{step:g}" integrator="{integrator}"{medium}/>
  <worldbody>
{world.rstrip()}
  </worldbody>
{rest.rstrip()}
</mujoco>
"""


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
