"""The report of a diagnosis: a Diagnosis in, one HTML page out."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ..diagnosis.effects import load_catalogue
from ..diagnosis.effects.base import implements
from ..diagnosis.effects.nominal import is_unidentified
from ..diagnosis.output.result import Diagnosis, Localization
from . import figures, tables
from .facts import percent
from .page import Html, Section, bars, bullets, diff, join, mark, paragraph, table
from .page import page as whole
from .phrases import COMMON, MEANS, UNTOLD
from .picture import figure, style
from .tables import given_number, quantity, short

_MOST_TRACES, _MOST_NAMED, _NEAREST = 6, 3, 3  # drawn, in a sentence, advised; chosen
_MOST_PLACES = 4  # that a sentence names; chosen
_NOISE = 1.5  # times the floor, an error that is called as large as noise; chosen
_UNKNOWN = 1e4  # times the floor, an error beside which none was measured; chosen
_ALL = 0.995  # share of the explainable error that is called all of it; chosen


def page(diagnosis: Diagnosis, model: str, recordings: Sequence[str]) -> str:
    """The page of a diagnosis, as one self-contained HTML text.

    Args:
        diagnosis: to be told.
        model: the file that was given.
        recordings: the files that it was compared with.
    """
    with style():
        sections = [
            _missing(diagnosis),
            _before_after(diagnosis),
            _traces(diagnosis),
            _located(diagnosis.located),
            _candidates(diagnosis),
            _refit(diagnosis),
            _change(diagnosis),
            _held_out(diagnosis),
            _remarks(diagnosis),
            _computed(diagnosis, model, recordings),
        ]
    title = f"Diagnosis of {Path(model).name}"
    return whole(title, sections, lead=sentence(diagnosis.document))


# ---- in words


def sentence(document: Mapping[str, Any]) -> str:
    """The verdict of diagnosis.json in a sentence."""
    verdict, found = document["verdict"], document["findings"]
    if verdict == "nothing":
        return (
            "Nothing is missing that these recordings can show: what the re-fitted "
            "model leaves is noise."
        )
    if verdict == "unlisted" or not found:
        return (
            "The model lacks physics that is not in the catalogue: structured error "
            "remains, and no effect earns its place."
        )
    rest = "" if verdict == "explained" else (
        ", and structured error remains that has no name"
    )  # fmt: skip
    return f"{_named(found)}; {_effect(document['fit'], len(_clauses(found)))}{rest}."


def _named(found: Sequence[Mapping[str, Any]]) -> str:
    """What was found, as the first half of a sentence."""
    said = _clauses(found)
    if len(said) == 1:
        return _capital(said[0])
    first = ", first of all" if len(said) > _MOST_NAMED else ""
    shown = "; ".join(said[:_MOST_NAMED])
    return f"{len(said)} things differ from the model{first}: {shown}"


def _clauses(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """A clause a finding; the same thing in several places is one."""
    alike: dict[str, list[Mapping[str, Any]]] = {}
    for finding in found:
        alike.setdefault(_clause(finding, "{}"), []).append(finding)
    return [
        _clause(same[0], _places([finding["target"] for finding in same]))
        for same in alike.values()
    ]


def _effect(fit: Mapping[str, Any], count: int) -> str:
    """How much the findings help, as the second half."""
    them = "it" if count == 1 else "together they"
    removed = given_number(fit.get("explainable_removed"))
    refit, patched = short(fit.get("refit"), 2), short(fit.get("patched"), 2)
    if not isfinite(removed):
        verb = "brings" if count == 1 else "bring"
        return f"{them} {verb} the held-out error from {refit} to {patched}"
    verb = "explains" if count == 1 else "explain"
    if removed <= 0:
        return f"{them} {verb} none of the held-out error ({refit} before)"
    much = percent(removed) if removed < _ALL else "all"
    return f"{them} {verb} {much} of the error that can be explained"


def _clause(finding: Mapping[str, Any], place: str) -> str:
    """A finding in plain words, without a capital and a full stop."""
    parameters = {p["name"]: quantity(p) for p in finding["parameters"]}
    every = ", ".join(f"{name} {said}" for name, said in parameters.items())
    words = {**COMMON, **parameters, "at": place, "all": every}
    name, since = finding["effect"], tables.since(finding)
    since = f", {since}" if since else ""
    effect = load_catalogue().get(name)
    if effect is not None and effect.phrase:
        try:
            return effect.phrase.format_map(words) + since
        except KeyError:  # the finding has other parameters than the phrase speaks of
            pass
    known = f" ({every})" if every else ""
    return f"{place} shows {_plain(name)}{known} that the model lacks{since}"


def _places(targets: Sequence[str]) -> str:
    """Targets as a person says them."""
    if len(targets) == 1:
        return _place(targets[0])
    kind, names = targets[0].partition(":")[0], [t.partition(":")[2] for t in targets]
    kind = "signal" if kind == "sensor" else kind
    if len(names) > _MOST_PLACES:
        return f"each of {len(names)} {kind}s"
    return f"each of the {kind}s {', '.join(names[:-1])} and {names[-1]}"


def _place(target: str) -> str:
    """A target as a person says it."""
    kind, colon, name = target.partition(":")
    if not colon:
        return "the robot" if kind == "world" else f"the {kind}"
    return f"the {'signal' if kind == 'sensor' else kind} {name}"


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


# ---- section by section


def _missing(diagnosis: Diagnosis) -> Section:
    """The findings, what the verdict means, what to do."""
    document = diagnosis.document
    found, verdict = document["findings"], document["verdict"]
    body = [tables.findings(document)] if found else []
    body.append(paragraph(_meaning(diagnosis)))
    body.append(bullets(note for f in found for note in _notes(f)))
    if verdict in ("partly", "unlisted") and (tries := _experiments(diagnosis)):
        body += [paragraph("Experiments that would show more:"), bullets(tries)]
    return Section("What is missing" if found else "What this means", tuple(body))


def _meaning(diagnosis: Diagnosis) -> str:
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
    patched, floor = (given_number(fit.get(key)) for key in ("patched", "floor"))
    if floor > 0 and patched > _NOISE * floor:
        times = f", {short(patched / floor, 2)} times the floor."
        if patched > _UNKNOWN * floor:  # of single readings nothing tells it
            times = "; what noise would leave is not known."
        means += (
            f" Replayed open loop, the held-out recordings are off by {short(patched)}"
            f"{times}"
        )
    return means


def _notes(finding: Mapping[str, Any]) -> Iterable[Html]:
    """What a user should know of a finding besides its numbers."""
    named = f"{finding['effect']} at {finding['target']}"
    rivals = ", ".join(finding.get("equivalent", ()))
    if rivals:
        advice = finding.get("separate_by")
        how = f" To separate them: {advice}." if advice else ""
        yield join(mark(named, "right"), f" cannot be told from {rivals} by these "
                   f"data.{how}")  # fmt: skip
    where = finding.get("where") or {}
    if where.get("regime", "always") != "always":
        yield join(mark(named, "right"), " shows most in the regime "
                   f"\N{LEFT DOUBLE QUOTATION MARK}{_plain(where['regime'])}"
                   f"\N{RIGHT DOUBLE QUOTATION MARK}{_windows(where)}.")  # fmt: skip
    if onset := where.get("onset"):
        moment = quantity({**onset, "value": onset.get("time"), "unit": "s"})
        yield join(mark(named, "right"), f" sets in at {moment} of episode "
                   f"{onset.get('episode')}.")  # fmt: skip
    effect = load_catalogue().get(finding["effect"])
    for field in effect.finding_fields if effect is not None else ():
        value = finding.get(field.name)
        if field.note and value in field.values:
            yield join(mark(named, "right"), field.note.format(value=value))
    if finding.get("native") is False:
        yield join(mark(named, "right"), _by_replay(finding["effect"]))


def _by_replay(effect: str) -> str:
    """What patched.xml has of an effect that plain MuJoCo cannot express."""
    known = load_catalogue().get(effect)
    if known is not None and implements(known, "edit_model"):
        return (
            ": plain MuJoCo can express only a part of it; patched.xml has that part, "
            "and selfheal replay applies all of it."
        )
    return (
        ": plain MuJoCo cannot express it, so it is not in patched.xml; selfheal "
        "replay applies it."
    )


def _windows(where: Mapping[str, Any]) -> str:
    """The first window that a finding shows in."""
    for window in where.get("windows", ())[:1]:
        start, end = short(window.get("start")), short(window.get("end"))
        return f", for example from {start} to {end} s of episode {window['episode']}"
    return ""


def _experiments(diagnosis: Diagnosis) -> list[str]:
    """What would tell the best candidates that earned no name from one another."""
    known = load_catalogue()
    found = [
        f"{_capital(known[c.effect].separate_by)}: would decide about {c.effect} at "
        f"{c.target}."
        for c in diagnosis.candidates
        if not c.named and c.effect in known and known[c.effect].separate_by
    ]
    return found[:_NEAREST]


def _before_after(diagnosis: Diagnosis) -> Section:
    """Four numbers."""
    fit = diagnosis.document["fit"]
    rows = {
        "model as given": "given",
        "what it states, re-fitted": "refit",
        "with the findings": "patched",
        "floor": "floor",
    }
    errors = {label: given_number(fit.get(key)) for label, key in rows.items()}
    drawn = bars((label, short(error), error) for label, error in errors.items())
    removed = given_number(fit.get("explainable_removed"))
    if not diagnosis.document["findings"]:
        said = "Nothing is named, so the patched model is the re-fitted one."
    elif isfinite(removed):
        said = f"Of the error that can be explained, they remove {percent(removed)}."
    else:
        said = "The re-fitted model is within 5 % of the floor: no share is stated."
    note = (
        "Normalized error on held-out recordings: 0 is perfect, 1 is as far off as a "
        "constant. The floor is what noise, or a correction of free form, leaves; what "
        "lies between it and the re-fitted model can be explained."
    )
    return Section("Before and after", (drawn, said, paragraph(mark(note, "soft"))))


def _traces(diagnosis: Diagnosis) -> Section:
    """The worst stretches."""
    chosen = [t for t in diagnosis.traces if len(t.time)][:_MOST_TRACES]
    title = "Measured against predicted, where it was worst"
    if not chosen:
        return Section(title, ("There is no held-out stretch to show.",))
    caption = (
        "Held-out stretches, none of them seen by the fit. Below each: predicted minus "
        "measured. A curve that leaves the picture is further off."
    )
    return Section(title, (figure(figures.traces(chosen), caption),))


def _located(located: Localization) -> Section:
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
    return Section(title, (figure(figures.error_map(located), caption),))


def _candidates(diagnosis: Diagnosis) -> Section:
    """The ranking."""
    found = diagnosis.document["findings"]
    if not diagnosis.candidates and not found:
        return Section("Candidates", ("No effect came near to being tried.",))
    note = (
        "Error left: share of the squared error that the effect alone leaves, before "
        "anything else is named. Gain: in the log-likelihood of what the fit did not "
        "see, an effective sample. p: corrected for every candidate tried. Stability: "
        "how often it, or what cannot be told from it, comes first when the recordings "
        "are resampled."
    )
    ranking = tables.candidates(diagnosis.candidates, found)
    return Section("Candidates", (ranking, paragraph(mark(note, "soft"))))


def _refit(diagnosis: Diagnosis) -> Section:
    """What the model stated already."""
    title, stated = "What the model already states", diagnosis.document["refit"]
    if not stated:
        return Section(title, ("It states nothing that was re-fitted.",))
    stuck = sum(map(tables.at_bound, stated))
    said = (
        "Opened as far as a careful user would: mass and inertia 15 %, lengths 3 %, "
        "the rest 30 %."
    )
    if stuck:
        said += f" At their bounds: {stuck}; the true value may lie beyond."
    if loose := sum(map(is_unidentified, stated)):
        said += f" Not pinned down: {loose}; the data fit any value that is allowed."
    return Section(title, (said, tables.refit(stated)))


def _change(diagnosis: Diagnosis) -> Section:
    """The diff."""
    title = "The change to the model"
    same = "patched.xml says the same as the given model."
    return Section(title, (diff(diagnosis.diff) if diagnosis.diff.strip() else same,))


def _held_out(diagnosis: Diagnosis) -> Section:
    """The table of signals."""
    title, signals = "Held-out recordings, signal by signal", diagnosis.signals
    if not signals:
        return Section(title, ("No signal could be compared.",))
    harmed = [s.name for s in signals if tables.worse(s)]
    said = (
        f"Made worse by the findings: {', '.join(harmed)}."
        if harmed
        else "No signal is made worse by the findings."
    )
    note = (
        "Below each error: its 90 % interval over episodes. Noise: of the readings "
        "alone; where a replay starts from a state that was read, that state's noise "
        "comes on top."
    )
    return Section(
        title, (said, tables.held_out(signals), paragraph(mark(note, "soft")))
    )


def _remarks(diagnosis: Diagnosis) -> Section:
    """What else a user should read."""
    return Section("Remarks", (bullets(diagnosis.remarks) or "None.",))


def _computed(diagnosis: Diagnosis, model: str, recordings: Sequence[str]) -> Section:
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
        "that was tried. The held-out recordings were seen by no fit; they were asked "
        "which of two hypotheses stays and which names do not help there and are taken "
        "back, and the result was replayed on them, open loop."
    )
    body = table(("what", "which"), rows, "ll")
    return Section("How this was computed", (said, body))
