"""Where a search for effects is: takes fits, says whether more is to be looked for.

A state is frozen. A step of the search (`stepwise`) takes one and returns the next one;
other modules get a new state from `start_state` or from the `with_...` methods.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..effects.base import Term
from ..effects.terms import find_other_forms, restates_nominal_value
from ..estimation.covariance import effective_sample_size
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import (
    expected_cost,
    noise_ratio,
    worst_channel_ratio,
)
from ..estimation.nonsmooth import search_multiples
from ..estimation.problem import Problem
from ..estimation.quadratic_model import stack_bounds
from ..estimation.reweighting import reweight_residuals
from ..estimation.settings import FIT
from .criteria import Claim
from .cross_validation import ScoredFit, fit_and_score
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class SearchState:
    """Where a search for effects is.

    Attributes:
        best: the fit of the nominal terms and of the named effects.
        nominal_count: number of nominal terms, which stand first in the fit.
        candidates: terms that may earn a name.
        claims: what speaks for each effect ever named, by the key of its term.
        first_round: candidates of the first screening, each with the cost that it
            leaves, as a share of the cost without it.
    """

    best: ScoredFit
    nominal_count: int
    candidates: Sequence[Term]
    claims: Mapping[tuple, Claim] = field(default_factory=dict)
    first_round: tuple[tuple[Term, float], ...] = ()

    @property
    def problem(self) -> Problem:
        """The segments, with the weights of now."""
        return self.best.fit.problem

    def with_fit(self, best: ScoredFit) -> "SearchState":
        """The state with another fit."""
        return replace(self, best=best)

    def with_candidates(self, candidates: Sequence[Term]) -> "SearchState":
        """The state in which other terms may earn a name."""
        return replace(self, candidates=candidates)

    def with_claim(self, term: Term, claim: Claim) -> "SearchState":
        """The state that knows what speaks for a term."""
        return replace(self, claims={**self.claims, term.key: claim})

    @property
    def named(self) -> tuple[Term, ...]:
        """Terms of the named effects."""
        return self.best.fit.terms[self.nominal_count :]

    @property
    def noise_ratio(self) -> float:
        """Root mean square of the residuals over that of the readings' noise."""
        return noise_ratio(self.best.fit)

    @property
    def is_white(self) -> bool:
        """Whether the residuals look like white noise, by their correlation times."""
        residuals = self.best.fit.residuals
        independent = effective_sample_size(self.problem, residuals)
        return bool(independent > SELECTION.white_share * np.count_nonzero(residuals))

    @property
    def is_explained_by_timestep(self) -> bool:
        """Whether noise and the time step's error would leave as large residuals."""
        return self.best.fit.cost <= expected_cost(self.best.fit)

    @property
    def has_bad_channel(self) -> bool:
        """Whether one scored column is far above its noise, whatever the others are."""
        return worst_channel_ratio(self.best.fit) > FIT.unexplained_ratio

    @property
    def is_mostly_explained(self) -> bool:
        """Whether the names leave little error, of a robot whose cost is rough."""
        nats = sum(self.claims[t.key].evidence.gain for t in self.named)
        return (
            self.problem.regime.has_rough_cost
            and np.exp(-2 * nats) < SELECTION.contact_remaining_share
        )

    @property
    def is_prior_violated(self) -> bool:
        """Whether nominal values alone are so far off that an effect may mend it."""
        if self.named:
            return False
        if self.problem.regime.has_rough_cost:  # roughness drives all of them some way
            return bool(self.restating_candidates)
        return self.best.fit.prior_penalty > SELECTION.significant_prior_penalty

    @property
    def restating_candidates(self) -> list[Term]:
        """Candidates that restate a nominal value; in contact, one at its bound."""
        fit = self.best.fit
        nominal_terms = list(fit.terms[: self.nominal_count])
        if self.problem.regime.has_rough_cost:
            low, high, _ = stack_bounds(fit.terms)
            margins = np.minimum(fit.values - low, high - fit.values) / (high - low)
            nominal_terms = [
                t
                for t, margin in zip(nominal_terms, margins, strict=False)
                if margin < SELECTION.bound_margin
            ]
        return [t for t in self.candidates if restates_nominal_value(t, nominal_terms)]

    @property
    def is_complete(self) -> bool:
        """Whether forward selection ends: no residual, no value asks for an effect.

        In contact, what set in at some time is one effect, if that explains the error.
        """
        has_set_in = any(t.onset for t in self.named)
        if has_set_in and self.problem.regime.has_rough_cost and self.is_explained:
            return True
        is_quiet = self.is_white or (
            self.named and self.noise_ratio < SELECTION.quiet_noise_ratio
        )
        is_explained = (
            is_quiet or self.is_explained_by_timestep
        ) and not self.has_bad_channel
        return bool(is_explained and not self.is_prior_violated)

    @property
    def is_quiet(self) -> bool:
        """Whether all residuals together are no larger than noise and roughness leave.

        Several names, or a rare one, may stand for others: where nothing touches they
        must leave less than one usual name.
        """
        is_doubtful = any(t.effect.rarity for t in self.named) or len(self.named) > 1
        is_strict = is_doubtful and not self.problem.regime.has_rough_cost
        is_near_noise = self.noise_ratio <= (
            FIT.strictly_unexplained_ratio if is_strict else FIT.unexplained_ratio
        )
        return (
            self.is_white
            or is_near_noise
            or self.is_explained_by_timestep
            or self.is_mostly_explained
        )

    @property
    def is_explained(self) -> bool:
        """Whether nothing is left that another hypothesis could explain."""
        return self.is_quiet and not self.has_bad_channel

    def find_alternatives(self, term: Term) -> Sequence[Term]:
        """Terms that may take a name's place: its rivals, or its other forms."""
        if term.key in self.claims:
            return self.claims[term.key].others
        return find_other_forms(term, self.candidates)


