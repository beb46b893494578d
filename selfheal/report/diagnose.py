"""The report of a diagnosis: a Diagnosis in, one HTML page out."""

from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path

import numpy as np

from ..diagnosis.effects import load_catalogue
from ..diagnosis.effects.nominal import is_unidentified
from ..diagnosis.effects.protocols import ModelEdit
from ..diagnosis.output.result import Diagnosis, Localization
from ..diagnosis.output.schema import Finding, Location
from ..extras import format_install
from . import figures, tables
from .errors import (
    MODELS,
    format_errors,
    format_held_out,
    format_horizons,
    is_worse,
    state_errors,
)
from .facts import format_percent
from .live import EXTRA, is_live_available, make_live_curves
from .page import (
    NOTHING,
    Html,
    Section,
    format_diff,
    join_markup,
    make_bars,
    make_bullets,
    make_note,
    make_table,
    mark_text,
)
from .page import make_page as whole
from .phrases import MEANS, UNTOLD, capitalize, replace_underscores, state_verdict
from .picture import embed_figure, use_page_style
from .robot import make_robot_sections
from .tables import format_quantity, format_short, parse_number

_MOST_TRACES, _NEAREST = 6, 3  # drawn, advised; chosen
_HORIZONS = (
    "Each row replays segments of that length from where the robot was measured to be. "
    "What builds up slowly shows in the long ones; they end where this robot cannot be "
    "predicted any farther."
)
_NOISE = 1.5  # times the floor, an error that is called as large as noise; chosen
_QUOTES = "\N{LEFT DOUBLE QUOTATION MARK}\N{RIGHT DOUBLE QUOTATION MARK}"
_UNKNOWN = 1e4  # times the floor, an error beside which none was measured; chosen


def make_diagnosis_page(
    diagnosis: Diagnosis, model: str, recordings: Sequence[str]
) -> str:
    """The page of a diagnosis, as one self-contained HTML text.

    Args:
        recordings: the files that it was compared with.
    """
    with use_page_style():
        traces, scripts = _make_traces_section(diagnosis)
        sections = [
            _make_findings_section(diagnosis),
            _make_errors_section(diagnosis),
            traces,
            *make_robot_sections(diagnosis),
            _make_map_section(diagnosis.located),
            _make_candidates_section(diagnosis),
            _make_refit_section(diagnosis),
            _make_diff_section(diagnosis),
            _make_signals_section(diagnosis),
            _make_remarks_section(diagnosis),
            _make_method_section(diagnosis, model, recordings),
        ]
    title = f"Diagnosis of {Path(model).name}"
    said = state_verdict(diagnosis.document), *state_errors(diagnosis.document["fit"])
    return whole(title, sections, lead=" ".join(said), scripts=scripts)


def _make_findings_section(diagnosis: Diagnosis) -> Section:
    """The findings, what the verdict means, what to do."""
    document = diagnosis.document
    found, verdict = document["findings"], document["verdict"]
    body: list[str] = [tables.format_findings(document)] if found else []
    body.append(_explain_verdict(diagnosis))
    body.append(make_bullets(note for f in found for note in _list_notes(f)))
    if verdict in ("partly", "unlisted") and (tries := _list_experiments(diagnosis)):
        body += ["Experiments that would show more:", make_bullets(tries)]
    return Section("What is missing" if found else "What this means", tuple(body))


def _explain_verdict(diagnosis: Diagnosis) -> str:
    """The verdict in sentences that hold for this diagnosis."""
    verdict, fit = diagnosis.document["verdict"], diagnosis.document["fit"]
    means = MEANS.get(verdict, f"The verdict is {verdict}.")
    if verdict != "explained":
        return means
    if diagnosis.more_than_noise:
        means = (
            "The findings remove nine tenths or more of what exceeds the noise; the "
            "rest is not all noise."
        )
    patched, floor = (parse_number(fit.get(key)) for key in ("patched", "floor"))
    if floor > 0 and patched > _NOISE * floor:
        times = f", {format_short(patched / floor, 2)} times the floor."
        if patched > _UNKNOWN * floor:  # of single readings nothing tells it
            times = "; what noise would leave is not known."
        off = f"the held-out recordings are off by {format_short(patched)}{times}"
        means += f" Replayed open loop, {off}"
    return means


def _list_notes(finding: Finding) -> Iterable[Html]:
    """What a user should know of a finding besides its numbers."""
    named = mark_text(f"{finding['effect']} at {finding['target']}", "right")
    return (join_markup(named, note) for note in _write_notes(finding))


