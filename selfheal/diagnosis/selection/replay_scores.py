"""Errors in held-out episodes: takes a hypothesis, gives scores of its replay.

A replay is open loop from the given or estimated initial state. What builds up slowly
shows only in long segments, so that scores are given for several horizons.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.base import Term
from ..estimation.covariance import standard_errors
from ..estimation.fit import Fit
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.multiple_shooting import build_initial_state_offsets
from ..estimation.settings import FIT
from ..simulation import score
from ..simulation.dataset import (
    LONG_SEGMENTS,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
)
from ..simulation.simulator import Simulator
from .hypotheses import Hypothesis
from .judge import Judge, is_outdone
from .quantization import append_step
from .refine import refit_native_timestep
from .settings import SELECTION
from .stated_values import restore_stated
from .subsampling import draw_segments

Models = Mapping[str, tuple[tuple[Term, ...], Floats]]  # and their values (P)
# kind and unit of signals; name of a model, or "floor": error [that unit]
ErrorsByKind = dict[tuple[str, str], dict[str, float]]


@dataclass(frozen=True, eq=False)
class HorizonScores:
    """Scores [1] of a replay in segments of about one length.

    Attributes:
        seconds: that length [s].
        segments: that were replayed.
        count: (E, S) readings of each episode and signal.
        squares: (E, S) [unit of the signal, squared] errors of each model ("given",
            "refit" and "patched").
        numbers: score of each model, and the "floor" that noise, initial states and
            time step leave.
        by_kind: root mean square errors of each of them, by kind and unit of signals.
    """

    seconds: float
    segments: Segments
    count: Floats
    squares: dict[str, Floats]
    numbers: dict[str, float]
    by_kind: ErrorsByKind

    @property
    def floor_ratio(self) -> float:
        """Score of the patched model over the floor [1]."""
        return self.numbers["patched"] / max(self.numbers["floor"], FIT.tiny)


@dataclass(frozen=True, eq=False)
class HeldOutScores(HorizonScores):
    """Errors of a replay of whole held-out episodes.

    Attributes:
        dataset: of the episodes.
        hypothesis: that the patched model has.
        refits: of each model but the given one, by its name, as MuJoCo steps it.
        unrestored: the patched model's before stated values were restored and rounded.
        horizons: scores in longer and longer segments, up to whole episodes, as far as
            the robot can be predicted.
    """

    dataset: Dataset
    hypothesis: Hypothesis
    refits: dict[str, Fit]
    unrestored: Fit
    horizons: tuple[HorizonScores, ...]

    @classmethod
    def compute(cls, dataset: Dataset, hypothesis: Hypothesis) -> "HeldOutScores":
        """Replay the model as given, re-fitted, and with the named effects."""
        final = hypothesis.final if hypothesis.named else hypothesis.nominal
        refit = whole = _refit_some(hypothesis.nominal)
        if hypothesis.named:
            whole = _refit_some(final)
        patched = restore_stated(whole, standard_errors(final))
        judge = Judge.build(dataset.held_out, final)
        before, after = (judge.log_native_errors(x.fit) for x in (whole, patched))
        if is_outdone(after, before):
            patched = whole
        if not hypothesis.named:
            refit = patched
        refits = {"refit": refit.fit, "patched": patched.fit}
        return cls._replay(dataset, hypothesis, refits, whole.fit)

    def with_quantization(self, hypothesis: Hypothesis) -> "HeldOutScores":
        """The scores with the quantized signals that a hypothesis names last.

        No fit sees how readings are rounded.
        """
        patched = self.refits["patched"]
        found = hypothesis.final
        added = found.terms[len(patched.terms) :], found.values[len(patched.values) :]
        for term, step in zip(*added, strict=True):
            patched = append_step(patched, term, step)
        refits = {**self.refits, "patched": patched}
        return self._replay(self.dataset, hypothesis, refits, self.unrestored)

    @classmethod
    def _replay(
        cls,
        dataset: Dataset,
        hypothesis: Hypothesis,
        refits: dict[str, Fit],
        unrestored: Fit,
    ) -> "HeldOutScores":
        """The scores of models fitted to their own time step, and of the given one."""
        simulator, patched = dataset.held_out.native, refits["patched"]
        models = {name: (fit.terms, fit.values) for name, fit in refits.items()}
        models = {"given": ((), np.zeros(0)), **models}
        segments = score.cut_replay_segments(simulator)
        floor, _ = _measure_floor(simulator, segments, patched)
        lasts = [e.sample_steps[-1] * simulator.timestep for e in simulator.episodes]
        whole = _score_models(float(max(lasts)), simulator, segments, models, floor)
        horizons = _score_horizons(simulator, whole.seconds, models, patched)
        return cls(
            **vars(whole),
            dataset=dataset,
            hypothesis=hypothesis,
            refits=refits,
            unrestored=unrestored,
            horizons=horizons,
        )


def _refit_some(fit: Fit) -> LinearizedFit:
    """A fit to the model's own time step, in as many segments as that is made in."""
    rng = np.random.default_rng(3)
    some = draw_segments(fit.problem, SELECTION.native_fit_steps, rng)
    return refit_native_timestep(LinearizedFit.from_fit(fit).select(some))


