"""Cases of the sealed benchmark: takes a seed and a kind, gives model, data and key."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.replay_error import open_loop, score, values
from benchmarks.sealed.effects import EFFECTS, Effect, blank, drawing
from benchmarks.sealed.hidden_robot import (
    Plan,
    Truth,
    Unfit,
    change,
    hidden,
    nuisances,
    simulate,
)
from benchmarks.sealed.mjcf import FAST, Draw, Robot
from benchmarks.sealed.motions import plans, sampling
from benchmarks.sealed.robots import ROBOTS
from benchmarks.sealed.sensors import Bench, Noise, draw_noise, draw_sensors, pieces
from benchmarks.sealed.strength import coarse, integration, strength
from benchmarks.sealed.unlisted import UNLISTED
from selfheal.files import atomic_path
from selfheal.recording import Recording, write

KINDS = ("single", "null", "double", "unlisted")
MIXED = ("single", "null", "single", "double", "single", "null", "unlisted")
SHARE = 0.6  # of a bound that a stated value's error is drawn from
LEAST, MOST = 3.0, 30.0  # error of an effect over noise, after a refit
PROBE = 2.6  # [s] of an episode that effects are sized on
ATTEMPTS = 25  # draws for one case
LOUD = ("limb_loss", "joint_jam")  # effects that have no size
TEST_PIECES = {"torque": 0.5, "none": 0.5}  # [s] where open loop does not hold longer

Rng = np.random.Generator


@dataclass(frozen=True)
class Case:
    """One sealed case.

    Attributes:
        name: of its folders.
        robot: the model as given.
        train: what is diagnosed.
        test: what a diagnosis is proven on.
        key: the truth.
    """

    name: str
    robot: Robot
    train: Recording
    test: Recording
    key: dict[str, Any]


@dataclass(frozen=True)
class Placed:
    """An effect at a place, with what it is made of.

    Attributes:
        effect: of the catalogue, or unlisted.
        target: where.
        values: its parameters.
        strength: error over noise, as it is and after a refit.
    """

    effect: Effect
    target: str
    values: dict[str, float]
    strength: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Scene:
    """A given robot, its stated errors, its sensors and its motions."""

    robot: Robot
    errors: dict[tuple[str, str], float]
    rk4: bool
    bench: Bench
    train: Sequence[Plan]
    test: Sequence[Plan]
    link_side: bool

    def truth(self, placed: Sequence[Placed] = ()) -> Truth:
        """The hidden robot with these effects."""
        truth = hidden(self.robot, rk4=self.rk4)
        truth.motor_side = not self.link_side
        for nuisance in nuisances(self.robot):
            key = (nuisance.kind, nuisance.name)
            change(truth.spec, nuisance, 1 + self.errors.get(key, 0.0))
        for one in placed:
            one.effect.install(truth, one.target, one.values)
        return truth

    def measured(self, truth: Truth) -> Bench:
        """The bench that has the hidden robot's readings."""
        return replace(self.bench, readings=truth.readings)


def scene(name: str, rng: Rng, zero=frozenset(), density: float = 0.0) -> Scene:
    """Everything of a case but its effects."""
    robot = ROBOTS[name](Draw(rng, zero, density))
    errors = {
        (n.kind, n.name): float(rng.uniform(-1, 1) * SHARE * n.bound)
        for n in nuisances(robot)
    }
    for key in errors:
        if key[0] == "friction":
            errors[key] = errors[key] / 2  # of both geoms of a contact
    sampled = sampling(robot, rng)
    bench = Bench(robot, {}, draw_noise(rng), draw_sensors(robot, rng))
    return Scene(
        robot,
        errors,
        bool(rng.random() < 0.5 and not robot.contact and FAST in robot.xml),
        bench,
        plans(robot, rng, sampled, test=False),
        plans(robot, rng, sampled, test=True),
        bool(rng.random() < 0.7),
    )


def _probe(scene: Scene) -> list[Plan]:
    """A few episodes of different motions, to size an effect on."""
    if scene.robot.free and not scene.robot.joints:
        return list(scene.train[:8])
    short = [p.rows * scene.robot.fine < PROBE for p in scene.train[:4]]
    return [
        replace(plan, rows=plan.rows[at], reference=plan.reference[at])
        for plan, at in zip(scene.train, short, strict=False)
    ]


