"""A last fit: takes a naming, gives the same names with the values that suit them."""

from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..estimation.candidate_fit import LinearizedFit
from ..estimation.least_squares import Fit, fit_parameters, refine_undamped
from ..estimation.marginalization import (
    is_horizon_informative,
    marginalize_initial_states,
)
from ..estimation.noise import ABOVE, noise_ratio
from ..estimation.nonsmooth import fit_smoothed, search_along_valleys, search_multiples
from ..estimation.problem import Problem
from ..estimation.reweighting import downweight_unscored, reestimate_misleading_states
from ..simulation.dataset import LONG, WINDOW, Dataset, cut_readable_segments
from ..simulation.model_variants import split_values
from .backward import exchange_term, is_simpler
from .cross_validation import ScoredFit
from .hypotheses import Hypothesis
from .screening import STEPS, subsample_problem

# steps of simulation in the last fit, about, and in all differences of it; chosen: a
# minute at 1 ms, and no more for a robot of which much is stated
POLISHED, SLOPES = 40000, 1e6


def refine_hypothesis(dataset: Dataset, hypothesis: Hypothesis) -> Hypothesis:
    """The same names, fitted to more pieces, to longer ones if those can be told."""
    found = hypothesis.final.fit
    sigma = downweight_unscored(hypothesis.problem, found)
    rng = np.random.default_rng(2)
    steps = int(np.clip(SLOPES / max(len(found.values), 1), STEPS[-1], POLISHED))
    short, long = (
        subsample_problem(
            Problem(
                dataset.training,
                cut_readable_segments(dataset.training, seconds),
                sigma,
            ),
            steps,
            rng,
        )
        for seconds in (WINDOW, LONG)
    )
    problem = (
        long
        if is_horizon_informative(long, short, found.terms, found.values)
        else short
    )
    return _refit(
        marginalize_initial_states(problem, found.terms, found.values), hypothesis
    )


def _refit(problem: Problem, hypothesis: Hypothesis) -> Hypothesis:
    """The same names in other windows."""
    found, nominal_terms = hypothesis.final.fit, hypothesis.nominal.fit
    alone = fit_parameters(problem, nominal_terms.terms, nominal_terms.values, rounds=6)
    final = alone
    if hypothesis.named:
        start = search_multiples(problem, found.terms, found.values)
        final = fit_parameters(problem, found.terms, start, rounds=6)
        if problem.regime.is_nonsmooth:  # the cost has many minima
            final = replace(final, values=search_along_valleys(problem, final))
            problem, final = fit_smoothed(problem, final)
        elif not problem.regime.has_rough_cost:
            problem, final = reestimate_misleading_states(problem, final)
    # where something touches, or is left, the cost is too rough for it
    if (
        not problem.regime.has_rough_cost
        and noise_ratio(problem, final.residuals) <= ABOVE
    ):
        final = refine_undamped(problem, final)
    whole = ScoredFit.from_fit(problem, final)
    less = ScoredFit.from_fit(problem, alone) if hypothesis.named else whole
    return replace(hypothesis, problem=problem, nominal=less, final=whole)


def prefer_simpler_names(hypothesis: Hypothesis) -> Hypothesis:
    """The same; what cannot be told from a name has its place if it is plainer.

    In more pieces than those that named it a number may turn out to do nothing, as the
    speed at which a motor's torque ends.
    """
    problem = hypothesis.problem
    for name in hypothesis.named:
        plainer = [t for t in name.equivalent if is_simpler(t, name.term)]
        final = exchange_term(problem, hypothesis.final, name.term, plainer)
        if final is hypothesis.final:
            continue
        rest = tuple(t for t in name.equivalent if t.key != final.candidate.key)
        new = replace(name, term=final.candidate, equivalent=(name.term, *rest))
        named = tuple(new if n is name else n for n in hypothesis.named)
        hypothesis = replace(hypothesis, final=final, named=named)
    return hypothesis


def refit_native_timestep(base: LinearizedFit) -> Fit:
    """The same effects, with stated values that suit the model's own time step.

    What a user sees who replays the model: half a step early, and damped otherwise
    than in continuous time. A fit in continuous time gives the effects' truth.
    """
    problem, found = base.problem, base.fit
    plain = replace(problem.unmarginalized, centered=False)
    plain = marginalize_initial_states(plain, found.terms, found.values)
    near = problem.transfer_jacobian(plain, found.jacobian)
    fixed = [
        t if t.effect.name == "stated" else _fix_values(t, v)
        for t, v in zip(
            found.terms, split_values(found.terms, found.values), strict=True
        )
    ]
    best = fit_parameters(plain, fixed, found.values, rounds=2, known=near)
    return replace(best, terms=found.terms)


def _fix_values(term: Term, values: Floats) -> Term:
    """The term with no other values than these."""
    parameters = tuple(
        replace(p, low=float(v), high=float(v))
        for p, v in zip(term.parameters, values, strict=True)
    )
    return replace(term, parameters=parameters)
