"""The report of a self-modeling run: a Run in, one HTML page out."""

from dataclasses import asdict

import numpy as np

from ..body.genome import build
from ..selfmodel.run import Run
from . import figures, tables
from .facts import (
    EQUAL,
    NEAR,
    errors,
    number,
    percent,
    right_edges,
    rivals,
)
from .page import Section, beside, details, join, page, paragraph, table
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
        else f", with {right.sum()} of {right.size} attachments correct"
    )
    error = run.result.get("tilt_error", last.tilt_error)  # the last check's, if done
    return (
        f"{unfinished}{body}, the best body explains the measured tilts to "
        f"{number(error)} degrees an action{known}{_least_sure(run)}."
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
    found = errors(run, build(run.anatomy, run.cycles[-1].genomes[:1]))
    against = (
        join(paragraph("Against the truth:"), table(("measure", "value"), found, "lr"))
        if found
        else paragraph(
            "Nobody knows the true body, so nothing is called correct or wrong."
        )
    )
    spent = beside(against, tables.simulations(run))
    return Section("Inferred body", (tables.tree(run), spent))


def _drawn(run: Run) -> Section:
    """The best body in 3-D."""
    colors = "Blue: attached to the correct parent; orange: to a wrong one. "
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
        "tilts of all bodies that might be right, each counted as far as it is "
        "believed, mean over the actions not tried yet."
    )
    return Section("Error and disagreement", (figure(figures.progress(run), caption),))


def _tilts(run: Run) -> Section:
    """Predicted against measured, drawn and in numbers."""
    caption = (
        "Every action tried, in order, by the joints that it sends down; all other "
        "joints go up. Predictions are those of the best candidate at the end."
    )
    drawn = figure(figures.tilts(run), caption)
    numbers = details("the numbers", tables.residuals(run))
    why = details("why each action was chosen", tables.reasons(run))
    return Section("Predicted against measured tilt", (drawn, numbers, why))


def _rivals(run: Run) -> Section:
    """Which other bodies explain the data equally well, or nearly."""
    found = rivals(run)
    equal = sum(r.excess <= EQUAL for r in found) - 1
    kept = len(run.cycles[-1].genomes)
    said = (
        f"Candidates kept: {kept}. Besides the best one, as good "
        f"as it (at most {EQUAL:g} more loss an action): {equal}; nearly as good (at "
        f"most {NEAR:g}): {len(found) - 1 - equal}."
    )
    if run.result:
        said += (
            " Other bodies considered, twins too, that no action of this robot tells "
            f"from the best one: {len(run.alike)}; trees of theirs other than the best "
            f"one's: {run.alike_trees}."
        )
    table = tables.rivals(run, found) if len(found) > 1 else ""
    return Section("Rivals that the data do not rule out", (said, table))


def _sureness(run: Run) -> Section:
    """How sure each attachment became."""
    caption = "Stated probability that each attachment is correct, in percent."
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
