"""What a user is told: takes a proven naming, gives a Diagnosis."""

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ModelError
from ...mjcf.edit import Edit, apply_edits, unified_diff
from ...recording.data import Floats
from ..data.robot_summary import Channel
from ..data.segments import Segments
from ..effects.base import Term
from ..effects.nominal import is_unidentified
from ..estimation.covariance import standard_errors
from ..estimation.least_squares import Fit, refine_jacobian
from ..estimation.problem import Problem
from ..selection.hypotheses import Hypothesis
from ..selection.verdict import HeldOutScores, RemainingStructure, explainable_removed
from ..simulation import score
from ..simulation.checks import find_divergence
from ..simulation.dataset import Dataset
from ..simulation.simulator import Simulator
from . import document as doc
from . import localization
from .mjcf_patch import build_edits
from .model_source import ModelSource, compile_patched
from .result import Candidate, Diagnosis, Localization, SignalFit, Trace

FEW = 6  # names that a remark lists; chosen
UNPATCHED = (
    "patched.xml is the model as given, for its text cannot say what was found; "
    "selfheal replay applies all of it. {}. Of a model without such elements, as "
    "mujoco.MjSpec.to_xml writes one, a patch could be made: diagnose that."
)
STILL = 0.01  # [rad or m] of motion below which a joint tells nothing; chosen


def build_diagnosis(
    dataset: Dataset,
    hypothesis: Hypothesis,
    verdict: str,
    proof: HeldOutScores,
    structure: RemainingStructure,
    refuted: Sequence[str],
    begun: float,
) -> Diagnosis:
    """The document, the patched model, and what a page draws beside them."""
    found, nominal_terms, numbers = proof.patched, proof.nominal, proof.numbers
    located, where = _localize(dataset, hypothesis)
    problem = hypothesis.problem
    errors = standard_errors(problem, refine_jacobian(problem, hypothesis.final.fit))
    refit = doc.build_refit(found, errors)
    remarks = _write_remarks(dataset, hypothesis, structure, refuted, refit)
    text, diff, changes, unpatched = patch_or_nominal(dataset, found)
    document = {
        "format": "selfheal-diagnosis",
        "version": 1,
        "verdict": verdict,
        "findings": doc.build_findings(hypothesis, errors, where),
        "refit": refit,
        "fit": {"held_out": list(dataset.held_out_names), **numbers,
                "explainable_removed": explainable_removed(numbers)},
    }  # fmt: skip
    if unpatched:
        document["unpatched"] = unpatched  # a replay then makes up for it
        remarks = (UNPATCHED.format(unpatched), *remarks)
    return Diagnosis(
        os.path.abspath(dataset.compiler.path),
        doc.to_json_values(document),
        changes,
        text,
        diff,
        _make_traces(dataset, proof.segments, nominal_terms, found),
        located,
        _fit_signals(dataset, proof.squares, proof.count),
        _list_candidates(hypothesis),
        remarks,
        time.monotonic() - begun,
        int(dataset.training.simulated_count[0] + dataset.held_out.simulated_count[0]),
        more_than_noise=structure.is_significant,
    )


def _localize(dataset: Dataset, hypothesis: Hypothesis):
    """The map of the re-fitted model's error, and where each finding acts."""
    simulator, problem = dataset.training, hypothesis.problem
    segments = problem.segments
    nominal_terms, final = hypothesis.nominal.fit, hypothesis.final.fit
    before = _square_residuals(problem, nominal_terms.terms, nominal_terms.values)
    share, p = localization.localize_error(simulator, dataset.robot, segments, before)
    located = Localization(
        tuple(c.name for c in simulator.channels), localization.REGIMES, share, p
    )
    where: dict[int, dict[str, Any]] = {}
    after = _square_residuals(problem, final.terms, final.values)
    masks = localization.classify_samples(simulator, dataset.robot, segments)
    for n, named in enumerate(hypothesis.named):
        if named.term.effect.rounds_readings:
            own = {"name": named.term.places[0]["signal"], "share_of_error": 1.0,
                   "p_value": named.evidence.p_value}  # fmt: skip
            where[n] = {"signals": [own], "regime": "always", "windows": []}
            continue
        less = _square_residuals(problem, *final.without_terms(named.term))
        where[n] = _describe_location(dataset, segments, masks, less - after)
        if onset := named.term.onset:
            where[n]["onset"] = {
                k: getattr(onset, k) for k in ("episode", "time", "low", "high")
            }
    return located, where


