"""Is it as sure as it says: statements and whether they are true in, tables out."""

from collections.abc import Sequence

import numpy as np

from .plan import Picture, Table
from .statistics import format_share

_BINS, _LEAST_STATEMENTS = (
    10,
    50,
)  # of a reliability table; statements that a verdict needs
Pairs = Sequence[tuple[float, bool]]


def compute_brier_score(pairs: Pairs) -> float:
    """Mean of (stated probability - what came true)^2."""
    stated, true = np.asarray(pairs, float).T
    return float(((stated - true) ** 2).mean())


def bin_statements(pairs: Pairs) -> list[tuple[int, int, float, float]]:
    """Each tenth of the stated probability that has statements.

    Its number, its statements, the mean of what they stated, the share that was true.
    """
    stated, true = np.asarray(pairs, float).T
    place = np.minimum((stated * _BINS).astype(int), _BINS - 1)
    return [
        (
            int(k),
            int((place == k).sum()),
            stated[place == k].mean(),
            true[place == k].mean(),
        )
        for k in np.unique(place)
    ]


def make_reliability_table(title: str, text: str, pairs: Pairs) -> Table:
    """A row for each tenth of the stated probability.

    Args:
        pairs: stated probabilities, and whether each statement was right.
    """
    if not pairs:
        return Table(title, f"{text} No statements.")
    rows = []
    for k, count, said, right in bin_statements(pairs):
        near = (
            ""
            if count < _LEAST_STATEMENTS
            else "yes"
            if abs(said - right) <= 0.1
            else "no"
        )
        rows.append(
            (f"{k / _BINS:.1f} to {(k + 1) / _BINS:.1f}", f"{count:,}",
             f"{100 * said:.1f} %", format_share(round(right * count), count), near)
        )  # fmt: skip
    always = float(np.mean([true for _, true in pairs]))
    text = (
        f"{text} {len(pairs):,} statements, Brier score "
        f"{compute_brier_score(pairs):.4f}, of one who "
        f"always says {always:.2f}: {always * (1 - always):.4f}."
    )
    head = ("stated", "statements", "stated, mean", "true", "within 10 points")
    return Table(title, text, head, rows)


def make_reliability_picture(title: str, series: dict[str, Pairs]) -> Picture:
    """A picture of stated probabilities against the share of right statements."""
    return Picture(title, "reliability", {k: v for k, v in series.items() if v})
