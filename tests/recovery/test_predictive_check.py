"""Whether what is believed explains a move that it was not fitted to."""

import numpy as np
import pytest

from selfheal.damage.kinds import Damage
from selfheal.recovery import predictive_check
from selfheal.recovery.explain import LAST_STEPS, HypothesisPosterior
from selfheal.recovery.predictive_check import FALSE_ALARM, is_refuted
from tests.support.short_recover import (
    BUILT,
    DEAF,
    FLAT,
    LOST,
    QUADRUPED,
    walk_damaged,
)

NEURON = Damage("neuron_dead", "neuron:2")


def _believe(*hypotheses):
    sure = np.full(len(hypotheses), 1 / len(hypotheses))
    return HypothesisPosterior(hypotheses, sure, FLAT)


@pytest.mark.parametrize(
    ("believed", "refuted"),
    [
        (_believe((NEURON,)), False),
        (_believe((), (LOST,), (NEURON,)), False),  # one of them is right
        (_believe((), (LOST,), (DEAF,)), True),
    ],
)
def test_a_belief_is_refuted_where_no_hypothesis_of_it_is_right(
    believed, refuted, walker
):
    move, rng = walk_damaged((NEURON,), walker), np.random.default_rng(0)
    assert is_refuted(QUADRUPED, BUILT, believed, [move], rng) is refuted


def test_a_robot_as_the_belief_has_it_seldom_refutes_it(walker, monkeypatch):
    monkeypatch.setattr(predictive_check, "COMPARED_STEPS", 40)
    monkeypatch.setattr(predictive_check, "DAMAGE_COST", 0.0)  # the twins decide
    rng, tries = np.random.default_rng(1), 20
    alarms = 0
    for _ in range(tries):
        near = 0.4 + LAST_STEPS["weak_motor"] * rng.uniform(-1, 1)
        weak = [Damage("weak_motor", "actuator:right_front_hip_servo", value)
                for value in (0.4, near)]  # fmt: skip
        move = walk_damaged((weak[1],), walker)
        alarms += is_refuted(QUADRUPED, BUILT, _believe((weak[0],)), [move], rng)
    # one is expected; more than three have a chance of 1.6 %
    assert alarms <= 3 * FALSE_ALARM * tries
