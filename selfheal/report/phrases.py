"""A diagnosis in words: takes diagnosis.json, gives sentences and their parts."""

from collections.abc import Sequence
from math import isfinite

from ..diagnosis.effects import load_catalogue
from ..diagnosis.output.schema import Document, Finding, FitScores
from . import tables
from .facts import format_percent
from .tables import format_quantity, format_short, parse_number

_MOST_NAMED = 3  # findings that a sentence names; chosen

# what an effect's phrase may name beside its target and its parameters
COMMON = {"lacks": "that the model lacks", "other": "other than in the model"}
UNTOLD = (
    "These recordings cannot tell where it is wrong: too few readings lie inside, or "
    "outside, of each regime."
)
# of a verdict
MEANS = {
    "explained": "What the findings leave of short pieces is as large as noise.",
    "partly": "The findings help on recordings that the fit did not see, but what "
    "remains is not noise, and no further effect of the catalogue earns its place. "
    "Use the patched model where its error is small enough, and look at the map below "
    "for where the rest lies.",
    "unlisted": "The re-fitted model is wrong in a way that is no noise, yet no effect "
    "of the catalogue predicts recordings better that the fit did not see. The map "
    "below tells where to look.",
    "undecided": "The search was stopped before it was through, and nothing that it "
    "had tried has proved itself. What was not tried may explain what is left: give it "
    "more time. The map below tells where the model is wrong so far.",
    "nothing": "After re-fitting what the model states, what remains on recordings "
    "that the fit did not see is as large as noise. That holds for motions like these; "
    "what was never excited cannot be seen, and stands under Remarks.",
}
_MOST_PLACES = 4  # that a sentence names; chosen
_ALL = 0.995  # share of the explainable error that is called all of it; chosen


def state_verdict(document: Document) -> str:
    """The verdict of diagnosis.json in a sentence."""
    verdict, found = document["verdict"], document["findings"]
    if verdict == "nothing":
        return (
            "Nothing is missing that these recordings can show: what the re-fitted "
            "model leaves is noise."
        )
    if verdict == "undecided":
        stopped = document["stopped"]
        return (
            f"Stopped after {stopped['tried']} of {stopped['of']} effects were tried, "
            f"while {stopped['while']}: nothing is proven yet, and structured error "
            "remains."
        )
    if verdict == "unlisted" or not found:
        return (
            "The model lacks physics that is not in the catalogue: structured error "
            "remains, and no effect earns its place."
        )
    left = ", and structured error remains that has no name"
    rest = left if verdict != "explained" else ""
    gain = _state_improvement(document["fit"], len(_list_clauses(found)))
    return f"{_name_findings(found)}; {gain}{rest}."


def _name_findings(found: Sequence[Finding]) -> str:
    """What was found, as the first half of a sentence."""
    said = _list_clauses(found)
    if len(said) == 1:
        return capitalize(said[0])
    first = f", the {_MOST_NAMED} that explain most" * (len(said) > _MOST_NAMED)
    shown = "; ".join(said[:_MOST_NAMED])
    return f"{len(said)} things differ from the model{first}: {shown}"


def _list_clauses(found: Sequence[Finding]) -> list[str]:
    """A clause a finding; the same thing in several places is one."""
    alike: dict[str, list[Finding]] = {}
    for finding in found:
        alike.setdefault(_write_clause(finding, "{}"), []).append(finding)
    return [
        _write_clause(same[0], _name_places([finding["target"] for finding in same]))
        for same in alike.values()
    ]


def _state_improvement(fit: FitScores, count: int) -> str:
    """How much the findings help, as the second half."""
    them, s = ("it", "s") if count == 1 else ("together they", "")
    removed, over = _find_removed(fit)
    refit, patched = (format_short(fit.get(k), 2) for k in ("refit", "patched"))
    if not isfinite(removed):
        return f"{them} bring{s} the held-out error from {refit} to {patched}"
    if removed <= 0:
        return f"{them} explain{s} none of the held-out error ({refit} before)"
    much = format_percent(removed) if removed < _ALL else "all"
    return f"{them} explain{s} {much} of the error{over} that can be explained"


def _find_removed(fit: FitScores) -> tuple[float, str]:
    """Share of the explainable error that is gone, and over how long, if that counts.

    Short pieces may be noise alone where longer ones show what findings are worth.
    """
    removed = parse_number(fit.get("explainable_removed"))
    if isfinite(removed):
        return removed, ""
    for horizon in fit.get("horizons", ()):
        longer = parse_number(horizon.get("explainable_removed"))
        if longer > 0:
            return longer, f" over {horizon['seconds']:.3g} s"
    return removed, ""


def _write_clause(finding: Finding, place: str) -> str:
    """A finding in words, without a capital and a full stop."""
    parameters = {p["name"]: format_quantity(p) for p in finding["parameters"]}
    every = ", ".join(f"{name} {said}" for name, said in parameters.items())
    words = {**COMMON, **_tell_given(finding), **parameters, "at": place, "all": every}
    name, since = finding["effect"], tables.format_onset(finding)
    since = f", {since}" if since else ""
    effect = load_catalogue().get(name)
    if effect is not None and effect.phrase:
        try:
            return effect.phrase.format_map(words) + since
        except KeyError:  # the finding has other parameters than the phrase speaks of
            pass
    known = f" ({every})" if every else ""
    return (
        f"{place} shows {replace_underscores(name)}{known} that the model lacks{since}"
    )


def _tell_given(finding: Finding) -> dict[str, str]:
    """What a phrase says of the one value that the model states in a finding's place.

    Returns:
        Words in the place of those of `COMMON`; none where the model states 0, or
        several values.
    """
    given = [p for p in finding["parameters"] if p.get("given")]
    if len(given) != 1:
        return {}
    (p,) = given
    said = f"{format_short(p['given'], 3)} {p['unit']}".removesuffix(" 1")
    stated = f"where the model states {said}"
    return {"lacks": stated, "other": stated}


def _name_places(targets: Sequence[str]) -> str:
    """Targets as a person says them."""
    if len(targets) == 1:
        return _name_place(targets[0])
    kind, names = targets[0].partition(":")[0], [t.partition(":")[2] for t in targets]
    kind = "signal" if kind == "sensor" else kind
    if len(names) > _MOST_PLACES:
        return f"each of {len(names)} {kind}s"
    return f"each of the {kind}s {', '.join(names[:-1])} and {names[-1]}"


def _name_place(target: str) -> str:
    """A target as a person says it."""
    kind, colon, name = target.partition(":")
    if not colon:
        return "the robot" if kind == "world" else f"the {kind}"
    return f"the {'signal' if kind == 'sensor' else kind} {name}"


def replace_underscores(name: str) -> str:
    """A name of diagnosis.json as words."""
    return name.replace("_", " ")


def capitalize(words: str) -> str:
    """Words with a capital first letter; the others stay as they are."""
    return words[:1].upper() + words[1:]
