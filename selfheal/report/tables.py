"""Tables of a self-modeling run: a Run in, markup out."""

import numpy as np

from ..body.genome import HINGE_NAMES
from ..selfmodel.run import Run
from .facts import (
    SIDES,
    TILT_NAMES,
    Rival,
    action_name,
    number,
    part_name,
    percent,
    true_side,
)
from .page import Html, join, mark, paragraph, table

_MOST_RIVALS = 12  # rows of the table; chosen


def tree(run: Run) -> Html:
    """A row a part: what it hangs on, where, how long, how sure, right or wrong."""
    best = run.cycles[-1].genomes
    head, align = ["#", "part", "hangs on", "at its side", "length [mm]"], "rlllr"
    full = run.settings.space == "full"
    if full:
        head, align = [*head, "hinge"], align + "l"
    head, align = [*head, "sureness"], align + "r"
    if run.truth is not None:
        head, align = [*head, "truth"], align + "l"
    rows = []
    for i, name in enumerate(run.anatomy.parts):
        parent, side = int(best.parent[0, i]), SIDES[best.side[0, i]]
        row: list[object] = [i + 1, name, part_name(run, parent), side]
        row.append(f"{1000 * best.length[0, i]:.0f}")
        row += [HINGE_NAMES[best.hinge[0, i]]] if full else []
        row.append(percent(run.cycles[-1].sureness[i]))
        row += [] if run.truth is None else [_verdict(run, i)]
        rows.append(row)
    return table(head, rows, align)


def _verdict(run: Run, i: int) -> Html:
    """Whether a part's attachment is right, and what is true if it is not."""
    assert run.truth is not None
    best, truth = run.cycles[-1].genomes, run.truth
    parent, side = int(truth.parent[0, i]), int(true_side(truth)[0, i])
    if best.parent[0, i] != parent:
        name = part_name(run, parent)
        return join(mark("wrong", "wrong"), f": truly on {name}, {SIDES[side]}")
    if best.side[0, i] != side:
        return join(mark("correct", "right"), f", but truly at its {SIDES[side]}")
    return mark("correct", "right")


def simulations(run: Run) -> Html:
    """Simulations by engine."""
    notes = {
        "choice": "spent on choosing actions",
        "failed": "diverged (counted above)",
    }
    counts = sorted(run.counts.items(), key=lambda item: item[0] in notes)
    rows = [(notes.get(k, f"on {k}"), f"{n:,}") for k, n in counts]
    return join(paragraph("Simulations:"), table(("what for", "number"), rows, "lr"))


def residuals(run: Run) -> Html:
    """A row an action: measured, predicted, and what is between them."""
    head = ["cycle", "joints down"]
    units = [f"{n} [deg]" for n in TILT_NAMES] + ["clearance [mm]"]
    felt = np.array([c.felt for c in run.cycles])
    shown = [k for k in range(3) if k < 2 or np.isfinite(felt[:, k]).any()]
    for k in shown:
        head += [f"{units[k]} measured", "predicted", "off by"]
    rows = []
    for n, cycle in enumerate(run.cycles):
        predicted = run.cycles[-1].tables[0][cycle.action]
        row: list[object] = [n + 1, action_name(run, cycle.action)]
        for k in shown:
            values = cycle.felt[k], predicted[k], predicted[k] - cycle.felt[k]
            row += [number(v, 1) for v in values]
        rows.append(row)
    return table(head, rows, "rl" + "rrr" * len(shown))


def reasons(run: Run) -> Html:
    """A row an action: why it was chosen."""
    rows = [
        (n + 1, action_name(run, cycle.action), cycle.why)
        for n, cycle in enumerate(run.cycles)
    ]
    return table(("cycle", "joints down", "why"), rows, "rll")


def rivals(run: Run, found: list[Rival]) -> Html:
    """A row a rival, the best one first, and what the columns mean."""
    head = ["rank", "loss", "extra an action", "what differs from the best one",
            "away [cm]", "most apart [deg]"]  # fmt: skip
    align = "rrrlrr"
    if run.truth is not None:
        head, align = [*head, "correct"], align + "r"
    rows = [_rival(run, r) for r in found[:_MOST_RIVALS]]
    note = (
        "Away: mean distance of the parts' centers from the best one's. Most apart: "
        "the largest difference in tilt that any of the robot's actions would show."
    )
    if len(found) > _MOST_RIVALS:
        note = f"The first {_MOST_RIVALS}, the best one included. {note}"
    return join(table(head, rows, align), paragraph(mark(note, "soft")))


def _rival(run: Run, rival: Rival) -> list[object]:
    """A rival's row."""
    differs = "; ".join(rival.differs) or "nothing worth naming"
    row: list[object] = [rival.rank, number(rival.loss), number(rival.excess)]
    row.append(differs if rival.rank > 1 else mark("the best one", "soft"))
    row += [number(rival.away, 1), number(rival.apart, 1)]
    if rival.right is not None:
        row.append(f"{rival.right} of {run.anatomy.size}")
    return row
