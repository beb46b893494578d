"""Values that a fit begins at tell what an effect would change."""

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from tests.support.problems import make_problem


@pytest.mark.parametrize("name", ["com_shift", "mount_shift", "payload"])
def test_some_initial_value_of_each_shift_changes_the_motion(arm, name):
    """A score test goes by the responses to initial values alone."""
    problem = make_problem(arm)
    none = problem.compute_residuals((), np.zeros((1, 0)))
    for term in find_effect(name).propose_terms(arm.robot):
        values = np.array(term.initial_values)
        changed = problem.compute_residuals((term,), values) - none
        assert np.abs(changed).max() > 0.1, term.label
