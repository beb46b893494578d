"""What the hidden drives have: random values of drives, and the effects they are."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.drives.robots import Link, Rng, Robot, measure_loads


@dataclass(frozen=True)
class Drive:
    """What one joint's drive has; for a slide read N and m.

    Attributes:
        coulomb: [N m] dry friction.
        viscous: [N m s/rad] friction.
        armature: [kg m^2] of the rotor, seen from the joint.
        load: [1] friction for each N m that the gear passes on.
        stiction: [N m] by which dry friction at rest exceeds that in motion.
        slip_speed: [rad/s] at which that excess has fallen to 1/e.
        lag: [s] time constant with which the drive follows its command.
        gain: [1] torque over the torque that its model and its log say.
        feed_forward: [1] share of the servo's damping that the goal's speed has too.
        dead_band: [rad] of the servo's error, in which its stiffness does nothing.
    """

    coulomb: float = 0.0
    viscous: float = 0.0
    armature: float = 0.0
    load: float = 0.0
    stiction: float = 0.0
    slip_speed: float = 1.0
    lag: float = 0.0
    gain: float = 1.0
    feed_forward: float = 0.0
    dead_band: float = 0.0


@dataclass(frozen=True)
class Truth:
    """All that a hidden robot has.

    Attributes:
        drives: one a joint.
        links: real masses and limits of the joints' links.
        delay: [s] of all commands; below 0 where readings are the late ones.
        compensates: whether the controller adds the torque of gravity.
        mount: stiffness [N m/rad] and damping [N m s/rad] of the base's support; ()
            where the base is fixed.
    """

    drives: tuple[Drive, ...]
    links: tuple[Link, ...]
    delay: float = 0.0
    compensates: bool = False
    mount: tuple[float, ...] = ()

    def describe(self) -> dict[str, Any]:
        """The truth as JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Effect:
    """One hidden effect.

    Attributes:
        names: by which a finding names it, that of contract section 4 first.
        targets: places at which a finding names it; "*": anywhere.
        values: of its parameters.
        remove: the truth without it.
    """

    names: tuple[str, ...]
    targets: tuple[str, ...]
    values: dict[str, float]
    remove: Callable[[Truth], Truth]


# names of what a drive has, the fields of its values, and its value where it is not
_OF_DRIVES: tuple[tuple[tuple[str, ...], dict[str, str], float], ...] = (
    (("coulomb_friction", "stribeck_friction", "asymmetric_friction"),
     {"coulomb": "frictionloss"}, 0.0),
    (("viscous_friction",), {"viscous": "damping"}, 0.0),
    (("armature",), {"armature": "armature"}, 0.0),
    (("load_dependent_friction",), {"load": "load_coefficient"}, 0.0),
    (("stribeck_friction",),
     {"stiction": "excess", "slip_speed": "stribeck_velocity"}, 0.0),
    (("actuator_lag",), {"lag": "timeconst"}, 0.0),
    (("torque_constant", "motor_gain", "servo_gain"), {"gain": "gain"}, 1.0),
    (("velocity_feedforward", "goal_feedforward"), {"feed_forward": "share"}, 0.0),
    (("dead_band",), {"dead_band": "width"}, 0.0),
)  # fmt: skip
# where the model states a value, its names where the real drive has less
_STATED = {"coulomb": "friction", "viscous": "damping", "armature": "armature"}
_OF_LIMITS = {
    "limit": ("torque_saturation", "torque_limit"),
    "goals": ("command_range", "control_range"),
    "range": ("hard_stop", "joint_range"),
}
EVERYWHERE = ("*",)


def _change_drive(index: int, field: str, value: float) -> Callable[[Truth], Truth]:
    def change(truth: Truth) -> Truth:
        drives, values = list(truth.drives), {field: value}
        drives[index] = replace(drives[index], **values)
        return replace(truth, drives=tuple(drives))

    return change


def _change_limit(index: int, field: str, value: Any) -> Callable[[Truth], Truth]:
    def change(truth: Truth) -> Truth:
        links, values = list(truth.links), {field: value}
        links[index] = replace(links[index], **values)
        return replace(truth, links=tuple(links))

    return change


