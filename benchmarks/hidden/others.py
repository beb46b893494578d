"""The other suite: robots that were written down, and what each lacks; no draws."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from benchmarks.hidden.case import Case, Experiment, Session, build_case
from benchmarks.hidden.effects import DRAWN, PLACED
from benchmarks.hidden.effects.base import Effect, PlacedEffect
from benchmarks.hidden.robots.robot import Rng, Robot
from benchmarks.hidden.robots.written import FOLDER, WRITTEN, WrittenRobot
from benchmarks.hidden.sensors import Instruments
from benchmarks.hidden.simulator import MotionPlan

STATED = 0.06  # share that a stated mass is off at most; a damping twice that
TEST = 1000  # added to the seed of a recording


@dataclass(frozen=True)
class OtherCase:
    """One case.

    Attributes:
        stated: seed of the errors in what the model states.
        effects: what is missing from the model: effect, target and values.
        off: errors of what the model states that are chosen, by "kind:name".
        jitter: share that the time between samples varies by.
        state: True where episodes state where they start.
        motor: True where joint positions are the motors'.
    """

    robot: str
    stated: int
    seed: int
    effects: Sequence[Mapping[str, Any]] = ()
    off: Mapping[str, float] = field(default_factory=dict)
    jitter: float = 0.0
    missing: float = 0.0
    state: bool = False
    motor: bool = False

    @property
    def kind(self) -> str:
        """As the sealed suite calls it."""
        return ("null", "single", "double")[len(self.effects)]


def _read_cases() -> dict[str, OtherCase]:
    tables = tomllib.loads((FOLDER / "cases.toml").read_text())
    return {name: OtherCase(**table) for name, table in tables.items()}


OTHER_CASES: Mapping[str, OtherCase] = _read_cases()
EFFECTS: Mapping[str, Effect] = {**DRAWN, **PLACED}


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

        def command(i: int, data: mujoco.MjData, control=control, at=at) -> np.ndarray:
            return control(at[i] * robot.fine, data)

        yield MotionPlan("", at, command, qpos, qvel)


def make_case(name: str, written: WrittenRobot | None = None) -> Case:
    """A case; always the same for the same name.

    Args:
        written: in place of its robot, with other episodes.
    """
    case = OTHER_CASES[name]
    written = written or WRITTEN[case.robot]
    robot = written.read()
    errors = _draw_errors(robot, np.random.default_rng(case.stated))
    instruments = Instruments(robot, written.signals, dropout=case.missing)
    for name_of, error in case.off.items():
        kind, _, where = name_of.partition(":")
        errors[kind, where] = error
    experiment = Experiment(robot, instruments, errors, link_side=not case.motor)
    placed = [
        PlacedEffect(EFFECTS[e["effect"]], e["target"], dict(e["values"]))
        for e in case.effects
    ]
    seeds = case.seed, case.seed + TEST
    rngs = np.random.default_rng(seeds[0]), np.random.default_rng(seeds[1])
    train, test = (_plan_episodes(case, written, robot, rng) for rng in rngs)
    session = Session(train, test, rngs, case.state, written.piece)
    return build_case(
        name, experiment, placed, session, kind=case.kind, seed=case.seed
    )[0]
