"""Damage as genomes, and how well it explains a trial."""

import numpy as np
import pytest

from selfheal.damage.kinds import Damage
from selfheal.recovery.estimate import Trial, decode_hypotheses, make_damage_score
from selfheal.robot.simulated_legs import SimulatedLegs
from tests.support.short_recover import LOST, QUADRUPED


def test_genomes_say_damage_as_the_overview_describes():
    off, on = -1.0, 1.0
    genome = np.array([[on, -1, -1, 0, on, 0, 1, 0, on, 1, -1, 0, off, 0, 0, 0]])
    (said,) = decode_hypotheses(genome, QUADRUPED)
    assert said == (
        Damage("joint_jam", "joint:right_back_knee"),
        Damage("limb_loss", "body:left_front_upper"),
        Damage("sensor_dead", "sensor:left_front_lower_touch"),
    )
    assert decode_hypotheses(np.full((1, 16), off), QUADRUPED) == [()]


def test_the_true_damage_explains_its_displacement(walker):
    robot = SimulatedLegs(QUADRUPED, 0).struck((LOST,))
    drives = robot.run_trials(walker[None])
    trial = Trial(walker, float(drives.displacement[0]), drives.sensors[0])
    genome = np.full((2, 16), -1.0)
    genome[0, :3] = [1, -1, -1]
    right, wrong = make_damage_score(QUADRUPED, [trial])(genome)
    assert right == pytest.approx(0) and wrong < -0.01
