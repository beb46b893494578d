"""A search for effects: takes windows and candidates, names what earns it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects.base import Term, find_other_forms, is_distinct, restates_nominal_value
from ..estimation.candidate_fit import LinearizedFit
from ..estimation.covariance import effective_sample_size
from ..estimation.least_squares import Fit, fit_parameters, stack_bounds
from ..estimation.marginalization import (
    is_horizon_informative,
    marginalize_initial_states,
)
from ..estimation.noise import (
    ABOVE,
    LEFT,
    expected_cost,
    noise_ratio,
    worst_channel_ratio,
)
from ..estimation.nonsmooth import search_multiples
from ..estimation.problem import Problem, assign_blocks
from ..estimation.reweighting import (
    downweight_unscored,
    reestimate_initial_states,
    reweight_residuals,
)
from .backward import (
    compute_removal_costs,
    eliminate_backward,
    exchange_term,
    fit_without,
)
from .criteria import (
    Claim,
    choose_winner,
    find_relieving,
    fit_finalists,
    fit_parameterless,
)
from .cross_validation import ScoredFit, fit_and_score, refit_without_folds
from .evidence import Evidence, improvement_p_value, is_as_good
from .screening import Progress, screen_candidates, select_hard_segments
from .settings import SELECTION


@dataclass
class StepwiseSearch:
    """Where a search for effects is.

    Attributes:
        problem: the windows.
        now: the best fit.
        stated: how many of its terms the model states.
        candidates: terms.
        rng: chooses windows.
        progress: told what is being done.
        claims: to each name ever given, by the effect's key; written to.
        first: what the first round gave.
    """

    problem: Problem
    best: ScoredFit
    nominal_count: int
    candidates: Sequence[Term]
    rng: np.random.Generator
    progress: Progress
    claims: dict[tuple, Claim]
    first_round: tuple[tuple[Term, float], ...] = ()

    @classmethod
    def from_segments(
        cls, problem, nominal_terms, candidates, rng, progress, some
    ) -> "StepwiseSearch":
        """In some of the windows, where nothing has a name yet."""
        given = np.ones(len(nominal_terms))
        problem = marginalize_initial_states(problem.select(some), nominal_terms, given)
        found = fit_parameters(problem, nominal_terms, given)
        problem, now = _reweight_and_fit(problem, found, 8)
        return cls(
            problem, now, len(nominal_terms), candidates, rng, progress, claims={}
        )

    @property
    def named(self) -> tuple[Term, ...]:
        """The effects of now."""
        return self.best.fit.terms[self.nominal_count :]

    @property
    def is_white(self) -> bool:
        """Whether what is left looks like noise that knows nothing of its past."""
        r = self.best.fit.residuals
        return bool(
            effective_sample_size(self.problem, r)
            > SELECTION.white_share * np.count_nonzero(r)
        )

    @property
    def is_explained_by_timestep(self) -> bool:
        """Whether noise and the time step's error leave as much as is left."""
        found = self.best.fit
        return found.cost <= expected_cost(self.problem, found)

    @property
    def has_bad_channel(self) -> bool:
        """Whether one column is far off, whatever the others are."""
        return worst_channel_ratio(self.problem, self.best.fit) > ABOVE

    @property
    def is_mostly_explained(self) -> bool:
        """Whether the names left little, of a robot whose cost is rough anyway."""
        nats = sum(self.claims[t.key].evidence.gain for t in self.named)
        return (
            self.problem.regime.has_rough_cost
            and np.exp(-2 * nats) < SELECTION.contact_remaining_share
        )

    @property
    def is_prior_violated(self) -> bool:
        """Whether stated values alone are so far off that a name might mend it."""
        if self.named:
            return False
        if self.problem.regime.has_rough_cost:  # roughness drives all of them some way
            return bool(self.restating_candidates)
        return self.best.fit.prior_penalty > SELECTION.significant_prior_penalty

    @property
    def restating_candidates(self) -> list[Term]:
        """What says a stated value anew; where something touches, one at its bound."""
        found = self.best.fit
        nominal_terms = list(found.terms[: self.nominal_count])
        if self.problem.regime.has_rough_cost:
            low, high, _ = stack_bounds(found.terms)
            room = np.minimum(found.values - low, high - found.values) / (high - low)
            nominal_terms = [
                t
                for t, own in zip(nominal_terms, room, strict=False)
                if own < SELECTION.bound_margin
            ]
        return [t for t in self.candidates if restates_nominal_value(t, nominal_terms)]

    @property
    def noise_ratio(self) -> float:
        """What is left, of what noise would leave."""
        return noise_ratio(self.problem, self.best.fit.residuals)

    @property
    def is_done(self) -> bool:
        """Whether nothing is left that another hypothesis could explain."""
        odd = any(t.effect.rarity for t in self.named) or len(self.named) > 1
        strict = odd and not self.problem.regime.has_rough_cost
        near = self.noise_ratio <= (LEFT if strict else ABOVE)
        quiet = (
            self.is_white
            or near
            or self.is_explained_by_timestep
            or self.is_mostly_explained
        )
        return quiet and not self.has_bad_channel

    def run_forward(self) -> None:
        """Add what earns a name, until nothing does."""
        tabu: set[tuple] = set()
        for _ in range(SELECTION.max_effects):
            quiet = self.is_white or (
                self.named and self.noise_ratio < SELECTION.quiet_noise_ratio
            )
            done = (quiet or self.is_explained_by_timestep) and not self.has_bad_channel
            if done and not self.is_prior_violated:
                break
            won = self._select_next(tabu)
            if won is None and tabu:
                tabu = set()
                continue
            if won is None or len(self.named) > SELECTION.max_effects:
                break
            best, claim = won
            self.claims[best.candidate.key] = claim
            self.progress(f"fitting {best.candidate.label}", 0.0)
            before = self.named
            gone = self._reconsider(best)
            tabu = {t.key for t in gone}  # for one round: what follows may need it
            replaced = tuple(t for t in before if t not in self.named)
            swapped = Claim(claim.evidence, replaced, replaced)
            for new in self.named:  # one of them may have taken another's place
                self.claims.setdefault(new.key, swapped)

    def _select_next(self, tabu: set[tuple]) -> tuple[ScoredFit, Claim] | None:
        """The candidate that earns a name beside those named, if one does."""
        taken = {t.key for t in self.named} | tabu
        open_to = [
            t
            for t in self.candidates
            if t.key not in taken and is_distinct(t, self.named)
        ]
        all_of_it = LinearizedFit.from_fit(self.problem, self.best.fit)
        bases = [
            select_hard_segments(all_of_it, steps, self.rng)
            for steps in SELECTION.screening_steps
        ]
        fits, independent, again = screen_candidates(bases, open_to, self.progress)
        part = bases[-1]
        if (
            len(open_to) > SELECTION.max_retried_candidates
            and not part.problem.regime.has_single_readings
        ):
            kept = [t for t in self.candidates if t not in open_to]
            self.candidates = [*again, *kept]
        if not self.first_round:
            self.first_round = tuple(
                (f.terms[-1], f.cost / part.fit.cost) for f in fits
            )
        finals = fit_finalists(part.problem, fits, self.progress)
        if part.problem.regime.has_single_readings:
            finals = refit_without_folds(part, finals, open_to)
        whole = fit_parameterless(part, self.nominal_count, open_to, self.progress)
        said = {s.candidate.key for s in whole}
        finals = [*whole, *(s for s in finals if s.candidate.key not in said)]
        now = ScoredFit.from_fit(part.problem, part.fit)
        won = choose_winner(part.problem, now, finals, independent)
        if won is None and self.is_prior_violated:
            anew = [t for t in self.restating_candidates if t.key not in taken]
            won = find_relieving(part, now, anew, self.progress)
        return won

    def _reconsider(self, best: ScoredFit) -> list[Term]:
        """Weigh anew, and undo what a later effect made needless or better explained.

        Returns:
            What went.
        """
        same = len(best.fit.residuals) == len(self.best.fit.residuals)
        near = best.fit.jacobian if same else None
        problem, at = self.problem, (best.fit.terms, best.fit.values)
        if best.reestimated and problem.regime.is_nonsmooth:  # begun from what was read
            problem = marginalize_initial_states(
                replace(problem.unmarginalized, initial_state_shift=None), *at
            )
        elif best.reestimated:
            problem = reestimate_initial_states(problem, *at)
        found = fit_parameters(problem, *at, rounds=6, known=near)
        self.problem, self.best = _reweight_and_fit(problem, found, 4)
        return self._remove_and_exchange()

    def _remove_and_exchange(self) -> list[Term]:
        """Let what is needless go, and what is better explained change its name.

        Returns:
            What went.
        """
        gone: list[Term] = []
        while len(self.named) > 1:
            tries = []
            prices = compute_removal_costs(
                LinearizedFit.from_fit(self.problem, self.best.fit), self.nominal_count
            )
            for term in sorted(self.named, key=lambda t: prices[t])[
                : SELECTION.max_removal_trials
            ]:
                own = fit_without(self.problem, self.best.fit, term)
                less = ScoredFit.from_fit(self.problem, own)
                if less.error < (1 + SELECTION.removal_tolerance) * self.best.error:
                    tries.append((term, less))
                if (
                    tries and len(self.named) > SELECTION.max_effects
                ):  # most of them go anyway
                    break
            if not tries:
                break
            term, self.best = min(tries, key=lambda x: x[1].error)
            gone.append(term)
        for term in () if self.problem.regime.has_single_readings else self.named[:-1]:
            self.best = exchange_term(
                self.problem, self.best, term, self._find_alternatives(term)
            )
        return gone

    def _find_alternatives(self, term: Term) -> Sequence[Term]:
        """What might take a name's place: what it was told from, or its other forms."""
        if term.key in self.claims:
            return self.claims[term.key].others
        return find_other_forms(term, self.candidates)

    def run_from_usual(self, longer: Problem, first: set[tuple]) -> bool:
        """Begin from all usual effects at once, in longer pieces if the starts allow.

        Returns:
            False where that is no other search than one from nothing, or than the
            one that found the names `first`.
        """
        usual = [t for t in self.candidates if t.effect.is_usual(t)]
        if not usual:
            return False
        self.progress(f"fitting {len(usual)} usual effects at once", 0.0)
        start = [np.array(t.initial_values[0]) for t in usual]
        terms = (*self.best.fit.terms, *usual)
        values = np.concatenate([self.best.fit.values, *start])
        found = fit_parameters(self.problem, terms, values, rounds=8)
        predicted = is_horizon_informative(longer, self.problem, terms, found.values)
        if predicted:
            self.problem = marginalize_initial_states(longer, terms, found.values)
            found = fit_parameters(self.problem, terms, found.values, rounds=8)
        found = eliminate_backward(self.problem, found, self.nominal_count)
        self.problem, self.best = _reweight_and_fit(self.problem, found, 4)
        self._remove_and_exchange()
        self._keep_significant(len(usual))
        if not predicted and {t.key for t in self.named} in (set(), first):
            return False
        self.run_forward()
        return True

    def _keep_significant(self, tried: int) -> None:
        """Keep the names that each are worth it, of so many that were tried."""
        for term in self.named:
            old = ScoredFit.from_fit(
                self.problem, fit_without(self.problem, self.best.fit, term)
            )
            p = improvement_p_value(self.problem, old, self.best, tried)
            if p >= SELECTION.max_p_value:
                self.best = old
                continue
            gain = np.bincount(
                assign_blocks(self.problem),
                old.held_out_errors - self.best.held_out_errors,
            )
            draws = self.rng.integers(
                len(gain), size=(SELECTION.bootstrap_resamples, len(gain))
            )
            nats = 0.5 * np.log(old.error / max(self.best.error, 1e-300))
            stable = float((gain[draws].sum(axis=1) > 0).mean())
            self.claims[term.key] = Claim(Evidence(float(nats), p, stable))

    def predicts_better_than(self, other: "StepwiseSearch") -> bool:
        """Whether this one predicts better, or as well by usual effects alone."""
        sigma = downweight_unscored(self.problem, self.best.fit)
        problem = replace(self.problem, sigma=sigma)
        problem = marginalize_initial_states(
            problem, self.best.fit.terms, self.best.fit.values
        )
        mine, theirs = (
            fit_and_score(problem, s.best.fit.terms, s.best.fit.values, rounds=2)
            for s in (self, other)
        )
        if mine.error < SELECTION.exchange_error_ratio * theirs.error:
            return True
        odd = [sum(t.effect.rarity for t in s.named) for s in (self, other)]
        return odd[0] < odd[1] and is_as_good(problem, mine, theirs)


def _reweight_and_fit(
    problem: Problem, found: Fit, rounds: int
) -> tuple[Problem, ScoredFit]:
    """The problem with weights by what a fit leaves, and the fit there."""
    new = reweight_residuals(problem, found)
    near = problem.transfer_jacobian(new, found.jacobian)
    start = search_multiples(new, found.terms, found.values)
    return new, fit_and_score(new, found.terms, start, rounds=rounds, known=near)
