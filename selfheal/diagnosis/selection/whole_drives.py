"""What whole drives lack: takes the state of a search, gives it with usual effects.

A real drive lacks several effects at every joint at once. They are fitted together,
first as if all drives were equal, then those of each joint, and removed backward, in
segments as long as the robot can be predicted.
"""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import share_values, spread_values, start_beside
from ..estimation.fit import Fit
from ..estimation.jacobian import compute_jacobian
from ..estimation.least_squares import fit_parameters
from ..estimation.problem import Problem
from .backward import eliminate_backward, find_negligible
from .cross_validation import ScoredFit
from .lengthening import fit_longer
from .search_record import SearchRecord
from .search_state import SearchState, reweight_and_fit, reweight_repeatedly
from .settings import SELECTION
from .stepwise import keep_significant, remove_and_exchange


def search_backward(
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> SearchState | None:
    """Fit all usual effects at once, and remove those that the data do not ask for.

    A real drive lacks several of them at every joint. What is named first alone stands
    for several. Slow effects show in longer segments, which are used as far as their
    initial states are known well enough.

    Args:
        state: in which nothing has a name.
        longer: the problem in longer and longer segments.
        rng: draws resamples.
        record: of what was tried and found.

    Returns:
        The state at the end; None where no effect is usual.
    """
    usual = _list_usual(state)
    if not usual:
        return None
    record(f"fitting {len(usual)} usual effects at once", 0.0)
    equal = _fit_equal_drives(state.problem, usual)
    richer = _enrich_equal_drives(equal, state.candidates)
    record.add_tried(usual)
    fit = _free_each_joint(state, richer, 1)
    del equal, richer  # bases of their initial states are as large as Jacobians
    record.keep(state.with_fit(ScoredFit.from_fit(fit)))
    fit = fit_parameters(
        fit.problem, fit.terms, fit.values, iterations=4, jacobian=fit.jacobian
    )
    fit = reweight_repeatedly(fit, 6)
    record.keep(state.with_fit(ScoredFit.from_fit(fit)))
    fit = fit_longer(fit, longer)
    fit = _exchange_forms(fit, state.candidates)
    tried = fit.terms[state.nominal_count :]
    fit = eliminate_backward(fit, state.nominal_count)
    # each multiple of each value is a simulation, and here values are many
    state = state.with_fit(reweight_and_fit(fit, 4, tries_multiples=False))
    record.keep(state)
    state, _ = remove_and_exchange(state)
    state = keep_significant(state, tried, rng)
    record.keep(state)
    return state


def _list_usual(state: SearchState) -> list[Term]:
    """The candidates that most robots have."""
    return [t for t in state.candidates if t.effect.is_usual(t)]


def _fit_equal_drives(problem: Problem, usual: Sequence[Term]) -> Fit:
    """A fit of effects whose values all joints share, to the problem weighted anew.

    They are a few numbers, which are found from far away. What the model states is as
    given.

    Args:
        problem: to be fitted.
        usual: terms at single places, each with initial values.
    """
    shared = share_values(usual)
    fit = fit_parameters(problem, shared, _search_initial_values(problem, shared))
    return reweight_repeatedly(fit, 6)


def _search_initial_values(problem: Problem, terms: Sequence[Term]) -> Floats:
    """The best initial values (P) of terms, or nominal ones, one term after the other.

    Args:
        problem: whose residuals are compared.
        terms: each with initial values.
    """
    chosen = [np.array([p.nominal for p in t.parameters]) for t in terms]
    for _ in range(SELECTION.sweeps_of_initial_values):
        for i, term in enumerate(terms):
            choices = [
                [*chosen[:i], np.array(x), *chosen[i + 1 :]]
                for x in dict.fromkeys([tuple(chosen[i]), *term.initial_values])
            ]
            points = np.array([np.concatenate(c) for c in choices])
            chosen = choices[_find_best(problem, terms, points)]
    return np.concatenate(chosen)


def _find_best(problem: Problem, terms: Sequence[Term], points: Floats) -> int:
    """Which of the points (n, P) leaves the least."""
    residuals = problem.compute_residuals(terms, points)
    return int(np.argmin((residuals**2).sum(axis=1)))


def _enrich_equal_drives(fit: Fit, candidates: Sequence[Term]) -> Fit:
    """The fit with richer models of equal drives, one after the other, if they explain.

    Friction with a Stribeck curve and of both sides of the gear, and a lag, as in
    nested models of drives (Rhoban's BAM, M1 to M6).

    Args:
        fit: of equal drives with the usual effects.
        candidates: terms that may earn a name.
    """
    in_models = [t for t in candidates if t.effect.is_in_drive_model(t)]
    forms = share_values([t for t in in_models if len(t.targets) == 1])
    while forms:
        tried = [_fit_form(fit, form) for form in forms]
        best = int(np.argmin([f.cost for f in tried]))
        if tried[best].cost > SELECTION.exchange_error_ratio * fit.cost:
            break
        fit = tried[best]
        del forms[best]
    return fit


def _fit_form(fit: Fit, form: Term) -> Fit:
    """The fit with one more form of drives, in place of what this overrides.

    Args:
        fit: of equal drives.
        form: term at all of their joints.
    """
    form = start_beside(form, fit.terms, fit.values)
    overridden = set(form.effect.overrides)
    replaced = [
        t
        for t in fit.terms
        if overridden & set(t.effect.overrides) and set(t.targets) <= set(form.targets)
    ]
    kept, values = fit.without_terms(*replaced)
    terms = (*kept, form)
    starts = np.array([[*values, *x] for x in form.initial_values])
    start = starts[_find_best(fit.problem, terms, starts)]
    return _fit_beside(fit, replaced, terms, start)


def _fit_beside(
    fit: Fit,
    replaced: Sequence[Term],
    terms: Sequence[Term],
    start: Floats,
    limit: float = np.inf,
) -> Fit:
    """The fit of terms of which the first ones were fitted before.

    Args:
        fit: of these first terms, and of those that are replaced.
        replaced: terms of the fit.
        terms: P parameters in all.
        start: (P) values to begin with [units of the parameters].
        limit: penalized cost [1] above which a closer fit would change nothing: what
            leaves more with this Jacobian, only updated, is not fitted with another.
    """
    problem, known = fit.problem, fit.jacobian_without(*replaced)
    residuals = problem.residuals_at(terms, start)
    new = compute_jacobian(problem, terms, start, residuals, first=known.shape[1])
    jacobian = np.hstack([known, new])
    if limit < np.inf:
        rough = fit_parameters(
            problem, terms, start, iterations=3, jacobian=jacobian, only_updates=True
        )
        if rough.cost + rough.prior_penalty > limit:
            return rough
        start, jacobian = rough.values, rough.jacobian
    return fit_parameters(problem, terms, start, iterations=4, jacobian=jacobian)


def _free_each_joint(state: SearchState, equal: Fit, iterations: int) -> Fit:
    """The fit of what the model states and of each joint's own values.

    Args:
        state: in which nothing has a name.
        equal: fit of equal drives, where they begin, and whose problem is fitted.
        iterations: of the fit, at most.
    """
    own = spread_values(equal.values_by_term, state.candidates)
    terms = (*state.best.fit.terms, *own)
    start = np.concatenate([np.ones(state.nominal_count), *own.values()])
    return fit_parameters(equal.problem, terms, start, iterations=iterations)


def _exchange_forms(fit: Fit, candidates: Sequence[Term]) -> Fit:
    """The fit with a lag of all drives in place of their delays, if that leaves less.

    What one drive does not tell, all of them together may.

    Args:
        fit: with the usual effects.
        candidates: terms that may earn a name.
    """
    negligible = find_negligible(fit)
    values = fit.values_by_term
    for form in dict.fromkeys(t.effect for t in candidates if t.effect.resembles):
        old = [t for t in fit.terms if t.effect.name == form.resembles]
        places = {
            t.targets: t for t in candidates if t.effect is form and t not in fit.terms
        }
        if all(t in negligible for t in old) or not all(
            t.targets in places for t in old
        ):
            continue
        new = [places[t.targets] for t in old]
        kept, start = fit.without_terms(*old)
        start = np.concatenate([start, *(values[t] for t in old)])
        cost = fit.cost + fit.prior_penalty
        limit = (1 + SELECTION.max_uncertain_removal) * cost
        other = _fit_beside(fit, old, (*kept, *new), start, limit)
        if other.cost + other.prior_penalty < cost:
            fit = other
    return fit
