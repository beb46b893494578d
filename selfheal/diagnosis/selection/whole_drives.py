"""What whole drives lack: takes the state of a search, gives it with usual effects.

A real drive lacks several effects at every joint at once. They are fitted together and
removed backward, in segments as long as the robot can be predicted.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import (
    is_distinct,
    share_values,
    spread_values,
    start_beside,
)
from ..estimation.least_squares import Fit, fit_parameters
from ..estimation.marginalization import (
    is_horizon_informative,
    marginalize_initial_states,
)
from ..estimation.problem import Problem
from ..simulation.model_variants import split_values
from .backward import eliminate_backward, find_negligible
from .cross_validation import ScoredFit
from .screening import Progress
from .search_state import SearchState, reweight_and_fit
from .settings import SELECTION
from .stepwise import keep_significant, remove_and_exchange


def search_backward(
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    progress: Progress,
) -> SearchState | None:
    """Fit all usual effects at once, and remove those that the data do not ask for.

    A real drive lacks several of them at every joint. What is named first alone stands
    for several. Slow effects show in longer segments, which are used as far as their
    initial states are known well enough.

    Args:
        state: in which nothing has a name.
        longer: the problem in longer and longer segments.
        rng: draws resamples.
        progress: called with a message and a share (0 to 1).

    Returns:
        The state at the end; None where no effect is usual.
    """
    usual = [t for t in state.candidates if t.effect.is_usual(t)]
    if not usual:
        return None
    problem, fit = _fit_at_once(state, usual, progress)
    problem, fit = _reweight_repeatedly(problem, fit)
    problem, fit = fit_longer(problem, fit, longer)
    state = replace(state, plain=fit)
    fit = _exchange_forms(problem, fit, state.candidates)
    reached = state.with_fit(problem, ScoredFit.from_fit(problem, fit))
    # slow noise, as estimated, may be what the usual effects leave
    if not (reached.is_white or reached.is_explained_by_timestep):
        fit = _extend_drive_models(problem, fit, state.candidates)
    tried = fit.terms[state.nominal_count :]
    fit = eliminate_backward(problem, fit, state.nominal_count)
    # each multiple of each value is a simulation, and here values are many
    reweighted = reweight_and_fit(problem, fit, 4, tries_multiples=False)
    state = state.with_fit(*reweighted)
    state, _ = remove_and_exchange(state)
    return keep_significant(state, tried, rng)


def fit_usual_effects(state: SearchState, progress: Progress) -> Fit | None:
    """Fit all usual effects at once; None: there are none.

    Args:
        state: in which nothing has a name.
        progress: called with a message and a share (0 to 1).
    """
    usual = [t for t in state.candidates if t.effect.is_usual(t)]
    return _fit_at_once(state, usual, progress)[1] if usual else None


def _fit_at_once(
    state: SearchState, usual: Sequence[Term], progress: Progress
) -> tuple[Problem, Fit]:
    """The problem, weighted by what equal drives leave, and a fit of all effects.

    A fit without them may have driven the nominal values far from where they are; one
    that explains all has not.

    Args:
        state: in which nothing has a name.
        usual: terms, one or more.
        progress: called with a message and a share (0 to 1).
    """
    progress(f"fitting {len(usual)} usual effects at once", 0.0)
    if state.is_explained:
        problem, nominal = state.problem, state.best.fit.values
        values = np.array([p.nominal for t in usual for p in t.parameters])
    else:
        problem, values = _fit_equal_drives(state.problem, usual)
        nominal = np.ones(state.nominal_count)
    terms, start = (*state.best.fit.terms, *usual), np.concatenate([nominal, values])
    return problem, fit_parameters(problem, terms, start, iterations=5)


def _fit_equal_drives(
    problem: Problem, usual: Sequence[Term]
) -> tuple[Problem, Floats]:
    """The problem weighted anew, and values (P) of effects that all joints share.

    They are a few numbers, which are found from far away.

    Args:
        problem: to be fitted.
        usual: terms at single places, each with initial values.
    """
    shared = share_values(usual)
    fit = fit_parameters(problem, shared, _search_initial_values(problem, shared))
    problem, fit = _reweight_repeatedly(problem, fit)
    return problem, np.concatenate(spread_values(shared, fit.values, usual))


def _reweight_repeatedly(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The problem weighted by residuals that get smaller, and the fit there.

    By the errors of the model as given one joint would outweigh all others.
    """
    for _ in range(SELECTION.reweightings_of_all):
        problem, scored = reweight_and_fit(problem, fit, 6, tries_multiples=False)
        fit = scored.fit
    return problem, fit


