"""Damped least squares within bounds: its steps, and planted values found again."""

from itertools import pairwise

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.covariance import standard_errors
from selfheal.diagnosis.estimation.jacobian import compute_jacobian
from selfheal.diagnosis.estimation.least_squares import fit_by_updates, fit_parameters
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.estimation.quadratic_model import (
    solve_bounded_step,
    stack_bounds,
)
from tests.support.problems import (
    NOISE,
    STEPS,
    LoggedProblem,
    as_type,
    list_nominal_terms,
    make_problem,
    with_contact,
)
from tests.support.recorded_robots import bench


def _quadratic(rng, size=5):
    a = rng.normal(size=(6 * size, size)) * np.exp(rng.normal(size=size))
    many = 1e6  # residuals weigh far more than that what they do not show stays
    return many * a.T @ a, many * a.T @ rng.normal(size=6 * size)


@pytest.mark.parametrize("seed", range(5))
def test_a_step_inside_its_bounds_is_the_unconstrained_one(seed):
    rng = np.random.default_rng(seed)
    h, g = _quadratic(rng)
    free = -np.linalg.solve(h, g)
    wide = 2 * np.abs(free).max() * np.ones(5)
    scale = np.exp(rng.normal(size=5))
    np.testing.assert_allclose(
        solve_bounded_step(h, g, -wide, wide, scale), free, rtol=1e-4, atol=1e-6
    )


@pytest.mark.parametrize("size", [5, 100])
@pytest.mark.parametrize("seed", range(5))
def test_a_step_stays_in_its_bounds_and_no_point_there_is_lower(size, seed):
    """By the conditions of Karush, Kuhn and Tucker."""
    rng = np.random.default_rng(seed)
    h, g = _quadratic(rng, size)
    free = np.abs(np.linalg.solve(h, g))
    low, high = -0.5 * free, 0.3 * free * rng.integers(2, size=size)
    move = solve_bounded_step(h, g, low, high, np.ones(size))
    assert (low <= move).all() and (move <= high).all()
    slope, near = (h @ move + g) / np.sqrt(np.diag(h)), 1e-6 * free
    assert (slope[move > low + near] < 0.1).all()  # of thousands at rest
    assert (slope[move < high - near] > -0.1).all()


def test_damping_shortens_a_step():
    h, g = _quadratic(np.random.default_rng(0))
    wide = np.full(5, 1e6)
    steps = [
        solve_bounded_step(h, g, -wide, wide, np.ones(5), d) for d in (1e-4, 1.0, 100.0)
    ]
    assert np.all(np.diff([np.linalg.norm(s) for s in steps]) < 0)


def test_what_no_residual_shows_stays():
    h, g = np.zeros((2, 2)), np.zeros(2)
    h[0, 0], g[0] = 1e4, -1e4
    h[1, 1], g[1] = 1e-8, -1e-8
    wide = np.full(2, 1e6)
    np.testing.assert_allclose(
        solve_bounded_step(h, g, -wide, wide, np.ones(2)), [1, 0], atol=1e-4
    )


def test_nothing_to_fit_is_no_step():
    none = np.zeros(0)
    assert solve_bounded_step(np.zeros((0, 0)), none, none, none, none).size == 0


def test_the_jacobian_predicts_small_changes(arm):
    problem, terms = make_problem(arm), list_nominal_terms(arm)
    x = np.ones(len(terms))
    r = problem.compute_residuals(terms, x[None])[0]
    jac = compute_jacobian(problem, terms, x, r)
    rng = np.random.default_rng(0)
    move = 1e-3 * rng.normal(size=len(x))
    change = problem.compute_residuals(terms, (x + move)[None])[0] - r
    assert np.linalg.norm(change - jac @ move) < 0.05 * np.linalg.norm(change)


def test_differences_are_as_small_as_the_residuals_ask(arm):
    """Over a whole step readings would bend."""
    (rotor, _) = find_effect("armature").propose_terms(arm.robot)
    truth = np.array([200 * rotor.scale[0]])
    problem = make_problem(arm, (rotor,), truth, noise=1e-9)
    x = 1.0001 * truth
    r = problem.residuals_at((rotor,), x)
    fine = compute_jacobian(problem, (rotor,), x, r, difference_step=1e-4)
    found = compute_jacobian(problem, (rotor,), x, r)
    wide = compute_jacobian(problem, (rotor,), x, r, difference_step=0.5)
    error, most = (np.linalg.norm(j - fine) for j in (found, wide))
    assert error < 0.1 * most and error < 0.01 * np.linalg.norm(fine)


