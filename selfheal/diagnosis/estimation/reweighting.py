"""Reweighting: takes a fit, gives its problem with weights and states that suit it.

Iteratively reweighted least squares: each column's residuals are divided by their own
root mean square, the fit is repeated, and so on. With weights per column that is
feasible generalized least squares (Greene 2012, section 9.2). Initial states are
marginalized again with the new weights.
"""

from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..simulation.simulator import Simulator
from .fit import Fit
from .least_squares import fit_parameters
from .linearized_fit import LinearizedFit
from .marginalization import marginalize_initial_states
from .noise import noise_ratio, residual_rms, update_noise_model
from .problem import Problem
from .settings import FIT


def downweight_unscored(fit: Fit) -> Floats:
    """(C) sigma [unit of each column], larger in unscored columns if much is left.

    A fit that leaves more than noise is a compromise between channels, and those that
    are not scored should hardly decide it.
    """
    problem = fit.problem
    if noise_ratio(fit) <= FIT.strictly_unexplained_ratio:
        return problem.sigma
    is_scored = repeat_by_column(problem.simulator.channels, "is_scored")
    return np.where(is_scored, problem.sigma, FIT.unscored_std_factor * problem.sigma)


def reweight_residuals(fit: Fit) -> Problem:
    """A fit's problem weighted by its residuals, with the noise that they show.

    A noise model changes how far initial states may move, and states that may not move
    far enough leave more than noise. So noise is estimated a second time, with the
    states of the first one.
    """
    problem, residuals = fit.problem, fit.residuals
    simulator = update_noise_model(problem, residuals)
    problem = _weight_by_residuals(problem, fit, residuals, simulator)
    if not problem.regime.estimates_noise:
        return problem
    residuals = problem.residuals_at(fit.terms, fit.values)
    simulator = update_noise_model(problem, residuals)
    if simulator is problem.simulator:
        return problem
    return _weight_by_residuals(problem, fit, residuals, simulator)


def _weight_by_residuals(
    problem: Problem, fit: Fit, residuals: Floats, simulator: Simulator
) -> Problem:
    """The problem with another noise model, weighted by residuals.

    Args:
        fit: with the values at which initial states are marginalized.
        residuals: (R) [standard deviations]; their root mean square is the new sigma,
            but no less than the noise.
        simulator: whose channels have the noise model.
    """
    noise = np.concatenate([c.noise for c in simulator.channels])
    least = np.where(np.isfinite(noise), noise, 0.0)
    sigma = np.maximum(residual_rms(problem, residuals), least)
    sigma = np.where(sigma > 0, sigma, problem.sigma)
    weighted = replace(problem, sigma=sigma, simulator=simulator)
    return marginalize_initial_states(weighted, fit.terms, fit.values)


def reestimate_misleading_states(fit: Fit) -> Fit:
    """The fit with initial states estimated again where one segment holds its values.

    Whether a robot sticks or slips at first may depend on an initial state that was
    searched with other values. These then stay where that segment alone would have
    them. So states are searched with the values that all other segments ask for (case
    deletion, Cook 1977).
    """
    for _ in range(fit.problem.regime.misleading_state_trials):
        problem, base = fit.problem, LinearizedFit.from_fit(fit)
        deletions = [
            base.drop_residuals(problem.segment_of_residual == w)
            for w in range(len(problem.segments))
        ]
        gain, step = max(deletions, key=lambda deletion: deletion[0])
        if gain < FIT.misleading_cost_share * fit.cost:
            break
        values = fit.values + step
        new_fit = fit_parameters(
            marginalize_initial_states(problem, fit.terms, values),
            fit.terms,
            values,
            iterations=FIT.misleading_iterations,
            jacobian=fit.jacobian,
        )
        if new_fit.cost > (1 - FIT.misleading_cost_share) * fit.cost:
            break
        fit = new_fit
    return fit