def _score_models(
    seconds: float,
    simulator: Simulator,
    segments: Segments,
    models: Models,
    floor: Floats,
) -> HorizonScores:
    """Scores of a replay of models, and of the floor, which none beats.

    Args:
        seconds: length of the segments [s].
        floor: (S) mean squares that the best model would leave.
    """
    count = score.count_readings(simulator, segments)
    squares = {
        name: score.sum_squared_errors(simulator, segments, terms, values)
        for name, (terms, values) in models.items()
    }
    numbers: dict[str, float] = {}
    by_kind: ErrorsByKind = {}
    for name, total in {**squares, "floor": floor * count}.items():
        numbers[name] = score.compute_score(simulator, total, count)
        for key, error in score.pool_errors(simulator, total, count).items():
            by_kind.setdefault(key, {})[name] = error
    for errors in (numbers, *by_kind.values()):
        errors["floor"] = min(errors["floor"], errors["patched"])
    return HorizonScores(seconds, segments, count, squares, numbers, by_kind)


def _score_horizons(
    simulator: Simulator, whole: float, models: Models, patched: Fit
) -> tuple[HorizonScores, ...]:
    """Scores in longer and longer segments, up to those of whole episodes.

    They end where errors of the initial states alone cause a large part of the motion:
    a chaotic robot cannot be predicted farther. Single readings have no horizon.

    Args:
        whole: length of the longest episode [s].
        patched: the fit that tells how far the robot can be predicted.
    """
    lengths = [s for s in (SHORT_SEGMENT, *LONG_SEGMENTS) if 2 * s <= whole]
    horizons: list[HorizonScores] = []
    for seconds in (*lengths, whole):
        segments = cut_readable_segments(simulator, seconds)
        if not len(segments) or segments.is_single_readings:
            break
        floor, by_start = _measure_floor(simulator, segments, patched)
        if horizons and not by_start < FIT.max_state_response:
            break
        horizons.append(_score_models(seconds, simulator, segments, models, floor))
    return tuple(horizons)


def _measure_floor(
    simulator: Simulator, segments: Segments, fit: Fit
) -> tuple[Floats, float]:
    """Mean squares that noise, initial states and the time step would leave.

    Noise is in what a prediction is compared with and, where the initial state was
    read, in what it starts from. The latter is propagated to first order: each state
    moves by its standard deviation, and the squared changes are summed. The time step's
    error is twice the change by half the step (Richardson 1911).

    Returns:
        Of all three (S) [each channel's unit^2], and the score [1] of the initial
        states alone.
    """
    offsets = build_initial_state_offsets(simulator, segments)
    predicted = simulator.simulate(
        fit.terms,
        np.tile(fit.values, (len(offsets), 1)),
        segments,
        initial_state_offset=offsets,
    )
    finer = simulator.with_half_step.simulate(
        fit.terms, fit.values[None], segments.with_finer_steps(2)
    )[0]
    by_start = np.nansum((predicted[1:] - predicted[0]) ** 2, axis=0)
    by_step = np.nan_to_num(4 * (predicted[0] - finer) ** 2)
    all_of_it, of_start = [], []
    for c in simulator.channels:
        is_read = np.isfinite(segments.readings[:, c.columns]).all(axis=1)
        noise = np.nansum(np.nan_to_num(c.noise) ** 2)
        start, step = (
            x[is_read][:, c.columns].sum(axis=1).mean() if is_read.any() else 0.0
            for x in (by_start, by_step)
        )
        all_of_it.append(noise + start + step)
        if c.is_scored:
            of_start.append(start / c.spread**2)
    return np.array(all_of_it), float(np.sqrt(np.mean(of_start or [0.0])))


def explainable_removed(numbers: dict[str, float]) -> float | None:
    """Share [1] of the explainable held-out error that names remove.

    (refit - patched) / (refit - floor) of the scores of `HeldOutScores` (contract,
    section 2); None where too little could be explained.
    """
    explainable = numbers["refit"] - numbers["floor"]
    if not explainable >= SELECTION.min_explainable_error * numbers["refit"]:
        return None
    return (numbers["refit"] - numbers["patched"]) / explainable
