"""An experiment on a hidden robot: draws its robot, errors, sensors and motions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.sealed.effects import (
    Effect,
)
from benchmarks.sealed.hidden_robot import (
    HiddenRobot,
    UnfitDraw,
    list_nuisances,
    make_hidden_robot,
    scale_value,
)
from benchmarks.sealed.mjcf import FAST, NumberDraw, Robot
from benchmarks.sealed.motions import draw_plans, draw_sampling
from benchmarks.sealed.robots import ROBOTS
from benchmarks.sealed.sensors import (
    Instruments,
    draw_noise,
    draw_sensors,
)
from benchmarks.sealed.simulator import MotionPlan, simulate_plans
from benchmarks.sealed.strength import (
    measure_strength,
)

SHARE = 0.6  # of a bound that a stated value's error is drawn from
LEAST, MOST = 3.0, 30.0  # error of an effect over noise, after a refit
PROBE = 2.6  # [s] of an episode that effects are sized on
LOUD = ("limb_loss", "joint_jam")  # effects that have no size
Rng = np.random.Generator


@dataclass(frozen=True)
class PlacedEffect:
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
class Experiment:
    """A given robot, its stated errors, its sensors and its motions."""

    robot: Robot
    errors: dict[tuple[str, str], float]
    rk4: bool
    instruments: Instruments
    train: Sequence[MotionPlan]
    test: Sequence[MotionPlan]
    link_side: bool

    def make_hidden_robot(self, placed: Sequence[PlacedEffect] = ()) -> HiddenRobot:
        """The hidden robot with these effects."""
        truth = make_hidden_robot(self.robot, rk4=self.rk4)
        truth.motor_side = not self.link_side
        for nuisance in list_nuisances(self.robot):
            key = (nuisance.kind, nuisance.name)
            scale_value(truth.spec, nuisance, 1 + self.errors.get(key, 0.0))
        for one in placed:
            one.effect.install(truth, one.target, one.values)
        return truth

    def make_instruments(self, truth: HiddenRobot) -> Instruments:
        """The same instruments, with the sensor errors of a hidden robot."""
        return replace(self.instruments, readings=truth.readings)


def draw_experiment(
    name: str, rng: Rng, zero=frozenset(), density: float = 0.0
) -> Experiment:
    """Everything of a case but its effects.

    Args:
        name: of the shape.
        rng: draws all of it.
        zero: attributes that the given model states as 0.
        density: [kg/m^3] of the medium that the given model states.
    """
    robot = ROBOTS[name](NumberDraw(rng, zero, density))
    errors = {
        (n.kind, n.name): float(rng.uniform(-1, 1) * SHARE * n.bound)
        for n in list_nuisances(robot)
    }
    for key in errors:
        if key[0] == "friction":
            errors[key] = errors[key] / 2  # of both geoms of a contact
    sampled = draw_sampling(robot, rng)
    instruments = Instruments(robot, {}, draw_noise(rng), draw_sensors(robot, rng))
    return Experiment(
        robot,
        errors,
        bool(rng.random() < 0.5 and not robot.contact and FAST in robot.xml),
        instruments,
        draw_plans(robot, rng, sampled, test=False),
        draw_plans(robot, rng, sampled, test=True),
        bool(rng.random() < 0.7),
    )


def _select_probe_plans(experiment: Experiment) -> list[MotionPlan]:
    """A few episodes of different motions, to size an effect on."""
    if experiment.robot.free and not experiment.robot.joints:
        return list(experiment.train[:8])
    short = [p.rows * experiment.robot.fine < PROBE for p in experiment.train[:4]]
    return [
        replace(plan, rows=plan.rows[at], reference=plan.reference[at])
        for plan, at in zip(experiment.train, short, strict=False)
    ]


def size_effect(
    experiment: Experiment, effect: Effect, target: str, rng: Rng
) -> PlacedEffect:
    """An effect as large as the case needs.

    Args:
        experiment: that it is sized on.
        effect: that is concealed.
        target: where.
        rng: draws its parameters.

    Raises:
        UnfitDraw: no sane size makes it matter.
    """
    values = effect.draw(experiment.robot, target, rng)
    low, high = effect.sizes
    size = float(np.clip(np.exp(rng.uniform(-0.7, 0.7)), low, high))
    aim = float(np.exp(rng.uniform(np.log(5.0), np.log(22.0))))
    for _ in range(7):
        placed = PlacedEffect(effect, target, values(size))
        try:
            raw, left = _measure_strength(experiment, placed)
        except UnfitDraw:
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
    raise UnfitDraw(
        f"{effect.name} at {target} of {experiment.robot.name} does not show"
    )


def _measure_strength(
    experiment: Experiment, placed: PlacedEffect
) -> tuple[float, float]:
    truth = experiment.make_hidden_robot([placed])
    runs = simulate_plans(truth, _select_probe_plans(experiment))
    base = experiment.make_hidden_robot()
    base.motor_side = truth.motor_side
    return measure_strength(experiment.make_instruments(truth), base, runs)
