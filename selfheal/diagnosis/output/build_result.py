"""The answer to a user: takes a hypothesis that was checked, gives a Diagnosis."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from ...errors import ModelError
from ...mjcf.defaults import fold_into_defaults
from ...mjcf.document import is_urdf
from ...mjcf.edit import Edit, apply_edits, diff_edits, unified_diff
from ...recording.data import Floats
from ..effects.base import Term
from ..effects.nominal import is_unidentified
from ..estimation.covariance import standard_errors
from ..estimation.information import Information
from ..estimation.least_squares import refine_jacobian
from ..selection.hypotheses import Hypothesis
from ..selection.replay_scores import (
    HeldOutScores,
    HorizonScores,
    explainable_removed,
)
from ..selection.structure import RemainingStructure
from ..selection.verdict import Verdict
from ..simulation import score
from ..simulation.checks import find_divergence
from ..simulation.dataset import Dataset
from . import document as doc
from .localization import localize_findings
from .mjcf_patch import build_edits
from .model_source import ModelSource, compile_patched, is_same_model
from .result import Candidate, Diagnosis, SignalFit
from .schema import Document, FitScores, KindErrors, Scores
from .traces import make_traces
from .urdf_patch import explain_urdf, find_urdf

MAX_LISTED_NAMES = 6  # names that a remark lists; chosen
# share of what is left that a torque of free form has to explain for a remark; chosen
MIN_FREE_FORM_SHARE = 0.05
UNPATCHED = (
    "patched.xml is the model as given, for its text cannot say what was found; "
    "selfheal replay applies all of it. {}. Of a model without such elements, as "
    "mujoco.MjSpec.to_xml writes one, a patch could be made: diagnose that."
)
# what readings of a kind are read at; all others at a body
_READ_AT = {
    "joint_position": "joint",
    "joint_velocity": "joint",
    "joint_torque": "actuator",
    "sensor": "sensor",
}
MIN_MOTION = 0.01  # [rad or m] of motion below which a joint tells nothing; chosen


@dataclass(frozen=True, eq=False)
class TestedHypothesis:
    """A hypothesis and what held-out episodes say of it.

    Attributes:
        hypothesis: with the names that stand.
        scores: errors in held-out episodes.
        structure: what the names leave; a torque of free form would explain it.
        refuted: labels of the names that do not stand.
    """

    hypothesis: Hypothesis
    verdict: Verdict
    scores: HeldOutScores
    structure: RemainingStructure
    refuted: tuple[str, ...]


def build_diagnosis(
    dataset: Dataset, tested: TestedHypothesis, begun: float
) -> Diagnosis:
    """The document, the patched model, and what a page draws beside them.

    Args:
        dataset: the recordings, parted in training and held out.
        begun: time.monotonic() at the beginning [s].
    """
    hypothesis, proof = tested.hypothesis, tested.scores
    named = proof.refits["patched"]
    located, where = localize_findings(dataset, hypothesis)
    fit = refine_jacobian(hypothesis.final)
    errors, information = standard_errors(fit), Information.build(fit)
    document: Document = {
        "format": "selfheal-diagnosis",
        "version": 1,
        "verdict": tested.verdict,
        "findings": doc.build_findings(hypothesis, errors, where),
        "refit": doc.build_refit(named, proof.unrestored.values, errors),
        "unidentified": doc.build_unidentified(information),
        "fit": _build_fit(dataset, proof),
    }
    remarks = _write_remarks(dataset, tested, document)
    text, diff, edits, unpatched = patch_or_nominal(dataset, named.terms, named.values)
    traces, poses = make_traces(dataset, proof)
    if unpatched:
        document["unpatched"] = unpatched  # a replay then makes up for it
        remarks = [UNPATCHED.format(unpatched), *remarks]
    else:
        remarks += _explain_urdf_patch(dataset.compiler.path, edits)
    return Diagnosis(
        os.path.abspath(dataset.compiler.path),
        cast(Document, doc.to_json_values(document)),
        edits,
        text,
        diff,
        traces,
        located,
        _fit_signals(dataset, proof.squares, proof.count),
        _list_candidates(hypothesis),
        tuple(remarks),
        time.monotonic() - begun,
        int(dataset.training.counter.count + dataset.held_out.counter.count),
        more_than_noise=tested.structure.is_significant,
        information=information,
        poses=poses,
    )


def _explain_urdf_patch(path: str, edits: Sequence[Edit]) -> list[str]:
    """What patched.urdf cannot hold, where the model has a URDF."""
    if not (urdf := find_urdf(path)):
        return []
    given, patched = (compile_patched(path, each).compile() for each in ((), edits))
    return explain_urdf(urdf, given, patched)


def _build_fit(dataset: Dataset, proof: HeldOutScores) -> FitScores:
    """Errors in held-out episodes: replayed as a user would, and over each horizon."""
    return {
        "held_out": list(dataset.held_out_names),
        **_build_scores(proof),
        "horizons": [
            {"seconds": h.seconds, **_build_scores(h)} for h in proof.horizons
        ],
    }


def _build_scores(scores: HeldOutScores | HorizonScores) -> Scores:
    """Errors of each model, normalized, and of each kind of signal in its unit."""
    errors = [
        cast(KindErrors, {"kind": kind, "unit": unit, **errors})
        for (kind, unit), errors in scores.by_kind.items()
    ]
    numbers = scores.numbers
    removed = explainable_removed(numbers)
    return cast(Scores, {**numbers, "explainable_removed": removed, "errors": errors})


def explain_unpatchable(model: str | os.PathLike[str]) -> str:
    """Why no change of a model's text could be patched; empty where one can.

    A patch without changes is made on trial, for this is cheap before a search.

    Raises:
        ModelError: the text cannot even be copied: a file is missing or no XML.
    """
    apply_edits(model, (), Path(model).resolve().parent)
    try:
        compile_patched(model, ())
    except ModelError as error:
        return str(error)
    return ""


def patch_or_nominal(
    dataset: Dataset, terms: Sequence[Term], values: Floats
) -> tuple[str, str, list[Edit], str]:
    """Text, difference and edits of `build_patch`, and "".

    Where the text cannot be patched, the text as given and the reason.

    Args:
        values: (P) of them [units of the parameters].
    """
    try:
        return *build_patch(dataset, terms, values), ""
    except ModelError as error:
        path = Path(dataset.compiler.path)
        return apply_edits(path, (), path.resolve().parent), "", [], str(error)


def build_patch(
    dataset: Dataset, terms: Sequence[Term], values: Floats
) -> tuple[str, str, list[Edit]]:
    """Text of patched.xml beside the given model, its difference, and the edits.

    Args:
        values: (P) of them [units of the parameters].

    Raises:
        ModelError: what was found has no place in the text, or MuJoCo refuses it.
    """
    path = Path(dataset.compiler.path)
    home = path.resolve().parent
    variant = dataset.compiler.compile_variant(terms)
    changes = build_edits(ModelSource(path), variant, terms, values)
    patched, folded = compile_patched(path, changes), fold_into_defaults(path, changes)
    if folded != changes and is_same_model(compile_patched(path, folded), patched):
        changes = folded
    text = apply_edits(path, changes, home)
    if is_urdf(path):  # the page shows what changes in its translation
        given = apply_edits(path, (), home)
        return text, unified_diff(given, text, f"{path.stem}.xml"), changes
    return text, diff_edits(path, changes), changes


def _fit_signals(
    dataset: Dataset, squares: Mapping[str, Floats], count: Floats
) -> tuple[SignalFit, ...]:
    """Held-out errors of each signal, with intervals over episodes."""
    simulator, noise = dataset.held_out, score.compute_noise_floor(dataset.held_out)

    def interval(square: Floats, s: int) -> tuple[float, float, float]:
        return score.bootstrap_interval(simulator, square, count, s)

    return tuple(
        SignalFit(
            c.name,
            c.is_scored,
            interval(squares["given"], s),
            interval(squares["refit"], s),
            interval(squares["patched"], s),
            float(noise[s]),
            unit=c.error_unit[1],
            scale=c.error_unit[0] * c.spread,
            reads=f"{_READ_AT.get(c.kind, 'body')}:{c.target}",
        )
        for s, c in enumerate(simulator.channels)
    )


def _list_candidates(hypothesis: Hypothesis) -> tuple[Candidate, ...]:
    """The candidates of the search's first round, best first."""
    named = {(n.term.effect.name, n.term.targets) for n in hypothesis.named}
    return tuple(
        Candidate(name, ", ".join(t.targets), left, (name, t.targets) in named)
        for t, left in hypothesis.ranking
        for name in [t.effect.name]
    )


