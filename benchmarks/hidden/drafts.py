"""Drives that models lack: a generator in; a robot, what it hides, its log.

Besides whole drives: decays, loops, wrong limits, carried weights, weak motors, clocks
that are apart, cameras, slow logs, and more of a servo.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.hidden.effects import DRAWN, PLACED
from benchmarks.hidden.effects.base import Effect, PlacedEffect
from benchmarks.hidden.robots.chains import draw_chain, draw_linkage
from benchmarks.hidden.robots.robot import Rng, Robot, draw_log_uniform
from benchmarks.hidden.truth import HiddenRobot

RATES = (30.0, 50.0, 100.0, 200.0, 250.0, 500.0)  # [Hz] of logs
FAST = (100.0, 200.0, 250.0, 500.0)  # [Hz] of those whose controller gives torques
EFFECTS: Mapping[str, Effect] = {**DRAWN, **PLACED}
Placed = list[PlacedEffect]


@dataclass(frozen=True)
class Log:
    """How a case is recorded.

    Attributes:
        rate: [Hz] of the samples.
        episodes: for the diagnosis.
        held: episodes that only the scorer sees.
        seconds: [s] of an episode.
        noise: share of a joint's swing that its encoder's noise is.
        steps: counts of an encoder for a turn, 0: not rounded.
        speed: share of a joint's speed that its tachometer's noise is; 0: none.
        torque: share of a joint's torque that its sensor's noise is; 0: none.
        state: whether episodes state where they start.
        camera: [m] noise of a camera that sees the links; 0: encoders are read.
        repeats: whether the torque that is reported is the one commanded.
    """

    rate: float
    episodes: int
    held: int
    seconds: float
    noise: float
    steps: int
    speed: float
    torque: float
    state: bool
    camera: float = 0.0
    repeats: bool = False


@dataclass(frozen=True)
class Draft:
    """A case before it is recorded.

    Attributes:
        robot: without anything stated of its drives.
        hidden: what the robot has.
        stated: what its model has.
        feedback: whether its commands are torques that follow goals.
        masses: relative errors of the links' masses, by body.
    """

    robot: Robot
    hidden: Placed
    stated: Placed
    log: Log
    feedback: bool = False
    masses: tuple[float, ...] = ()

    def list_missing(self) -> list[tuple[PlacedEffect, Placed]]:
        """Effects in which robot and model differ, each with the rest without it."""
        missing = [one for one in self.hidden if one not in self.stated]
        found = [(m, [one for one in self.hidden if one is not m]) for m in missing]
        only = [one for one in self.stated if one not in self.hidden]
        return found + [(one, [*self.hidden, one]) for one in only]

    def state_model(self) -> Robot:
        """The robot as its model has it."""
        if not self.stated:
            return self.robot
        made = HiddenRobot(self.robot, self.robot.read_spec())
        for one in self.stated:
            one.effect.install(made, one.target, one.values)
        made.spec.compile()
        return replace(self.robot, xml=made.spec.to_xml())


def _place(name: str, target: str, **values: float) -> PlacedEffect:
    return PlacedEffect(EFFECTS[name], target, values)


# ---------------------------------------------------------------- what is drawn


def _draw_log(rng: Rng, robot: Robot, rates: Sequence[float] = RATES) -> Log:
    """How a case is recorded, at one of some rates [Hz]."""
    steps = int(rng.choice([0, 0, 4096, 16384]))
    servo = robot.drive == "servo"
    return Log(
        rate=float(rng.choice(rates)),
        episodes=5,
        held=2,
        seconds=float(rng.uniform(7, 10)),
        noise=0.0 if steps else float(10 ** rng.uniform(-4, -2.7)),
        steps=steps,
        speed=float(rng.choice([0.0, 0.01, 0.03])),
        torque=float(rng.choice([0.0, 0.0, 0.0, 0.03])) if servo else 0.0,
        state=bool(rng.random() < 0.5),
    )


def _draw_masses(rng: Rng, robot: Robot) -> tuple[float, ...]:
    """Masses up to 5 % off."""
    return tuple(float(rng.uniform(-0.05, 0.05)) for _ in robot.links)


PLAIN = {"load": 0.0, "stribeck": 0.0, "delay": 0.0, "lag": 0.0}
FULL = {"load": 0.4, "stribeck": 0.25, "delay": 0.45, "lag": 0.3}


def draw_drives(
    rng: Rng, robot: Robot, chances: Mapping[str, float] = FULL
) -> tuple[Placed, tuple[float, ...]]:
    """Dry and viscous friction and rotors, within plausible bounds, and masses.

    Shares of the joint's torque and inertia as in servos (BAM: 4 to 15 % friction of
    the torque used), legs (PACE, ANYmal) and industrial arms (rotors of up to the
    inertia of what they move).

    Args:
        chances: that a case has load-dependent friction, Stribeck's, delay and lag.

    Returns:
        What the drives have, and the relative errors of the links' masses.
    """
    on = {name: rng.random() < share for name, share in chances.items()}
    alike = rng.random() < 0.25  # of one size and with one drive at all joints
    joints, found = tuple(robot.load), []
    shares = [_draw_shares(rng) for _ in joints]
    for i, joint in enumerate(joints):
        same = alike and robot.is_slide(joint) == robot.is_slide(joints[0])
        like, s = joints[0 if same else i], shares[0 if same else i]
        speed = 2 * np.pi * robot.rate * robot.amplitude[like]
        coulomb, at = s["coulomb"] * robot.load[like], f"joint:{joint}"
        found += [
            _place("coulomb_friction", at, frictionloss=coulomb),
            _place("viscous_friction", at, damping=s["viscous"] * coulomb / speed),
            _place("armature", at, armature=s["armature"] * robot.inertia[like]),
        ]
        if on["load"]:
            values = {"load_coefficient": s["load"], "both": 1.0}
            found.append(_place("load_dependent_friction", at, **values))
        if on["stribeck"]:
            excess, slip = s["stiction"] * coulomb, s["slip"] * speed
            found.append(_place("stiction", at, excess=excess, stribeck_velocity=slip))
        if on["lag"]:
            lag = min(s["lag"], _find_slowest_lag(robot, joint))
            at = f"actuator:{robot.find_actuator(joint)}"
            found.append(_place("actuator_lag", at, timeconst=lag))
    masses = _draw_masses(rng, robot)
    if on["delay"]:
        found.append(_place("clock_shift", "world", shift=rng.uniform(0.004, 0.025)))
    return found, masses


def _find_slowest_lag(robot: Robot, joint: str) -> float:
    """Time constant [s] of the torque that leaves a joint's servo well damped."""
    if robot.drive != "servo":
        return np.inf
    actuator = robot.model.actuator(robot.find_actuator(joint))
    return 0.25 * actuator.biasprm[2] / actuator.biasprm[1]