def _search_initial_values(problem: Problem, terms: Sequence[Term]) -> Floats:
    """The best initial values (P) of terms, or nominal ones, one term after the other.

    Args:
        problem: whose residuals are compared.
        terms: each with initial values.
    """
    chosen = [tuple(p.nominal for p in t.parameters) for t in terms]
    for _ in range(SELECTION.sweeps_of_initial_values):
        for i, term in enumerate(terms):
            tried = dict.fromkeys([chosen[i], *term.initial_values])
            choices = [[*chosen[:i], x, *chosen[i + 1 :]] for x in tried]
            points = np.array([np.concatenate(c) for c in choices])
            residuals = problem.compute_residuals(terms, points)
            chosen = choices[int(np.argmin((residuals**2).sum(axis=1)))]
    return np.concatenate(chosen)


def _exchange_forms(problem: Problem, fit: Fit, candidates: Sequence[Term]) -> Fit:
    """The fit with a lag of all drives in place of their delays, if that leaves less.

    What one drive does not tell, all of them together may.

    Args:
        problem: that was fitted.
        fit: with the usual effects.
        candidates: terms that may earn a name.
    """
    negligible = find_negligible(fit)
    values = dict(zip(fit.terms, split_values(fit.terms, fit.values), strict=True))
    for form in dict.fromkeys(t.effect for t in candidates if t.effect.resembles):
        old = [t for t in fit.terms if t.effect.name == form.resembles]
        places = {t.targets: t for t in candidates if t.effect is form}
        if all(t in negligible for t in old) or not all(
            t.targets in places for t in old
        ):
            continue
        new = [places[t.targets] for t in old]
        kept, start = fit.without_terms(*old)
        start = np.concatenate([start, *(values[t] for t in old)])
        other = fit_parameters(problem, (*kept, *new), start, iterations=5)
        if other.cost + other.prior_penalty < fit.cost + fit.prior_penalty:
            fit = other
    return fit


def _extend_drive_models(problem: Problem, fit: Fit, candidates: Sequence[Term]) -> Fit:
    """The fit with richer models of all drives at once, if these explain more.

    Friction with a Stribeck curve and of both sides of the gear, and a lag, as in
    nested models of drives (Rhoban's BAM, M1 to M6). One at a time none of them may
    explain anything: each is seen beside the others only.

    Args:
        problem: that was fitted.
        fit: with the usual effects.
        candidates: terms that may earn a name.
    """
    found = [t for t in candidates if t.effect.is_in_drive_model(t)]
    if not found:
        return fit
    more = [
        start_beside(t, fit.terms, fit.values) for t in found if len(t.targets) == 1
    ]
    other_forms = [t for t in fit.terms if not is_distinct(t, more)]
    terms, values = fit.without_terms(*other_forms)
    terms = (*terms, *more)
    starts = [
        np.concatenate([
            values, *(t.initial_values[i % len(t.initial_values)] for t in more)
        ])
        for i in range(max(len(t.initial_values) for t in more))
    ]  # fmt: skip
    residuals = problem.compute_residuals(terms, np.array(starts))
    best = starts[int(np.argmin((residuals**2).sum(axis=1)))]
    new = fit_parameters(problem, terms, best, iterations=6)
    return new if new.cost < SELECTION.exchange_error_ratio * fit.cost else fit


def fit_longer(
    problem: Problem, fit: Fit, longer: Sequence[Problem]
) -> tuple[Problem, Fit]:
    """The fit repeated in longer and longer segments, as far as these inform.

    Args:
        problem: that was fitted.
        fit: its fit.
        longer: the problem in longer and longer segments.
    """
    for other in longer:
        other = replace(other, sigma=problem.sigma, simulator=problem.simulator)
        if not is_horizon_informative(other, problem, fit.terms, fit.values):
            break
        problem = marginalize_initial_states(other, fit.terms, fit.values)
        fit = fit_parameters(problem, fit.terms, fit.values, iterations=5)
    return problem, fit


def lengthen_segments(state: SearchState, longer: Sequence[Problem]) -> SearchState:
    """The state fitted in longer segments, while these inform and nothing is left.

    What builds up slowly is not seen in short segments, as the loss of energy of a
    free pendulum.

    Args:
        state: in which short segments are explained, or not.
        longer: the problem in longer and longer segments.
    """
    steps = state.problem.segments.lengths.mean()
    for other in longer:
        if not state.is_explained:
            break
        if other.segments.lengths.mean() <= steps:
            continue
        problem, fit = fit_longer(state.problem, state.best.fit, [other])
        if problem is state.problem:
            break
        state = state.with_fit(*reweight_and_fit(problem, fit, 4))
    return state
