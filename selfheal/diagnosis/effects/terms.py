"""What several terms are to each other, and terms changed."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from .base import Term
from .measurement import Quantization


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


def list_restated_columns(
    terms: Sequence[Term],
) -> dict[Term, list[tuple[int, int, float]]]:
    """Columns of parameters that state something anew, of the terms that do.

    Args:
        terms: all of them, whose parameters are columns in this order.

    Returns:
        Of each such parameter its own column, the stated value's, and what is stated.
    """
    first = np.cumsum([0, *(len(t.parameters) for t in terms)]).tolist()
    return {
        t: [(first[n] + k, first[i], t.parameters[k].nominal) for k, i in restated]
        for n, t in enumerate(terms)
        if (restated := find_restated(t, terms).items())
    }


def remove_rounding(terms: Sequence[Term], values: Floats) -> Floats:
    """Values (n, P) in which those that round readings are nominal."""
    rounds = [isinstance(t.effect, Quantization) for t in terms for _ in t.parameters]
    nominal = [p.nominal for t in terms for p in t.parameters]
    return np.where(np.array(rounds, bool), nominal, values)
