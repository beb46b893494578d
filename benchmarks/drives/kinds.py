"""Kinds of cases: seeds in; robots, what they hide and how they are recorded out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.drives.robots import (
    Rng,
    Robot,
    draw_linkage,
    draw_robot,
    measure_loads,
)
from benchmarks.drives.truth import (
    PLAIN,
    Drive,
    Truth,
    draw_drives,
    draw_masses,
    state_drives,
)

RATES = (30.0, 50.0, 100.0, 200.0, 250.0, 500.0)  # [Hz] of logs
FAST = (100.0, 200.0, 250.0, 500.0)  # [Hz] of those whose controller gives torques


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
        camera: [m and 1] noise of a camera that sees the links; 0: encoders are read.
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
        robot: as its model has it.
        truth: what it has.
        log: how it is recorded.
        feedback: whether its commands are torques that follow goals.
    """

    robot: Robot
    truth: Truth
    log: Log
    feedback: bool = False


def draw_log(rng: Rng, robot: Robot, *, feedback: bool = False) -> Log:
    """How a case is recorded.

    Args:
        rng: draws it.
        robot: that is recorded.
        feedback: whether commands depend on the state.
    """
    steps = int(rng.choice([0, 0, 4096, 16384]))
    return Log(
        rate=float(rng.choice(FAST if feedback else RATES)),
        episodes=5,
        held=2,
        seconds=float(rng.uniform(7, 10)),
        noise=0.0 if steps else float(10 ** rng.uniform(-4, -2.7)),
        steps=steps,
        speed=float(rng.choice([0.0, 0.01, 0.03])),
        torque=float(rng.choice([0.0, 0.0, 0.0, 0.03])) if robot.is_servo else 0.0,
        state=bool(rng.random() < 0.5),
    )


def draft_everything(rng: Rng, seed: int) -> Draft:
    """The whole drive is missing at every one of 1 to 7 joints."""
    joints = 1 + seed % 7
    servo = bool(rng.random() < 0.55)
    feedback = not servo and (joints > 2 or bool(rng.random() < 0.3))
    robot = draw_robot(rng, joints, "servo" if servo else "motor")
    truth = draw_drives(rng, robot)
    return Draft(robot, truth, draw_log(rng, robot, feedback=feedback), feedback)


def draft_decay(rng: Rng, seed: int) -> Draft:
    """An undriven pendulum or leg swings out for 10 to 15 s; friction is missing."""
    robot = draw_robot(rng, 1 + seed % 3, "none")
    torques, inertias = measure_loads(robot)
    drives = []
    for torque, inertia in zip(torques, inertias, strict=True):
        swings = np.sqrt(torque * inertia)  # damping that would stop it in a swing
        loss = float(rng.choice([0.0, 1.0]) * rng.uniform(0.002, 0.008) * torque)
        drives.append(Drive(loss, float(rng.uniform(0.005, 0.02) * swings)))
    log = replace(
        draw_log(rng, robot), seconds=float(rng.uniform(10, 15)),
        episodes=int(rng.integers(2, 4)), held=1,
    )  # fmt: skip
    return Draft(robot, Truth(tuple(drives), draw_masses(rng, robot)), log)


def draft_loop(rng: Rng, seed: int) -> Draft:
    """A leg with a four-bar linkage, its motors' encoders alone; drives are missing."""
    robot = draw_linkage(rng)
    log = replace(draw_log(rng, robot), state=False)
    return Draft(robot, draw_drives(rng, robot, PLAIN), log)


def _draw_stated(rng: Rng, joints: int, style: str) -> Draft:
    """A robot whose model states its drives; at first nothing is hidden.

    Args:
        rng: draws it.
        joints: their number.
        style: as `draw_robot` takes it.
    """
    robot = draw_robot(rng, joints, style)
    truth = draw_drives(rng, robot, PLAIN)
    feedback = style == "motor" and joints > 1
    log = draw_log(rng, robot, feedback=feedback)
    return Draft(state_drives(robot, truth), truth, log, feedback)


