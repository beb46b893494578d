"""The contract's diagnosis.json (section 2): takes a hypothesis, gives the document."""

import json
from collections.abc import Mapping
from typing import cast

import numpy as np
from pydantic import JsonValue
from pydantic_core import to_jsonable_python

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.nominal import MOMENTS, SIDES, NominalParameter
from ..estimation.covariance import confidence_interval
from ..estimation.fit import Fit
from ..estimation.information import Information
from ..estimation.settings import FIT
from ..selection.hypotheses import Hypothesis, NamedEffect
from ..simulation.model_variants import split_values
from .schema import Confounded, Document, Finding, Location, Refit, StatedParameter

MAX_EQUIVALENTS = 3  # that a finding lists; chosen
INERTIAL = {"mass", "inertia", "armature", *MOMENTS}
LENGTHS = {"length", *SIDES}


def build_findings(
    hypothesis: Hypothesis, errors: Floats, where: Mapping[int, Location]
) -> list[Finding]:
    """One entry for each named effect and target, those first that explain most.

    Args:
        hypothesis: with the named effects and their fit.
        errors: (P) standard errors of the fit's values [each parameter's unit].
        where: what each named effect acts on, by its number.
    """
    fit, found = hypothesis.final, list[Finding]()
    split = (split_values(fit.terms, x) for x in (fit.values, errors))
    parameters = {
        term: list_parameters(term, values, error)
        for term, values, error in zip(fit.terms, *split, strict=True)
    }
    for n, named in enumerate(hypothesis.named):
        effect, evidence = named.term.effect, named.evidence
        for target in named.term.targets:
            entry = {
                "effect": effect.name,
                "target": target,
                **named.term.finding_fields,
                "equivalent": _list_equivalents(named),
                "separate_by": effect.separate_by,
                "parameters": parameters[named.term],
                "where": where[n],
                "evidence": {
                    "heldout_nll_gain": evidence.gain,
                    "p_value": evidence.p_value,
                    "stability": evidence.stability,
                    "heldout_error_growth": named.growth,
                },
                "native": effect.is_native,
            }
            found.append(cast(Finding, entry))  # with the effect's own fields
    return found


def _list_equivalents(named: NamedEffect) -> list[str]:
    """Names of other effects that explain as much, most likely first, each once."""
    names = [t.effect.name for t in named.equivalent]
    mine = named.term.effect.name
    return [n for i, n in enumerate(names) if n != mine and n not in names[:i]][
        :MAX_EQUIVALENTS
    ]


def list_parameters(
    term: Term, values: Floats, errors: Floats
) -> list[StatedParameter]:
    """A finding's parameters: name, value, 90 % interval and unit of each.

    Where a parameter takes the place of what the model states, that is "given".

    Args:
        values: (p) of its parameters [each one's unit].
        errors: (p) their standard errors.
    """
    out = list[StatedParameter]()
    stated = {spec.name for spec in term.effect.parameters if spec.is_in_model}
    for p, value, error in zip(term.parameters, values, errors, strict=True):
        low, high = confidence_interval(p, value, error)
        entry = StatedParameter(name=p.name, value=value, low=low, high=high)
        if p.name in stated and np.isfinite(p.nominal):
            entry["given"] = p.nominal
        entry["unit"] = p.unit
        out.append(entry)
    for spec in term.effect.parameters:
        if spec.size != 1:
            out = _merge_components(spec.name, out)
    return out


def _merge_components(
    name: str, entries: list[StatedParameter]
) -> list[StatedParameter]:
    """Entries with the components of a vector (NAME_x, ...) as one, the last."""
    components = [e for e in entries if e["name"].startswith(f"{name}_")]
    if not components:
        return entries
    values, low, high = zip(
        *((e["value"], e["low"], e["high"]) for e in components), strict=True
    )
    merged = StatedParameter(
        name=name,
        value=list(values),
        low=list(low),
        high=list(high),
        unit=components[0]["unit"],
    )
    return [*(e for e in entries if e not in components), merged]


def build_refit(patched: Fit, unrestored: Floats, errors: Floats) -> list[Refit]:
    """One entry for each nominal value: as given, as patched, and its interval.

    Args:
        patched: the fit of the patched model; its nominal terms count.
        unrestored: (P) its values before some returned to what the model states [1].
        errors: (P) standard errors of its values.
    """
    out, half = [], FIT.interval_factor * FIT.interval_standard_errors
    each = (patched.values, unrestored, errors)
    for term, factor, fitted, error in zip(
        patched.terms, *(split_values(patched.terms, x) for x in each), strict=True
    ):
        if not isinstance(term.effect, NominalParameter):
            continue
        given, (p,) = term.effect.value, term.parameters
        low, high = sorted(
            given * np.clip(x + k * half * e, p.low, p.high)
            for x, e in zip(fitted, error, strict=True)
            for k in (-1, 1)
        )
        entry: Refit = {
            "parameter": term.targets[0],
            "given": given,
            "value": given * factor[0],
            "low": low,
            "high": high,
            "unit": term.effect.unit,
        }
        out.append(entry)
    return out


def build_unidentified(information: Information) -> list[Confounded]:
    """One entry for each group of values that the recordings tell only together."""
    out = []
    for group in information.find_confounded():
        fields = {name.rpartition("/")[2] for name in group}
        if fields & INERTIAL and fields - INERTIAL - LENGTHS:
            words = "the common scale of torques and masses"
        elif fields & INERTIAL and fields & LENGTHS:
            words = "masses against lengths"
        else:
            words = "what these values do together"
        fixed_by = "what the model states of them"
        out.append(Confounded(together=list(group), words=words, fixed_by=fixed_by))
    return out


def to_json_values(thing: object) -> JsonValue:
    """A copy with what JSON has: arrays become lists, NaN and infinity become null."""
    return to_jsonable_python(
        thing, inf_nan_mode="null", fallback=lambda array: array.tolist()
    )


def format_document(document: Document) -> str:
    """The text of diagnosis.json."""
    return json.dumps(to_json_values(document), indent=1, allow_nan=False) + "\n"
