"""The report of a self-modeling run: a Run in, one HTML page out."""

from dataclasses import asdict

import numpy as np

from ..body.genome import HINGE_NAMES, build
from ..selfmodel.run import Run
from . import figures
from .facts import (
    EQUAL,
    NEAR,
    SIDES,
    Rival,
    action_name,
    errors,
    number,
    part_name,
    percent,
    right_edges,
    rivals,
    true_side,
)
from .page import Html, Section, details, join, mark, page, paragraph, table
from .picture import figure, style


def identify_page(run: Run) -> str:
    """The page of a run, finished or not, as one self-contained HTML text."""
    title = f"The body of {run.settings.robot}"
    if not run.cycles:
        nothing = Section(
            "Inferred body", ("No action has been tried yet, so nothing is known.",)
        )
        return page(title, [nothing, _settings(run)], lead=_lead(run))
    with style():
        sections = [
            _inferred(run),
            _drawn(run),
            _candidates(run),
            _progress(run),
            _tilts(run),
            _rivals(run),
            _sureness(run),
            _settings(run),
        ]
    return page(title, sections, lead=_lead(run))


def _lead(run: Run) -> str:
    """The run in one sentence, or two if it is not finished."""
    done, asked = len(run.cycles), run.settings.cycles
    unfinished = "" if run.result else (
        f"This run is not finished: {done} of {asked} actions so far. "
    )  # fmt: skip
    if not done:
        return unfinished.strip()
    last = run.cycles[-1]
    body = f"After {_count(done, 'action')} and {last.spent:,} simulations"
    right = right_edges(run, build(run.anatomy, last.genomes[:1]))
    known = (
        ""
        if right is None
        else f", with {right.sum()} of {right.size} attachments right"
    )
    return (
        f"{unfinished}{body}, the best body explains the measured tilts to "
        f"{number(last.tilt_error)} degrees an action{known}{_least_sure(run)}."
    )


def _least_sure(run: Run) -> str:
    """The attachment that is most in doubt, as the end of a sentence."""
    stated = run.cycles[-1].sureness
    if not np.isfinite(stated).any():
        return ""
    part = int(np.nanargmin(stated))
    return f"; least sure is {run.anatomy.parts[part]} ({percent(stated[part])})"


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _inferred(run: Run) -> Section:
    """The inferred tree as a table, its errors, and what it took."""
    pieces: list[str] = [_tree(run)]
    if found := errors(run, build(run.anatomy, run.cycles[-1].genomes[:1])):
        pieces.append(paragraph("Against the truth:"))
        pieces.append(table(("measure", "value"), found, "lr"))
    else:
        pieces.append(
            "Nobody knows the true body, so nothing is called right or wrong."
        )
    pieces += _spent(run)
    return Section("Inferred body", tuple(pieces))


def _tree(run: Run) -> Html:
    """A row a part: what it hangs on, where, how long, how sure, right or wrong."""
    best = run.cycles[-1].genomes
    head, align = ["#", "part", "hangs on", "side", "length [mm]"], "rlllr"
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
        return join(mark("wrong", "wrong"), f": {name}, {SIDES[side]}")
    if best.side[0, i] != side:
        return join(mark("right", "right"), f", but its {SIDES[side]} side")
    return mark("right", "right")


def _spent(run: Run) -> list[str]:
    """Simulations by engine."""
    if not run.counts:
        return []
    notes = {
        "choice": "spent on choosing actions",
        "failed": "diverged (counted above)",
    }
    rows = [(notes.get(k, f"on {k}"), f"{n:,}") for k, n in run.counts.items()]
    return [paragraph("Simulations:"), table(("what for", "number"), rows, "lr")]


def _drawn(run: Run) -> Section:
    """The best body in 3-D."""
    colors = "Blue: attached to the right parent; orange: to a wrong one. "
    caption = (
        "Parts at zero joint angles; numbers as in the table. The dashed square is "
        "where parts attach to the torso, the arrow points forward. "
    )
    caption += colors if run.truth is not None else ""
    return Section(
        "The body it believes in", (figure(figures.best_body(run), caption.strip()),)
    )


def _candidates(run: Run) -> Section:
    """Rivals of several cycles in 3-D."""
    caption = (
        "The best candidates after each of these cycles, best on the left, all at one "
        "scale; the loss is the sum over the actions tried until then."
    )
    drawn = figure(figures.candidates(run), caption)
    return Section("Candidate bodies, cycle by cycle", (drawn,))


