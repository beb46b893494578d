"""A case: takes an experiment with its effects, gives model, recordings and key."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden.effects.base import PlacedEffect
from benchmarks.hidden.robots.robot import Rng, Robot
from benchmarks.hidden.sensors import Instruments, Record, record_plans
from benchmarks.hidden.simulator import MotionPlan, Rollout
from benchmarks.hidden.strength import make_coarse_spec
from benchmarks.hidden.truth import Errors, HiddenRobot, make_hidden_robot
from benchmarks.replay_error import compute_score, extract_values, simulate_open_loop
from selfheal.files import atomic_path
from selfheal.recording import Recording, write

TWO_SIDED = ("backlash", "compliance")  # motor and link are at two angles


@dataclass(frozen=True)
class Experiment:
    """A robot, the errors of what its model states, and its sensors.

    Attributes:
        errors: of what the model states.
        integrator: of the hidden robot; "": the given model's.
        link_side: whether joint positions are the links' where there is play.
    """

    robot: Robot
    instruments: Instruments
    errors: Errors = field(default_factory=dict)
    integrator: str = ""
    link_side: bool = True

    def make_hidden_robot(self, placed: Iterable[PlacedEffect] = ()) -> HiddenRobot:
        """The hidden robot with these effects."""
        truth = make_hidden_robot(self.robot, self.errors, self.integrator)
        truth.motor_side = not self.link_side
        for one in placed:
            one.effect.install(truth, one.target, one.values)
        return truth

    def find_unit(self, one: PlacedEffect, parameter: str) -> str:
        """The unit of a parameter; a slide's has m and N."""
        unit, kind = one.effect.units[parameter], one.target.partition(":")[0]
        robot = self.robot
        joint = "" if kind in ("body", "world") else robot.find_joint(one.target)
        if joint not in robot.joints or not robot.is_slide(joint):
            return unit
        return unit.replace("N m", "N").replace("rad", "m").replace("kg m^2", "kg")

    def describe_effect(self, one: PlacedEffect) -> dict[str, Any]:
        """What the key says of an effect."""
        entry: dict[str, Any] = {
            "effect": one.effect.name,
            "target": one.target,
            "parameters": [
                {"name": name, "value": value, "unit": self.find_unit(one, name)}
                for name, value in one.values.items()
                if name in one.effect.units
            ],
            "all_values": one.values,
            "error_over_noise": one.strength[0],
            "after_refit": one.strength[1],
        }
        if one.effect.name in TWO_SIDED:
            entry["measured"] = "link" if self.link_side else "motor"
        return entry


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        test: what a diagnosis is scored on.
        pieces: more that is concealed, by the name of its file.
    """

    name: str
    robot: Robot
    train: Recording
    test: Recording
    key: dict[str, Any]
    pieces: Mapping[str, Recording] = field(default_factory=dict)


@dataclass(frozen=True)
class Session:
    """How a case is recorded.

    Attributes:
        train: plans of what is diagnosed, may be drawn as they are asked for.
        test: plans of what scores.
        rngs: draw the noise of both.
        state: whether what is diagnosed states where its episodes start.
        piece: [s] of the pieces of the test, where open loop does not hold longer; 0:
            whole episodes.
        check: raises `UnfitDraw` where a rollout makes no case.
    """

    train: Iterable[MotionPlan]
    test: Iterable[MotionPlan]
    rngs: tuple[Rng, Rng]
    state: bool
    piece: float = 0.0
    check: Callable[[Rollout], None] = lambda run: None


def build_case(
    name: str,
    experiment: Experiment,
    placed: Sequence[PlacedEffect],
    session: Session,
    *,
    given: Robot | None = None,
    **key: Any,
) -> tuple[Case, Record, Record]:
    """Simulate and record a case.

    Args:
        given: the robot as its model has it, if not as the experiment has it; the
            scorer then measures references itself.
        key: what the key says besides: at least kind and seed.

    Returns:
        The case, and what is known of what is diagnosed and of the test.

    Raises:
        UnfitDraw: the simulation diverged.
    """
    truth, robot = experiment.make_hidden_robot(placed), given or experiment.robot
    train, test = (
        record_plans(
            experiment.instruments, truth, plans, rng, state=state, check=session.check
        )
        for plans, rng, state in (
            (session.train, session.rngs[0], session.state),
            (session.test, session.rngs[1], True),
        )
    )
    test = test.cut(session.piece)
    sensors = experiment.instruments.sensors.items()
    whole = {
        "format": "selfheal-sealed-key",
        "version": 1,
        "robot": robot.name,
        "effects": [experiment.describe_effect(one) for one in placed],
        "quantized_noise": [f"sensor:{n}" for n, s in sensors if s.step],
        "parameter_errors": {":".join(k): v for k, v in experiment.errors.items()},
        "test": {} if given else score_references(experiment, test),
        **key,
    }
    return Case(name, robot, train.seen, test.seen, whole), train, test


def score_references(
    experiment: Experiment, test: Record
) -> Mapping[str, float | None]:
    """Scores on the test that any diagnosis is to be held against.

    given: the model as given. stated: with the true values of all it states, without
    the effects. floor: the truth itself, so noise alone.
    """
    given = experiment.robot.model
    stated = make_coarse_spec(experiment.make_hidden_robot()).compile()
    scores = {
        "given": compute_score(simulate_open_loop(given, test.seen), test.seen),
        "stated": compute_score(simulate_open_loop(stated, test.seen), test.seen),
        "floor": compute_score(extract_values(test.clean), test.seen),
    }
    return {k: v if np.isfinite(v) else None for k, v in scores.items()}


def save_case(case: Case, cases: Path, keys: Path) -> None:
    """Write a case into two folders: what is given, and what is concealed.

    Args:
        cases: folder for model.xml and recording.h5, in a folder of the case's name.
        keys: folder for key.json and recordings that score, likewise.
    """
    given, sealed = cases / case.name, keys / case.name
    given.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(parents=True, exist_ok=True)
    with atomic_path(given / "model.xml") as path:
        path.write_text(case.robot.xml)
    write(case.train, given / "recording.h5")
    for file, recording in {"test": case.test, **case.pieces}.items():
        write(recording, sealed / f"{file}.h5")
    with atomic_path(sealed / "key.json") as path:  # last: the case is whole
        path.write_text(json.dumps(case.key, indent=1, default=float) + "\n")
