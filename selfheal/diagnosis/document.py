"""From a naming to the contract's diagnosis.json (section 2)."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..recording.data import Floats
from .evidence import blocks_of
from .fit import Fit, believed
from .name import Naming
from .plant import parts
from .problem import Problem
from .terms import Term
from .textual import native

LEVEL = 1.645  # standard errors of a 90 % interval
# times as wide is that of a finding: models are wrong in ways that no error counts, and
# of 71 values that other hands hid 1.645 errors held 75 %, these 83 (results, diagnose)
WIDER = 1.4


def uncertainty(problem: Problem, found: Fit) -> Floats:
    """Standard errors (P), robust to residuals that are alike in a window.

    The sandwich of Huber (1967) and White (1980) over blocks of windows, or the usual
    estimate where that is larger; what is believed of stated values counts as one more
    reading of each, off by its own standard deviation. What the time step, and not
    knowing the clock better, move a value by are errors of it, too: those of parameters
    that are considered and not estimated (Schmidt 1966).
    """
    jac, r = found.jacobian, found.residuals
    scale = np.sqrt((jac**2).sum(axis=0))
    live = scale > 1e-9 * max(scale.max(initial=0.0), 1e-300)
    out = np.full(len(found.values), np.inf)
    if not live.any():
        return out
    a = jac[:, live] / scale[live]
    block = blocks_of(problem)[problem.window_of]
    slopes = np.stack([
        a[block == b].T @ r[block == b] for b in np.unique(block)
    ])  # fmt: skip
    belief = np.diag(believed(found.terms)[live] / scale[live] ** 2)
    size, turn = np.linalg.eigh(a.T @ a + belief)
    # a direction that no reading shows is as uncertain as can be, not certain; what is
    # believed is ever so little beside many readings, and tells it all the same
    size = np.maximum(size, 1e-14 * size.max())
    curvature = turn * size @ turn.T
    usual = (curvature - belief) * float(r @ r) / max(len(r) - len(a.T), 1)
    robust = slopes.T @ slopes * len(slopes) / max(len(slopes) - 1, 1)
    # no direction is more uncertain than it was before anything was read
    most = 1 / np.sqrt(np.maximum((turn * (belief @ turn)).sum(axis=0), 1e-300))

    def cover(causes: Floats) -> Floats:
        """Variances that columns of `causes` make, as slopes of the cost."""
        along = (turn / size).T @ causes
        kept = most / np.maximum(np.linalg.norm(along, axis=1), most)
        return ((turn * kept @ along) ** 2).sum(axis=1)

    slopes_of_errors = (
        a.T @ considered(found.terms, found.values, r)
        for considered in (problem.of_step, problem.of_clock)
    )
    variance = np.maximum(*(cover(_root(data + belief)) for data in (usual, robust)))
    variance += sum(cover(slope[:, None]) for slope in slopes_of_errors)
    out[live] = np.sqrt(variance) / scale[live]
    return out


def _root(matrix: Floats) -> Floats:
    """R with R R' = a matrix that is not negative."""
    size, turn = np.linalg.eigh(matrix)
    return np.asarray(turn * np.sqrt(np.maximum(size, 0.0)))


def findings_of(
    naming: Naming, errors: Floats, where: Mapping[int, Mapping]
) -> list[dict[str, Any]]:
    """One entry an effect and place.

    Args:
        naming: whose names are told.
        errors: (P) standard ones of its values.
        where: each acts, by the number of the finding.
    """
    found, out = naming.final.fit, []
    spread = parts(found.terms, errors)
    values = parts(found.terms, found.values)
    for n, named in enumerate(naming.named):
        i = next(k for k, t in enumerate(found.terms) if t is named.term)
        for target in named.term.targets:
            out.append({
                "effect": named.term.effect.name,
                "target": target,
                **named.term.note,
                "equivalent": _others(named),
                "separate_by": named.term.effect.separate_by,
                "parameters": _parameters(named.term, values[i], spread[i]),
                "where": where[n],
                "evidence": {
                    "heldout_nll_gain": named.evidence.gain,
                    "p_value": named.evidence.p_value,
                    "stability": named.evidence.stability,
                },
                "native": native(named.term),
            })  # fmt: skip
    return out


def _others(named) -> list[str]:
    names = [t.effect.name for t in named.equivalent]
    mine = named.term.effect.name
    return [n for i, n in enumerate(names) if n != mine and n not in names[:i]][:3]


def _parameters(term: Term, values: Floats, errors: Floats) -> list[dict[str, Any]]:
    out = []
    for p, value, error in zip(term.parameters, values, errors, strict=True):
        low = max(p.low, value - WIDER * LEVEL * error)
        high = min(p.high, value + WIDER * LEVEL * error)
        out.append({"name": p.name, "value": value, "low": low, "high": high,
                    "unit": p.unit})  # fmt: skip
    return _as_contract(term, out)


def _as_contract(term: Term, entries: list[dict]) -> list[dict]:
    """What is a vector (a payload's position) as one entry, the last."""
    vector = term.effect.vector
    axes = [e for e in entries if vector and e["name"].startswith(f"{vector}_")]
    if not axes:
        return entries
    joined = {k: [a[k] for a in axes] for k in ("value", "low", "high")}
    own = {"name": vector, **joined, "unit": axes[0]["unit"]}
    return [*(e for e in entries if e not in axes), own]


def refit_of(patched: Fit, errors: Floats) -> list[dict[str, Any]]:
    """What the model states, its value in the patched model, and its interval."""
    out = []
    each = (parts(patched.terms, x) for x in (patched.values, errors))
    for term, value, error in zip(patched.terms, *each, strict=True):
        if term.effect.name != "stated":
            continue
        (factor,), (error,) = value, error
        given = term.note["value"]
        (p,) = term.parameters
        low, high = sorted(
            given * np.clip(factor + k * LEVEL * error, p.low, p.high) for k in (-1, 1)
        )
        out.append({"parameter": term.targets[0], "given": given,
                    "value": given * factor, "low": low, "high": high,
                    "unit": term.note["unit"]})  # fmt: skip
    return out


def plain(thing: Any) -> Any:
    """The same with nothing that JSON does not have: NaN and infinity become null."""
    if isinstance(thing, Mapping):
        return {k: plain(v) for k, v in thing.items()}
    if isinstance(thing, list | tuple | np.ndarray):
        return [plain(v) for v in thing]
    if isinstance(thing, np.floating | float):
        return float(thing) if np.isfinite(thing) else None
    if isinstance(thing, np.integer | np.bool_):
        return thing.item()
    return thing


def text_of(document: Mapping[str, Any]) -> str:
    """diagnosis.json."""
    return json.dumps(plain(document), indent=1, allow_nan=False) + "\n"
