"""From a naming to the contract's diagnosis.json (section 2)."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..estimation.covariance import LEVEL, confidence_interval
from ..estimation.least_squares import Fit
from ..selection.hypotheses import Hypothesis
from ..simulation.model_variants import split_values
from .mjcf_patch import is_native


def build_findings(
    hypothesis: Hypothesis, errors: Floats, where: Mapping[int, Mapping]
) -> list[dict[str, Any]]:
    """One entry an effect and place.

    Args:
        hypothesis: whose names are told.
        errors: (P) standard ones of its values.
        where: each acts, by the number of the finding.
    """
    found, out = hypothesis.final.fit, []
    spread = split_values(found.terms, errors)
    values = split_values(found.terms, found.values)
    for n, named in enumerate(hypothesis.named):
        i = next(k for k, t in enumerate(found.terms) if t is named.term)
        for target in named.term.targets:
            out.append({
                "effect": named.term.effect.name,
                "target": target,
                **named.term.finding_fields,
                "equivalent": _list_equivalents(named),
                "separate_by": named.term.effect.separate_by,
                "parameters": _list_parameters(named.term, values[i], spread[i]),
                "where": where[n],
                "evidence": {
                    "heldout_nll_gain": named.evidence.gain,
                    "p_value": named.evidence.p_value,
                    "stability": named.evidence.stability,
                },
                "native": is_native(named.term),
            })  # fmt: skip
    return out


def _list_equivalents(named) -> list[str]:
    names = [t.effect.name for t in named.equivalent]
    mine = named.term.effect.name
    return [n for i, n in enumerate(names) if n != mine and n not in names[:i]][:3]


def _list_parameters(
    term: Term, values: Floats, errors: Floats
) -> list[dict[str, Any]]:
    out = []
    for p, value, error in zip(term.parameters, values, errors, strict=True):
        low, high = confidence_interval(p, value, error)
        out.append({"name": p.name, "value": value, "low": low, "high": high,
                    "unit": p.unit})  # fmt: skip
    return _merge_vector(term, out)


def _merge_vector(term: Term, entries: list[dict]) -> list[dict]:
    """What is a vector (a payload's position) as one entry, the last."""
    vector = term.effect.vector_parameter
    axes = [e for e in entries if vector and e["name"].startswith(f"{vector}_")]
    if not axes:
        return entries
    joined = {k: [a[k] for a in axes] for k in ("value", "low", "high")}
    own = {"name": vector, **joined, "unit": axes[0]["unit"]}
    return [*(e for e in entries if e not in axes), own]


def build_refit(patched: Fit, errors: Floats) -> list[dict[str, Any]]:
    """What the model states, its value in the patched model, and its interval."""
    out = []
    each = (split_values(patched.terms, x) for x in (patched.values, errors))
    for term, value, error in zip(patched.terms, *each, strict=True):
        if term.effect.name != "stated":
            continue
        (factor,), (error,) = value, error
        given = term.finding_fields["value"]
        (p,) = term.parameters
        low, high = sorted(
            given * np.clip(factor + k * LEVEL * error, p.low, p.high) for k in (-1, 1)
        )
        out.append({"parameter": term.targets[0], "given": given,
                    "value": given * factor, "low": low, "high": high,
                    "unit": term.finding_fields["unit"]})  # fmt: skip
    return out


def to_json_values(thing: Any) -> Any:
    """The same with nothing that JSON does not have: NaN and infinity become null."""
    if isinstance(thing, Mapping):
        return {k: to_json_values(v) for k, v in thing.items()}
    if isinstance(thing, list | tuple | np.ndarray):
        return [to_json_values(v) for v in thing]
    if isinstance(thing, np.floating | float):
        return float(thing) if np.isfinite(thing) else None
    if isinstance(thing, np.integer | np.bool_):
        return thing.item()
    return thing


def format_document(document: Mapping[str, Any]) -> str:
    """diagnosis.json."""
    return json.dumps(to_json_values(document), indent=1, allow_nan=False) + "\n"