def draft_limits(rng: Rng, seed: int) -> Draft:
    """A stop, a limit of torque or goal, or friction that only the model has."""
    draft = _draw_stated(rng, int(rng.integers(1, 5)), "servo")
    robot, truth = draft.robot, draft.truth
    at = int(rng.integers(len(robot.links)))
    link, torque = robot.links[at], measure_loads(robot)[0][at]
    drives, near = list(truth.drives), rng.uniform(0.3, 0.6) * link.swing
    within = (link.home - near, link.home + near)
    stated: dict[str, Any] = [
        {"range": within},
        {"limit": rng.uniform(0.4, 0.8) * torque},
        {"goals": within},
        {"friction": rng.uniform(0.1, 0.3) * torque},
    ][seed % 4]
    if "friction" in stated:
        drives[at] = replace(drives[at], coulomb=0.0)
    links = list(robot.links)
    links[at] = replace(link, **stated)
    truth = replace(truth, drives=tuple(drives))
    return replace(draft, robot=replace(robot, links=tuple(links)), truth=truth)


def draft_gravity(rng: Rng, seed: int) -> Draft:
    """The controller adds the torque of gravity; the model does not."""
    draft = _draw_stated(rng, 2 + seed % 6, "servo")
    return replace(draft, truth=replace(draft.truth, compensates=True))


def draft_gain(rng: Rng, seed: int) -> Draft:
    """Motors give more or less than commanded; the torque reported is the command."""
    draft = _draw_stated(rng, 1 + seed % 4, "motor")
    truth, alike = draft.truth, seed % 2 == 0
    gain = float(rng.choice([rng.uniform(0.65, 0.85), rng.uniform(1.2, 1.4)]))
    at = int(rng.integers(len(truth.drives)))
    drives = tuple(
        replace(drive, gain=gain) if alike or i == at else drive
        for i, drive in enumerate(truth.drives)
    )
    log = replace(draft.log, repeats=True)
    return replace(draft, truth=replace(truth, drives=drives), log=log)


def draft_clock(rng: Rng, seed: int) -> Draft:
    """The clocks of commands and readings are apart by one shift of either sign."""
    draft = _draw_stated(rng, 1 + seed % 5, "servo")
    shift = float(rng.uniform(0.01, 0.04) * (1 if seed % 2 else -1))
    return replace(draft, truth=replace(draft.truth, delay=shift))


def draft_camera(rng: Rng, seed: int) -> Draft:
    """A camera sees the links and no encoder is read; the drives are missing."""
    robot = draw_robot(rng, 1 + seed % 3, "servo")
    log = replace(
        draw_log(rng, robot), rate=float(rng.choice([60.0, 100.0, 120.0])), speed=0.0,
        torque=0.0, camera=float(rng.uniform(3e-4, 1e-3)),
    )  # fmt: skip
    return Draft(robot, draw_drives(rng, robot, PLAIN), log)


def draft_slow(rng: Rng, seed: int) -> Draft:
    """Positions alone, at 30 Hz, without initial states; the drives are missing."""
    robot = draw_robot(rng, 1 + seed % 6, "servo")
    log = replace(
        draw_log(rng, robot), rate=30.0, speed=0.0, torque=0.0, state=False
    )  # fmt: skip
    return Draft(robot, draw_drives(rng, robot), log)


def draft_servo(rng: Rng, seed: int) -> Draft:
    """A goal's speed is fed forward, a servo has a dead band, or the base gives."""
    draft = _draw_stated(rng, 1 + seed % 4, "servo")
    robot, truth = draft.robot, draft.truth
    if seed % 3 == 2:
        torques, inertias = measure_loads(robot)
        stiffness = float(sum(torques) / rng.uniform(0.03, 0.08))
        damping = float(0.2 * np.sqrt(stiffness * inertias.max()))
        return replace(draft, truth=replace(truth, mount=(stiffness, damping)))
    drives = [
        replace(drive, feed_forward=float(rng.uniform(0.7, 1.0)))
        if seed % 3 == 0
        else replace(drive, dead_band=float(rng.uniform(0.02, 0.06) * link.swing))
        for drive, link in zip(truth.drives, robot.links, strict=True)
    ]
    return replace(draft, truth=replace(truth, drives=tuple(drives)))


KINDS: dict[str, Callable[[Rng, int], Draft]] = {
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
