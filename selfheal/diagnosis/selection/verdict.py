"""How far a hypothesis holds: takes it, gives a verdict and held-out errors.

A test for lack of fit, by a free-form torque and by the size of the residuals, and a
replay of the held-out episodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.free_form import FreeFormTorque
from ..estimation.candidate_fit import fit_candidate
from ..estimation.jacobian import compute_jacobian
from ..estimation.least_squares import fit_parameters
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import (
    expected_cost,
    expected_noise,
    robust_noise,
    worst_channel_ratio,
)
from ..estimation.problem import Problem
from ..estimation.settings import FIT
from ..simulation import score
from ..simulation.dataset import SHORT_SEGMENT, Dataset, cut_readable_segments
from ..simulation.simulator import Simulator
from .cross_validation import ScoredFit
from .evidence import improvement_p_value
from .holdout import squared_error, squared_error_reestimated
from .hypotheses import Hypothesis
from .replay_scores import HeldOutScores, explainable_removed
from .screening import (
    draw_segments,
    mean_seconds,
    select_hard_segments,
    subsample_problem,
)
from .settings import SELECTION


def _share_removed_in_segments(dataset: Dataset, hypothesis: Hypothesis) -> float:
    """Share [1] of the explainable error that names remove in held-out segments.

    Of root mean squares e: (e_nominal - e_final) / (e_nominal - e_noise). Signals weigh
    as in the fit: a score over their spread there may be of little but one that hardly
    moves in a few poses. A replay of a chaotic robot tells where it was when it began.
    """
    sigma, fit = hypothesis.problem.sigma, hypothesis.final.fit
    segments = cut_readable_segments(dataset.held_out, SHORT_SEGMENT)
    held_out = Problem(dataset.held_out, segments, sigma)
    held_out = marginalize_initial_states(held_out, fit.terms, fit.values)
    before, after = np.sqrt(
        [
            squared_error_reestimated(held_out, hypothesis.nominal.fit),
            squared_error(held_out, fit),
        ]
    )
    explainable = before - np.sqrt(expected_noise(held_out))
    least = SELECTION.min_explainable_error * before
    return float((before - after) / max(explainable, least))


@dataclass(frozen=True)
class RemainingStructure:
    """What the named effects leave.

    Attributes:
        p_value: that a free-form torque explains no more of it.
        share: of the squared error that a free-form torque explains.
        noise_ratio: root mean square of the residuals over what noise and time step
            leave.
        worst_channel_ratio: the same in the worst scored column.
        explained: share of the explainable squared error that the names explain.
    """

    p_value: float
    share: float
    noise_ratio: float
    worst_channel_ratio: float
    explained: float

    @property
    def is_significant(self) -> bool:
        """Whether something is left that is no noise."""
        is_shown = (
            self.p_value < SELECTION.remaining_p_value
            and self.share > SELECTION.min_remaining_share
        )
        return (is_shown and self.noise_ratio > 1) or max(
            self.noise_ratio, self.worst_channel_ratio
        ) > FIT.unexplained_ratio


def analyze_remaining(dataset: Dataset, hypothesis: Hypothesis) -> RemainingStructure:
    """Look for structure that the names leave, in some of the training segments.

    A likelihood-ratio test of a free-form torque of each joint, and the size of the
    residuals beside that of noise and time step.
    """
    problem, jacobian = _pose_in_short_segments(dataset, hypothesis)
    fit = hypothesis.final.fit
    fit = fit_parameters(
        problem, fit.terms, fit.values, iterations=0, jacobian=jacobian
    )
    base, old = LinearizedFit.from_fit(fit), ScoredFit.from_fit(fit)
    p_value, share = 1.0, 0.0
    terms = FreeFormTorque().propose_terms(dataset.robot)
    for term in _choose_likeliest(base, terms):
        new = ScoredFit.from_fit(fit_candidate(base, term, iterations=2))
        p = improvement_p_value(old, new, len(terms))
        p_value = min(p_value, p)
        share = max(share, 1 - new.error / old.error)
    left = fit.cost
    before = (
        squared_error_reestimated(problem, hypothesis.nominal.fit)
        if hypothesis.named
        else left
    )
    noise = expected_cost(fit)
    if hypothesis.named and problem.regime.has_single_readings:
        noise = max(noise, robust_noise(problem, fit.residuals))
    return RemainingStructure(
        p_value,
        share,
        float(np.sqrt(left / max(noise, 1e-12))),
        worst_channel_ratio(fit),
        float((before - left) / max(before - noise, 1e-12)),
    )


def _choose_likeliest(base: LinearizedFit, terms: Sequence[Term]) -> list[Term]:
    """The few of many terms that would lower the cost most in the hardest segments.

    By a score test (Rao 1948).

    Args:
        base: the fit without them.
        terms: as many parameters each, which do nothing at their nominal values.
    """
    most = SELECTION.max_free_forms
    if len(terms) <= most:
        return list(terms)
    steps, rng = SELECTION.screening_steps[0], np.random.default_rng(5)
    base = select_hard_segments(base, steps, rng)
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
    problem, fit = hypothesis.problem, hypothesis.final.fit
    rng = np.random.default_rng(1)
    if mean_seconds(problem) < SELECTION.long_screening_segment:
        chosen = draw_segments(problem, SELECTION.remaining_steps, rng)
        rows = np.isin(problem.segment_of_residual, chosen)
        return problem.select(chosen), fit.jacobian[rows]
    segments = cut_readable_segments(dataset.training, SHORT_SEGMENT)
    whole = Problem(dataset.training, segments, problem.sigma)
    part = subsample_problem(whole, SELECTION.remaining_steps, rng)
    return marginalize_initial_states(part, fit.terms, fit.values), None


def drop_names(hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis without any name."""
    return replace(hypothesis, named=(), final=hypothesis.nominal)


