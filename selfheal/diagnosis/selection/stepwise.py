"""Stepwise regression: takes the state of a search, gives the state that it ends in.

Forward selection, with backward elimination and exchanges after each step (Efroymson
1960). An effect enters by a likelihood-ratio test of held-out residuals (`criteria`).
"""

from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np

from ..effects.base import Term
from ..effects.terms import is_distinct, start_beside
from ..estimation.candidate_fit import fit_candidate
from ..estimation.least_squares import fit_parameters
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.reweighting import reestimate_initial_states
from .backward import (
    compute_removal_costs,
    eliminate_backward,
    estimate_without,
    exchange_term,
    find_negligible,
    fit_without,
    is_needless,
)
from .criteria import (
    Claim,
    choose_winner,
    find_relieving,
    fit_damages,
    fit_finalists,
    is_clear,
)
from .cross_validation import ScoredFit, refit_without_folds
from .evidence import weigh_name
from .screening import screen_candidates, select_hard_segments
from .search_record import SearchRecord
from .search_state import SearchState, reweight_and_fit
from .settings import SELECTION


def search_forward(
    state: SearchState,
    rng: np.random.Generator,
    record: SearchRecord,
    most: int = SELECTION.max_effects,
) -> SearchState:
    """Add effects that earn a name until none does, or nothing is left.

    What a step removes may not come back in the next one (tabu list, Glover 1989).

    Args:
        state: to begin with.
        rng: draws the segments on which candidates are tried first.
        record: of what was tried and found.
        most: effects that may be added.
    """
    tabu: set[tuple] = set()
    for _ in range(most):
        if state.is_complete:
            break
        state, winner = _select_next(state, tabu, rng, record)
        if winner is None and tabu:
            tabu = set()
            continue
        if winner is None:
            break
        best, claim = winner
        record(f"fitting {best.candidate.label}", 0.0)
        before = state.named
        state, removed = _admit(state.with_claim(best.candidate, claim), best)
        if best.candidate in state.named and not state.is_complete:
            state = _add_siblings(state, best.candidate, tabu, rng)
        tabu = {t.key for t in removed}  # for one round: what follows may need it
        replaced = tuple(t for t in before if t not in state.named)
        for term in state.named:
            if term.key not in state.claims:  # it took the place of another one
                exchanged = Claim(claim.evidence, replaced, replaced)
                state = state.with_claim(term, exchanged)
        record.keep(state)
    return state


def _select_next(
    state: SearchState,
    tabu: Set[tuple],
    rng: np.random.Generator,
    record: SearchRecord,
) -> tuple[SearchState, tuple[ScoredFit, Claim] | None]:
    """The candidate that earns a name beside those named; None: no one does.

    Args:
        state: of the search.
        tabu: keys of candidates that may not be tried.
        rng: draws segments.
        record: of what was tried and found.

    Returns:
        The state, in which only the best candidates stay open, and the winner.
    """
    taken = {t.key for t in state.named} | tabu
    fit = state.best.fit
    open_terms = [
        start_beside(t, fit.terms, fit.values)
        for t in state.candidates
        if t.key not in taken and is_distinct(t, state.named)
    ]
    restating = [t for t in state.restating_candidates if t.key not in taken]
    base = LinearizedFit.from_fit(state.best.fit)
    bases = [select_hard_segments(base, n, rng) for n in SELECTION.screening_steps]
    part = bases[-1]
    before = ScoredFit.from_fit(part.fit)
    damages = fit_damages(part, state.nominal_count, open_terms, record)
    winner = choose_winner(before, damages, len(open_terms))
    if winner and is_clear(before, winner[0]):
        return state, winner
    fits, independent, retried = screen_candidates(
        bases, open_terms, record, record.add_tried
    )
    has_single_readings = part.problem.regime.has_single_readings
    if len(open_terms) > SELECTION.max_retried_candidates and not has_single_readings:
        tried = {t.key for t in open_terms}
        kept = [t for t in state.candidates if t.key not in tried]
        state = state.with_candidates([*retried, *kept])
    if not state.first_round:
        ranking = tuple((f.terms[-1], f.cost / part.fit.cost) for f in fits)
        state = replace(state, first_round=ranking)
    finalists = fit_finalists(fits, record)
    if has_single_readings:
        finalists = refit_without_folds(part, finalists, open_terms)
    fitted = {s.candidate.key for s in damages}
    others = [s for s in finalists if s.candidate.key not in fitted]
    winner = choose_winner(before, [*damages, *others], independent)
    if winner is None and state.is_prior_violated:
        winner = find_relieving(part, before, restating, record)
    return state, winner