def _write_remarks(
    dataset: Dataset, tested: TestedHypothesis, document: Document
) -> list[str]:
    """Sentences that a reader should know before believing the rest."""
    structure = tested.structure
    found = [
        f"Joint {j.name} moved by less than {MIN_MOTION} {j.unit}: what is wrong with "
        "it, if anything is, these recordings cannot show."
        for j in dataset.robot.joints
        if j.measured and j.range < MIN_MOTION
    ]
    segments = tested.hypothesis.problem.segments
    count, episode, time = find_divergence(dataset.training, segments)
    if count:
        found.append(
            f"The model as given diverges in {count} of {len(segments)} pieces, first "
            f"in episode {episode} at {time:.4g} s."
        )
    if tested.refuted:
        found.append(
            f"What also fitted, {'; '.join(tested.refuted)}, did not help in the "
            "held-out episodes, so it is not named."
        )
    if structure.is_significant and structure.share > MIN_FREE_FORM_SHARE:
        found.append(
            f"A torque of free form would explain {100 * structure.share:.0f} % of "
            "what is left."
        )
    together = document["unidentified"]
    found += [
        f"These data tell {_list_some(e['together'])} only together: {e['words']} is "
        f"fixed by {e['fixed_by']}."
        for e in together
    ]
    grouped = {name for e in together for name in e["together"]}
    unknown = [e["parameter"] for e in document["refit"] if is_unidentified(e)]
    if unknown := [name for name in unknown if name not in grouped]:
        found.append(f"Not pinned down by these data: {_list_some(unknown)}.")
    return found


def _list_some(names: Sequence[str]) -> str:
    """The first few of some names, and how many more there are."""
    more = len(names) - MAX_LISTED_NAMES
    shown = ", ".join(names[:MAX_LISTED_NAMES])
    return f"{shown} and {more} more" if more > 0 else shown
