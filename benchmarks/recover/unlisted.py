"""Changes that are in no list of damages: a name in, a robot that has it out."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from typing import Any
from unittest import mock

import mujoco
import numpy as np

from selfheal.body.legged import LeggedRobot
from selfheal.damage.kinds import Damage
from selfheal.engine.reflex import Rollouts
from selfheal.mujoco_files import silence_mujoco
from selfheal.recovery import explain
from selfheal.robot.scenarios import draw_scenario
from selfheal.robot.simulated_legs import SimulatedLegs

CHANGES = {
    "zero": "the zero of a joint is off by 0.3 rad",
    "longer": "a lower leg is longer by 20 %",
    "sticky": "dry friction of half its motor's torque in a joint",
    "withheld": "a hidden neuron is dead, which the list of damages leaves out here",
}


@dataclass(frozen=True)
class ChangedLegs:
    """A robot that is whole until it is struck, by what no damage says."""

    whole: SimulatedLegs
    changed: SimulatedLegs

    @property
    def legged(self) -> LeggedRobot:
        """Its body as it was built."""
        return self.whole.legged

    def run_trials(self, weights: np.ndarray) -> Rollouts:
        """Run under controllers (N, synapses)."""
        return self.whole.run_trials(weights)

    def struck(self, damage: tuple[Damage, ...]) -> SimulatedLegs:
        """This robot after the change; it has no other damage."""
        return self.changed


def change_robot(what: str, robot: LeggedRobot, seed: int) -> tuple[ChangedLegs, str]:
    """A robot that will be changed, and where."""
    rng = np.random.default_rng([seed, list(CHANGES).index(what), 43])
    whole = SimulatedLegs(robot, seed)
    if what == "withheld":
        damage = draw_scenario(10, robot, seed)
        return ChangedLegs(whole, whole.struck(damage)), damage[0].target
    if what == "longer":
        place = str(rng.choice([p for p in robot.parts if p.endswith("_lower")]))
    else:
        place = robot.joint_of_motor(int(rng.integers(len(robot.motors)))).name
    change = {"zero": _move_zero, "longer": _lengthen, "sticky": _make_sticky}[what]
    model = _edit_model(robot, partial(change, place=place))
    return ChangedLegs(whole, SimulatedLegs(replace(robot, model=model), seed)), place


def withhold_neurons() -> AbstractContextManager[Any]:
    """Within it a dead hidden neuron is in no list of damages."""
    listed = explain.list_single_damages

    def withheld(robot: LeggedRobot) -> list[Damage]:
        return [d for d in listed(robot) if d.kind != "neuron_dead"]

    return mock.patch.object(explain, "list_single_damages", withheld)


def _edit_model(robot: LeggedRobot, change: Callable[[Any], None]) -> Any:
    """The robot's model, compiled anew after a change of its specification."""
    import mujoco

    silence_mujoco()
    text = (files("selfheal.models") / robot.name / f"{robot.name}.xml").read_text()
    spec = mujoco.MjSpec.from_string(text)
    change(spec)
    model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


def _move_zero(spec: mujoco.MjSpec, place: str) -> None:
    """Let a joint read 0.3 rad where it stands at its default angle."""
    spec.joint(place).ref = np.degrees(0.3)


def _lengthen(spec: mujoco.MjSpec, place: str) -> None:
    """Lengthen a lower leg, with the sensor about it, by 20 %; it weighs the same."""
    for each in (spec.geom(place), spec.site(place)):
        each.fromto[:] = 1.2 * each.fromto


def _make_sticky(spec: mujoco.MjSpec, place: str) -> None:
    """Give a joint dry friction of half its motor's torque."""
    (motor,) = (a for a in spec.actuators if a.target == place)
    spec.joint(place).frictionloss = 0.5 * motor.forcerange[1]
