"""Errors of a diagnosis's predictions: `fit` of its document in, words, tables out."""

from collections.abc import Iterator, Sequence
from math import degrees, floor, isfinite, log10

from ..diagnosis.data.robot_summary import POSITION_LIKE
from ..diagnosis.output.result import SignalFit
from ..diagnosis.output.schema import FitScores, KindErrors, Scores
from .facts import DASH, format_percent
from .page import Html, join_markup, make_table, mark_text
from .tables import format_short, parse_number

MODELS = ("given", "refit", "patched", "floor")
# what people read in place of an SI unit, and how many of it that is
READ_AS = {
    "rad": ("deg", degrees(1)),
    "rad/s": ("deg/s", degrees(1)),
    "m": ("mm", 1e3),
    "m/s": ("mm/s", 1e3),
}


def format_error(value: object, unit: str) -> str:
    """An error in the unit that people read, by two digits, or a dash.

    Args:
        value: of a document [unit].
    """
    read_as, size = READ_AS.get(unit, (unit, 1.0))
    error = size * parse_number(value)
    if not isfinite(error):
        return DASH
    written = (
        f"{error:.{max(0, 1 - floor(log10(error)))}f}"
        if 1e-4 <= error < 1e6
        else format_short(error, 2)
    )
    return f"{written} {read_as}".removesuffix(" 1")


def state_errors(fit: FitScores) -> list[str]:
    """A sentence on each kind of signal that counts, over the shortest segments."""
    every: list[Scores] = [*(fit.get("horizons") or ()), fit]
    scores = every[0]
    said = []
    for errors in scores.get("errors") or ():
        if errors["kind"] in POSITION_LIKE:
            given, _, patched, least = _format_models(errors)
            said.append(
                f"Prediction error of {_name_kind(errors['kind'])} "
                f"{name_replay(scores)}: {given} as given, {patched} patched "
                f"(noise {least})."
            )
    return said


def list_errors(fit: FitScores) -> Iterator[tuple[str, ...]]:
    """Errors of each kind of signal in its unit, in segments of each length.

    Returns:
        The kind, the length, and the error of each of `MODELS`.
    """
    every: Sequence[Scores] = fit.get("horizons") or [fit]
    found = [(e, scores) for scores in every for e in scores.get("errors") or ()]
    kinds = list(dict.fromkeys(e["kind"] for e, _ in found))
    for errors, scores in sorted(found, key=lambda each: kinds.index(each[0]["kind"])):
        kind, over = _name_kind(errors["kind"]), name_replay(scores)
        yield kind, over.removeprefix("over "), *_format_models(errors)


def name_replay(scores: Scores) -> str:
    """The length of replayed segments in words ("over 2 s")."""
    if "seconds" not in scores:
        return "in the replay"
    return f"over {format_short(scores['seconds'], 2)} s"


def _format_models(errors: KindErrors) -> list[str]:
    """The errors of a kind of signal by each of `MODELS`."""
    return [format_error(errors.get(model), errors["unit"]) for model in MODELS]


def _name_kind(kind: str) -> str:
    """Signals of a kind ("joint positions")."""
    if kind == "sensor":
        return "sensor readings"
    words = kind.replace("_", " ")
    return f"{words[:-1]}ies" if words.endswith("y") else f"{words}s"


def format_horizons(fit: FitScores) -> Html:
    """A row for each length of replayed segments: errors, and what is removed."""
    head = ["replayed", "as given", "re-fitted"]
    head += ["with the findings", "floor", "explainable removed"]
    rows = []
    for horizon in fit["horizons"]:
        errors = [format_short(horizon.get(key)) for key in MODELS]
        removed = parse_number(horizon.get("explainable_removed"))
        share = format_percent(removed) if isfinite(removed) else DASH
        rows.append([name_replay(horizon), *errors, share])
    return make_table(head, rows, "lrrrrr")


def format_errors(fit: FitScores) -> Html:
    """A row for each kind of signal and length of replayed segments, in its unit."""
    head = "error of", "over", "as given", "re-fitted", "with the findings", "floor"
    return make_table(head, list_errors(fit), "lrrrrr")


def format_held_out(signals: Sequence[SignalFit]) -> Html:
    """A row a signal: its error by each model, those that count first."""
    rows = [
        (
            s.name,
            *(_format_signal_error(e, s) for e in (s.given, s.refit, s.patched)),
            join_markup(format_short(s.floor), _format_physical(s.floor, s)),
            mark_text("worse than re-fitted", "wrong") if is_worse(s) else "",
            "" if s.scored else mark_text("not scored", "soft"),
        )
        for s in sorted(signals, key=lambda s: not s.scored)
    ]
    head = ("signal", "given", "re-fitted", "patched", "noise", "", "")
    return make_table(head, rows, "lrrrrll")


def is_worse(signal: SignalFit) -> bool:
    """Whether the findings make a signal worse by more than the last digit."""
    return signal.patched[0] > 1.01 * signal.refit[0]


def _format_physical(error: float, signal: SignalFit) -> Html:
    """A signal's error in its unit, in brackets."""
    said = format_error(error * signal.scale, signal.unit)
    return mark_text(f" ({said})", "soft")


def _format_signal_error(error: tuple[float, float, float], signal: SignalFit) -> Html:
    """An error, also in the signal's unit, above its interval."""
    value, low, high = error
    known = isfinite(low) and isfinite(high)
    between = f"{format_short(low)} to {format_short(high)}" if known else DASH
    physical = _format_physical(value, signal)
    soft = mark_text(between, "soft")
    return join_markup(format_short(value), physical, Html("<br>"), soft)
