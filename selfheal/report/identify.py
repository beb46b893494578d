"""The report of a self-modeling run: a Run in, one HTML page out."""

from dataclasses import asdict

import numpy as np

from ..body.genome import build_bodies
from ..engine.channels import list_channels
from ..selfmodel.run import Run
from . import figures, tables
from .facts import (
    DASH,
    EQUAL,
    NEAR,
    find_right_edges,
    format_number,
    format_percent,
    list_errors,
    list_rivals,
)
from .page import (
    Section,
    join_markup,
    make_details,
    make_page,
    make_paragraph,
    make_table,
    place_beside,
)
from .picture import embed_figure, use_page_style


def make_identify_page(run: Run) -> str:
    """The page of a run, finished or not, as one self-contained HTML text."""
    title = f"The body of {run.settings.robot}"
    lead, settings = _write_lead(run), _make_settings_section(run)
    if not run.cycles:
        said = "No action has been tried yet, so nothing is known."
        return make_page(
            title, [Section("Inferred body", (said,)), settings], lead=lead
        )
    with use_page_style():
        sections = [
            _make_body_section(run),
            *(_draw_section(run, name) for name in ("body", "candidates", "progress")),
            _make_readings_section(run),
            _make_rivals_section(run),
            _draw_section(run, "sureness"),
            *([_make_dynamics_section(run)] if run.result.get("dynamics") else []),
            settings,
        ]
    return make_page(title, sections, lead=lead)


# of a figure alone: its title, what draws it, its caption, and what the caption adds
# where the truth is known
_DRAWN = {
    "body": (
        "The body it believes in",
        figures.draw_best_body,
        "Parts at zero joint angles; numbers as in the table. The dashed square is "
        "where parts attach to the torso, the arrow points forward. Pale: "
        "candidates at least a twentieth as likely; where they differ is undecided.",
        " Blue: attached to the correct parent; orange: to a wrong one.",
    ),
    "candidates": (
        "Candidate bodies, cycle by cycle",
        figures.draw_candidates,
        "The best candidates after each of these cycles, best on the left, all at one "
        "scale; the loss is the sum over the actions tried until then.",
        "",
    ),
    "progress": (
        "Error and disagreement",
        figures.draw_progress,
        "Error: of tilts, |left/right| + |forward/back| between the best candidate and "
        "the robot, mean over the actions so far; without tilts, of all sensors, in "
        "as many degrees as they count like. Disagreement: standard deviation of the "
        "same of all bodies that might be right, each counted as far as it is "
        "believed, mean over the actions not tried yet.",
        "",
    ),
    "sureness": (
        "How sure it is of each attachment",
        figures.draw_sureness,
        "Stated probability that each attachment is correct, in percent.",
        " Framed: the best candidate had it wrong.",
    ),
}


def _draw_section(run: Run, name: str) -> Section:
    """A section of one figure."""
    title, draw, caption, known = _DRAWN[name]
    caption += known if run.truth is not None else ""
    return Section(title, (embed_figure(draw(run), caption),))


def _write_lead(run: Run) -> str:
    """The run in one sentence, or two if it is not finished."""
    done, planned = len(run.cycles), run.settings.cycles
    unfinished = ""
    if not run.result:
        unfinished = f"This run is not finished: {done} of {planned} actions so far. "
    if not done:
        return unfinished.strip()
    last = run.cycles[-1]
    body = f"After {_format_count(done, 'action')} and {last.spent:,} simulations"
    right = find_right_edges(run, build_bodies(run.anatomy, last.genomes[:1]))
    known = ""
    if right is not None:
        known = f", with {right.sum()} of {right.size} attachments correct"
    error = run.result.get("tilt_error", last.tilt_error)  # the last check's, if done
    name = list_channels(run.anatomy).error_name
    return (
        f"{unfinished}{body}, the best body explains the readings to a {name} error of "
        f"{format_number(error)} degrees an action{known}{_name_least_sure(run)}."
    )


def _name_least_sure(run: Run) -> str:
    """The attachment that is most in doubt, as the end of a sentence."""
    stated = run.cycles[-1].sureness
    if not np.isfinite(stated).any():
        return ""
    part = int(np.nanargmin(stated))
    return f"; least sure is {run.anatomy.parts[part]} ({format_percent(stated[part])})"


def _format_count(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _make_body_section(run: Run) -> Section:
    """The inferred tree as a table, its errors, and what it took."""
    found = list_errors(run, build_bodies(run.anatomy, run.cycles[-1].genomes[:1]))
    against = make_paragraph(
        "Nobody knows the true body, so nothing is called correct or wrong."
    )
    if found:
        table = make_table(("measure", "value"), found, "lr")
        against = join_markup(make_paragraph("Against the truth:"), table)
    spent = place_beside(against, tables.format_simulations(run))
    return Section("Inferred body", (tables.format_tree(run), spent))


def _make_readings_section(run: Run) -> Section:
    """Predicted against measured, drawn and in numbers."""
    caption = (
        "Every action tried, in order, by the joints that it sends down; all other "
        "joints go up. Predictions are those of the best candidate at the end."
    )
    drawn = embed_figure(figures.draw_readings(run), caption)
    numbers = make_details("the numbers", tables.format_residuals(run))
    why = make_details("why each action was chosen", tables.format_reasons(run))
    return Section("Predicted against measured", (drawn, numbers, why))


def _make_rivals_section(run: Run) -> Section:
    """Which other bodies explain the data equally well, or nearly."""
    found = list_rivals(run)
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
            f"from the best one: {len(run.indistinguishable)}; trees of theirs other "
            f"than the best "
            f"one's: {run.indistinguishable_trees}."
        )
    table = tables.format_rivals(run, found) if len(found) > 1 else ""
    return Section("Rivals that the data do not rule out", (said, table))


def _make_dynamics_section(run: Run) -> Section:
    """What moves over time showed, and how much it helps."""
    found = run.result["dynamics"]
    how = (
        "The torso lay still on the floor, no limb touched that, and the joints alone "
        "are explained."
        if found["held"]
        else "Limbs touched the floor, and all sensors are explained."
    )
    rows = [
        ("best.xml", format_number(found["given"])),
        ("with the dynamics found", format_number(found["patched"])),
        ("noise alone", format_number(found["floor"])),
    ]
    head = ("predicted by", "error on a held-out move, in standard deviations")
    where = "The page of the diagnosis is dynamics/report.html."
    return Section("How its joints move", (how, make_table(head, rows, "lr"), where))


def _make_settings_section(run: Run) -> Section:
    """The settings."""
    rows = [
        (name.replace("_", " "), _format_setting(v))
        for name, v in asdict(run.settings).items()
    ]
    rows.append(("actions that the robot offers", f"{len(run.actions)}"))
    if run.cycles:
        rows.append(("time taken", f"{run.cycles[-1].seconds:.1f} s"))
    return Section("Settings", (make_table(("setting", "value"), rows, "ll"),))


def _format_setting(value: object) -> str:
    """A setting as a reader expects it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return str(value) or DASH
