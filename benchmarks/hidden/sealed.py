"""The sealed suite: nine robots, 35 effects and 9 unlisted ones, sized by the noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.hidden import motions as move
from benchmarks.hidden.case import Case, Experiment, Session, build_case
from benchmarks.hidden.effects import DRAWN, UNLISTED
from benchmarks.hidden.effects.base import Effect, PlacedEffect
from benchmarks.hidden.robots.robot import (
    FAST,
    NumberDraw,
    Rng,
    Robot,
    draw_log_uniform,
)
from benchmarks.hidden.robots.shapes import ROBOTS, make_blank_robot
from benchmarks.hidden.sensors import (
    Instruments,
    measure_joints,
    measure_pose,
    measure_torque,
)
from benchmarks.hidden.simulator import MotionPlan, simulate_plans
from benchmarks.hidden.strength import measure_integration_error, measure_strength
from benchmarks.hidden.truth import UnfitDraw, list_nuisances

KINDS = ("single", "null", "double", "unlisted")
MIXED = ("single", "null", "single", "double", "single", "null", "unlisted")
ATTEMPTS = 25  # draws for one case
TEST_PIECES = {"torque": 0.5, "none": 0.5}  # [s] where open loop does not hold longer
SHARE = 0.6  # of a bound that a stated value's error is drawn from
LEAST, MOST = 3.0, 30.0  # error of an effect over noise, after a refit
PROBE = 2.6  # [s] of an episode that effects are sized on
LOUD = ("limb_loss", "joint_jam")  # effects that have no size

TRAIN = ("multisine", "slow", "steps", "chirp", "fast", "holds", "multisine", "slow")
TEST = ("multisine", "steps", "slow", "fast")
SECONDS = 5.0  # of a driven episode; chosen: forty seconds of log a case
LEGGED_SECONDS = 3.0
SWING_SECONDS = 4.0
TOSSES = 24

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


@dataclass(frozen=True)
class Draw:
    """An experiment and the plans of its recordings."""

    experiment: Experiment
    train: Sequence[MotionPlan]
    test: Sequence[MotionPlan]
    state: bool
    noted: dict[str, Any]


# ---------------------------------------------------------------- what is drawn


def _draw_noise(rng: Rng) -> dict[str, float]:
    """Noise of one case; chosen: that of good to middling encoders and cameras.

    position and velocity in the joint's units, torque as a share of the joint's typical
    load, place [m], turn [rad], memory: correlation from sample to sample, lattice:
    encoder step below the noise, dropout: share of samples missing.
    """
    between = partial(draw_log_uniform, rng)
    position = between(3e-4, 1.5e-3)
    colored, coarse, gaps = rng.random(3)
    return {
        "position": position,
        "velocity": between(5e-3, 4e-2),
        "torque": between(0.01, 0.04),
        "place": between(4e-4, 1.5e-3),
        "turn": between(2e-3, 6e-3),
        "memory": float(rng.uniform(0.5, 0.95)) if colored < 0.35 else 0.0,
        "lattice": position if coarse < 0.2 else 0.0,
        "dropout": float(rng.uniform(0.005, 0.05)) if gaps < 0.3 else 0.0,
    }


def _draw_instruments(
    robot: Robot, rng: Rng
) -> tuple[Instruments, bool, dict[str, Any]]:
    """Instruments, whether episodes state where they start, and what the key notes."""
    noise = _draw_noise(rng)
    velocity, torque, state, epoch = rng.random(4)
    speed = noise["velocity"] if robot.joints and velocity < 0.35 else 0.0
    sensors = measure_joints(robot, robot.joints, noise["position"], speed)
    for joint in robot.joints:
        name = f"{joint}_position"
        sensors[name] = replace(sensors[name], step=noise["lattice"])
    if robot.actuators and torque < 0.3:
        for name, joint in robot.actuators.items():
            loudness = noise["torque"] * robot.load[joint]
            sensors[f"{name}_torque"] = measure_torque(robot, joint, loudness)
    if robot.free:
        sensors |= measure_pose(robot.free, noise["place"], noise["turn"])
    since = round(float(rng.uniform(0, 60)), 3) if epoch < 0.3 else 0.0
    instruments = Instruments(robot, sensors, noise["memory"], noise["dropout"], since)
    return instruments, bool(state < 0.5), {"noise": noise}


def _draw_sampling(robot: Robot, rng: Rng) -> tuple[float, float, int]:
    """Rate [Hz], jitter (share of a period), samples that a command is held."""
    # of a driven robot, whole steps of the given model: commands then fall between
    # two steps in the jittered cases only
    legged = robot.contact and robot.drive == "servo"
    rates: tuple[int, ...] = (100, 125) if legged else (100, 200, 250, 500)
    if robot.drive == "none":
        rates = (150, 200, 250, 400, 500)
    rate, jitter = float(rng.choice(rates)), float(rng.choice([0.0, 0.0, 0.2, 0.35]))
    # a torque feedback at less than 100 Hz would not be stable
    slow_hold = max(2, int(rate / 100)) if robot.drive == "torque" else int(rate / 40)
    hold = slow_hold if rng.random() < 0.3 and rate > 100 else 1
    return rate, jitter, hold


def _draw_plans(robot: Robot, rng: Rng, sampled, *, test: bool) -> list[MotionPlan]:
    """The plans of a recording; of the test, fewer and other episodes."""
    if robot.drive != "none":
        seconds = LEGGED_SECONDS if robot.contact else SECONDS
        names = TEST if test else TRAIN
        return [move.plan_driven(robot, rng, name, sampled, seconds) for name in names]
    if robot.free:
        count = TOSSES // 3 if test else TOSSES
        return [move.plan_toss(robot, rng, sampled) for _ in range(count)]
    count = 4 if test else 8
    return [move.plan_release(robot, rng, sampled, SWING_SECONDS) for _ in range(count)]


def draw_experiment(
    name: str, rng: Rng, zero=frozenset(), density: float = 0.0
) -> Draw:
    """Everything of a case but its effects.

    Args:
        zero: attributes that the given model states as 0.
        density: [kg/m^3] of the medium that the given model states.
    """
    robot = ROBOTS[name](NumberDraw(rng, zero, density))
    errors = {
        (n.kind, n.name): float(rng.uniform(-1, 1) * SHARE * n.bound)
        for n in list_nuisances(robot)
    }
    if ("friction", "") in errors:
        errors["friction", ""] /= 2  # of both geoms of a contact
    sampled = _draw_sampling(robot, rng)
    instruments, state, noted = _draw_instruments(robot, rng)
    rk4 = bool(rng.random() < 0.5 and not robot.contact and FAST in robot.xml)
    integrator = "RK4" if rk4 else "implicit"
    train, test = (_draw_plans(robot, rng, sampled, test=t) for t in (False, True))
    link_side = bool(rng.random() < 0.7)
    experiment = Experiment(robot, instruments, errors, integrator, link_side)
    return Draw(experiment, train, test, state, noted)


# ---------------------------------------------------------------- how large effects are


def _select_probe_plans(draw: Draw) -> list[MotionPlan]:
    """A few episodes of different motions, to size an effect on."""
    robot = draw.experiment.robot
    if robot.free and not robot.joints:
        return list(draw.train[:8])
    return [
        replace(plan, rows=plan.rows[plan.rows * robot.fine < PROBE])
        for plan in draw.train[:4]
    ]


def size_effect(draw: Draw, effect: Effect, target: str, rng: Rng) -> PlacedEffect:
    """An effect as large as the case needs.

    Raises:
        UnfitDraw: no sane size makes it matter.
    """
    robot = draw.experiment.robot
    values = effect.draw(robot, target, rng)
    low, high = effect.sizes
    size = float(np.clip(np.exp(rng.uniform(-0.7, 0.7)), low, high))
    aim = draw_log_uniform(rng, 5.0, 22.0)
    for _ in range(7):
        placed = PlacedEffect(effect, target, values(size))
        try:
            raw, left = _measure_strength(draw, placed)
        except UnfitDraw:
            raw, left = np.inf, np.inf
        most = np.inf if effect.name in LOUD else MOST
        if LEAST <= left <= most and left < np.inf:
            return replace(placed, strength=(raw, left))
        factor = 0.3 if left == np.inf else (aim / max(left, 0.05)) ** 0.9
        new = float(np.clip(size * np.clip(factor, 0.15, 6.0), low, high))
        if new == size:
            break
        size = new
    raise UnfitDraw(f"{effect.name} at {target} of {robot.name} does not show")


def _measure_strength(draw: Draw, placed: PlacedEffect) -> tuple[float, float]:
    truth = draw.experiment.make_hidden_robot([placed])
    runs = simulate_plans(truth, _select_probe_plans(draw))
    instruments = replace(draw.experiment.instruments, readings=truth.readings)
    return measure_strength(instruments, draw.experiment.make_hidden_robot(), runs)


# ---------------------------------------------------------------- cases


def _list_robots(effect: Effect) -> list[str]:
    return [name for name in ROBOTS if effect.list_targets(make_blank_robot(name))]


def _choose_effects(
    kind: str, seed: int, rng: Rng, wanted: Sequence[str]
) -> list[Effect]:
    """The effects of a case: by turns, so that a row of seeds has them all."""
    if kind == "null":
        return []
    menu = list((UNLISTED if kind == "unlisted" else DRAWN).values())
    if wanted:
        menu = [e for e in menu if e.name in wanted]
    chosen = [menu[seed % len(menu)]]
    if kind == "double":
        rest = [e for e in DRAWN.values() if _are_compatible(chosen[0], e)]
        if not rest:
            raise UnfitDraw(f"nothing goes with {chosen[0].name}")
        chosen.append(rest[rng.integers(len(rest))])
    return chosen


def _are_compatible(one: Effect, other: Effect) -> bool:
    names = {one.name, other.name}
    if len(names) == 1 or "joint_jam" in names:
        return False
    shared = set(_list_robots(one)) & set(_list_robots(other))
    return bool(shared) and not any(names <= family for family in _FAMILIES)


def find_kind(kind: str, seed: int) -> str:
    """The kind of a seed's case: "mixed" is of each in turn."""
    return MIXED[seed % len(MIXED)] if kind == "mixed" else kind