def _progress(run: Run) -> Section:
    """Curves."""
    caption = (
        "Tilt error: |left/right| + |forward/back| between the best candidate and the "
        "robot, mean over the actions so far. Disagreement: standard deviation of the "
        "rivals' tilts, mean over the actions not tried yet."
    )
    return Section("Error and disagreement", (figure(figures.progress(run), caption),))


def _tilts(run: Run) -> Section:
    """Predicted against measured, drawn and in numbers."""
    caption = (
        "Every action tried, in order, by the joints that it sends down; all other "
        "joints go up. Predictions are those of the best candidate at the end."
    )
    drawn = figure(figures.tilts(run), caption)
    return Section(
        "Predicted against measured tilt",
        (
            drawn,
            details("the numbers, and why each action was chosen", _residuals(run)),
        ),
    )


def _residuals(run: Run) -> Html:
    """A row an action: measured, predicted, and what is between them."""
    head = ["cycle", "joints down"]
    units = [f"{n} [deg]" for n in figures.TILT_NAMES] + ["clearance [mm]"]
    felt = np.array([c.felt for c in run.cycles])
    shown = [k for k in range(3) if k < 2 or np.isfinite(felt[:, k]).any()]
    for k in shown:
        head += [f"{units[k]} measured", "predicted", "difference"]
    head.append("why this action")
    rows = []
    for n, cycle in enumerate(run.cycles):
        predicted = run.cycles[-1].tables[0][cycle.action]
        row: list[object] = [n + 1, action_name(run, cycle.action)]
        for k in shown:
            values = cycle.felt[k], predicted[k], predicted[k] - cycle.felt[k]
            row += [number(v, 1) for v in values]
        rows.append([*row, cycle.why])
    return table(head, rows, "rl" + "rrr" * len(shown) + "l")


_MOST_RIVALS = 12  # rows of the table; chosen


def _rivals(run: Run) -> Section:
    """Which other bodies explain the data equally well, or nearly."""
    title = "Rivals that the data do not rule out"
    found = rivals(run)
    equal = sum(r.excess <= EQUAL for r in found) - 1
    said = (
        f"Of {_count(len(run.cycles[-1].genomes), 'candidate')} kept, besides the best "
        f"one, {equal} explain the data equally well (at most {EQUAL:g} more loss an "
        f"action) and {len(found) - 1 - equal} nearly (at most {NEAR:g})."
    )
    if len(found) == 1:
        return Section(title, (said,))
    head = ["rank", "loss", "more an action", "what differs from the best one",
            "away [cm]", "can be told apart by [deg]"]  # fmt: skip
    align = "rrrlrr"
    if run.truth is not None:
        head, align = [*head, "right"], align + "r"
    rows = [_rival(run, r) for r in found[:_MOST_RIVALS]]
    note = (
        "Away: mean distance of the parts' centers from the best one's. Can be told "
        "apart by: the largest difference in tilt that any action would show."
    )
    if len(found) > _MOST_RIVALS:
        note = f"The first {_MOST_RIVALS}, the best one included. {note}"
    return Section(
        title, (said, table(head, rows, align), paragraph(mark(note, "soft")))
    )


def _rival(run: Run, rival: Rival) -> list[object]:
    """A rival's row."""
    differs = "; ".join(rival.differs) or "nothing worth naming"
    row: list[object] = [rival.rank, number(rival.loss), number(rival.excess)]
    row.append(differs if rival.rank > 1 else mark("the best one", "soft"))
    row += [number(rival.away, 1), number(rival.apart, 1)]
    if rival.right is not None:
        row.append(f"{rival.right} of {run.anatomy.size}")
    return row


def _sureness(run: Run) -> Section:
    """How sure each attachment became."""
    caption = "Stated probability that each attachment is right, in percent."
    if run.truth is not None:
        caption += " Framed: the best candidate had it wrong."
    return Section(
        "How sure it is of each attachment", (figure(figures.sureness(run), caption),)
    )


def _settings(run: Run) -> Section:
    """What was asked."""
    rows = [(name.replace("_", " "), _setting(v)) for name, v in
            asdict(run.settings).items()]  # fmt: skip
    rows.append(("actions that the robot offers", f"{len(run.actions)}"))
    if run.cycles:
        rows.append(("time taken", f"{run.cycles[-1].seconds:.1f} s"))
    return Section("Settings", (table(("setting", "value"), rows, "ll"),))


def _setting(value: object) -> str:
    """A setting as a reader expects it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return str(value) or "\N{EN DASH}"
