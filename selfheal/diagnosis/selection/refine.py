"""The last fit: takes a hypothesis, gives it with values fitted to more segments."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.base import Onset
from ..estimation.least_squares import (
    fit_by_updates,
    fit_parameters,
    refine_undamped,
)
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import (
    keep_informative,
    marginalize_initial_states,
)
from ..estimation.noise import noise_ratio, normalize_rms
from ..estimation.nonsmooth import fit_smoothed, search_along_valleys, search_multiples
from ..estimation.problem import Problem
from ..estimation.reweighting import downweight_unscored, reestimate_misleading_states
from ..estimation.settings import FIT
from ..simulation.dataset import (
    FITTED_SEGMENTS,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
)
from .hypotheses import Hypothesis
from .settings import SELECTION
from .stated_values import fix_effects
from .subsampling import count_native_steps, draw_segments, mean_seconds


def refine_hypothesis(dataset: Dataset, hypothesis: Hypothesis) -> Hypothesis:
    """Fit a hypothesis to more segments, long ones if their initial states allow it.

    Of many values hardly more short segments can be fitted than the search had: then
    its own serve.
    """
    fit, searched = hypothesis.final, hypothesis.problem
    sigma = downweight_unscored(fit)
    rng = np.random.default_rng(2)
    wanted = SELECTION.refit_jacobian_steps / max(len(fit.values), 1)
    least, most = count_native_steps(searched), SELECTION.refit_steps
    steps = max(int(min(wanted, most)), least)
    onsets = [n.term.onset for n in hypothesis.named if n.term.onset]
    is_short = mean_seconds(searched) < SELECTION.long_segment
    keeps = is_short and not onsets and steps < SELECTION.min_more_steps * least

    def pose(seconds: float) -> Problem:
        """Segments of about that length [s]."""
        if keeps and seconds == SHORT_SEGMENT:
            return replace(searched, sigma=sigma)
        segments = _cut(dataset, seconds, onsets)
        problem = Problem(dataset.training, segments, sigma)
        return problem.select(draw_segments(problem, steps, rng))

    lengths = (SHORT_SEGMENT, *FITTED_SEGMENTS[: 1 if onsets else None])
    informative = keep_informative(map(pose, lengths), fit.terms, fit.values)
    return _refit(*_lengthen(informative, hypothesis), hypothesis)


def _cut(dataset: Dataset, seconds: float, onsets: Sequence[Onset]) -> Segments:
    """Segments of about that length [s] in which no effect may have set in."""
    simulator = dataset.training
    segments = cut_readable_segments(simulator, seconds)
    episodes = [simulator.episodes[i] for i in segments.episode]
    number = np.array([e.number for e in episodes])
    begin = np.array([e.start for e in episodes])
    begin = begin + segments.first_step * simulator.timestep
    end = begin + segments.lengths * simulator.timestep
    keeps = np.ones(len(segments), bool)
    for x in onsets:
        keeps &= (number != x.number) | (end <= x.low) | (begin >= x.high)
    return segments.select(np.flatnonzero(keeps)) if keeps.any() else segments


def _lengthen(
    problems: Sequence[Problem], hypothesis: Hypothesis
) -> tuple[Problem, Floats]:
    """The longest segments that a hypothesis can be made to predict as well as short.

    What builds up over longer ones is fitted there first. Over still longer ones errors
    of the time step, or of what is missing, can grow so far that they decide the fit.

    Returns:
        The segments, and values (P) of the hypothesis that were fitted on the way.
    """
    fit = hypothesis.final
    limit = SELECTION.max_horizon_growth * max(1.0, noise_ratio(fit))
    longest, values = problems[0], fit.values
    for problem in problems:
        longer = marginalize_initial_states(problem, fit.terms, values)
        residuals = longer.residuals_at(fit.terms, values)
        if normalize_rms(longer, residuals) >= limit:
            tried = fit_parameters(longer, fit.terms, values, iterations=6)
            if normalize_rms(longer, tried.residuals) >= limit:
                break
            values = tried.values
        longest = longer
    return longest, values


def _refit(problem: Problem, start: Floats, hypothesis: Hypothesis) -> Hypothesis:
    """Fit the nominal terms alone, and all terms of a hypothesis, to other segments.

    Args:
        start: (P) values of the hypothesis to begin with.
        hypothesis: fitted to the segments of the search.
    """
    old, nominal = hypothesis.final, hypothesis.nominal
    named = tuple(n.term for n in hypothesis.named)
    if named:
        residuals = problem.residuals_at(old.terms, start)
        if normalize_rms(problem, residuals) > FIT.unexplained_ratio:
            start = search_multiples(problem, old.terms, start)
    jacobian = None
    if problem.segments is hypothesis.problem.segments:
        jacobian = old.transfer_jacobian(problem)
    final = fit_parameters(problem, old.terms, start, iterations=6, jacobian=jacobian)
    alone = final
    if named:
        jacobian = final.restore(named).jacobian_without(*named)
        terms, values = nominal.terms, nominal.values
        alone = (
            fit_by_updates(problem, terms, values, 6, jacobian)
            if problem.regime.is_nonsmooth
            else fit_parameters(problem, terms, values, iterations=6, jacobian=jacobian)
        )
        left = noise_ratio(final)
        if problem.regime.is_nonsmooth:
            if left > FIT.strictly_unexplained_ratio:  # the cost has many minima
                final = replace(final, values=search_along_valleys(final))
                final = fit_smoothed(final)
        elif not problem.regime.has_rough_cost:
            final = reestimate_misleading_states(final)
        if final.problem is not problem:  # its initial states are other ones
            problem, jacobian = final.problem, alone.transfer_jacobian(final.problem)
            alone = fit_parameters(
                problem, alone.terms, alone.values, iterations=0, jacobian=jacobian
            )
    # in contact, or where error is left, the cost is too rough for it
    if (
        not problem.regime.has_rough_cost
        and noise_ratio(final) <= FIT.unexplained_ratio
    ):
        final = refine_undamped(final)
    return replace(hypothesis, nominal=alone if named else final, final=final)


def refit_native_timestep(base: LinearizedFit) -> LinearizedFit:
    """Fit nominal values to the model's own time step; effects keep their values.

    This is what a user sees who replays the model: half a step early, and with another
    damping than in continuous time. A fit in continuous time gives the effects' truth.

    Returns:
        The fit in the same segments, stepped as MuJoCo does.
    """
    fit, native = base.fit, base.problem.native
    best = fit_parameters(
        native, fix_effects(fit), fit.values, iterations=2, jacobian=fit.jacobian
    )
    return LinearizedFit.from_fit(replace(best, terms=fit.terms))
