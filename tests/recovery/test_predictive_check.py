"""Whether what is believed explains a move that it was not fitted to."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.damage.kinds import KINDS, Damage
from selfheal.recovery import predictive_check
from selfheal.recovery.explain import LAST_STEP, HypothesisPosterior
from selfheal.recovery.predictive_check import FALSE_ALARM, is_refuted
from tests.support.short_recover import (
    BUILT,
    DEAF,
    FLAT,
    LOST,
    QUADRUPED,
    walk_damaged,
)

WEAK = Damage("weak_motor", "actuator:right_front_hip_servo", 0.4)
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
    width = KINDS[WEAK.kind].recover_values.step * LAST_STEP
    alarms = 0
    for _ in range(tries):
        near = WEAK.value + width * rng.uniform(-1, 1)
        move = walk_damaged((replace(WEAK, value=near),), walker)
        alarms += is_refuted(QUADRUPED, BUILT, _believe((WEAK,)), [move], rng)
    # one is expected; more than three have a chance of 1.6 %
    assert alarms <= 3 * FALSE_ALARM * tries