@pytest.mark.parametrize("name", ["arm", "pendulum"])
def test_planted_nominal_values_are_recovered(name, request):
    """Predictions fit, and so does each value that the data determine."""
    b = request.getfixturevalue(name)
    terms = list_nominal_terms(b)
    rng = np.random.default_rng(1)
    truth = 1 + 0.5 * rng.uniform(-1, 1, len(terms)) * (stack_bounds(terms)[1] - 1)
    problem = make_problem(b, terms, truth)
    found = fit_parameters(problem, terms, np.ones(len(terms)))
    assert found.cost < 1.05 * np.isfinite(problem.segments.readings).sum()
    low, high, _ = stack_bounds(terms)
    assert (low <= found.values).all() and (found.values <= high).all()
    error = standard_errors(found)
    before = (high - low) / 4  # anything was read
    pinned = error < 0.25 * before
    apart = np.abs(found.values - truth)
    assert (apart[pinned] < 4 * error[pinned] + 0.01).all()
    # a lone joint's inertia and torques are known up to a factor only
    assert pinned.any() == (name == "arm")


def test_a_fit_never_ends_worse_than_it_began(arm):
    terms = list_nominal_terms(arm)
    problem = make_problem(
        arm, (find_effect("coulomb_friction").propose_terms(arm.robot)[0],), (0.3,)
    )
    begin = problem.compute_residuals(terms, np.ones((1, len(terms))))[0]
    assert fit_parameters(problem, terms, np.ones(len(terms))).cost <= begin @ begin


def test_a_wrong_jacobian_to_begin_with_changes_nothing_in_the_end(arm):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    problem = make_problem(arm, (dry,), (0.1,))
    plain = fit_parameters(problem, (dry,), (0.3,), iterations=20)
    rng = np.random.default_rng(0)
    for known in (plain.jacobian, rng.normal(size=plain.jacobian.shape)):
        found = fit_parameters(problem, (dry,), (0.3,), iterations=20, jacobian=known)
        assert found.cost == pytest.approx(plain.cost, rel=1e-3)


def test_a_jacobian_that_is_only_updated_costs_no_differences(arm):
    terms = tuple(find_effect("viscous_friction").propose_terms(arm.robot))
    truth, start = np.array([0.1, 0.1]), np.array([0.08, 0.12])
    problem = as_type(make_problem(arm, terms, truth), LoggedProblem)
    before = problem.residuals_at(terms, start)
    jacobian = compute_jacobian(problem, terms, start, before)
    problem.batches.clear()
    found = fit_by_updates(problem, terms, start, 8, jacobian)
    # a damped step is one simulation, or the three of the other dampings
    assert all(len(points) in (1, 3) for points in problem.batches)
    best = fit_parameters(problem, terms, start)
    assert best.cost == pytest.approx(found.cost, rel=1e-3)


def test_in_contact_jacobian_columns_of_nominal_values_are_kept(tmp_path):
    b = bench("box", tmp_path, episodes=4, seconds=0.6)
    stated, (slip, *_) = (
        list_nominal_terms(b),
        find_effect("ground_friction").propose_terms(b.robot),
    )
    terms, truth = (*stated, slip), np.append(np.ones(len(stated)), 0.3)
    problem = as_type(with_contact(make_problem(b, terms, truth)), LoggedProblem)
    rng = np.random.default_rng(4)
    start = truth + 0.01 * rng.normal(size=len(truth))
    before = problem.residuals_at(terms, start)
    found = fit_parameters(problem, terms, start)
    assert found.cost < 2 * len(before) < 0.5 * (before @ before)
    batches = problem.batches[1:]  # after that of `before`
    whole = [k for k, points in enumerate(batches) if len(points) == len(truth)]
    # a batch that moves nothing but the friction from where the last one was
    alone = [
        len(two) == 1 and (one[:, :-1] == two[0, :-1]).all(axis=1).any()
        for one, two in pairwise(batches)
    ]
    assert whole[0] == 1 and any(alone)


@pytest.mark.parametrize("soft", [0.004, 0.03])
def test_a_stop_is_found_where_it_is_however_soft(soft, tmp_path):
    def stopped(model):
        joint = model.joint("elbow").id
        model.jnt_range[joint], model.jnt_limited[joint] = (-3, 0.1), 1
        model.jnt_solref[joint] = soft, 1

    b = bench("arm", tmp_path, change=stopped, noise=3e-4, seed=2)
    stop = find_effect("hard_stop").propose_terms(b.robot)[3]  # of the elbow, above
    segments = cut_segments(b.simulator.episodes, STEPS)
    problem = Problem(b.simulator, segments, np.full(segments.readings.shape[1], NOISE))
    found = fit_parameters(problem, (stop,), np.array(stop.initial_values[0]))
    assert found.values == pytest.approx([0.1, soft], rel=0.15)
    assert found.values[0] == pytest.approx(0.1, abs=2e-3)
