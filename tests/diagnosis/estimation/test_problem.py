"""Residuals of a problem: readings left out, error of the time step, blocks."""

from dataclasses import replace

import numpy as np

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.jacobian import compute_jacobian
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.marginalization import marginalize_initial_states
from selfheal.diagnosis.estimation.noise import expected_cost
from selfheal.diagnosis.estimation.problem import assign_blocks
from tests.support.problems import STEPS, make_problem


def test_residuals_do_not_count_what_was_not_read(arm):
    problem = make_problem(arm)
    readings = problem.segments.readings.copy()
    readings[::3] = np.nan
    lost = replace(problem, segments=replace(problem.segments, readings=readings))
    r = lost.compute_residuals((), np.zeros((1, 0))).reshape(readings.shape)
    assert (r[::3] == 0).all() and np.abs(r[1::3]).max() > 0


def test_the_steps_own_error_shrinks_with_the_step(arm):
    problem = make_problem(arm)
    nothing = (), np.zeros(0)
    coarse, finer = (
        fit_parameters(p, *nothing) for p in (problem, problem.with_half_step)
    )
    whole = np.linalg.norm(coarse.timestep_error())
    assert 0 < np.linalg.norm(finer.timestep_error()) < 0.7 * whole
    assert expected_cost(coarse) > whole**2


def test_a_jacobian_is_transferred_to_other_weights(arm):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    plain = make_problem(arm, (dry,), (0.1,))
    white = marginalize_initial_states(plain, (dry,), np.array([0.1]))
    rng = np.random.default_rng(0)
    sigma = plain.sigma * rng.uniform(0.5, 2, len(plain.sigma))
    other = marginalize_initial_states(
        replace(plain, sigma=sigma), (dry,), np.array([0.1])
    )
    at = np.array([0.15])
    here, there = (
        compute_jacobian(p, (dry,), at, p.residuals_at((dry,), at))
        for p in (white, other)
    )
    np.testing.assert_allclose(
        white.transfer_jacobian(other, here), there, rtol=1e-6, atol=1e-6
    )
    assert white.transfer_jacobian(other, here[:, :0]).shape == (len(here), 0)


def test_blocks_are_neighbors_and_cover_all(arm):
    blocks = assign_blocks(make_problem(arm))
    assert (np.diff(blocks) >= 0).all() and (np.diff(blocks) <= 1).all()
    assert blocks[0] == 0 and len(blocks) == len(
        cut_segments(arm.simulator.episodes, STEPS)
    )
