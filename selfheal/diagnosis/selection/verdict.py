"""How far a hypothesis holds: takes it and its held-out errors, gives a verdict."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ...recording.data import Floats
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import expected_noise
from ..estimation.problem import Problem
from ..simulation import score
from ..simulation.dataset import SHORT_SEGMENT, cut_readable_segments
from ..simulation.simulator import Simulator
from .holdout import squared_error, squared_error_reestimated
from .hypotheses import Hypothesis
from .judge import Judge, is_outdone
from .replay_scores import HeldOutScores, explainable_removed
from .settings import SELECTION
from .structure import RemainingStructure


class Verdict(StrEnum):
    """How far a diagnosis goes (contract, section 2)."""

    NOTHING = "nothing"
    EXPLAINED = "explained"
    PARTLY = "partly"
    UNLISTED = "unlisted"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Outcome:
    """What a search and the tests of a hypothesis came to.

    Attributes:
        has_names: whether effects have a name.
        has_quantization: whether signals are named whose noise is rounding.
        has_structure: whether more than noise is left, or names were withdrawn that
            predict held-out episodes worse.
        explained: share of the explainable squared error that the names explain.
        is_replay_off: whether replays are farther off than noise can make them.
        floor_ratios: held-out error over the floor at each horizon.
        removed: share of the explainable held-out error that is removed at each
            horizon; None where there is too little.
        is_stopped: whether the search was stopped before its end.
    """

    has_names: bool
    has_quantization: bool
    has_structure: bool
    explained: float
    is_replay_off: bool
    floor_ratios: tuple[float, ...]
    removed: tuple[float | None, ...]
    is_stopped: bool


def decide_verdict(outcome: Outcome) -> Verdict:
    """The verdict on an outcome.

    Nothing is missing only where the replay is about as good as noise allows, and all
    is explained only where the names remove nearly all of what can be explained. What a
    stopped search did not try may explain the structure that it leaves.
    """
    most = SELECTION.fully_explained_error
    is_clean = not outcome.has_structure
    if outcome.has_names or outcome.has_quantization:
        is_whole = is_clean or (outcome.has_names and outcome.explained > most)
        is_replayed = not outcome.is_replay_off and all(
            share is None or share >= most for share in outcome.removed
        )
        return Verdict.EXPLAINED if is_whole and is_replayed else Verdict.PARTLY
    limit = SELECTION.max_floor_ratio_of_nothing
    is_floor = not any(ratio > limit for ratio in outcome.floor_ratios)
    if is_clean and is_floor and not outcome.is_replay_off:
        return Verdict.NOTHING
    return Verdict.UNDECIDED if outcome.is_stopped else Verdict.UNLISTED


def drop_names(hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis without any name."""
    return replace(hypothesis, named=(), final=hypothesis.nominal)


def _share_removed_in_segments(held_out: Simulator, hypothesis: Hypothesis) -> float:
    """Share [1] of the explainable error that names remove in held-out segments.

    Of root mean squares e: (e_nominal - e_final) / (e_nominal - e_noise). Signals weigh
    as in the fit: a score over their spread there may be of little but one that hardly
    moves in a few poses. A replay of a chaotic robot tells where it was when it began.
    """
    sigma, fit = hypothesis.problem.sigma, hypothesis.final
    segments = cut_readable_segments(held_out, SHORT_SEGMENT)
    problem = Problem(held_out, segments, sigma)
    problem = marginalize_initial_states(problem, fit.terms, fit.values)
    before = np.sqrt(squared_error_reestimated(problem, hypothesis.nominal))
    after = np.sqrt(squared_error(problem, fit))
    explainable = before - np.sqrt(expected_noise(problem))
    least = SELECTION.min_explainable_error * before
    return float((before - after) / max(explainable, least))


def explains_too_little(structure: RemainingStructure) -> bool:
    """Whether structure is left, and more of the error than the names explain."""
    is_little = structure.explained < SELECTION.min_explained_error
    return structure.is_significant and is_little


def is_outdone_by_refit(scores: HeldOutScores) -> bool:
    """Whether what the model states, re-fitted, predicts clearly better alone."""
    refit, patched = scores.refits["refit"], scores.refits["patched"]
    judge = Judge.build(scores.dataset.held_out, patched)
    alone, named = (judge.log_native_errors(fit) for fit in (refit, patched))
    return is_outdone(named, alone)


def predicts_worse(scores: HeldOutScores) -> bool:
    """Whether the patched model predicts worse than the given one over some horizon.

    By 5 %, and by more than the floor that noise leaves; or whether it diverges.
    """
    ratio = SELECTION.worse_replay_ratio
    return any(
        not h["patched"] <= ratio * max(h["given"], h["floor"])
        for h in (scores.numbers, *(h.numbers for h in scores.horizons))
        if np.isfinite(h["given"])
    )


def removes_too_little(scores: HeldOutScores) -> bool:
    """Whether names remove next to nothing of the explainable held-out error."""
    if not scores.hypothesis.named:
        return False
    least = SELECTION.min_removed_error
    if not scores.segments.is_single_readings:
        removed = explainable_removed(scores.numbers)
        if removed is None or removed >= least:
            return False
        least = SELECTION.min_explained_error
    held_out = scores.dataset.held_out
    return _share_removed_in_segments(held_out, scores.hypothesis) < least


def is_replay_off(scores: HeldOutScores) -> bool:
    """Whether a replay of the held-out episodes is farther off than noise can make it.

    It has to be so without the time step's own error as well. Of a robot with contact
    it has to be so in most episodes: in one it may fall on another side by chance.
    Single readings do not tell the noise.
    """
    if scores.segments.is_single_readings:
        return False
    simulator, fit = scores.dataset.held_out.native, scores.hypothesis.final
    limit = SELECTION.max_replay_floor_ratio * scores.numbers["floor"]
    if _typical_score(simulator, scores.squares["patched"], scores.count) <= limit:
        return False
    squares = score.sum_squared_errors(
        simulator.leapfrog, scores.segments, fit.terms, fit.values
    )
    return _typical_score(simulator, squares, scores.count) > limit


def _typical_score(simulator: Simulator, squares: Floats, count: Floats) -> float:
    """Score [1] of all episodes, or in contact the median of their scores.

    Args:
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
