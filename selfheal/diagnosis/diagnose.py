"""A model and recordings in, a diagnosis out: read, fit, choose, test, answer."""

import os
import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ..recording import Recording
from .effects import load_catalogue
from .effects.base import Onset, Term
from .effects.nominal import build_nominal_terms
from .estimation.problem import (
    Problem,
    build_longer_problems,
    build_problem,
    check_enough_segments,
)
from .output.build_result import (
    TestedHypothesis,
    build_diagnosis,
    explain_unpatchable,
)
from .output.result import Diagnosis
from .selection.change_point import (
    choose_held_out_after,
    detect_change_point,
    set_onset,
)
from .selection.holdout import (
    choose_hypothesis,
    drop_refuted,
    keep_predictive,
    leave_bounds,
)
from .selection.hypotheses import (
    Hypothesis,
    finish_early,
    name_effects,
    start_search,
)
from .selection.quantization import name_quantization
from .selection.refine import refine_hypothesis
from .selection.replay_scores import HeldOutScores, explainable_removed
from .selection.search_record import Progress, SearchRecord
from .selection.search_state import SearchState
from .selection.stated_values import (
    hold_stated,
    round_effects,
)
from .selection.structure import analyze_remaining
from .selection.time_left import Stage, TimeLeft
from .selection.verdict import (
    Outcome,
    decide_verdict,
    drop_names,
    explains_too_little,
    is_outdone_by_refit,
    is_replay_off,
    predicts_worse,
    removes_too_little,
)
from .simulation.cache import OutOfTime
from .simulation.checks import check_dataset
from .simulation.dataset import (
    SHORT_SEGMENT,
    Dataset,
    prepare_dataset,
)

# shares of the time at which search and last fit are stopped; chosen: the tests of what
# was found take a fifth to a quarter of a whole diagnosis
SEARCH_SHARE, FIT_SHARE = 0.55, 0.75


def diagnose(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    *,
    held_out: Sequence[str] = (),
    seed: int = 0,
    memory: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    is_over: Callable[[float], bool] = lambda share: False,
    findings_only: bool = False,
    begun: float | None = None,
) -> Diagnosis:
    """Where simulation and reality differ, and which physics was left out.

    Args:
        model: MJCF or URDF.
        held_out: episodes or parts kept from the fit, as `recording.split` takes them.
        seed: of the segments that candidates are first tried on.
        memory: folder of what was worked out, in which a killed run goes on.
        progress: called with a message and the share (0 to 1) of the time that is over,
            about; 0 as long as nothing is known of it.
        is_over: whether a share (0 to 1) of the time is over, so that what was found so
            far is the answer.
        findings_only: whether what the model states stays as it is in the end.
        begun: `time.monotonic()` [s] when all of it began; None: now.

    Raises:
        ModelError: MuJoCo cannot load the model, or it diverges.
        RecordingError: a recording does not fit it, or is too short or too quiet.
    """
    begun = time.monotonic() if begun is None else begun
    record = SearchRecord(progress, TimeLeft(begun))
    start = partial(_start, model, recordings, memory, seed, record, is_over)
    dataset, problem, rng, state, onset = start(held_out)
    if onset and not held_out:
        later = choose_held_out_after(onset, recordings, dataset.held_out)
        if later:  # what is held out now could not show it
            dataset, problem, rng, state, onset = start(later)
    hypothesis = _choose_effects(dataset, problem, state, rng, record, is_over)
    is_stopped = bool(record.stopped)  # before the search was through
    effects = {t.effect.name for t in state.candidates}
    untried = record.list_untried(state.candidates)
    del state  # each Jacobian of many joints takes as much as the whole program
    dataset, hypothesis = _fit_last(dataset, hypothesis, record, is_over, findings_only)
    tested = _test(dataset, hypothesis, is_stopped, record)
    found = build_diagnosis(dataset, tested, begun)
    if not record.stopped:
        return found
    return found.with_stop(record.stopped, len(effects), untried)


def _start(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    memory: str | os.PathLike[str] | None,
    seed: int,
    record: SearchRecord,
    is_over: Callable[[float], bool],
    held_out: Sequence[str],
) -> tuple[Dataset, Problem, np.random.Generator, SearchState, Onset | None]:
    """Stages 1 and 2, and what draws segments from then on.

    Args:
        model: MJCF or URDF.
        memory: folder of what was worked out.
        seed: of the segments of the search.
        is_over: whether a share of the time is over.
        held_out: episodes or parts of them kept from the fit.
    """
    rng = np.random.default_rng(seed)
    dataset, problem = _read(model, recordings, held_out, memory, record)
    state, onset = _fit_nominal(dataset, problem, rng, record, is_over)
    return dataset, problem, rng, state, onset


def _read(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    held_out: Sequence[str],
    memory: str | os.PathLike[str] | None,
    record: SearchRecord,
) -> tuple[Dataset, Problem]:
    """Stage 1: the recordings, split and checked, and the segments to fit."""
    record.enter(Stage.READ, "reading")
    dataset = prepare_dataset(model, recordings, held_out, memory)
    check_dataset(dataset)
    if reason := explain_unpatchable(model):
        record.enter(Stage.READ, f"patched.xml will be the model as given: {reason}")
    problem = build_problem(dataset, SHORT_SEGMENT)
    check_enough_segments(dataset.training, problem)
    return dataset, problem


