"""Where a search for effects is: takes fits, says whether more is to be looked for.

Segments are as long as the robot can be predicted: in longer ones slow effects show.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..effects.base import Term
from ..effects.declaration import UNUSUAL
from ..estimation.covariance import effective_sample_size
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.marginalization import (
    is_horizon_informative,
    marginalize_initial_states,
)
from ..estimation.noise import expected_cost, noise_ratio, worst_channel_ratio
from ..estimation.problem import Problem
from ..estimation.quadratic_model import stack_bounds
from ..estimation.reweighting import reweight_residuals
from ..estimation.settings import FIT
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class Evidence:
    """Why an effect is named.

    Attributes:
        gain: [nats] per effective sample that it adds to the likelihood.
        p_value: of that gain, corrected for all candidates tried.
        stability: share of resamples of the blocks in which it helps to predict.
    """

    gain: float
    p_value: float
    stability: float


@dataclass(frozen=True, eq=False)
class Claim:
    """What speaks for a name, and which terms cannot be distinguished from it."""

    evidence: Evidence
    rivals: tuple[Term, ...] = ()


@dataclass(frozen=True, eq=False)
class SearchState:
    """Where a search for effects is.

    Attributes:
        best: the fit of the nominal terms and of the named effects.
        nominal_count: number of nominal terms, which stand first in the fit.
        candidates: terms that may earn a name.
        claims: what speaks for each effect ever named, by the key of its term.
        first_round: candidates beside the model as given, each with the mean square
            error that it leaves, as a share of that without it.
    """

    best: Fit
    nominal_count: int
    candidates: Sequence[Term]
    claims: Mapping[tuple, Claim] = field(default_factory=dict)
    first_round: tuple[tuple[Term, float], ...] = ()

    @property
    def problem(self) -> Problem:
        """The segments, with the weights of now."""
        return self.best.problem

    @property
    def named(self) -> tuple[Term, ...]:
        """Terms of the named effects."""
        return self.best.terms[self.nominal_count :]

    @property
    def is_explained(self) -> bool:
        """Whether nothing is left that another hypothesis could explain.

        The residuals are those of noise and of the time step, in each scored column.
        Several names, or a rare one, may stand for others: where nothing touches they
        must leave less than one usual name.
        """
        if self._has_bad_channel:
            return False
        is_doubtful = (
            any(t.log_odds < UNUSUAL for t in self.named) or len(self.named) > 1
        )
        is_strict = is_doubtful and not self.problem.regime.has_rough_cost
        limit = FIT.strictly_unexplained_ratio if is_strict else FIT.unexplained_ratio
        return self._is_noise or noise_ratio(self.best) <= limit

    @property
    def is_complete(self) -> bool:
        """Whether no residual and no stated value asks for an effect."""
        is_noise = self._is_noise and not self._has_bad_channel
        return is_noise and not self._is_prior_violated

    @property
    def _has_bad_channel(self) -> bool:
        """Whether one scored column is far above its noise, whatever the others are."""
        return worst_channel_ratio(self.best) > FIT.unexplained_ratio

    @property
    def _is_noise(self) -> bool:
        """Whether residuals are white, or no larger than noise and time step leave."""
        residuals = self.best.residuals
        independent = effective_sample_size(self.problem, residuals)
        is_white = independent > SELECTION.white_share * np.count_nonzero(residuals)
        return bool(is_white or self.best.cost <= expected_cost(self.best))

    @property
    def _is_prior_violated(self) -> bool:
        """Whether stated values are so far off that an effect may mend it.

        In contact roughness drives all of them some way: there, whether one is at its
        bound.
        """
        if not self.problem.regime.has_rough_cost:
            return self.best.prior_penalty > SELECTION.significant_prior_penalty
        low, high, _ = stack_bounds(self.best.terms)
        values = self.best.values
        margins = np.minimum(values - low, high - values) / (high - low)
        return bool((margins < SELECTION.bound_margin).any())


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


def reweight_and_fit(fit: Fit, iterations: int) -> Fit:
    """A fit repeated in its problem weighted by its residuals.

    One iteration of feasible generalized least squares: each column of readings weighs
    by the variance of its own residuals.

    Args:
        iterations: of Gauss-Newton, at most.
    """
    reweighted = reweight_residuals(fit)
    jacobian = fit.transfer_jacobian(reweighted)
    return fit_parameters(
        reweighted, fit.terms, fit.values, iterations=iterations, jacobian=jacobian
    )


def fit_longer(fit: Fit, longer: Sequence[Problem]) -> Fit:
    """The fit repeated in longer and longer segments, as far as these inform."""
    for wanted in longer:
        shorter, at = fit.problem, (fit.terms, fit.values)
        posed = replace(wanted, sigma=shorter.sigma, simulator=shorter.simulator)
        if not is_horizon_informative(posed, shorter, *at):
            break
        posed = marginalize_initial_states(posed, *at)
        fit = fit_parameters(posed, *at, iterations=5)
    return fit


def lengthen_segments(state: SearchState, longer: Sequence[Problem]) -> SearchState:
    """The state fitted in longer segments, while these inform and nothing is left.

    What builds up slowly is not seen in short segments, as the loss of energy of a
    free pendulum.
    """
    steps = state.problem.segments.lengths.mean()
    for other in longer:
        if not state.is_explained:
            break
        if other.segments.lengths.mean() <= steps:
            continue
        fit = fit_longer(state.best, [other])
        if fit is state.best:
            break
        state = replace(state, best=reweight_and_fit(fit, 4))
    return state