def _draw_shares(rng: Rng) -> dict[str, float]:
    between = partial(draw_log_uniform, rng)
    return {
        "coulomb": between(0.04, 0.2),
        "viscous": between(0.3, 2.0),
        "armature": between(0.15, 1.5),
        "load": between(0.05, 0.2),
        "stiction": between(0.3, 0.9),
        "slip": between(0.03, 0.15),
        "lag": between(0.004, 0.02),
    }


# ---------------------------------------------------------------- kinds


def _lack_drives(
    rng: Rng, robot: Robot, log: Log, chances: Mapping[str, float]
) -> Draft:
    """A robot whose model states nothing of its drives."""
    hidden, masses = draw_drives(rng, robot, chances)
    return Draft(robot, hidden, [], log, masses=masses)


def _draft_stated(rng: Rng, joints: int, style: str) -> Draft:
    """A robot whose model states its drives; at first nothing is hidden."""
    robot, feedback = draw_chain(rng, joints, style), style == "motor" and joints > 1
    hidden, masses = draw_drives(rng, robot, PLAIN)
    log = _draw_log(rng, robot, FAST if feedback else RATES)
    return Draft(robot, hidden, list(hidden), log, feedback, masses)


def draft_everything(rng: Rng, seed: int) -> Draft:
    """The whole drive is missing at every one of 1 to 7 joints."""
    joints = 1 + seed % 7
    servo = bool(rng.random() < 0.55)
    feedback = not servo and (joints > 2 or bool(rng.random() < 0.3))
    robot = draw_chain(rng, joints, "servo" if servo else "motor")
    hidden, masses = draw_drives(rng, robot)
    log = _draw_log(rng, robot, FAST if feedback else RATES)
    return Draft(robot, hidden, [], log, feedback, masses)


def draft_decay(rng: Rng, seed: int) -> Draft:
    """An undriven pendulum or leg swings out for 10 to 15 s; friction is missing."""
    robot, hidden = draw_chain(rng, 1 + seed % 3, "none"), []
    for joint, torque in robot.load.items():
        swings = np.sqrt(torque * robot.inertia[joint])  # would stop it in a swing
        loss = float(rng.choice([0.0, 1.0]) * rng.uniform(0.002, 0.008) * torque)
        damping = float(rng.uniform(0.005, 0.02) * swings)
        hidden.append(_place("viscous_friction", f"joint:{joint}", damping=damping))
        if loss:
            dry = _place("coulomb_friction", f"joint:{joint}", frictionloss=loss)
            hidden.append(dry)
    log = replace(
        _draw_log(rng, robot),
        seconds=float(rng.uniform(10, 15)),
        episodes=int(rng.integers(2, 4)),
        held=1,
    )
    return Draft(robot, hidden, [], log, masses=_draw_masses(rng, robot))


def draft_loop(rng: Rng, seed: int) -> Draft:
    """A leg with a four-bar linkage, its motors' encoders alone; drives are missing."""
    robot = draw_linkage(rng)
    return _lack_drives(rng, robot, replace(_draw_log(rng, robot), state=False), PLAIN)