def _fit_nominal(
    dataset: Dataset,
    problem: Problem,
    rng: np.random.Generator,
    record: SearchRecord,
    is_over: Callable[[float], bool],
) -> tuple[SearchState, Onset | None]:
    """Stage 2: the nominal model's values, and since when they do not explain it all.

    Where time is over before they are fitted, the model as it is given.

    Args:
        rng: draws the segments of the search.
        is_over: whether a share of the time is over.
    """

    def start(terms: Sequence[Term]) -> SearchState:
        """The state in which nothing has a name, and these terms are fitted."""
        effects = load_catalogue().values()
        return start_search(problem, dataset.robot, terms, effects, rng=rng)

    state = None
    record.enter(Stage.NOMINAL, "refitting what the model states")
    try:
        with problem.simulator.counter.limit(lambda: is_over(SEARCH_SHARE)):
            state = start(build_nominal_terms(dataset.robot))
            onset = None if state.is_explained else detect_change_point(state.best)
    except OutOfTime:
        record.stop()
        return state or start(()), None
    return state.with_candidates(set_onset(state.candidates, onset)), onset


def _choose_effects(
    dataset: Dataset,
    problem: Problem,
    state: SearchState,
    rng: np.random.Generator,
    record: SearchRecord,
    is_over: Callable[[float], bool],
) -> Hypothesis:
    """Stage 3: a hypothesis of what is missing; held-out episodes choose of several.

    Where time is over, what the search found so far.

    Args:
        state: of a search in which nothing has a name.
        is_over: whether a share of the time is over.
    """
    longer = build_longer_problems(dataset, problem)
    counter = problem.simulator.counter
    try:
        with counter.limit(lambda: is_over(SEARCH_SHARE)):
            found = name_effects(state, problem, longer, rng=rng, record=record)
    except OutOfTime:
        record.stop()
        found = finish_early(record, state, problem)
    return choose_hypothesis(dataset, found)


def _fit_last(
    dataset: Dataset,
    hypothesis: Hypothesis,
    record: SearchRecord,
    is_over: Callable[[float], bool],
    findings_only: bool,
) -> tuple[Dataset, Hypothesis]:
    """The last fit of a hypothesis; as the search fitted it where time is over.

    Args:
        record: of the search, whose state goes.
        is_over: whether a share of the time is over.
        findings_only: whether the last fit leaves what the model states.

    Returns:
        The dataset, which knows the noise that the fit tells, and the hypothesis.
    """
    record.forget_state()
    counter = hypothesis.problem.simulator.counter
    dataset = dataset.with_noise_of(hypothesis.problem.simulator)
    record.enter(Stage.LAST_FIT, "fitting everything once more")
    if findings_only:
        hypothesis = hold_stated(hypothesis)
    try:
        with counter.limit(lambda: is_over(FIT_SHARE)):
            refined = refine_hypothesis(dataset, hypothesis)
            refined = keep_predictive(dataset, refined, hypothesis)
            return dataset, leave_bounds(dataset, refined)
    except OutOfTime:
        record.stop()
        return dataset, hypothesis


def _test(
    dataset: Dataset, hypothesis: Hypothesis, is_stopped: bool, record: SearchRecord
) -> TestedHypothesis:
    """Stage 4: which names hold in the held-out episodes, and what they leave.

    Args:
        is_stopped: whether the search was stopped before its end.
    """
    record.enter(Stage.TESTS, "testing what was found on the held-out episodes")
    hypothesis, refuted = drop_refuted(dataset, hypothesis)
    hypothesis = round_effects(hypothesis)
    record.enter(Stage.TESTS, "looking for what has no name")
    structure = analyze_remaining(dataset, hypothesis)
    if explains_too_little(structure):
        hypothesis = drop_names(hypothesis)
    scores = HeldOutScores.compute(dataset, hypothesis)
    is_worse = bool(hypothesis.named) and (
        predicts_worse(scores, ("given",)) or is_outdone_by_refit(dataset, scores)
    )
    if is_worse or removes_too_little(dataset, hypothesis, scores):
        # what does not predict where nothing was fitted is no finding
        refuted = (*refuted, *(n.term.label for n in hypothesis.named))
        hypothesis = drop_names(hypothesis)
        scores = HeldOutScores.compute(dataset, hypothesis)
    if not hypothesis.named and predicts_worse(scores, ("given",)):
        hypothesis = hold_stated(hypothesis)
        scores = HeldOutScores.compute(dataset, hypothesis)
    count, catalogue = len(hypothesis.named), load_catalogue().values()
    hypothesis = name_quantization(hypothesis, dataset.robot, catalogue)
    if len(hypothesis.named) > count:
        scores = scores.with_quantization(dataset, hypothesis)
    outcome = Outcome(
        count > 0,
        len(hypothesis.named) > count,
        structure.is_significant or is_worse,
        structure.explained,
        is_replay_off(dataset, hypothesis, scores),
        tuple(h.floor_ratio for h in scores.horizons),
        tuple(explainable_removed(h.numbers) for h in scores.horizons),
        is_stopped,
    )
    verdict = decide_verdict(outcome)
    return TestedHypothesis(hypothesis, verdict, scores, structure, refuted)