def list_effects(robot: Robot, truth: Truth) -> list[Effect]:
    """The hidden effects of a robot, by joint: all in which it is not as stated."""
    found = []
    for i, stated in enumerate(robot.links):
        found += _list_joint_effects(robot, truth, i, stated)
    if truth.delay:
        values = {"delay": truth.delay}
        found.append(_hide_anywhere(("command_delay", "sensor_delay", "clock_shift"),
                                    values, {"delay": 0.0}))  # fmt: skip
    if truth.compensates:
        found.append(
            _hide_anywhere(("gravity_compensation",), {}, {"compensates": False})
        )
    if truth.mount:
        values = dict(zip(("stiffness", "damping"), truth.mount, strict=True))
        names = ("mount_compliance", "compliance")
        found.append(_hide_anywhere(names, values, {"mount": ()}))
    return found


def _hide_anywhere(
    names: tuple[str, ...], values: dict[str, float], absent: dict[str, Any]
) -> Effect:
    """An effect of the whole robot.

    Args:
        names: of it.
        values: of its parameters.
        absent: fields of the truth without it.
    """
    return Effect(names, EVERYWHERE, values, lambda t: replace(t, **absent))


def _list_joint_effects(robot: Robot, truth: Truth, index: int, stated: Link):
    """The hidden effects of one joint.

    Args:
        robot: as its model has it.
        truth: what it has.
        index: of the joint.
        stated: its link in the model.
    """
    drive, real = truth.drives[index], truth.links[index]
    joint = f"joint:{stated.joint}"
    for names, fields, absent in _OF_DRIVES:
        first = next(iter(fields))
        without = getattr(stated, _STATED[first]) if first in _STATED else absent
        if getattr(drive, first) != without:
            values = {say: getattr(drive, f) for f, say in fields.items()}
            change = _change_drive(index, first, without or absent)
            yield Effect(names, (joint,), values, change)
    for field, names in _OF_LIMITS.items():
        was, now = getattr(stated, field), getattr(real, field)
        if was != now:
            values = dict(enumerate_values(now))
            yield Effect(names, (joint,), values, _change_limit(index, field, was))


def enumerate_values(limit: Any) -> list[tuple[str, float]]:
    """Names and values of a limit: one number, or two, or none."""
    numbers = limit if isinstance(limit, tuple) else (limit,)
    return [(f"limit{i}", float(number)) for i, number in enumerate(numbers)]


def draw_masses(rng: Rng, robot: Robot) -> tuple[Link, ...]:
    """Real links: masses up to 5 % off, friction, damping and rotor left to drives."""
    return tuple(
        replace(link, mass=link.mass * (1 + rng.uniform(-0.05, 0.05)),
                friction=0.0, damping=0.0, armature=0.0)
        for link in robot.links
    )  # fmt: skip


def state_drives(robot: Robot, truth: Truth) -> Robot:
    """The robot with friction and rotors stated as the drives have them."""
    links = [
        replace(link, friction=drive.coulomb, damping=drive.viscous,
                armature=drive.armature)
        for link, drive in zip(robot.links, truth.drives, strict=True)
    ]  # fmt: skip
    return replace(robot, links=tuple(links))


PLAIN = {"load": 0.0, "stribeck": 0.0, "delay": 0.0, "lag": 0.0}
FULL = {"load": 0.4, "stribeck": 0.25, "delay": 0.45, "lag": 0.3}


def draw_drives(rng: Rng, robot: Robot, chances: Mapping[str, float] = FULL) -> Truth:
    """Drives with dry and viscous friction and rotors, within plausible bounds.

    Shares of the joint's torque and inertia as in servos (BAM: 4 to 15 % friction of
    the torque used), legs (PACE, ANYmal) and industrial arms (rotors of up to the
    inertia of what they move).

    Args:
        rng: draws them.
        robot: that has them.
        chances: that a case has load-dependent friction, Stribeck's, delay and lag.
    """
    torques, inertias = measure_loads(robot)
    on = {name: rng.random() < share for name, share in chances.items()}
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
    links = draw_masses(rng, robot)
    delay = rng.uniform(0.004, 0.025) if on["delay"] else 0.0
    return Truth(tuple(drives), links, delay)


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
