"""Is it as sure as it says: statements and whether they are true in, tables out."""

import numpy as np

from .plan import Pairs, Reliability, Table
from .statistics import format_share

_BINS = 10  # of a reliability table
_LEAST_STATEMENTS = 50  # that a verdict needs


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
        (int(k), int(own.sum()), stated[own].mean(), true[own].mean())
        for k in np.unique(place)
        for own in [place == k]
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
        cells = {
            "stated": f"{k / _BINS:.1f} to {(k + 1) / _BINS:.1f}",
            "statements": f"{count:,}",
            "stated, mean": f"{100 * said:.1f} %",
            "true": format_share(round(right * count), count),
            "within 10 points": "",
        }
        if count >= _LEAST_STATEMENTS:
            cells["within 10 points"] = "yes" if abs(said - right) <= 0.1 else "no"
        rows.append(list(cells.values()))
    always = float(np.mean([true for _, true in pairs]))
    text = (
        f"{text} {len(pairs):,} statements, Brier score "
        f"{compute_brier_score(pairs):.4f}, of one who "
        f"always says {always:.2f}: {always * (1 - always):.4f}."
    )
    return Table(title, text, list(cells), rows)


def make_reliability_picture(title: str, series: dict[str, Pairs]) -> Reliability:
    """A picture of the series that have statements."""
    return Reliability(title, {k: v for k, v in series.items() if v})
