"""A simpler name is preferred where it predicts as much."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.selection.cross_validation import ScoredFit
from selfheal.diagnosis.selection.hypotheses import Hypothesis
from selfheal.diagnosis.selection.refine import choose_equivalents
from tests.support.problems import make_problem, name_effect


def test_a_parameter_without_effect_gives_way_to_the_simpler_name(arm):
    limit, falling = (
        find_effect(name).propose_terms(arm.robot)[1]
        for name in ("torque_saturation", "speed_torque_limit")
    )
    most = 0.5 * arm.robot.actuators[1].max_force
    problem = make_problem(arm, (limit,), (most,))
    at = np.array([most, falling.high[1]])  # at no speed that it reaches
    found = ScoredFit.from_fit(fit_parameters(problem, (falling,), at, iterations=0))
    alone = ScoredFit.from_fit(fit_parameters(problem, (), np.zeros(0)))
    name = name_effect(falling)
    naming = Hypothesis(alone, found, (name,), ())
    assert choose_equivalents(naming) is naming
    rivaled = replace(naming, named=(replace(name, equivalent=(limit,)),))
    plain = choose_equivalents(rivaled)
    (new,) = plain.named
    assert (new.term.key, new.equivalent) == (limit.key, (falling,))
    assert plain.final.fit.terms == (new.term,)
    assert plain.final.fit.values == pytest.approx([most], rel=0.05)
