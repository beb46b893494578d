"""The other suite: robots that were written down, and what each lacks; no draws."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.hidden.case import Case, Experiment, Session, build_case
from benchmarks.hidden.effects import BY_NAME, PLACED
from benchmarks.hidden.effects.base import Effect, PlacedEffect
from benchmarks.hidden.effects.bodies import VECTOR_BIAS
from benchmarks.hidden.robots.robot import Rng, Robot
from benchmarks.hidden.robots.written import WRITTEN, WrittenRobot
from benchmarks.hidden.sensors import Instruments
from benchmarks.hidden.simulator import MotionPlan
from benchmarks.hidden.truth import Errors

STATED = 0.06  # share that a stated mass is off at most; a damping twice that
TEST = 1000  # added to the seed of a recording


@dataclass(frozen=True)
class OtherCase:
    """One case.

    Attributes:
        robot: as given, of `WRITTEN`.
        stated: seed of the errors in what the model states.
        seed: of the recording.
        effects: what is missing from the model: name, target, values. Those that the
            motion cannot show are left out.
        off: errors of what the model states that are chosen, not drawn.
        jitter: share that the time between samples varies by.
        missing: share of the samples.
        state: True where episodes state where they start.
        motor: True where joint positions are the motors'.
    """

    robot: str
    stated: int
    seed: int
    effects: Sequence[tuple[str, str, Mapping[str, float]]] = ()
    off: Errors | None = None
    jitter: float = 0.0
    missing: float = 0.0
    state: bool = False
    motor: bool = False

    @property
    def kind(self) -> str:
        """As the sealed suite calls it."""
        return ("null", "single", "double")[len(self.effects)]


# fmt: off
OTHER_CASES: Mapping[str, OtherCase] = {
    "gantry_viscous": OtherCase(
        "gantry", 0, 1, [("viscous_friction", "joint:y", {"damping": 9.0})]),
    "gantry_null": OtherCase("gantry", 4, 2),
    "gantry_friction": OtherCase(
        "gantry", 5, 3,
        [("coulomb_friction", "joint:swing_x", {"frictionloss": 0.15})], jitter=0.3),
    "arm_coulomb": OtherCase(
        "geared_arm", 0, 1,
        [("coulomb_friction", "joint:elbow", {"frictionloss": 0.9})], missing=0.02),
    "arm_payload": OtherCase(
        "geared_arm", 2, 2,
        [("payload", "body:hand",
          {"mass": 0.3, "position_x": 0.09, "position_y": 0.0, "position_z": 0.0})],
        state=True),
    # lies inside what a refit may do
    "arm_gain": OtherCase("geared_arm", 3, 3, off={("gear", "m_shoulder"): -0.1}),
    "arm_bias": OtherCase(
        "geared_arm", 6, 5, [("sensor_bias", "sensor:q_wrist", {"bias": 0.06})]),
    "furuta_delay": OtherCase(
        "furuta", 0, 1, [("command_delay", "actuator:drive", {"delay": 0.017})]),
    "furuta_gyro": OtherCase(
        "furuta_imu", 3, 2, [("vector_bias", "sensor:imu", {"bias_y": 0.08})]),
    "hopper_payload": OtherCase(
        "hopper", 0, 1,
        [("payload", "body:torso",
          {"mass": 0.6, "position_x": 0.1, "position_z": 0.06})], state=True),
    "hopper_weak": OtherCase(
        "hopper", 7, 2, [("servo_gain", "actuator:fk", {"kp": 30.0})], state=True),
    "hopper_slope": OtherCase(
        "hopper", 5, 5, [("slope", "world", {"tilt": 0.06, "azimuth": 0.0})]),
    "rover_friction": OtherCase(
        "rover", 0, 1, [("coulomb_friction", "joint:left", {"frictionloss": 0.06})]),
    "rover_null": OtherCase("rover", 9, 3),
    "sled_friction": OtherCase(
        "sled", 3, 1, [("ground_friction", "world", {"friction": 0.17})]),
    "sled_null": OtherCase("sled", 4, 2),
    "scara_slope": OtherCase(
        "scara", 0, 1, [("slope", "world", {"tilt": 0.08, "azimuth": 0.0})]),
    "scara_two": OtherCase(
        "scara", 3, 2,
        [("coulomb_friction", "joint:q2", {"frictionloss": 0.5}),
         ("actuator_lag", "actuator:ar", {"timeconst": 0.04})]),
    "drone_com": OtherCase(
        "drone", 0, 1, [("com_shift", "body:drone", {"x": 0.012, "y": 0.0, "z": 0.0})]),
    "drone_weak": OtherCase(
        "drone", 4, 2, [("servo_gain", "actuator:t2", {"kp": 0.55})]),
    "pen_single_episode": OtherCase(
        "coarse_pendulum", 1, 1,
        [("coulomb_friction", "joint:hinge", {"frictionloss": 0.12})]),
    "pen_null_drift": OtherCase("belt_pendulum", 2, 2),
    "pen_two_effects": OtherCase(
        "tacho_pendulum", 3, 3,
        [("armature", "joint:hinge", {"armature": 0.03}),
         ("command_delay", "actuator:srv", {"delay": 0.03})]),
    "planar_backlash": OtherCase(
        "planar_arm", 1, 1, [("backlash", "joint:b", {"gap": 0.04})], motor=True),
    "planar_spring": OtherCase(
        "planar_arm", 2, 2,
        [("joint_spring", "joint:c", {"stiffness": 1.2, "springref": 0.0})]),
    "planar_length": OtherCase(
        "planar_arm", 3, 3, [("link_length", "body:l2", {"length": 0.29})]),
    "elevator_payload": OtherCase(
        "elevator", 1, 1, [("payload", "body:car", {"mass": 4.0})]),
    "elevator_sat": OtherCase(
        "elevator", 2, 2, [("torque_saturation", "actuator:winch", {"limit": 150.0})]),
    "ball_drag": OtherCase("ball", 1, 1, [("fluid_drag", "world", {"density": 4.8})]),
    "cartpole_sensors": OtherCase(
        "cartpole", 1, 1, [("viscous_friction", "joint:hinge", {"damping": 0.02})],
        state=True),
    "cartpole_bias": OtherCase(
        "cartpole_encoders", 2, 2, [("sensor_bias", "sensor:pole", {"bias": -0.05})]),
}
# fmt: on
EFFECTS: Mapping[str, Effect] = {**BY_NAME, **PLACED, "vector_bias": VECTOR_BIAS}


def _draw_errors(robot: Robot, rng: Rng) -> dict[tuple[str, str], float]:
    """Errors of the mass of every body, and of the damping of every joint."""
    spec, found = robot.read_spec(), dict[tuple[str, str], float]()
    for body in spec.bodies[1:]:
        for geom in body.geoms:
            if geom.mass > 0:
                error = STATED * rng.uniform(-1, 1)
                found.setdefault(("mass", body.name), error)
    for joint in spec.joints:
        error = 2 * STATED * rng.uniform(-1, 1)
        if joint.name in robot.joints:
            found["damping", joint.name] = error
    return found


def _plan_episodes(
    case: OtherCase, written: WrittenRobot, robot: Robot, rng: Rng
) -> Iterator[MotionPlan]:
    """The plans of a recording, drawn as they are asked for."""
    for _ in range(written.episodes):
        qpos, qvel = robot.model.qpos0.copy(), np.zeros(robot.model.nv)
        if written.start:
            written.start(qpos, qvel, rng)
        control, rows, due = written.motion(rng, robot), [], 0.0
        for row in range(int(written.seconds / robot.fine)):
            if row * robot.fine >= due - 1e-12:
                rows.append(row)
                due += 1 / written.rate * (1 + case.jitter * rng.uniform(-1, 1))
        at = np.array(rows)

        def command(i: int, data: Any, control=control, at=at) -> np.ndarray:
            return control(at[i] * robot.fine, data)

        yield MotionPlan("", at, command, qpos, qvel)


def make_case(name: str, written: WrittenRobot | None = None) -> Case:
    """A case; always the same for the same name.

    Args:
        name: of `OTHER_CASES`.
        written: in place of its robot, with other episodes.
    """
    case = OTHER_CASES[name]
    written = written or WRITTEN[case.robot]
    robot = written.read()
    errors = _draw_errors(robot, np.random.default_rng(case.stated))
    instruments = Instruments(robot, written.signals, dropout=case.missing)
    experiment = Experiment(
        robot, instruments, {**errors, **(case.off or {})}, link_side=not case.motor
    )
    placed = [PlacedEffect(EFFECTS[e], at, dict(v)) for e, at, v in case.effects]
    seeds = case.seed, case.seed + TEST
    rngs = np.random.default_rng(seeds[0]), np.random.default_rng(seeds[1])
    train, test = (_plan_episodes(case, written, robot, rng) for rng in rngs)
    session = Session(train, test, rngs, case.state, written.piece)
    return build_case(
        name, experiment, placed, session, kind=case.kind, seed=case.seed
    )[0]