def draft_limits(rng: Rng, seed: int) -> Draft:
    """A stop, a limit of torque or goal, or friction that only the model has."""
    draft = _draft_stated(rng, int(rng.integers(1, 5)), "servo")
    robot = draft.robot
    joint = tuple(robot.load)[int(rng.integers(len(robot.load)))]
    torque, home = robot.load[joint], robot.center[joint]
    near = rng.uniform(0.3, 0.6) * robot.amplitude[joint]
    within = {"low": home - near, "high": home + near}
    at, of = f"joint:{joint}", f"actuator:{robot.find_actuator(joint)}"
    limit, dry = rng.uniform(0.4, 0.8) * torque, rng.uniform(0.1, 0.3) * torque
    stated = [
        _place("joint_range", at, **within),
        _place("torque_saturation", of, limit=limit),
        _place("command_range", of, **within),
        _place("coulomb_friction", at, frictionloss=dry),
    ][seed % 4]

    def keep(placed: Placed) -> Placed:
        same = stated.effect.name, stated.target
        return [one for one in placed if (one.effect.name, one.target) != same]

    return replace(
        draft, hidden=keep(draft.hidden), stated=[*keep(draft.stated), stated]
    )


def _hide(draft: Draft, *more: PlacedEffect) -> Draft:
    return replace(draft, hidden=[*draft.hidden, *more])


def draft_gravity(rng: Rng, seed: int) -> Draft:
    """The controller adds the torque of gravity; the model does not."""
    draft = _draft_stated(rng, 2 + seed % 6, "servo")
    return _hide(draft, _place("gravity_compensation", "world"))


def draft_gain(rng: Rng, seed: int) -> Draft:
    """Motors give more or less than commanded; the torque reported is the command."""
    draft = _draft_stated(rng, 1 + seed % 4, "motor")
    gain = float(rng.choice([rng.uniform(0.65, 0.85), rng.uniform(1.2, 1.4)]))
    actuators = tuple(draft.robot.actuators)
    at = int(rng.integers(len(actuators)))
    weak = actuators if seed % 2 == 0 else actuators[at : at + 1]
    gains = [_place("torque_constant", f"actuator:{a}", gain=gain) for a in weak]
    return _hide(replace(draft, log=replace(draft.log, repeats=True)), *gains)


def draft_clock(rng: Rng, seed: int) -> Draft:
    """The clocks of commands and readings are apart by one shift of either sign."""
    draft = _draft_stated(rng, 1 + seed % 5, "servo")
    shift = float(rng.uniform(0.01, 0.04) * (1 if seed % 2 else -1))
    return _hide(draft, _place("clock_shift", "world", shift=shift))


def draft_camera(rng: Rng, seed: int) -> Draft:
    """A camera sees the links and no encoder is read; the drives are missing."""
    robot = draw_chain(rng, 1 + seed % 3, "servo")
    log = replace(
        _draw_log(rng, robot),
        rate=float(rng.choice([60.0, 100.0, 120.0])),
        speed=0.0,
        torque=0.0,
        steps=0,
        camera=float(rng.uniform(3e-4, 1e-3)),
    )
    return _lack_drives(rng, robot, log, PLAIN)


def draft_slow(rng: Rng, seed: int) -> Draft:
    """Positions alone, at 30 Hz, without initial states; the drives are missing."""
    robot = draw_chain(rng, 1 + seed % 6, "servo")
    slow = replace(_draw_log(rng, robot), rate=30.0, speed=0.0, torque=0.0, state=False)
    return _lack_drives(rng, robot, slow, FULL)


def draft_servo(rng: Rng, seed: int) -> Draft:
    """A goal's speed is fed forward, a servo has a dead band, or the base gives."""
    draft = _draft_stated(rng, 1 + seed % 4, "servo")
    robot, more = draft.robot, []
    if seed % 3 == 2:
        stiffness = float(sum(robot.load.values()) / rng.uniform(0.03, 0.08))
        damping = float(0.2 * np.sqrt(stiffness * max(robot.inertia.values())))
        values = {"stiffness": stiffness, "damping": damping}
        return _hide(draft, _place("base_compliance", "body:base", **values))
    for actuator, joint in robot.actuators.items():
        gains, at = robot.model.actuator(actuator), f"actuator:{actuator}"
        stiff, damped = gains.gainprm[0], -gains.biasprm[2]
        if seed % 3 == 0:  # a share of the servo's damping has the goal's speed too
            lead = rng.uniform(0.7, 1.0) * damped / stiff
            more.append(_place("velocity_feedforward", at, lead=float(lead)))
        else:
            width = rng.uniform(0.02, 0.06) * robot.amplitude[joint] * stiff
            more.append(_place("dead_band", at, width=float(width)))
    return _hide(draft, *more)


KINDS: Mapping[str, Callable[[Rng, int], Draft]] = {
    "everything": draft_everything,
    "decay": draft_decay,
    "loop": draft_loop,
    "limits": draft_limits,
    "gravity": draft_gravity,
    "gain": draft_gain,
    "clock": draft_clock,
    "camera": draft_camera,
    "slow": draft_slow,
    "servo": draft_servo,
}
