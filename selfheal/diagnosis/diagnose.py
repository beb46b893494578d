"""A model and recordings in, a diagnosis out: read, fit, choose, test, answer."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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
from .selection.hypotheses import Hypothesis, finish_early, name_effects, start_search
from .selection.quantization import name_quantization
from .selection.refine import refine_hypothesis
from .selection.replay_scores import HeldOutScores, explainable_removed
from .selection.search_record import Progress, SearchRecord
from .selection.search_state import SearchState
from .selection.stated_values import hold_stated, round_effects
from .selection.structure import RemainingStructure, analyze_remaining
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


def diagnose(  # noqa: PLR0913, what a user may ask for
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
    stages = _Stages(
        os.fspath(model), recordings, held_out, memory, seed, findings_only, record
    )
    if not held_out and (later := stages.list_episodes_after_onset()):
        stages = replace(stages, held_out=later)  # none held out could show it
    return stages.answer(begun)


@dataclass(eq=False)
class _Stages:
    """The stages of a diagnosis: each is computed once, from those before it.

    Where time is over in one of them, it is what was found so far.

    Attributes:
        seed: of the segments of the search.
        findings_only: whether the last fit leaves what the model states.
    """

    model: str
    recordings: Sequence[Recording]
    held_out: Sequence[str]
    memory: str | os.PathLike[str] | None
    seed: int
    findings_only: bool
    record: SearchRecord

    @cached_property
    def dataset(self) -> Dataset:
        """Stage 1: the recordings, split and checked."""
        self.record.enter(Stage.READ, "reading")
        dataset = prepare_dataset(
            self.model, self.recordings, self.held_out, self.memory
        )
        check_dataset(dataset)
        return dataset

    @cached_property
    def problem(self) -> Problem:
        """The segments to fit."""
        training = self.dataset.training
        if reason := explain_unpatchable(self.model):
            what = f"patched.xml will be the model as given: {reason}"
            self.record.enter(Stage.READ, what)
        problem = build_problem(self.dataset, SHORT_SEGMENT)
        check_enough_segments(training, problem)
        return problem

    @cached_property
    def rng(self) -> np.random.Generator:
        """Draws segments, in the nominal fit and then in the search."""
        return np.random.default_rng(self.seed)

    @cached_property
    def nominal(self) -> tuple[SearchState, Onset | None]:
        """Stage 2: the nominal model's values, and since when they do not explain all.

        The model as it is given, where time is over before they are fitted.
        """
        onset, state, problem = None, None, self.problem
        self.record.enter(Stage.NOMINAL, "refitting what the model states")
        with self.record.limit(problem.simulator, SEARCH_SHARE):
            state = self._start_search(build_nominal_terms(self.dataset.robot))
            onset = None if state.is_explained else detect_change_point(state.best)
        state = state or self._start_search(())
        return replace(state, candidates=set_onset(state.candidates, onset)), onset

    def _start_search(self, terms: Sequence[Term]) -> SearchState:
        """The state in which nothing has a name, and these terms are fitted."""
        effects, robot = load_catalogue().values(), self.dataset.robot
        return start_search(self.problem, robot, terms, effects, self.rng)

    def list_episodes_after_onset(self) -> tuple[str, ...]:
        """Later ones than an onset to hold out, if what is held out is not; or none."""
        _, onset = self.nominal
        if not onset:
            return ()
        return choose_held_out_after(onset, self.recordings, self.dataset.held_out)

    @cached_property
    def chosen(self) -> Hypothesis:
        """Stage 3: what is missing; held-out episodes choose of several hypotheses."""
        (state, _), problem, found = self.nominal, self.problem, list[Hypothesis]()
        longer = build_longer_problems(self.dataset, problem)
        with self.record.limit(problem.simulator, SEARCH_SHARE):
            found = name_effects(state, problem, longer, self.rng, self.record)
        found = found or finish_early(self.record, state, problem)
        self.record.end_search(state.candidates)
        del self.nominal  # each Jacobian takes as much as the whole program
        return choose_hypothesis(self.dataset.held_out, found)

    @cached_property
    def refined(self) -> tuple[Dataset, Hypothesis]:
        """The last fit of the hypothesis, and the data with the noise that it tells."""
        found = self.chosen
        dataset = self.dataset.with_noise_of(found.problem.simulator)
        self.record.enter(Stage.LAST_FIT, "fitting everything once more")
        if self.findings_only:
            found = hold_stated(found)
        with self.record.limit(dataset.training, FIT_SHARE):
            refined = refine_hypothesis(dataset, found)
            refined = keep_predictive(dataset.held_out, refined, found)
            found = leave_bounds(dataset, refined)
        return dataset, found

    @cached_property
    def tested(self) -> tuple[Hypothesis, tuple[str, ...]]:
        """Stage 4: the names that hold in held-out episodes, and labels of others."""
        dataset, found = self.refined
        what = "testing what was found on the held-out episodes"
        self.record.enter(Stage.TESTS, what)
        found, refuted = drop_refuted(dataset.held_out, found)
        return round_effects(found), refuted

    @cached_property
    def structure(self) -> RemainingStructure:
        """What the names leave."""
        (dataset, _), (found, _) = self.refined, self.tested
        self.record.enter(Stage.TESTS, "looking for what has no name")
        return analyze_remaining(dataset, found)

    @cached_property
    def scores(self) -> tuple[HeldOutScores, tuple[str, ...], bool]:
        """Held-out scores of the answer, labels of names that go, if these harm."""
        (dataset, _), (found, refuted) = self.refined, self.tested
        if explains_too_little(self.structure):
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
        return scores, refuted, is_worse

    def answer(self, begun: float) -> Diagnosis:
        """Stage 5: the verdict, with signals that are rounded, and all that it is of.

        Args:
            begun: `time.monotonic()` [s] when all of it began.
        """
        (dataset, _), record = self.refined, self.record
        structure, (scores, refuted, is_worse) = self.structure, self.scores
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
                is_stopped=record.is_search_stopped,
            )
        )
        tested = TestedHypothesis(found, verdict, scores, structure, refuted)
        answer = build_diagnosis(dataset, tested, begun)
        if not record.stopped:
            return answer
        return answer.with_stop(record.stopped, record.effects, record.untried)