def sized(scene: Scene, effect: Effect, target: str, rng: Rng) -> Placed:
    """An effect as large as the case needs.

    Raises:
        Unfit: no sane size makes it matter.
    """
    values = effect.draw(scene.robot, target, rng)
    low, high = effect.sizes
    size = float(np.clip(np.exp(rng.uniform(-0.7, 0.7)), low, high))
    aim = float(np.exp(rng.uniform(np.log(5.0), np.log(22.0))))
    for _ in range(7):
        placed = Placed(effect, target, values(size))
        try:
            raw, left = _strength(scene, placed)
        except Unfit:
            raw, left = np.inf, np.inf
        if LEAST <= left <= MOST:
            return replace(placed, strength=(raw, left))
        if effect.name in LOUD and LEAST <= left < np.inf:
            return replace(placed, strength=(raw, left))
        factor = 0.3 if left == np.inf else (aim / max(left, 0.05)) ** 0.9
        new = float(np.clip(size * np.clip(factor, 0.15, 6.0), low, high))
        if new == size:
            break
        size = new
    raise Unfit(f"{effect.name} at {target} of {scene.robot.name} does not show")


def _strength(scene: Scene, placed: Placed) -> tuple[float, float]:
    truth = scene.truth([placed])
    runs = simulate(truth, _probe(scene))
    base = scene.truth()
    base.motor_side = truth.motor_side
    return strength(scene.measured(truth), base, runs)


def _robots_for(effect: Effect) -> list[str]:
    return [name for name in ROBOTS if effect.targets(blank(name))]


def _choice(kind: str, seed: int, rng: Rng, wanted: Sequence[str]) -> list[Effect]:
    """The effects of a case: by turns, so that a row of seeds has them all."""
    if kind == "null":
        return []
    menu = UNLISTED if kind == "unlisted" else EFFECTS
    if wanted:
        menu = [e for e in menu if e.name in wanted]
    chosen = [menu[seed % len(menu)]]
    if kind == "double":
        rest = [e for e in EFFECTS if _compatible(chosen[0], e)]
        if not rest:
            raise Unfit(f"nothing goes with {chosen[0].name}")
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


def _compatible(one: Effect, other: Effect) -> bool:
    if one.name == other.name or other.name == "joint_jam" or one.name == "joint_jam":
        return False
    names = {one.name, other.name}
    shared = set(_robots_for(one)) & set(_robots_for(other))
    return bool(shared) and not any(names <= family for family in _FAMILIES)


def make(kind: str, seed: int, *, effects=(), robots=()) -> Case:
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
            return _attempt(kind, seed, attempt, rng, effects, robots)
        except Unfit as reason:
            reasons.append(str(reason))
    raise Unfit(f"{kind} {seed}: " + "; ".join(sorted(set(reasons))))


