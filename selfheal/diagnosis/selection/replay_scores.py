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

Models = Mapping[str, tuple[tuple[Term, ...], Floats]]
# kind and unit of signals; name of a model, or "floor": error [that unit]
ErrorsByKind = dict[tuple[str, str], dict[str, float]]


@dataclass(frozen=True)
class HorizonScores:
    """Scores [1] of a replay in segments of one length.

    Attributes:
        seconds: length of the segments [s].
        numbers: score of each model ("given", "refit" and "patched"), and the "floor"
            that noise, initial states and time step leave.
        by_kind: root mean square errors of each of them, by kind and unit of signals.
    """

    seconds: float
    numbers: dict[str, float]
    by_kind: ErrorsByKind

    @property
    def floor_ratio(self) -> float:
        """Score of the patched model over the floor [1]."""
        return self.numbers["patched"] / max(self.numbers["floor"], FIT.tiny)


@dataclass(frozen=True, eq=False)
class HeldOutScores:
    """Errors of a replay of the held-out episodes.

    Attributes:
        refits: of each model but the given one, by its name, as MuJoCo steps it.
        unrestored: the patched model's before stated values were restored and rounded.
        segments: that were replayed.
        count: (E, S) readings of each episode and signal.
        squares: (E, S) [unit of the signal, squared] errors of each model, by its name.
        numbers: score [1] of each model, by its name, and of the noise floor.
        by_kind: root mean square errors of each of them, by kind and unit of signals.
        horizons: scores in longer and longer segments, up to whole episodes, as far as
            the robot can be predicted.
    """

    refits: dict[str, Fit]
    unrestored: Fit
    segments: Segments
    count: Floats
    squares: dict[str, Floats]
    numbers: dict[str, float]
    by_kind: ErrorsByKind
    horizons: tuple[HorizonScores, ...]

    @classmethod
    def compute(cls, dataset: Dataset, hypothesis: Hypothesis) -> "HeldOutScores":
        """Replay the model as given, re-fitted, and with the named effects."""
        fits = {"refit": hypothesis.nominal}
        if hypothesis.named:
            fits["patched"] = hypothesis.final
        refits = {
            name: refit_native_timestep(_select_some(fit)) for name, fit in fits.items()
        }
        whole = refits.setdefault("patched", refits["refit"])
        errors = standard_errors(fits.get("patched", fits["refit"]))
        refits["patched"] = restored = restore_stated(whole, errors)
        judge = Judge.build(dataset.held_out, fits.get("patched", fits["refit"]))
        before, after = (judge.log_native_errors(x.fit) for x in (whole, restored))
        if is_outdone(after, before):
            refits["patched"] = whole
        if not hypothesis.named:
            refits["refit"] = refits["patched"]
        fitted = {name: refit.fit for name, refit in refits.items()}
        return cls._replay(dataset, fitted, whole.fit)

    def with_quantization(
        self, dataset: Dataset, hypothesis: Hypothesis
    ) -> "HeldOutScores":
        """The scores with the quantized signals that a hypothesis names last.

        No fit sees how readings are rounded.
        """
        patched = self.refits["patched"]
        found = hypothesis.final
        added = found.terms[len(patched.terms) :], found.values[len(patched.values) :]
        for term, step in zip(*added, strict=True):
            patched = append_step(patched, term, step)
        refits = {**self.refits, "patched": patched}
        return self._replay(dataset, refits, self.unrestored)

    @classmethod
    def _replay(
        cls, dataset: Dataset, refits: dict[str, Fit], unrestored: Fit
    ) -> "HeldOutScores":
        """The scores of models fitted to their own time step, and of the given one."""
        simulator, patched = dataset.held_out.native, refits["patched"]
        segments = score.cut_replay_segments(simulator)
        count = score.count_readings(simulator, segments)
        models: Models = {
            "given": ((), np.zeros(0)),
            **{name: (fit.terms, fit.values) for name, fit in refits.items()},
        }
        squares = _square_errors(simulator, segments, models)
        floor, _ = _measure_floor(dataset, segments, patched)
        scores = _score_models(simulator, squares, count, floor)
        horizons = _score_horizons(dataset, models, patched)
        return cls(refits, unrestored, segments, count, squares, *scores, horizons)


def _select_some(fit: Fit) -> LinearizedFit:
    """A fit in as many of its segments as a native fit is made in."""
    rng = np.random.default_rng(3)
    some = draw_segments(fit.problem, SELECTION.native_fit_steps, rng)
    return LinearizedFit.from_fit(fit).select(some)


def _square_errors(
    simulator: Simulator, segments: Segments, models: Models
) -> dict[str, Floats]:
    """Sums (E, S) of the squared errors [unit of the signal, squared] of each model."""
    return {
        name: score.sum_squared_errors(simulator, segments, terms, values)
        for name, (terms, values) in models.items()
    }


def _score_models(
    simulator: Simulator, squares: Mapping[str, Floats], count: Floats, floor: Floats
) -> tuple[dict[str, float], ErrorsByKind]:
    """Scores [1] and errors by kind of models and of the floor, which none beats.

    Args:
        squares: (E, S) sums of squared errors of each model, by its name.
        count: (E, S) readings of each episode and signal.
        floor: (S) mean squares that the best model would leave.
    """
    squares = {**squares, "floor": floor * count}
    numbers = {k: score.compute_score(simulator, s, count) for k, s in squares.items()}
    numbers["floor"] = min(numbers["floor"], numbers["patched"])
    by_kind: ErrorsByKind = {}
    for name, total in squares.items():
        for key, error in score.pool_errors(simulator, total, count).items():
            by_kind.setdefault(key, {})[name] = error
    for errors in by_kind.values():
        errors["floor"] = min(errors["floor"], errors["patched"])
    return numbers, by_kind


def _score_horizons(
    dataset: Dataset, models: Models, patched: Fit
) -> tuple[HorizonScores, ...]:
    """Scores in longer and longer segments of the held-out episodes.

    They end where errors of the initial states alone cause a large part of the motion:
    a chaotic robot cannot be predicted farther. Single readings have no horizon.

    Args:
        models: to be replayed, by name: terms and their values (P).
        patched: the fit that tells how far the robot can be predicted.
    """
    simulator = dataset.held_out.native
    lasts = [e.sample_steps[-1] * simulator.timestep for e in simulator.episodes]
    whole = float(max(lasts))
    lengths = [s for s in (SHORT_SEGMENT, *LONG_SEGMENTS) if 2 * s <= whole]
    horizons: list[HorizonScores] = []
    for seconds in (*lengths, whole):
        segments = cut_readable_segments(simulator, seconds)
        if not len(segments) or segments.is_single_readings:
            break
        floor, by_start = _measure_floor(dataset, segments, patched)
        if horizons and not by_start < FIT.max_state_response:
            break
        count = score.count_readings(simulator, segments)
        squares = _square_errors(simulator, segments, models)
        scores = _score_models(simulator, squares, count, floor)
        horizons.append(HorizonScores(seconds, *scores))
    return tuple(horizons)


def _measure_floor(
    dataset: Dataset, segments: Segments, fit: Fit
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
    simulator = dataset.held_out.native
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
