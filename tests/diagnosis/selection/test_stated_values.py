"""A patch changes of the stated values what the data contradict, to their digits."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.covariance import standard_errors
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.linearized_fit import LinearizedFit
from selfheal.diagnosis.selection.hypotheses import Hypothesis
from selfheal.diagnosis.selection.refine import refit_native_timestep
from selfheal.diagnosis.selection.settings import SELECTION
from selfheal.diagnosis.selection.stated_values import (
    hold_stated,
    release_bounds,
    restore_stated,
    round_effects,
)
from tests.support.problems import list_nominal_terms, make_problem, name_effect

FRICTION = 0.0871


@pytest.fixture(scope="module")
def terms(arm):
    """What the model states, and dry friction at a joint."""
    friction = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    return *list_nominal_terms(arm), friction


def _fit(arm, terms, factors):
    """The fit to a robot of these values, and its standard errors."""
    problem = make_problem(arm, terms, [*factors, FRICTION])
    start = np.array([*np.ones(len(factors)), 0.05])
    fit = fit_parameters(problem, terms, start, iterations=8)
    return LinearizedFit.from_fit(fit), standard_errors(fit)


@pytest.fixture(scope="module")
def right(arm, terms):
    """The fit to a robot that is as its model states."""
    return _fit(arm, terms, np.ones(len(terms) - 1))


@pytest.fixture(scope="module")
def wrong(arm, terms):
    """The fit to a robot whose elbow is damped 1.2 times as much, and where that is."""
    (at,) = (i for i, t in enumerate(terms) if t.targets[0] == "joint:elbow/damping")
    factors = np.ones(len(terms) - 1)
    factors[at] = 1.2
    return *_fit(arm, terms, factors), at


def test_what_the_model_states_rightly_stays(right):
    base, errors = right
    values = restore_stated(base, errors).fit.values
    assert (values[:-1] == 1).mean() > 0.8 > (base.fit.values[:-1] == 1).mean()
    assert values[-1] == base.fit.values[-1]


def test_what_is_stated_wrongly_changes_and_the_fit_hardly_suffers(wrong):
    base, errors, at = wrong
    restored = restore_stated(base, errors).fit
    assert restored.values[at] == pytest.approx(1.2, abs=0.1)
    assert (restored.values[:-1] == 1).sum() > len(errors) / 2
    costs = [f.cost + f.prior_penalty for f in (base.fit, restored)]
    assert costs[1] < costs[0] * 1.02


def test_a_value_at_a_bound_returns(terms, wrong):
    base, _, at = wrong
    (p,) = terms[at].parameters
    bounded = replace(terms[at], parameters=(replace(p, high=1.1),))
    own = (*terms[:at], bounded, *terms[at + 1 :])
    start = np.minimum(base.fit.values, [t.high[0] for t in own])
    fit = fit_parameters(base.problem, own, start, iterations=4)
    assert fit.values[at] > 1.09
    assert release_bounds(fit).values[at] == 1
    assert release_bounds(base.fit) is base.fit


def test_without_any_name_the_model_is_as_given_again(terms, right):
    fit = fit_parameters(right[0].problem, terms[:-1], np.ones(len(terms) - 1))
    given = hold_stated(Hypothesis(fit, fit, (), ()))
    assert (given.final.values == 1).all()
    native = refit_native_timestep(LinearizedFit.from_fit(given.final))
    assert (native.fit.values == 1).all()


def test_a_changed_value_has_the_digits_of_its_interval(terms, wrong):
    base, errors, at = wrong
    restored = restore_stated(base, errors).fit.values
    assert restored[at] != 1
    each = zip(terms[:-1], restored[:-1], errors[:-1], strict=True)
    for term, value, error in (x for x in each if x[1] != 1):
        given = term.effect.value
        text = f"{value * given:.12g}"
        assert float(text) == pytest.approx(value * given, rel=1e-11)
        last_digit = 10.0 ** -len(text.partition(".")[2])
        assert last_digit > error * given * SELECTION.max_rounding_step / 1e3


def test_an_effect_has_the_digits_of_its_interval(terms, right):
    base, errors = right
    naming = Hypothesis(base.fit, base.fit, (name_effect(terms[-1]),), ())
    rounded = round_effects(naming).final
    assert rounded.values[:-1] == pytest.approx(base.fit.values[:-1], abs=0)
    assert abs(rounded.values[-1] - base.fit.values[-1]) < errors[-1] / 3
    assert len(f"{rounded.values[-1]:.12g}") < len(f"{base.fit.values[-1]:.12g}")


def test_a_shift_along_the_axis_changes_nothing_and_is_none(pendulum):
    (shift, *_) = find_effect("com_shift").propose_terms(pendulum.robot)
    truth = (0.01, 0.0, 0.0)  # the axis is y
    problem = make_problem(pendulum, (shift,), truth)
    fit = fit_parameters(problem, (shift,), np.array([0.008, 0.05, 0.0]), iterations=4)
    naming = Hypothesis(fit, fit, (name_effect(shift),), ())
    x, y, _ = round_effects(naming).final.values
    assert y == 0 and x == pytest.approx(truth[0], rel=0.1)


def test_findings_alone_leave_what_the_model_states(terms, right):
    base, errors = right
    nominal = fit_parameters(base.problem, terms[:-1], np.ones(len(terms) - 1))
    naming = Hypothesis(nominal, base.fit, (name_effect(terms[-1]),), ())
    held = hold_stated(naming)
    for fit in (held.nominal, held.final):
        assert (fit.values[: len(terms) - 1] == 1).all()
    assert held.final.values[-1] == pytest.approx(FRICTION, abs=4 * errors[-1])
    assert held.named == naming.named
    again = hold_stated(held)
    assert again.final.values == pytest.approx(held.final.values, rel=1e-3)
