"""Is it as sure as it says: statements and whether they are true in, tables out."""

from collections.abc import Sequence

import numpy as np

from .plan import Picture, Table
from .statistics import share

BINS, _ENOUGH = 10, 50  # of a reliability table; statements that a verdict needs
Pairs = Sequence[tuple[float, bool]]


def brier(pairs: Pairs) -> float:
    """Mean of (stated probability - what came true)^2."""
    stated, true = np.asarray(pairs, float).T
    return float(((stated - true) ** 2).mean())


def reliability(title: str, text: str, pairs: Pairs) -> Table:
    """A row for each tenth of the stated probability."""
    if not pairs:
        return Table(title, f"{text} No statements.")
    stated, true = np.asarray(pairs, float).T
    place = np.minimum((stated * BINS).astype(int), BINS - 1)
    rows = []
    for k in np.unique(place):
        inside = place == k
        said, right = stated[inside].mean(), true[inside].mean()
        enough = inside.sum() >= _ENOUGH
        near = "" if not enough else "yes" if abs(said - right) <= 0.1 else "no"
        rows.append(
            (f"{k / BINS:.1f} to {(k + 1) / BINS:.1f}", f"{inside.sum():,}",
             f"{100 * said:.1f} %", share(int(true[inside].sum()), int(inside.sum())),
             near)
        )  # fmt: skip
    text = (
        f"{text} {len(pairs):,} statements, Brier score {brier(pairs):.4f}, of one who "
        f"always says {true.mean():.2f}: {true.mean() * (1 - true.mean()):.4f}."
    )
    head = ("stated", "statements", "stated, mean", "true", "within 10 points")
    return Table(title, text, head, rows)


def diagram(title: str, series: dict[str, Pairs]) -> Picture:
    """The same as a picture."""
    return Picture(title, "reliability", {k: v for k, v in series.items() if v})
