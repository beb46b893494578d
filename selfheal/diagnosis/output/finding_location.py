"""Where named effects act: takes a hypothesis, gives signals, regimes and segments."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.base import Term
from ..effects.measurement import Quantization
from ..estimation.problem import Problem
from ..selection.hypotheses import Hypothesis
from ..simulation.dataset import Dataset
from ..simulation.simulator import Simulator
from . import localization
from .result import Localization
from .schema import Location, SignalShare, Window

MAX_LISTED_SEGMENTS = 3  # that a finding lists; chosen
MIN_LISTED_SHARE = 0.02  # of the error, less of which a finding does not list; chosen
# share of the gain that a regime has to hold, and how much denser than elsewhere the
# gain has to be there, for a finding to name it; chosen
MIN_REGIME_GAIN, MIN_REGIME_DENSITY = 0.3, 1.5


def localize_findings(
    dataset: Dataset, hypothesis: Hypothesis
) -> tuple[Localization, dict[int, Location]]:
    """Where the re-fitted model is wrong, and where each named effect acts."""
    simulator, problem = dataset.training, hypothesis.problem
    segments = problem.segments
    refit, final = hypothesis.nominal, hypothesis.final
    before = _square_residuals(problem, refit.terms, refit.values)
    share, p = localization.localize_error(simulator, dataset.robot, segments, before)
    located = Localization(
        tuple(c.name for c in simulator.channels), localization.REGIMES, share, p
    )
    where: dict[int, Location] = {}
    after = _square_residuals(problem, final.terms, final.values)
    masks = localization.classify_samples(simulator, dataset.robot, segments)
    for n, named in enumerate(hypothesis.named):
        if isinstance(named.term.effect, Quantization):
            signal = named.term.targets[0].partition(":")[2]
            own = SignalShare(name=signal, share_of_error=1.0)
            own["p_value"] = named.evidence.p_value
            where[n] = {"signals": [own], "regime": "always", "windows": []}
            continue
        without = _square_residuals(problem, *final.without_terms(named.term))
        where[n] = _describe_location(dataset, segments, masks, without - after)
        if onset := named.term.onset:
            where[n]["onset"] = {
                "episode": onset.episode,
                "time": onset.time,
                "low": onset.low,
                "high": onset.high,
            }
    return located, where


def _square_residuals(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Floats:
    """Squared residuals (M, S) [variances], summed over a signal's columns.

    Args:
        problem: with M samples of S signals.
        values: (P) of all their parameters.
    """
    r = problem.unmarginalized.residuals_at(terms, values)
    r = r.reshape(problem.segments.readings.shape)
    return np.stack(
        [(r[:, c.columns] ** 2).sum(axis=1) for c in problem.simulator.channels], axis=1
    )


def _describe_location(
    dataset: Dataset, segments: Segments, masks: np.ndarray, gain: Floats
) -> Location:
    """Where an effect lowers the error: signals, regime and segments.

    Args:
        masks: (R, M, S) whether a sample is in a regime.
        gain: (M, S) by how much the effect lowers the squared error [variances].
    """
    simulator = dataset.training
    by_signal = np.maximum(gain.sum(axis=0), 0)
    by_signal = by_signal / max(by_signal.sum(), 1e-300)
    signals: list[SignalShare] = [
        {
            "name": simulator.channels[s].name,
            "share_of_error": by_signal[s],
            "p_value": improvement_p_value(segments, gain[:, s]),
        }
        for s in np.argsort(-by_signal)
        if by_signal[s] > MIN_LISTED_SHARE
    ]
    by_segment = np.bincount(
        segments.segment_of_sample, gain.sum(axis=1), minlength=len(segments)
    )
    most = np.argsort(-by_segment)[:MAX_LISTED_SEGMENTS]
    return {
        "signals": signals,
        "regime": _find_densest_regime(masks, gain),
        "windows": [_describe_segment(simulator, segments, int(w)) for w in most],
    }


def improvement_p_value(segments: Segments, gain: Floats) -> float:
    """p-value that an effect does not lower an error: Wilcoxon's signed-rank test.

    Args:
        segments: with M samples; each segment is one observation, few or many.
        gain: (M) by how much the effect lowers the squared error [variances].
    """
    from scipy.stats import wilcoxon

    each = np.bincount(segments.segment_of_sample, gain, minlength=len(segments))
    each = each[each != 0]
    return float(wilcoxon(each, alternative="greater").pvalue) if len(each) else 1.0


def _find_densest_regime(masks: np.ndarray, gain: Floats) -> str:
    """The regime that holds the most gain for its size; "always" without any.

    Args:
        masks: (R, M, S) whether a sample is in a regime.
        gain: (M, S) by how much an effect lowers the squared error [variances].
    """
    total, size = gain.sum(), gain.size
    best, density = "always", MIN_REGIME_DENSITY
    for r, name in enumerate(localization.REGIMES):
        inside = masks[r]
        if inside.sum() < localization.MIN_REGIME_SAMPLES or total <= 0:
            continue
        share = gain[inside].sum() / total
        if share > MIN_REGIME_GAIN and share / (inside.sum() / size) > density:
            best, density = name, share / (inside.sum() / size)
    return best


def _describe_segment(simulator: Simulator, segments: Segments, w: int) -> Window:
    """Episode, start and end of a segment."""
    episode = simulator.episodes[int(segments.episode[w])]
    start = episode.start + segments.first_step[w] * simulator.timestep
    end = start + segments.lengths[w] * simulator.timestep
    return {"episode": episode.id, "start": start, "end": end}
