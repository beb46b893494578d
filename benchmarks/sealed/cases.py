"""Cases of the sealed benchmark: takes a seed and a kind, gives model, data and key."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import mujoco
import numpy as np

from benchmarks.replay_error import compute_score, extract_values, simulate_open_loop
from benchmarks.sealed.effects import (
    EFFECTS,
    Effect,
    choose_omissions,
    make_blank_robot,
)
from benchmarks.sealed.experiment import (
    Experiment,
    PlacedEffect,
    Rng,
    draw_experiment,
    size_effect,
)
from benchmarks.sealed.hidden_robot import (
    UnfitDraw,
)
from benchmarks.sealed.mjcf import Robot
from benchmarks.sealed.robots import ROBOTS
from benchmarks.sealed.sensors import (
    Instruments,
    Noise,
    cut_segments,
)
from benchmarks.sealed.simulator import simulate_plans
from benchmarks.sealed.strength import (
    make_coarse_spec,
    measure_integration_error,
)
from benchmarks.sealed.unlisted import UNLISTED
from selfheal.files import atomic_path
from selfheal.recording import Recording, write

KINDS = ("single", "null", "double", "unlisted")
MIXED = ("single", "null", "single", "double", "single", "null", "unlisted")
ATTEMPTS = 25  # draws for one case
TEST_PIECES = {"torque": 0.5, "none": 0.5}  # [s] where open loop does not hold longer


class GivenModel(Protocol):
    """A robot as the user has it: a name and MJCF."""

    @property
    def name(self) -> str:
        """The name of the robot."""

    @property
    def xml(self) -> str:
        """The model, as MJCF."""


@dataclass(frozen=True)
class Case:
    """One sealed case.

    Attributes:
        name: of its folders.
        robot: the model as given.
        train: what is diagnosed.
        test: what a diagnosis is scored on.
        key: the truth.
    """

    name: str
    robot: GivenModel
    train: Recording
    test: Recording
    key: dict[str, Any]


def _list_robots(effect: Effect) -> list[str]:
    return [name for name in ROBOTS if effect.targets(make_blank_robot(name))]


def _choose_effects(
    kind: str, seed: int, rng: Rng, wanted: Sequence[str]
) -> list[Effect]:
    """The effects of a case: by turns, so that a row of seeds has them all."""
    if kind == "null":
        return []
    menu = UNLISTED if kind == "unlisted" else EFFECTS
    if wanted:
        menu = [e for e in menu if e.name in wanted]
    chosen = [menu[seed % len(menu)]]
    if kind == "double":
        rest = [e for e in EFFECTS if _are_compatible(chosen[0], e)]
        if not rest:
            raise UnfitDraw(f"nothing goes with {chosen[0].name}")
        chosen.append(rest[rng.integers(len(rest))])
    return chosen


# pairs that act on the same thing; a second one would hide or undo the first
_FAMILIES = (
    {"coulomb_friction", "stribeck_friction", "asymmetric_friction"},
    {"stribeck_friction", "load_dependent_friction"},
    {"asymmetric_friction", "load_dependent_friction"},
    {"coulomb_friction", "load_dependent_friction"},
    {"backlash", "compliance"},
    {"torque_saturation", "speed_torque_limit"},
    {"slope", "wind"},
    {"fluid_drag", "wind"},
    {"link_length", "limb_loss"},
)


def _are_compatible(one: Effect, other: Effect) -> bool:
    if one.name == other.name or other.name == "joint_jam" or one.name == "joint_jam":
        return False
    names = {one.name, other.name}
    shared = set(_list_robots(one)) & set(_list_robots(other))
    return bool(shared) and not any(names <= family for family in _FAMILIES)


def make_case(kind: str, seed: int, *, effects=(), robots=()) -> Case:
    """One case, the same for the same seed.

    Args:
        kind: of `KINDS`, or "mixed".
        seed: of everything in it.
        effects: names to choose from, all by default.
        robots: names to choose from, all by default.

    Raises:
        Unfit: no draw makes a case.
    """
    if kind == "mixed":
        kind = MIXED[seed % len(MIXED)]
    reasons = []
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, KINDS.index(kind), attempt])
        try:
            return _attempt_case(kind, seed, attempt, rng, effects, robots)
        except UnfitDraw as reason:
            reasons.append(str(reason))
    raise UnfitDraw(f"{kind} {seed}: " + "; ".join(sorted(set(reasons))))


def _attempt_case(
    kind: str, seed: int, attempt: int, rng: Rng, effects, robots
) -> Case:
    chosen = _choose_effects(kind, seed, rng, effects)
    fit = set(robots or ROBOTS)
    for effect in chosen:
        fit &= set(_list_robots(effect))
    names = [name for name in ROBOTS if name in fit]
    if not names:
        raise UnfitDraw(f"no robot for {[e.name for e in chosen]}")
    menu = len(UNLISTED if kind == "unlisted" else EFFECTS)
    turn = seed if kind == "null" else seed // menu + 5 * seed
    name = names[(turn + attempt // 3) % len(names)]
    return _build_case(kind, seed, name, chosen, rng)


def _build_case(
    kind: str, seed: int, name: str, chosen: list[Effect], rng: Rng
) -> Case:
    shape, targets, zero, density = make_blank_robot(name), [], frozenset[str](), 0.0
    for effect in chosen:
        places = effect.targets(shape)
        targets.append(places[int(rng.integers(len(places)))])
        more, medium = choose_omissions(effect, targets[-1], rng)
        zero, density = zero | more, max(density, medium)
    experiment = draw_experiment(name, rng, zero, density)
    placed = [
        size_effect(experiment, effect, target, rng)
        for effect, target in zip(chosen, targets, strict=True)
    ]
    truth = experiment.make_hidden_robot(placed)
    train, test = (
        simulate_plans(truth, experiment.train),
        simulate_plans(truth, experiment.test),
    )
    instruments, rest = experiment.make_instruments(truth), experiment.robot.drive
    state = experiment.instruments.sensors.state and (
        rest == "servo" or bool(experiment.robot.free)
    )
    if experiment.robot.contact and experiment.robot.joints:
        state = False
    recorded = instruments.record_episodes(experiment.train, train, rng, state=state)
    test_recording = instruments.record_episodes(experiment.test, test, rng, state=True)
    if length := _choose_test_length(experiment.robot):
        test_recording = cut_segments(test_recording, test, length)
    key = _make_key(kind, seed, experiment, instruments, placed, train)
    key["test"] = _score_references(experiment, instruments, test_recording, test)
    return Case(name_case(seed), experiment.robot, recorded, test_recording, key)


def _score_references(
    experiment: Experiment, instruments: Instruments, test_recording: Recording, runs
) -> dict[str, Any]:
    """Scores on the test that any diagnosis is to be held against.

    given: the model as given. stated: with the true values of all it states, without
    the effects. floor: the truth itself, so noise alone.
    """
    given = mujoco.MjModel.from_xml_string(experiment.robot.xml)
    stated = make_coarse_spec(experiment.make_hidden_robot()).compile()
    silent = replace(instruments, noise=Noise(*[0.0] * 8))
    clean = silent.record_episodes(
        experiment.test, runs, np.random.default_rng(0), state=True
    )
    if length := _choose_test_length(experiment.robot):
        clean = cut_segments(clean, runs, length)
    scores = {
        "given": compute_score(
            simulate_open_loop(given, test_recording), test_recording
        ),
        "stated": compute_score(
            simulate_open_loop(stated, test_recording), test_recording
        ),
        "floor": compute_score(extract_values(clean), test_recording),
    }
    return {k: v if np.isfinite(v) else None for k, v in scores.items()}


def _choose_test_length(robot: Robot) -> float:
    """Length [s] of the pieces of a test, 0 for whole episodes."""
    if robot.free and not robot.joints:
        return 0.0
    return 1.0 if robot.contact else TEST_PIECES.get(robot.drive, 0.0)


def _make_key(
    kind, seed, experiment: Experiment, instruments: Instruments, placed, runs
) -> dict[str, Any]:
    lattice = instruments.noise.lattice
    quantized = (
        [f"sensor:{j}_position" for j in experiment.robot.joints] if lattice else []
    )
    return {
        "format": "selfheal-sealed-key",
        "version": 1,
        "kind": kind,
        "seed": seed,
        "robot": experiment.robot.name,
        "effects": [_describe_effect(one, experiment) for one in placed],
        "quantized_noise": quantized,
        "parameter_errors": {":".join(k): v for k, v in experiment.errors.items()},
        "integrator": "RK4" if experiment.rk4 else "implicit",
        "fine_step": experiment.robot.fine,
        "integration_over_noise": measure_integration_error(
            experiment.instruments, experiment.make_hidden_robot(), runs
        ),
        **instruments.describe(),
    }


def _describe_effect(one: PlacedEffect, experiment: Experiment) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "effect": one.effect.name,
        "target": one.target,
        "parameters": [
            {"name": name, "value": value, "unit": _find_unit(one, name, experiment)}
            for name, value in one.values.items()
            if name in one.effect.units
        ],
        "all_values": one.values,
        "error_over_noise": one.strength[0],
        "after_refit": one.strength[1],
    }
    if one.effect.name in ("backlash", "compliance"):
        entry["measured"] = "link" if experiment.link_side else "motor"
    return entry


def _find_unit(one: PlacedEffect, name: str, experiment: Experiment) -> str:
    """Its unit; a slide's has m and N."""
    unit = one.effect.units[name]
    kind, _, target = one.target.partition(":")
    joint = experiment.robot.actuators.get(target, target.removesuffix("_position"))
    model = mujoco.MjModel.from_xml_string(experiment.robot.xml)
    if joint not in experiment.robot.joints or kind == "body":
        return unit
    if model.joint(joint).type[0] != mujoco.mjtJoint.mjJNT_SLIDE:
        return unit
    return unit.replace("N m", "N").replace("rad", "m").replace("kg m^2", "kg")


def name_case(seed: int) -> str:
    """Name of a seed's case, which does not tell its kind."""
    return f"case_{seed:05d}"


def save_case(case: Case, cases: Path, keys: Path) -> None:
    """Write a case into two folders: what is given, and what is concealed.

    Args:
        case: that is written.
        cases: folder for model.xml and recording.h5, in a folder of the case's name.
        keys: folder for key.json and test.h5, likewise.
    """
    given, sealed = cases / case.name, keys / case.name
    given.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(parents=True, exist_ok=True)
    with atomic_path(given / "model.xml") as path:
        path.write_text(case.robot.xml)
    write(case.train, given / "recording.h5")
    write(case.test, sealed / "test.h5")
    with atomic_path(sealed / "key.json") as path:
        path.write_text(json.dumps(case.key, indent=1, default=_to_python) + "\n")


def _to_python(value: Any) -> Any:
    """A numpy number as Python's own."""
    return value.item()
