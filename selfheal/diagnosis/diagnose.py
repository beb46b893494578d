"""A model and recordings in, a diagnosis out: read, fit, choose, test, answer."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..recording import Recording
from .effects import load_catalogue
from .effects.base import Onset, Term
from .effects.nominal import build_nominal_terms
from .estimation.problem import (
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
from .selection.hypotheses import finish_early, name_effects, start_search
from .selection.quantization import name_quantization
from .selection.refine import refine_hypothesis
from .selection.replay_scores import HeldOutScores, explainable_removed
from .selection.search_record import Progress, SearchRecord
from .selection.search_state import SearchState
from .selection.stated_values import hold_stated, round_effects
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
from .simulation.checks import check_dataset
from .simulation.dataset import SHORT_SEGMENT, Dataset, prepare_dataset

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
    record = SearchRecord(progress, TimeLeft(begun), is_over)

    def start(held_out: Sequence[str]) -> tuple[_Stages, Onset | None]:
        """Stages 1 and 2: the recordings, split and checked, and the nominal fit."""
        record.enter(Stage.READ, "reading")
        dataset = prepare_dataset(model, recordings, held_out, memory)
        check_dataset(dataset)
        if reason := explain_unpatchable(model):
            what = f"patched.xml will be the model as given: {reason}"
            record.enter(Stage.READ, what)
        stages = _Stages(dataset, record, seed)
        return stages, stages.fit_nominal()

    stages, onset = start(held_out)
    if onset and not held_out:
        later = choose_held_out_after(onset, recordings, stages.dataset.held_out)
        if later:  # what is held out now could not show it
            stages, _ = start(later)
    stages.choose_effects()
    stages.fit_last(findings_only)
    return stages.test(begun)


class _Stages:
    """Stages 2 to 5 of a diagnosis, and what each leaves to the next.

    Where time is over in one of them, what it has found so far.

    Attributes:
        dataset: the recordings; after the last fit with the noise that this tells.
    """

    def __init__(self, dataset: Dataset, record: SearchRecord, seed: int) -> None:
        """`seed`: of the segments of the search."""
        self.dataset, self._record = dataset, record
        self._rng = np.random.default_rng(seed)
        self._problem = build_problem(dataset, SHORT_SEGMENT)
        check_enough_segments(dataset.training, self._problem)

    def fit_nominal(self) -> Onset | None:
        """Stage 2: the nominal model's values, and since when they do not explain all.

        The model as it is given, where time is over before they are fitted.
        """
        onset, state, record = None, None, self._record
        record.enter(Stage.NOMINAL, "refitting what the model states")
        with record.limit(self.dataset.training, SEARCH_SHARE):
            state = self._start_search(build_nominal_terms(self.dataset.robot))
            onset = None if state.is_explained else detect_change_point(state.best)
        self._state = state or self._start_search(())
        candidates = set_onset(self._state.candidates, onset)
        self._state = replace(self._state, candidates=candidates)
        return onset

    def _start_search(self, terms: Sequence[Term]) -> SearchState:
        """The state in which nothing has a name, and these terms are fitted."""
        effects, robot = load_catalogue().values(), self.dataset.robot
        return start_search(self._problem, robot, terms, effects, self._rng)

    def choose_effects(self) -> None:
        """Stage 3: a hypothesis of what is missing; held-out episodes choose."""
        record, problem, state = self._record, self._problem, self._state
        longer, found = build_longer_problems(self.dataset, problem), None
        with record.limit(self.dataset.training, SEARCH_SHARE):
            found = name_effects(state, problem, longer, self._rng, record)
        found = found or finish_early(record, state, problem)
        self._hypothesis = choose_hypothesis(self.dataset.held_out, found)
        self._is_stopped = bool(record.stopped)
        self._effects = {t.effect.name for t in state.candidates}
        self._untried = record.list_untried(state.candidates)
        # each Jacobian of many joints takes as much as the whole program
        del self._state
        record.forget_state()

    def fit_last(self, findings_only: bool) -> None:
        """The last fit of the hypothesis, in more and longer segments.

        Args:
            findings_only: whether it leaves what the model states.
        """
        found, record = self._hypothesis, self._record
        self.dataset = self.dataset.with_noise_of(found.problem.simulator)
        record.enter(Stage.LAST_FIT, "fitting everything once more")
        if findings_only:
            found = self._hypothesis = hold_stated(found)
        with record.limit(self.dataset.training, FIT_SHARE):
            refined = refine_hypothesis(self.dataset, found)
            refined = keep_predictive(self.dataset.held_out, refined, found)
            self._hypothesis = leave_bounds(self.dataset, refined)

    def test(self, begun: float) -> Diagnosis:
        """Stages 4 and 5: which names hold in held-out episodes, and the answer.

        Args:
            begun: `time.monotonic()` [s] when all of it began.
        """
        dataset, record = self.dataset, self._record
        record.enter(Stage.TESTS, "testing what was found on the held-out episodes")
        found, refuted = drop_refuted(dataset.held_out, self._hypothesis)
        found = round_effects(found)
        record.enter(Stage.TESTS, "looking for what has no name")
        structure = analyze_remaining(dataset, found)
        if explains_too_little(structure):
            found = drop_names(found)
        scores = HeldOutScores.compute(dataset, found)
        is_worse = bool(found.named) and (
            predicts_worse(scores) or is_outdone_by_refit(scores)
        )
        if is_worse or removes_too_little(scores):
            # what does not predict where nothing was fitted is no finding
            refuted = (*refuted, *(n.term.label for n in found.named))
            scores = HeldOutScores.compute(dataset, drop_names(found))
        if not scores.hypothesis.named and predicts_worse(scores):
            scores = HeldOutScores.compute(dataset, hold_stated(scores.hypothesis))
        count = len(scores.hypothesis.named)
        found = name_quantization(scores.hypothesis, dataset.robot)
        if len(found.named) > count:
            scores = scores.with_quantization(found)
        verdict = decide_verdict(
            Outcome(
                has_names=count > 0,
                has_quantization=len(found.named) > count,
                has_structure=structure.is_significant or is_worse,
                explained=structure.explained,
                is_replay_off=is_replay_off(scores),
                floor_ratios=tuple(h.floor_ratio for h in scores.horizons),
                removed=tuple(explainable_removed(h.numbers) for h in scores.horizons),
                is_stopped=self._is_stopped,
            )
        )
        tested = TestedHypothesis(found, verdict, scores, structure, refuted)
        answer = build_diagnosis(dataset, tested, begun)
        if not record.stopped:
            return answer
        return answer.with_stop(record.stopped, len(self._effects), self._untried)