def _square_residuals(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Floats:
    """Squared residuals (M, S) in standard deviations, summed over columns."""
    r = problem.unmarginalized.residuals_at(terms, values)
    r = r.reshape(problem.segments.readings.shape)
    return np.stack(
        [(r[:, c.columns] ** 2).sum(axis=1) for c in problem.simulator.channels], axis=1
    )


def _describe_location(
    dataset: Dataset, segments: Segments, masks, gain: Floats
) -> dict[str, Any]:
    simulator = dataset.training
    by_signal = np.maximum(gain.sum(axis=0), 0)
    by_signal = by_signal / max(by_signal.sum(), 1e-300)
    order = np.argsort(-by_signal)
    signals = [
        {"name": simulator.channels[s].name, "share_of_error": by_signal[s],
         "p_value": _improvement_p_value(segments, gain[:, s])}
        for s in order if by_signal[s] > 0.02
    ]  # fmt: skip
    by_window = np.bincount(
        segments.segment_of_sample, gain.sum(axis=1), minlength=len(segments)
    )
    worst = np.argsort(-by_window)[:3]
    return {
        "signals": signals,
        "regime": _find_densest_regime(masks, gain),
        "windows": [_describe_segment(simulator, segments, int(w)) for w in worst],
    }


def _improvement_p_value(segments: Segments, gain: Floats) -> float:
    """p-value that an effect lowers a signal's error, over windows, few or many."""
    from scipy.stats import wilcoxon

    each = np.bincount(segments.segment_of_sample, gain, minlength=len(segments))
    each = each[each != 0]
    return float(wilcoxon(each, alternative="greater").pvalue) if len(each) else 1.0


def _find_densest_regime(masks: np.ndarray, gain: Floats) -> str:
    """Where the gain is densest, if anywhere."""
    total, size = gain.sum(), gain.size
    best, density = "always", 1.5
    for r, name in enumerate(localization.REGIMES):
        inside = masks[r]
        if inside.sum() < localization.FEW or total <= 0:
            continue
        share = gain[inside].sum() / total
        if share > 0.3 and share / (inside.sum() / size) > density:
            best, density = name, share / (inside.sum() / size)
    return best


def _describe_segment(
    simulator: Simulator, segments: Segments, w: int
) -> dict[str, Any]:
    episode = simulator.episodes[int(segments.episode[w])]
    start = episode.start + segments.first_step[w] * simulator.timestep
    return {"episode": episode.id, "start": start,
            "end": start + segments.lengths[w] * simulator.timestep}  # fmt: skip


def patch_or_nominal(dataset: Dataset, found: Fit) -> tuple[str, str, list[Edit], str]:
    """What `patch_of` gives; or the given text, and why there is no patch."""
    try:
        return *build_patch(dataset, found), ""
    except ModelError as error:
        path = Path(dataset.compiler.path)
        return apply_edits(path, (), path.resolve().parent), "", [], str(error)


def build_patch(dataset: Dataset, found: Fit) -> tuple[str, str, list[Edit]]:
    """Text of patched.xml beside the given model, its difference, and the edits.

    Raises:
        ModelError: what was found has no place in the text, or MuJoCo refuses it.
    """
    path = Path(dataset.compiler.path)
    home = path.resolve().parent
    variant = dataset.compiler.compile_variant(found.terms)
    changes = build_edits(ModelSource(path), variant, found.terms, found.values)
    compile_patched(path, changes)
    text = apply_edits(path, changes, home)
    return text, unified_diff(apply_edits(path, (), home), text), changes


def _make_traces(
    dataset: Dataset, segments: Segments, nominal_terms: Fit, found: Fit
) -> tuple[Trace, ...]:
    """The worst stretches of the held-out episodes, by the re-fitted model.

    Of poses that were read once, all of them in a row.
    """
    simulator, none = dataset.held_out, ((), np.zeros(0))
    each = [
        simulator.simulate(terms, values[None], segments)[0]
        for terms, values in (none, (nominal_terms.terms, nominal_terms.values),
                              (found.terms, found.values))
    ]  # fmt: skip
    worst = []
    for c in simulator.channels:
        for k in range(c.first_column, c.first_column + c.width):
            apart = (each[1][:, k] - segments.readings[:, k]) / c.spread
            square = np.nan_to_num(apart**2, nan=0.0, posinf=0.0)
            by = np.bincount(
                segments.segment_of_sample, square, minlength=len(segments)
            )
            w = int(by.argmax())
            worst.append((by[w] * (2 if c.is_scored else 1), c, k, w))
    worst.sort(key=lambda x: -x[0])
    if segments.is_single_readings:
        pose = np.arange(1, len(segments.segment_of_sample) + 1, dtype=float)
        return tuple(
            Trace("", _column_name(c, k), c.unit, pose, segments.readings[:, k],
                  *(e[:, k] for e in each))
            for _, c, k, _ in worst[:4]
        )  # fmt: skip
    return tuple(
        _make_trace(simulator, segments, each, c, k, w) for _, c, k, w in worst[:4]
    )


def _column_name(c: Channel, k: int) -> str:
    """Name of one of all columns."""
    return c.name if c.width == 1 else f"{c.name}[{k - c.first_column}]"


def _make_trace(
    simulator: Simulator, segments: Segments, each, c, k: int, w: int
) -> Trace:
    rows = np.flatnonzero(segments.segment_of_sample == w)
    episode = simulator.episodes[int(segments.episode[w])]
    at = (
        episode.start
        + (segments.first_step[w] + segments.sample_steps[rows]) * simulator.timestep
    )
    return Trace(episode.id, _column_name(c, k), c.unit, at, segments.readings[rows, k],
                 *(e[rows, k] for e in each))  # fmt: skip


def _fit_signals(dataset: Dataset, squares, count) -> tuple[SignalFit, ...]:
    simulator, noise = dataset.held_out, score.compute_noise_floor(dataset.held_out)
    return tuple(
        SignalFit(
            c.name,
            c.is_scored,
            floor=float(noise[s]),
            **{
                k: score.bootstrap_interval(simulator, x, count, s)
                for k, x in squares.items()
            },
        )
        for s, c in enumerate(simulator.channels)
    )


def _list_candidates(hypothesis: Hypothesis) -> tuple[Candidate, ...]:
    named = {(n.term.effect.name, n.term.targets) for n in hypothesis.named}
    return tuple(
        Candidate(t.effect.name, ", ".join(t.targets), left,
                  (t.effect.name, t.targets) in named)
        for t, left in hypothesis.ranking
    )  # fmt: skip


def _write_remarks(
    dataset: Dataset,
    hypothesis: Hypothesis,
    structure: RemainingStructure,
    refuted: Sequence[str],
    refit: Sequence[Mapping[str, Any]],
) -> tuple[str, ...]:
    """What a reader should know before believing the rest."""
    found = [
        f"Joint {j.name} moved by less than {STILL} {j.unit}: what is wrong with it, "
        "if anything is, these recordings cannot show."
        for j in dataset.robot.joints
        if j.measured and j.range < STILL
    ]
    segments = hypothesis.problem.segments
    count, episode, time = find_divergence(dataset.training, segments)
    if count:
        found.append(
            f"The model as given diverges in {count} of {len(segments)} pieces, first "
            f"in episode {episode} at {time:.4g} s."
        )
    if refuted:
        found.append(
            f"What also fitted, {'; '.join(refuted)}, did not help in the "
            "held-out episodes, so it is not named."
        )
    if structure.is_significant and structure.share > 0.05:
        found.append(
            f"A torque of free form would explain {100 * structure.share:.0f} % of "
            "what is left."
        )
    loose = [e["parameter"] for e in refit if is_unidentified(e)]
    if loose:
        more = f" and {len(loose) - FEW} more" if len(loose) > FEW else ""
        found.append(f"Not pinned down by these data: {', '.join(loose[:FEW])}{more}.")
    return tuple(found)
