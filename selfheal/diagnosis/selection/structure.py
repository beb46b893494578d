"""What names leave: takes a hypothesis, says whether it is more than noise.

A test for lack of fit: by a torque of free form, which has to predict held-out episodes
better, and by the size of the residuals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.free_form import FreeFormTorque
from ..estimation.fit import Fit
from ..estimation.jacobian import compute_jacobian
from ..estimation.least_squares import fit_one_more, fit_parameters
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import expected_cost, robust_noise, worst_channel_ratio
from ..estimation.problem import Problem
from ..estimation.settings import FIT
from ..simulation.dataset import SHORT_SEGMENT, Dataset, cut_readable_segments
from .holdout import squared_error_reestimated
from .hypotheses import Hypothesis
from .judge import Judge, is_clearly_better
from .settings import SELECTION
from .subsampling import draw_segments, mean_seconds


@dataclass(frozen=True)
class RemainingStructure:
    """What the named effects leave.

    Attributes:
        share: of the squared error that a torque of free form explains; 0 where none
            predicts held-out episodes clearly better.
        noise_ratio: root mean square of the residuals over what noise and time step
            leave.
        worst_channel_ratio: the same in the worst scored column.
        explained: share of the explainable squared error that the names explain.
    """

    share: float
    noise_ratio: float
    worst_channel_ratio: float
    explained: float

    @property
    def is_significant(self) -> bool:
        """Whether something is left that is no noise."""
        is_shown = self.share > SELECTION.min_remaining_share
        return (is_shown and self.noise_ratio > 1) or max(
            self.noise_ratio, self.worst_channel_ratio
        ) > FIT.unexplained_ratio


def analyze_remaining(dataset: Dataset, hypothesis: Hypothesis) -> RemainingStructure:
    """Look for structure that the names leave, in some of the training segments."""
    problem, jacobian = _pose_in_short_segments(dataset, hypothesis)
    fit = hypothesis.final
    fit = fit_parameters(
        problem, fit.terms, fit.values, iterations=0, jacobian=jacobian
    )
    share = _find_free_form(dataset, fit)
    left = fit.cost
    before, noise = left, expected_cost(fit)
    if hypothesis.named:
        before = squared_error_reestimated(problem, hypothesis.nominal)
        if problem.regime.has_single_readings:
            noise = max(noise, robust_noise(problem, fit.residuals))
    return RemainingStructure(
        share,
        float(np.sqrt(left / max(noise, FIT.tiny))),
        worst_channel_ratio(fit),
        float((before - left) / max(before - noise, FIT.tiny)),
    )


def _find_free_form(dataset: Dataset, fit: Fit) -> float:
    """Largest share of the squared error that a torque of free form explains.

    Of those that predict held-out episodes clearly better.
    """
    base, judge = LinearizedFit.from_fit(fit), Judge.build(dataset.held_out, fit)
    errors, share = judge.log_errors(fit), 0.0
    for term in _choose_likeliest(base, FreeFormTorque().propose_terms(dataset.robot)):
        absent = np.array([p.nominal for p in term.parameters], float)
        new = fit_one_more(fit, term, absent, 2)
        if is_clearly_better(judge.log_errors(new), errors):
            share = max(share, 1 - new.cost / fit.cost)
    return share


def _choose_likeliest(base: LinearizedFit, terms: Sequence[Term]) -> list[Term]:
    """The few of many terms that would lower the cost most, by a score test (Rao 1948).

    Args:
        terms: as many parameters each, which do nothing at their nominal values.
    """
    most = SELECTION.max_free_forms
    if len(terms) <= most:
        return list(terms)
    fit, absent = base.fit, [p.nominal for t in terms for p in t.parameters]
    responses = compute_jacobian(
        base.problem,
        (*fit.terms, *terms),
        np.concatenate([fit.values, absent]),
        fit.residuals,
        len(fit.values),
    )
    each = np.split(responses, len(terms), axis=1)
    gains = [base.estimate_gain(fit.residuals + response.T) for response in each]
    return [terms[i] for i in np.argsort(gains)[::-1][:most]]


def _pose_in_short_segments(
    dataset: Dataset, hypothesis: Hypothesis
) -> tuple[Problem, Floats | None]:
    """Some short segments of the training data, at a hypothesis's values.

    Those of its last fit, whose initial states and Jacobian are known, if these are
    short.

    Returns:
        The problem, and the Jacobian (R, P) there or None.
    """
    problem, fit = hypothesis.problem, hypothesis.final
    rng = np.random.default_rng(1)
    if mean_seconds(problem) < SELECTION.long_segment:
        chosen = draw_segments(problem, SELECTION.remaining_steps, rng)
        rows = np.isin(problem.segment_of_residual, chosen)
        return problem.select(chosen), fit.jacobian[rows]
    segments = cut_readable_segments(dataset.training, SHORT_SEGMENT)
    whole = Problem(dataset.training, segments, problem.sigma)
    part = whole.select(draw_segments(whole, SELECTION.remaining_steps, rng))
    return marginalize_initial_states(part, fit.terms, fit.values), None