def _write_notes(finding: Finding) -> Iterable[str]:
    """The notes on a finding, each after its name."""
    if rivals := ", ".join(finding.get("equivalent", ())):
        advice = finding.get("separate_by")
        how = f" To separate them: {advice}." if advice else ""
        yield f" cannot be distinguished from {rivals} by these data.{how}"
    where = finding.get("where") or {}
    if (regime := where.get("regime", "always")) != "always":
        quoted = f"{_QUOTES[0]}{replace_underscores(regime)}{_QUOTES[1]}"
        yield f" shows most in the regime {quoted}{_name_window(where)}."
    if onset := where.get("onset"):
        moment = format_quantity({**onset, "value": onset.get("time"), "unit": "s"})
        yield f" sets in at {moment} of episode {onset.get('episode')}."
    effect = load_catalogue().get(finding["effect"])
    for field in effect.finding_fields if effect is not None else ():
        value = finding.get(field.name)
        if field.note and value in field.values:
            yield field.note.format(value=value)
    if finding.get("native") is False:
        yield _explain_replay(finding["effect"])


def _explain_replay(effect: str) -> str:
    """What patched.xml has of an effect that plain MuJoCo cannot express."""
    known = load_catalogue().get(effect)
    if known is not None and isinstance(known, ModelEdit):
        return (
            ": plain MuJoCo can express only a part of it; patched.xml has that part, "
            "and selfheal replay applies all of it."
        )
    return (
        ": plain MuJoCo cannot express it, so it is not in patched.xml; selfheal "
        "replay applies it."
    )


def _name_window(where: Location) -> str:
    """The first window that a finding shows in."""
    for window in where.get("windows", ())[:1]:
        start, end = format_short(window.get("start")), format_short(window.get("end"))
        return f", for example from {start} to {end} s of episode {window['episode']}"
    return ""


def _list_experiments(diagnosis: Diagnosis) -> list[str]:
    """What would tell the best candidates that earned no name from one another."""
    known = load_catalogue()
    found = [
        f"{capitalize(known[c.effect].separate_by)}: would decide about {c.effect} at "
        f"{c.target}."
        for c in diagnosis.candidates
        if not c.named and c.effect in known and known[c.effect].separate_by
    ]
    return found[:_NEAREST]


def _make_errors_section(diagnosis: Diagnosis) -> Section:
    """The errors on held-out recordings, and over longer and longer segments."""
    fit = diagnosis.document["fit"]
    labels = "model as given", "what it states, re-fitted", "with the findings", "floor"
    drawn = make_bars(
        (label, format_short(error), parse_number(error))
        for label, key in zip(labels, MODELS, strict=True)
        if key in fit
        for error in [fit.get(key)]
    )
    removed = parse_number(fit.get("explainable_removed"))
    if not diagnosis.document["findings"]:
        said = "Nothing is named, so the patched model is the re-fitted one."
    elif isfinite(removed):
        share = format_percent(removed)
        said = f"Of the error that can be explained, they remove {share}."
    else:
        said = "The re-fitted model is within 5 % of the floor: no share is stated."
    note = (
        "Normalized error on held-out recordings: 0 is perfect, 1 is as far off as a "
        "constant. The floor is what noise, or a correction of free form, leaves; what "
        "lies between it and the re-fitted model can be explained."
    )
    over: tuple[str, ...] = ()
    if fit.get("horizons"):
        over = format_horizons(fit), _HORIZONS, format_errors(fit)
    return Section("Before and after", (drawn, said, *over, make_note(note)))


def _make_traces_section(diagnosis: Diagnosis) -> tuple[Section, list[str]]:
    """The worst stretches, and the scripts that make them zoom."""
    chosen = [t for t in diagnosis.traces if len(t.time)][:_MOST_TRACES]
    title = "Measured against predicted, where it was worst"
    if not chosen:
        return Section(title, ("There is no held-out stretch to show.",)), []
    caption = (
        "Held-out stretches, none of them seen by the fit. Below each: predicted minus "
        "measured. A curve that leaves the picture is further off."
    )
    fig, live = figures.draw_traces(chosen), NOTHING
    scripts: list[str] = []
    if is_live_available():
        live, scripts = make_live_curves(chosen, fig)
    else:
        caption += f" With more libraries they zoom: {format_install(EXTRA)}"
    return Section(title, (embed_figure(fig, caption, live),)), scripts


