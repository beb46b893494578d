"""Initial states are estimated anew where the present ones mislead a fit."""

import numpy as np

from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.marginalization import marginalize_initial_states
from selfheal.diagnosis.estimation.reweighting import reestimate_misleading_states
from tests.support.problems import make_misread_problem, make_problem


def test_an_initial_state_that_misleads_a_fit_is_estimated_again(sticky):
    b, term, values = sticky
    speeds = np.zeros((len(make_problem(b).segments), 2))
    speeds[::4, 0], speeds[2::4, 0] = -2, 2
    problem = make_misread_problem(b, term, values, speeds)
    begin = np.array([0.3, 0.6, 0.05])
    marginalized = marginalize_initial_states(problem, (term,), begin)
    bad = fit_parameters(marginalized, (term,), begin)
    good = reestimate_misleading_states(bad)
    assert good.cost < 0.97 * bad.cost
    apart = [np.linalg.norm((f.values - values) / values) for f in (bad, good)]
    assert apart[1] < 0.5 * apart[0]
    # where no segment misleads, nothing changes
    assert reestimate_misleading_states(good) is good
