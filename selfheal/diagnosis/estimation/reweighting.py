"""Weights of residuals and initial states, found anew where a fit shows them wrong."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..effects.base import Term
from ..simulation.simulator import Simulator
from .candidate_fit import LinearizedFit
from .least_squares import Fit, fit_parameters
from .marginalization import marginalize_initial_states
from .noise import LEFT, noise_ratio, residual_rms, update_noise_model
from .problem import Problem

UNSCORED = 4.0  # times as far off may be what is not scored; chosen
TAILS = 4.0  # degrees of freedom of single readings' errors (Lange et al. 1989)
# of `reseated`: share of the cost that all other windows would save without one, above
# which its start may be wrong, and of the cost, what starts sought anew have to save;
# and how many such windows are looked at; chosen
HARMS, SEATS = 0.01, 2


def downweight_unscored(problem: Problem, found: Fit) -> Floats:
    """Sigma (C), larger where something stays unexplained for what is not scored.

    A fit is a compromise there.
    """
    if noise_ratio(problem, found.residuals) <= LEFT:
        return problem.sigma
    scored = repeat_by_column(problem.simulator.channels, "is_scored")
    return np.where(scored, problem.sigma, UNSCORED * problem.sigma)


def reweight_residuals(problem: Problem, found: Fit) -> Problem:
    """Each column's residuals measured by how large they are now.

    What is heard of the noise changes how far starts are believed, and starts that are
    believed too much leave what is no noise: so it is heard once more.
    """
    residuals = found.residuals
    problem = _weight_by_residuals(
        problem, found, residuals, update_noise_model(problem, residuals)
    )
    if problem.regime.has_single_readings:
        return problem
    residuals = problem.residuals_at(found.terms, found.values)
    simulator = update_noise_model(problem, residuals)
    if simulator is problem.simulator:
        return problem
    return _weight_by_residuals(problem, found, residuals, simulator)


def _weight_by_residuals(
    problem: Problem, found: Fit, residuals: Floats, simulator: Simulator
) -> Problem:
    """The problem in a world that knows its noise, weighed by residuals (R)."""
    noise = np.concatenate([c.noise for c in simulator.channels])
    least = np.where(np.isfinite(noise), noise, 0.0)
    sigma = np.maximum(residual_rms(problem, residuals), least)
    sigma = np.where(sigma > 0, sigma, problem.sigma)
    new = replace(problem, sigma=sigma, simulator=simulator)
    return marginalize_initial_states(new, found.terms, found.values)


def reestimate_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Problem:
    """The problem with starts sought with these values, if any had to be sought.

    A start that was sought without a friction is where a robot without it would have
    begun; a chaotic one then leaves no way to what is true. Where something touches,
    that takes too long.
    """
    if (
        problem.initial_state_shift is None
        or problem.regime.is_nonsmooth
        or problem.regime.has_single_readings
    ):
        return problem
    return marginalize_initial_states(problem, terms, values)


def reestimate_misleading_states(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """The fit with starts sought anew where a window holds its values off.

    Whether a robot sticks or slips at first may hang on a start that was sought with
    other values; those then stay where that window alone would have them. So starts are
    sought with the values that all others ask for.
    """
    for _ in range(0 if problem.regime.has_single_readings else SEATS):
        base, segments = (
            LinearizedFit.from_fit(problem, found),
            range(len(problem.segments)),
        )
        each = [base.drop_residuals(problem.segment_of_residual == w) for w in segments]
        saved, move = max(each, key=lambda x: x[0])
        if saved < HARMS * found.cost:
            break
        values = found.values + move
        new = marginalize_initial_states(problem, found.terms, values)
        tried = fit_parameters(new, found.terms, values, rounds=3, known=found.jacobian)
        if tried.cost > (1 - HARMS) * found.cost:
            break
        problem, found = new, tried
    return problem, found