def name_case(seed: int) -> str:
    """Name of a seed's case, which does not say its kind."""
    return f"case_{seed:05d}"


def make_case(kind: str, seed: int, *, effects=(), robots=()) -> Case:
    """One case, the same for the same seed.

    Args:
        kind: of `KINDS`, or "mixed".
        effects: names to choose from, all by default.
        robots: names to choose from, all by default.

    Raises:
        UnfitDraw: no draw makes a case.
    """
    kind = find_kind(kind, seed)
    reasons = []
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, KINDS.index(kind), attempt])
        try:
            chosen = _choose_effects(kind, seed, rng, effects)
            name = _choose_robot(kind, seed, attempt, chosen, robots)
            return _draw_case(kind, seed, name, chosen, rng)
        except UnfitDraw as reason:
            reasons.append(str(reason))
    raise UnfitDraw(f"{kind} {seed}: " + "; ".join(sorted(set(reasons))))


def _choose_robot(
    kind: str, seed: int, attempt: int, chosen: Sequence[Effect], robots: Sequence[str]
) -> str:
    fit = set(robots or ROBOTS)
    for effect in chosen:
        fit &= set(_list_robots(effect))
    names = [name for name in ROBOTS if name in fit]
    if not names:
        raise UnfitDraw(f"no robot for {[e.name for e in chosen]}")
    menu = len(UNLISTED if kind == "unlisted" else DRAWN)
    turn = seed if kind == "null" else seed // menu + 5 * seed
    return names[(turn + attempt // 3) % len(names)]


def _draw_case(
    kind: str, seed: int, name: str, chosen: Sequence[Effect], rng: Rng
) -> Case:
    shape, targets, zero, density = make_blank_robot(name), [], frozenset[str](), 0.0
    for effect in chosen:
        places = effect.list_targets(shape)
        targets.append(places[int(rng.integers(len(places)))])
        more, medium = effect.choose_omissions(targets[-1], rng)
        zero, density = zero | more, max(density, medium)
    draw = draw_experiment(name, rng, zero, density)
    placed = [
        size_effect(draw, effect, target, rng)
        for effect, target in zip(chosen, targets, strict=True)
    ]
    experiment, robot = draw.experiment, draw.experiment.robot
    state = draw.state and bool(robot.drive == "servo" or robot.free)
    if robot.contact and robot.joints:
        state = False
    piece = 1.0 if robot.contact else TEST_PIECES.get(robot.drive, 0.0)
    if robot.free and not robot.joints:
        piece = 0.0
    case, train, _ = build_case(
        name_case(seed),
        experiment,
        placed,
        Session(draw.train, draw.test, (rng, rng), state, piece),
        kind=kind,
        seed=seed,
        integrator=experiment.integrator,
        fine_step=robot.fine,
        **draw.noted,
    )
    costs = measure_integration_error(
        experiment.instruments, experiment.make_hidden_robot(), train.runs
    )
    return replace(case, key={**case.key, "integration_over_noise": costs})