def start_state(
    problem: Problem,
    nominal_terms: Sequence[Term],
    candidates: Sequence[Term],
    chosen: np.ndarray,
) -> SearchState:
    """The state of a search in which nothing has a name, in some of the segments.

    Args:
        problem: all segments that may be used.
        nominal_terms: terms of the nominal model's values, which are fitted.
        candidates: terms that may earn a name.
        chosen: (v) numbers of the segments to use.
    """
    nominal = np.ones(len(nominal_terms))
    problem = marginalize_initial_states(problem.select(chosen), nominal_terms, nominal)
    fit = fit_parameters(problem, nominal_terms, nominal)
    return SearchState(reweight_and_fit(fit, 8), len(nominal_terms), candidates)


def reweight_and_fit(
    fit: Fit, iterations: int, *, tries_multiples: bool = True
) -> ScoredFit:
    """A fit repeated in its problem weighted by its residuals.

    One iteration of feasible generalized least squares: each column of readings weighs
    by the variance of its own residuals.

    Args:
        fit: to begin with.
        iterations: of Gauss-Newton, at most.
        tries_multiples: whether values are looked at farther off first.
    """
    reweighted = reweight_residuals(fit)
    jacobian = fit.transfer_jacobian(reweighted)
    start = fit.values
    if tries_multiples:
        start = search_multiples(reweighted, fit.terms, start)
    return fit_and_score(
        reweighted, fit.terms, start, iterations=iterations, jacobian=jacobian
    )


def reweight_repeatedly(fit: Fit, iterations: int) -> Fit:
    """The fit to its problem weighted by residuals that get smaller.

    By the errors of the model as given one joint would outweigh all others.

    Args:
        fit: to begin with.
        iterations: of Gauss-Newton in each problem, at most.
    """
    for _ in range(SELECTION.reweightings_of_all):
        fit = reweight_and_fit(fit, iterations, tries_multiples=False).fit
    return fit