def _attempt(kind: str, seed: int, attempt: int, rng: Rng, effects, robots) -> Case:
    chosen = _choice(kind, seed, rng, effects)
    fit = set(robots or ROBOTS)
    for effect in chosen:
        fit &= set(_robots_for(effect))
    names = [name for name in ROBOTS if name in fit]
    if not names:
        raise Unfit(f"no robot for {[e.name for e in chosen]}")
    menu = len(UNLISTED if kind == "unlisted" else EFFECTS)
    turn = seed if kind == "null" else seed // menu + 5 * seed
    name = names[(turn + attempt // 3) % len(names)]
    return _build(kind, seed, name, chosen, rng)


def _build(kind: str, seed: int, name: str, chosen: list[Effect], rng: Rng) -> Case:
    shape, targets, zero, density = blank(name), [], frozenset[str](), 0.0
    for effect in chosen:
        places = effect.targets(shape)
        targets.append(places[int(rng.integers(len(places)))])
        more, medium = drawing(effect, targets[-1], rng)
        zero, density = zero | more, max(density, medium)
    made = scene(name, rng, zero, density)
    placed = [
        sized(made, effect, target, rng)
        for effect, target in zip(chosen, targets, strict=True)
    ]
    truth = made.truth(placed)
    train, test = simulate(truth, made.train), simulate(truth, made.test)
    bench, rest = made.measured(truth), made.robot.drive
    state = made.bench.sensors.state and (rest == "servo" or bool(made.robot.free))
    if made.robot.contact and made.robot.joints:
        state = False
    recorded = bench.recording(made.train, train, rng, state=state)
    proof = bench.recording(made.test, test, rng, state=True)
    if length := _test_piece(made.robot):
        proof = pieces(proof, test, length)
    key = _key(kind, seed, made, bench, placed, train)
    key["test"] = _standard(made, bench, proof, test)
    return Case(case_name(seed), made.robot, recorded, proof, key)


def _standard(made: Scene, bench: Bench, proof: Recording, runs) -> dict[str, Any]:
    """Scores on the test that any diagnosis is to be held against.

    given: the model as given. stated: with the true values of all it states, without
    the effects. floor: the truth itself, so noise alone.
    """
    given = mujoco.MjModel.from_xml_string(made.robot.xml)
    stated = coarse(made.truth()).compile()
    silent = replace(bench, noise=Noise(*[0.0] * 8))
    clean = silent.recording(made.test, runs, np.random.default_rng(0), state=True)
    if length := _test_piece(made.robot):
        clean = pieces(clean, runs, length)
    scores = {
        "given": score(open_loop(given, proof), proof),
        "stated": score(open_loop(stated, proof), proof),
        "floor": score(values(clean), proof),
    }
    return {k: v if np.isfinite(v) else None for k, v in scores.items()}


def _test_piece(robot: Robot) -> float:
    """Length [s] of the pieces of a test, 0 for whole episodes."""
    if robot.free and not robot.joints:
        return 0.0
    return 1.0 if robot.contact else TEST_PIECES.get(robot.drive, 0.0)


def _key(kind, seed, made: Scene, bench: Bench, placed, runs) -> dict[str, Any]:
    lattice = bench.noise.lattice
    besides = [f"sensor:{j}_position" for j in made.robot.joints] if lattice else []
    return {
        "format": "selfheal-sealed-key",
        "version": 1,
        "kind": kind,
        "seed": seed,
        "robot": made.robot.name,
        "effects": [_told(one, made) for one in placed],
        "quantized_noise": besides,
        "parameter_errors": {":".join(k): v for k, v in made.errors.items()},
        "integrator": "RK4" if made.rk4 else "implicit",
        "fine_step": made.robot.fine,
        "integration_over_noise": integration(made.bench, made.truth(), runs),
        **bench.facts(),
    }


def _told(one: Placed, made: Scene) -> dict[str, Any]:
    told: dict[str, Any] = {
        "effect": one.effect.name,
        "target": one.target,
        "parameters": [
            {"name": name, "value": value, "unit": _unit(one, name, made)}
            for name, value in one.values.items()
            if name in one.effect.units
        ],
        "all_values": one.values,
        "error_over_noise": one.strength[0],
        "after_refit": one.strength[1],
    }
    if one.effect.name in ("backlash", "compliance"):
        told["measured"] = "link" if made.link_side else "motor"
    return told


def _unit(one: Placed, name: str, made: Scene) -> str:
    """Its unit; a slide's has m and N."""
    unit = one.effect.units[name]
    kind, _, target = one.target.partition(":")
    joint = made.robot.actuators.get(target, target.removesuffix("_position"))
    model = mujoco.MjModel.from_xml_string(made.robot.xml)
    if joint not in made.robot.joints or kind == "body":
        return unit
    if model.joint(joint).type[0] != mujoco.mjtJoint.mjJNT_SLIDE:
        return unit
    return unit.replace("N m", "N").replace("rad", "m").replace("kg m^2", "kg")


def case_name(seed: int) -> str:
    """A name that does not tell the kind; a seed makes one case of one kind."""
    return f"case_{seed:05d}"


def save(case: Case, cases: Path, keys: Path) -> None:
    """Write a case into two folders: what is given, and what is concealed."""
    given, sealed = cases / case.name, keys / case.name
    given.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(parents=True, exist_ok=True)
    with atomic_path(given / "model.xml") as path:
        path.write_text(case.robot.xml)
    write(case.train, given / "recording.h5")
    write(case.test, sealed / "test.h5")
    with atomic_path(sealed / "key.json") as path:
        path.write_text(json.dumps(case.key, indent=1, default=_plain) + "\n")


def _plain(value: Any) -> Any:
    """A numpy number as Python's own."""
    return value.item()
