"""What several terms are to each other, and terms changed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...recording.data import Floats
from .base import Term
from .places import add_keys


def is_distinct(term: Term, kept: Sequence[Term]) -> bool:
    """Whether no kept term has the term's effect at one of its targets."""
    return not any(
        term.effect.name == t.effect.name and set(term.targets) & set(t.targets)
        for t in kept
    )


def find_other_forms(term: Term, among: Sequence[Term]) -> list[Term]:
    """Terms at the same targets of the same effect, or that override the same value."""
    overridden = set(term.effect.overrides)
    return [
        t
        for t in among
        if t.targets == term.targets
        and t.key != term.key
        and (t.effect is term.effect or overridden & set(t.effect.overrides))
    ]


def extend_places(term: Term, **more: Any) -> Term:
    """The term with more keys in each of its places."""
    return replace(term, places=tuple(add_keys(place, **more) for place in term.places))


def restates_nominal_value(term: Term, nominal_terms: Sequence[Term]) -> bool:
    """Whether a term fits again a value of the model that a nominal term fits too."""
    if not np.isfinite([p.nominal for p in term.parameters]).all():
        return False
    said = {target for t in nominal_terms for target in t.targets}
    own = {f"{target}/{p.name}" for target in term.targets for p in term.parameters}
    return bool(own & said)


def find_overridden(term: Term, terms: Sequence[Term]) -> list[int]:
    """Which nominal terms have no influence beside a term, by their index."""
    own = {f"{at}/{name}" for at in term.targets for name in term.effect.overrides}
    return [i for i, t in enumerate(terms) if own & set(t.targets)]


def find_restated(term: Term, terms: Sequence[Term]) -> dict[int, int]:
    """Nominal terms whose values a term states anew, by the number of its parameter.

    Args:
        term: at one target, all the time; what several targets state differs.
        terms: nominal ones among them, of one parameter each.
    """
    if len(term.targets) > 1 or term.onset:
        return {}
    numbers = {t.targets[0]: i for i, t in enumerate(terms) if len(t.targets) == 1}
    restated = {
        k: numbers.get(f"{term.targets[0]}/{p.name}")
        for k, p in enumerate(term.parameters)
        if p.name in term.effect.overrides
    }
    return {k: i for k, i in restated.items() if i is not None}


def start_beside(term: Term, terms: Sequence[Term], values: Floats) -> Term:
    """The term as it begins near a fitted term whose place it takes.

    Dry friction that was fitted is where a search for a Stribeck curve begins: from
    far away it would first have to find the friction again.

    Args:
        term: that may be fitted beside others.
        terms: that are fitted.
        values: (P) of them [units of the parameters].
    """
    ends = np.cumsum([0, *(len(t.parameters) for t in terms)])
    for other, first in zip(terms, ends, strict=False):
        if other.targets != term.targets or other.effect is term.effect:
            continue
        if set(other.effect.overrides) & set(term.effect.overrides):
            return term.effect.start_from(term, float(values[first]))
    return term


def remove_rounding(terms: Sequence[Term], values: Floats) -> Floats:
    """Values (n, P) in which those that round readings are nominal."""
    each = [(t.effect.rounds_readings, p.nominal) for t in terms for p in t.parameters]
    rounds = np.array([r for r, _ in each], bool)
    return np.where(rounds, [nominal for _, nominal in each], values)