def _admit(state: SearchState, best: ScoredFit) -> tuple[SearchState, list[Term]]:
    """Fit with a new effect and new weights; undo what that makes needless.

    Args:
        state: of the search.
        best: fit with the new effect, perhaps in fewer segments.

    Returns:
        The state, and the effects that were removed.
    """
    is_whole = best.fit.problem.segments is state.problem.segments
    jacobian = best.fit.jacobian if is_whole else None
    problem, start = state.problem, (best.fit.terms, best.fit.values)
    if best.is_reestimated and problem.regime.is_nonsmooth:  # begun from what was read
        problem = marginalize_initial_states(problem.with_measured_states, *start)
    elif best.is_reestimated:
        problem = reestimate_initial_states(problem, *start)
    fit = fit_parameters(problem, *start, iterations=6, jacobian=jacobian)
    return remove_and_exchange(state.with_fit(reweight_and_fit(fit, 4)))


def _add_siblings(
    state: SearchState, winner: Term, tabu: Set[tuple], rng: np.random.Generator
) -> SearchState:
    """Add a usual effect at all other places too, and keep it where it is significant.

    What one drive of a robot has, the others often have as well; one by one, each
    would need a screening of its own.

    Args:
        state: of the search, in which the winner is named.
        winner: the effect that was added at one place.
        tabu: keys of candidates that may not be tried.
        rng: draws segments and resamples.
    """
    problem, old = state.problem, state.best.fit
    siblings = [
        start_beside(t, old.terms, old.values)
        for t in state.candidates
        if t.effect is winner.effect
        and len(t.targets) == len(winner.targets) == 1
        and t.finding_fields == winner.finding_fields
        and not t.effect.rarity
        and t.key not in tabu
        and is_distinct(t, state.named)
    ]
    if not siblings:
        return state
    base = LinearizedFit.from_fit(old)
    part = select_hard_segments(base, SELECTION.screening_steps[0], rng)
    fits = [fit_candidate(part, t, iterations=1) for t in siblings]
    start = [f.values[len(old.values) :] for f in fits]
    fit = fit_parameters(
        problem,
        (*old.terms, *siblings),
        np.concatenate([old.values, *start]),
        iterations=6,
    )
    fit = eliminate_backward(fit, state.nominal_count)
    if not any(t in fit.terms for t in siblings):
        return state
    state, _ = remove_and_exchange(state.with_fit(reweight_and_fit(fit, 4)))
    return keep_significant(state, siblings, rng)


def remove_and_exchange(state: SearchState) -> tuple[SearchState, list[Term]]:
    """Remove effects that are needless; exchange those that others explain better.

    Returns:
        The state, and the effects that were removed.
    """
    best = state.best
    removed: list[Term] = []
    while len(state.named) > 1:
        trials = []
        base = LinearizedFit.from_fit(best.fit)
        costs = compute_removal_costs(base, state.named)
        cheapest = sorted(state.named, key=lambda t: costs[t])
        for term in cheapest[: SELECTION.max_removal_trials]:
            less = ScoredFit.from_fit(fit_without(base, term))
            if is_needless(best, less):
                trials.append((term, less))
            if trials and len(state.named) > SELECTION.max_effects:
                break  # most of them go anyway
        if not trials:
            break
        negligible = find_negligible(best.fit)
        term, best = min(trials, key=lambda x: (x[0] not in negligible, x[1].error))
        state = state.with_fit(best)
        removed.append(term)
    named = () if state.problem.regime.has_single_readings else state.named
    for term in named:
        if term is named[-1] and term.key in state.claims:
            continue  # it has just won against all others
        best = exchange_term(best, term, state.find_alternatives(term))
    return state.with_fit(best), removed


def keep_significant(
    state: SearchState, tried: Sequence[Term], rng: np.random.Generator
) -> SearchState:
    """The state without those of some effects that a likelihood-ratio test refutes.

    What it clearly proves to first order is not fitted without.

    Args:
        state: of the search.
        tried: effects that were fitted together, by whose number p-values are
            corrected (Bonferroni).
        rng: draws resamples.
    """
    is_rough = state.problem.regime.has_rough_cost  # a Jacobian is, too
    keys = {t.key for t in tried}
    untested = [t for t in state.named if t.key in keys or t.key not in state.claims]
    for term in untested:
        best = state.best
        base = LinearizedFit.from_fit(best.fit)
        (less, _), (whole, _) = (estimate_without(base, x) for x in ([term], []))
        evidence = weigh_name(less, whole, len(tried), rng)
        if is_rough or evidence.p_value > SELECTION.clear_p_value:
            less = ScoredFit.from_fit(fit_without(base, term))
            evidence = weigh_name(less, best, len(tried), rng)
        if evidence.p_value >= SELECTION.max_p_value:
            state = state.with_fit(less)
        else:
            state = state.with_claim(term, Claim(evidence))
    return state


def vet_untested(state: SearchState, rng: np.random.Generator) -> SearchState:
    """The state without the names that no test was made of and that fail it."""
    untested = [t for t in state.named if t.key not in state.claims]
    if not untested:
        return state
    scored = ScoredFit.from_fit(eliminate_backward(state.best.fit, state.nominal_count))
    return keep_significant(state.with_fit(scored), untested, rng)