def decide_verdict(
    hypothesis: Hypothesis, structure: RemainingStructure
) -> tuple[Hypothesis, str]:
    """The verdict, and the hypothesis without names if these explain too little."""
    if (
        hypothesis.named
        and structure.is_significant
        and structure.explained < SELECTION.min_explained_error
    ):
        return drop_names(hypothesis), "unlisted"
    if hypothesis.named:
        is_whole = (
            structure.explained > SELECTION.fully_explained_error
            or not structure.is_significant
        )
        return hypothesis, "explained" if is_whole else "partly"
    return hypothesis, "unlisted" if structure.is_significant else "nothing"


def withhold_verdict(verdict: str, is_stopped: bool) -> str:
    """The verdict of a search, as far as one that was stopped bears it out.

    What it did not try may explain the structure that it leaves.
    """
    return "undecided" if is_stopped and verdict == "unlisted" else verdict


def limit_verdict(verdict: str, scores: HeldOutScores) -> str:
    """The verdict as far as the scores over all horizons bear it out.

    Nothing is missing only where the replay is about as good as noise allows, and all
    is explained only where the names remove nearly all of what can be explained.

    Args:
        verdict: by the residuals.
        scores: of the hypothesis.
    """
    if verdict == "nothing" and any(
        h.floor_ratio > SELECTION.max_floor_ratio_of_nothing for h in scores.horizons
    ):
        return "unlisted"
    removed = [explainable_removed(h.numbers) for h in scores.horizons]
    if verdict == "explained" and any(
        share is not None and share < SELECTION.fully_explained_error
        for share in removed
    ):
        return "partly"
    return verdict


def predicts_worse(scores: HeldOutScores, others: Sequence[str]) -> bool:
    """Whether the patched model predicts worse than others over some horizon.

    By 5 %, and by more than the floor that noise leaves; or whether it diverges.

    Args:
        scores: of the models, by name.
        others: names of the others.
    """
    ratio = SELECTION.worse_replay_ratio
    return any(
        not h["patched"] <= ratio * max(min(h[name] for name in others), h["floor"])
        for h in (scores.numbers, *(h.numbers for h in scores.horizons))
        if np.isfinite(min(h[name] for name in others))
    )


def removes_too_little(
    dataset: Dataset, hypothesis: Hypothesis, scores: HeldOutScores
) -> bool:
    """Whether names remove next to nothing of the explainable held-out error.

    Args:
        dataset: with the held-out episodes.
        hypothesis: with names.
        scores: its replay.
    """
    if scores.segments.is_single_readings:
        share = _share_removed_in_segments(dataset, hypothesis)
        return share < SELECTION.min_removed_error
    removed = explainable_removed(scores.numbers)
    if removed is None or removed >= SELECTION.min_removed_error:
        return False
    share = _share_removed_in_segments(dataset, hypothesis)
    return share < SELECTION.min_explained_error


def is_replay_off(
    dataset: Dataset, hypothesis: Hypothesis, scores: HeldOutScores
) -> bool:
    """Whether a replay of the held-out episodes is farther off than noise can make it.

    It has to be so without the time step's own error as well. Of a robot with contact
    it has to be so in most episodes: in one it may fall on another side by chance.
    Single readings do not tell the noise.

    Args:
        dataset: with the held-out episodes.
        hypothesis: that was replayed.
        scores: its replay.
    """
    if scores.segments.is_single_readings:
        return False
    simulator, fit = dataset.held_out.native, hypothesis.final.fit
    limit = SELECTION.max_replay_floor_ratio * scores.numbers["floor"]
    if _typical_score(simulator, scores.squares["patched"], scores.count) <= limit:
        return False
    squares = score.sum_squared_errors(
        simulator, scores.segments, fit.terms, fit.values, centered=True
    )
    return _typical_score(simulator, squares, scores.count) > limit


def _typical_score(simulator: Simulator, squares: Floats, count: Floats) -> float:
    """Score [1] of all episodes, or in contact the median of their scores.

    Args:
        simulator: of the held-out episodes.
        squares: (E, S) [unit of the signal, squared] errors.
        count: (E, S) readings.
    """
    if not simulator.has_contact:
        return score.compute_score(simulator, squares, count)
    scores = [
        score.compute_score(simulator, s[None], n[None])
        for s, n in zip(squares, count, strict=True)
    ]
    return float(np.nanmedian(scores))
