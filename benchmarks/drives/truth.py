"""What the hidden drives have: random values of drives, and the effects they are."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.drives.robots import Rng, Robot, measure_loads


@dataclass(frozen=True)
class Drive:
    """One joint's drive beyond what its model says; for a slide read N and m.

    Attributes:
        coulomb: [N m] dry friction.
        viscous: [N m s/rad] friction.
        armature: [kg m^2] of the rotor, seen from the joint.
        load: [1] friction for each N m that the gear passes on.
        stiction: [N m] by which dry friction at rest exceeds that in motion.
        slip_speed: [rad/s] at which that excess has fallen to 1/e.
        lag: [s] time constant of the torque.
    """

    coulomb: float = 0.0
    viscous: float = 0.0
    armature: float = 0.0
    load: float = 0.0
    stiction: float = 0.0
    slip_speed: float = 1.0
    lag: float = 0.0


@dataclass(frozen=True)
class Truth:
    """All that a hidden robot has and its model lacks.

    Attributes:
        drives: one a joint.
        masses: factors of the links' masses.
        delay: [s] of all commands.
    """

    drives: tuple[Drive, ...]
    masses: tuple[float, ...]
    delay: float = 0.0

    def describe(self) -> dict[str, Any]:
        """The truth as JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Effect:
    """One hidden effect.

    Attributes:
        name: of contract section 4.
        targets: places at which a finding names it.
        values: of its parameters.
        remove: the truth without it.
    """

    name: str
    targets: tuple[str, ...]
    values: dict[str, float]
    remove: Callable[[Truth], Truth]


# effect, fields that show that it is there, first of them is set to zero without it
_OF_DRIVES = {
    "coulomb_friction": {"coulomb": "frictionloss"},
    "viscous_friction": {"viscous": "damping"},
    "armature": {"armature": "armature"},
    "load_dependent_friction": {"load": "load_coefficient"},
    "stribeck_friction": {"stiction": "excess", "slip_speed": "stribeck_velocity"},
    "actuator_lag": {"lag": "timeconst"},
}


def _remove_from_drive(index: int, field: str) -> Callable[[Truth], Truth]:
    def remove(truth: Truth) -> Truth:
        drives = list(truth.drives)
        values: dict[str, Any] = {field: 0.0}
        drives[index] = replace(drives[index], **values)
        return replace(truth, drives=tuple(drives))

    return remove


def list_effects(robot: Robot, truth: Truth) -> list[Effect]:
    """The hidden effects of a robot, by joint."""
    found = []
    for i, drive in enumerate(truth.drives):
        for name, fields in _OF_DRIVES.items():
            first = next(iter(fields))
            if getattr(drive, first):
                values = {say: getattr(drive, f) for f, say in fields.items()}
                target = f"joint:{robot.joints[i]}"
                if name == "actuator_lag":
                    target = f"actuator:{robot.actuators[i]}"
                remove = _remove_from_drive(i, first)
                found.append(Effect(name, (target,), values, remove))
    if truth.delay:
        targets = tuple(f"actuator:{name}" for name in robot.actuators)
        found.append(
            Effect("command_delay", targets, {"delay": truth.delay},
                   lambda t: replace(t, delay=0.0))
        )  # fmt: skip
    return found


def draw_drives(rng: Rng, robot: Robot) -> Truth:
    """Drives that have everything which their model lacks, within plausible bounds.

    Shares of the joint's torque and inertia as in servos (BAM: 4 to 15 % friction of
    the torque used), legs (PACE, ANYmal) and industrial arms (rotors of up to the
    inertia of what they move).
    """
    torques, inertias = measure_loads(robot)
    has = {"load": 0.4, "stribeck": 0.25, "delay": 0.45, "lag": 0.3}
    on = {name: rng.random() < share for name, share in has.items()}
    alike = rng.random() < 0.25  # of one size and with one drive at all joints
    shares = [_draw_shares(rng) for _ in robot.links]
    speeds = 2 * np.pi * robot.rate * robot.swings
    drives = []
    for i in range(len(robot.links)):
        k = 0 if alike else i
        s, torque, inertia, speed = shares[k], torques[k], inertias[k], speeds[k]
        if robot.links[i].slide != robot.links[k].slide:
            s, torque, inertia, speed = shares[i], torques[i], inertias[i], speeds[i]
        coulomb = s["coulomb"] * torque
        drives.append(
            Drive(
                coulomb,
                s["viscous"] * coulomb / speed,
                s["armature"] * inertia,
                s["load"] if on["load"] else 0.0,
                s["stiction"] * coulomb if on["stribeck"] else 0.0,
                s["slip"] * speed,
                min(s["lag"], _find_slowest_lag(robot, i)) if on["lag"] else 0.0,
            )
        )
    masses = tuple(1 + rng.uniform(-0.05, 0.05, len(robot.links)))
    delay = rng.uniform(0.004, 0.025) if on["delay"] else 0.0
    return Truth(tuple(drives), masses, delay)


def _find_slowest_lag(robot: Robot, index: int) -> float:
    """Time constant [s] of the torque that leaves a joint's servo well damped."""
    link = robot.links[index]
    return 0.25 * link.kv / link.kp if link.kp else np.inf


def _draw_shares(rng: Rng) -> dict[str, float]:
    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    return {
        "coulomb": between(0.04, 0.2),
        "viscous": between(0.3, 2.0),
        "armature": between(0.15, 1.5),
        "load": between(0.05, 0.2),
        "stiction": between(0.3, 0.9),
        "slip": between(0.03, 0.15),
        "lag": between(0.004, 0.02),
    }