def _make_map_section(located: Localization) -> Section:
    """The map."""
    title = "Where the re-fitted model is wrong"
    share = np.asarray(located.share)
    if not share.size or not np.isfinite(share).any():
        return Section(title, (UNTOLD,))
    caption = (
        "Share of the squared error in percent, by signal and regime. Framed: more "
        "than elsewhere, p below 0.01, corrected for the whole map. A dash: never "
        "seen. Regimes overlap, so they can add up to more than all."
    )
    if len(located.signals) > figures.SIGNALS:
        caption += f" The {figures.SIGNALS} signals with the most error are shown."
    return Section(title, (embed_figure(figures.draw_error_map(located), caption),))


def _make_candidates_section(diagnosis: Diagnosis) -> Section:
    """The ranking."""
    found = diagnosis.document["findings"]
    if not diagnosis.candidates and not found:
        return Section("Candidates", ("No effect came near to being tried.",))
    note = (
        "Error left: share of the squared error that the effect alone leaves, before "
        "anything else is named. Gain: in the log-likelihood of what the fit did not "
        "see, an effective sample. p: corrected for every candidate tried. Stability: "
        "how often it, or what cannot be distinguished from it, comes first when the "
        "recordings are resampled."
    )
    ranking = tables.format_candidates(diagnosis.candidates, found)
    return Section("Candidates", (ranking, make_note(note)))


def _make_refit_section(diagnosis: Diagnosis) -> Section:
    """What the model stated already."""
    title, stated = "What the model already states", diagnosis.document["refit"]
    if not stated:
        return Section(title, ("It states nothing that was re-fitted.",))
    stuck = sum(map(tables.is_at_bound, stated))
    said = (
        "Opened as far as a careful user would: mass and inertia 15 %, lengths 3 %, "
        "the rest 30 %."
    )
    if stuck:
        said += f" At their bounds: {stuck}; the true value may lie beyond."
    if loose := sum(map(is_unidentified, stated)):
        said += f" Not pinned down: {loose}; the data fit any value that is allowed."
    return Section(title, (said, tables.format_refit(stated)))


def _make_diff_section(diagnosis: Diagnosis) -> Section:
    """The diff."""
    shown = "patched.xml says the same as the given model."
    if diagnosis.diff.strip():
        shown = format_diff(diagnosis.diff)
    return Section("The change to the model", (shown,))


def _make_signals_section(diagnosis: Diagnosis) -> Section:
    """The table of signals."""
    title, signals = "Held-out recordings, signal by signal", diagnosis.signals
    if not signals:
        return Section(title, ("No signal could be compared.",))
    harmed = [s.name for s in signals if is_worse(s)]
    said = (
        f"Made worse by the findings: {', '.join(harmed)}."
        if harmed
        else "No signal is made worse by the findings."
    )
    note = (
        "Normalized, and in the signal's unit in brackets; below each error its 90 % "
        "interval over episodes. Noise: of the readings "
        "alone; where a replay starts from a state that was read, that state's noise "
        "comes on top."
    )
    return Section(title, (said, format_held_out(signals), make_note(note)))


def _make_remarks_section(diagnosis: Diagnosis) -> Section:
    """What else a user should read."""
    return Section("Remarks", (make_bullets(diagnosis.remarks) or "None.",))


def _make_method_section(
    diagnosis: Diagnosis, model: str, recordings: Sequence[str]
) -> Section:
    """What was done with what."""
    rows = [
        ("model", model),
        ("recordings", ", ".join(recordings)),
        ("held out", ", ".join(diagnosis.document["fit"].get("held_out", ()))),
        ("windows simulated", f"{diagnosis.simulations:,}"),
        ("time taken", f"{diagnosis.seconds:.1f} s"),
    ]
    said = (
        "Recordings were held out first. On the rest, what the model states was "
        "re-fitted within its bounds; then every effect of the catalogue was tried "
        "everywhere it could be, together with that re-fit. A name is given only to "
        "what predicts windows better that its fit did not see, after paying for all "
        "that was tried. The held-out recordings were seen by no fit; they decided "
        "which of two hypotheses stays and which names do not help there and are "
        "withdrawn, and the result was replayed on them, open loop."
    )
    if stopped := diagnosis.document.get("stopped"):
        said += f" All that was done until it was stopped, while {stopped['while']}."
    body = make_table(("what", "which"), rows, "ll")
    return Section("How this was computed", (said, body))
