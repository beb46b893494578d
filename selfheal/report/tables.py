"""Tables of a self-modeling run, and of a diagnosis: either in, markup out."""

from collections.abc import Callable, Collection, Mapping, Sequence
from math import floor, isfinite, log10
from typing import Any

from ..body.genome import HINGE_NAMES
from ..diagnosis.effects.nominal import is_unidentified, relative_bound
from ..diagnosis.output.result import Candidate
from ..engine.channels import list_channels
from ..selfmodel.run import Run
from .facts import (
    SIDES,
    Rival,
    choose_channels,
    find_true_side,
    format_number,
    format_percent,
    name_action,
    name_part,
)
from .page import (
    Html,
    join_markup,
    make_details,
    make_paragraph,
    make_table,
    mark_text,
)

_MOST_RIVALS = 12  # rows of the table; chosen
_MOST_CHANNELS = 3  # that fit on a page; chosen
_MOST_CANDIDATES, _MOST_REFIT = 12, 12  # rows that need no click; chosen
_AT_BOUND = 0.01  # of the way to a bound that counts as having got there; chosen
GROWTH = "error without it"  # the head of a column
_DASH, _BREAK = "\N{EN DASH}", Html("<br>")


def format_tree(run: Run) -> Html:
    """A row a part: its parent, where on it, how long, how sure, right or wrong."""
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
        row: list[object] = [i + 1, name, name_part(run, parent), side]
        row.append(f"{1000 * best.length[0, i]:.0f}")
        row += [HINGE_NAMES[best.hinge[0, i]]] if full else []
        row.append(format_percent(run.cycles[-1].sureness[i]))
        row += [] if run.truth is None else [_judge_attachment(run, i)]
        rows.append(row)
    return make_table(head, rows, align)


def _judge_attachment(run: Run, i: int) -> Html:
    """Whether a part's attachment is right, and what is true if it is not."""
    assert run.truth is not None
    best, truth = run.cycles[-1].genomes, run.truth
    parent, side = int(truth.parent[0, i]), int(find_true_side(truth)[0, i])
    if best.parent[0, i] != parent:
        name = name_part(run, parent)
        return join_markup(
            mark_text("wrong", "wrong"), f": truly on {name}, {SIDES[side]}"
        )
    if best.side[0, i] != side:
        return join_markup(
            mark_text("correct", "right"), f", but truly at its {SIDES[side]}"
        )
    return mark_text("correct", "right")


def format_simulations(run: Run) -> Html:
    """Simulations by engine."""
    notes = {
        "choice": "spent on choosing actions",
        "failed": "diverged (counted above)",
    }
    counts = sorted(run.counts.items(), key=lambda item: item[0] in notes)
    rows = [(notes.get(k, f"on {k}"), f"{n:,}") for k, n in counts]
    return join_markup(
        make_paragraph("Simulations:"), make_table(("what for", "number"), rows, "lr")
    )


def format_residuals(run: Run) -> Html:
    """A row an action: measured, predicted, and what is between them."""
    head = ["cycle", "joints down"]
    channels = list_channels(run.anatomy)
    shown = choose_channels(run, _MOST_CHANNELS)
    for k in shown:
        name = f"{channels.names[k]} [{channels.units[k]}]"
        head += [f"{name} measured", "predicted", "off by"]
    rows = []
    for n, cycle in enumerate(run.cycles):
        predicted = run.cycles[-1].tables[0][cycle.action]
        row: list[object] = [n + 1, name_action(run, cycle.action)]
        for k in shown:
            values = cycle.felt[k], predicted[k], predicted[k] - cycle.felt[k]
            row += [format_number(v, 1) for v in values]
        rows.append(row)
    return make_table(head, rows, "rl" + "rrr" * len(shown))


def format_reasons(run: Run) -> Html:
    """A row an action: why it was chosen."""
    rows = [
        (n + 1, name_action(run, cycle.action), cycle.why)
        for n, cycle in enumerate(run.cycles)
    ]
    return make_table(("cycle", "joints down", "why"), rows, "rll")


def format_rivals(run: Run, found: list[Rival]) -> Html:
    """A row a rival, the best one first, and what the columns mean."""
    head = ["rank", "loss", "extra an action", "what differs from the best one",
            "away [cm]", "most apart [deg]"]  # fmt: skip
    align = "rrrlrr"
    if run.truth is not None:
        head, align = [*head, "correct"], align + "r"
    rows = [_format_rival(run, r) for r in found[:_MOST_RIVALS]]
    note = (
        "Away: mean distance of the parts' centers from the best one's. Most apart: "
        "the largest difference in tilt that any of the robot's actions would show."
    )
    if len(found) > _MOST_RIVALS:
        note = f"The first {_MOST_RIVALS}, the best one included. {note}"
    return join_markup(
        make_table(head, rows, align), make_paragraph(mark_text(note, "soft"))
    )


def _format_rival(run: Run, rival: Rival) -> list[object]:
    """A rival's row."""
    differs = "; ".join(rival.differs) or "nothing worth naming"
    row: list[object] = [
        rival.rank,
        format_number(rival.loss),
        format_number(rival.excess),
    ]
    row.append(differs if rival.rank > 1 else mark_text("the best one", "soft"))
    row += [format_number(rival.away, 1), format_number(rival.apart, 1)]
    if rival.right is not None:
        row.append(f"{rival.right} of {run.anatomy.size}")
    return row


def parse_number(value: object) -> float:
    """A number of a document; NaN where it says that there is none."""
    return float(value) if isinstance(value, int | float) else float("nan")


def format_short(value: object, digits: int = 3) -> str:
    """A number of a document by its leading digits, or a dash."""
    known = parse_number(value)
    return f"{known:.{digits}g}" if isfinite(known) else _DASH


def format_quantity(stated: Mapping[str, Any]) -> str:
    """A value with its unit and interval, to the digits that the interval gives.

    Args:
        stated: value, low, high and unit, as the document has them; a vector's are
            lists, and its interval is left out.
    """
    value, low, high = (stated.get(key) for key in ("value", "low", "high"))
    unit = f" {stated.get('unit') or ''}".removesuffix(" 1").rstrip()
    if isinstance(value, Sequence):
        each = zip(value, low or value, high or value, strict=True)
        written = [
            _choose_digits(*map(parse_number, x))(parse_number(x[0])) for x in each
        ]
        return f"({', '.join(written)}){unit}"
    value, low, high = map(parse_number, (value, low, high))
    return _format_scalar(value, low, high, unit)


def format_onset(finding: Mapping[str, Any]) -> str:
    """When it set in, to the digits that the interval gives; empty if it always was."""
    onset = (finding.get("where") or {}).get("onset")
    if not onset:
        return ""
    numbers = [parse_number(onset.get(key)) for key in ("time", "low", "high")]
    return (
        f"since {_choose_digits(*numbers)(numbers[0])} s of episode {onset['episode']}"
    )


def _format_scalar(value: float, low: float, high: float, unit: str) -> str:
    """A number with its unit and, where it is known, its interval."""
    written = _choose_digits(value, low, high)
    said = f"{written(value)}{unit}"
    if not (isfinite(low) and isfinite(high)):
        return said
    return f"{said} ({written(low)} to {written(high)})"


def _choose_digits(value: float, low: float, high: float) -> Callable[[float], str]:
    """How to write a value and its interval."""
    half, size = (high - low) / 2, max(abs(low), abs(high), abs(value))
    if not (isfinite(half) and half > 0 and 1e-4 <= size < 1e6):
        return format_short
    places = min(max(0, -floor(log10(half / 2))), 8)
    return lambda x: format_number(x, places)


def format_findings(document: Mapping[str, Any]) -> Html:
    """A row a finding: what, where, how much, and where it shows, largest first."""
    rows = [
        (
            found["effect"],
            found["target"],
            _BREAK.join(map(_format_parameter, found["parameters"])),
            format_growth(found),
            _BREAK.join(map(_format_signal, _list_signals(found))),
        )
        for found in document["findings"]
    ]
    head = ("effect", "where", "value (90 % interval)", GROWTH)
    return make_table((*head, "seen in (share of error)"), rows, "lllrl")


def format_growth(finding: Mapping[str, Any]) -> str:
    """How many times as large the held-out error is without a finding."""
    times = (finding.get("evidence") or {}).get("heldout_error_growth")
    return _DASH if times is None else f"{format_number(times, 2)} times"


def _format_parameter(stated: Mapping[str, Any]) -> str:
    return f"{stated['name']} {format_quantity(stated)}"


def _list_signals(found: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """The signals that a finding shows in, at most three."""
    return (found.get("where") or {}).get("signals", ())[:3]


def _format_signal(signal: Mapping[str, Any]) -> str:
    share = format_percent(parse_number(signal.get("share_of_error")))
    return f"{signal['name']} ({share}, p {format_short(signal.get('p_value'), 2)})"


def format_candidates(
    chosen: Sequence[Candidate], found: Sequence[Mapping[str, Any]]
) -> Html:
    """A row a candidate, with the evidence of those that earned a name."""
    left = list(found)
    rivals = {name for f in found for name in f.get("equivalent", ())}
    rows = []
    for rank, candidate in enumerate(chosen):
        own = [f for f in left if _matches_finding(candidate, f)]
        left = [f for f in left if f not in own]
        if rank < _MOST_CANDIDATES or own:
            rows.append(_format_candidate(rank + 1, candidate, own, rivals))
    # named after another one was, so not among the first
    for f in left:
        candidate = Candidate(f["effect"], f["target"], float("nan"), True)
        rows.append(_format_candidate(_DASH, candidate, [f], rivals))
    head = ("rank", "effect", "where", "error left", "gain [nats]", "p", "stability",
            "")  # fmt: skip
    return make_table(head, rows, "rllrrrrl")


def _matches_finding(candidate: Candidate, finding: Mapping[str, Any]) -> bool:
    """Whether a finding is that candidate, or one place of it."""
    places = candidate.target.split(", ")
    return finding["effect"] == candidate.effect and finding["target"] in places


def _format_candidate(
    rank: object,
    candidate: Candidate,
    own: Sequence[Mapping[str, Any]],
    rivals: Collection[str],
) -> list[object]:
    """A candidate's row."""
    evidence = own[0].get("evidence") or {} if own else {}
    status = "named" if candidate.named else ""
    if not status and candidate.effect in rivals:
        status = "not told apart"
    return [
        rank,
        candidate.effect,
        candidate.target,
        format_percent(candidate.left),
        format_short(evidence.get("heldout_nll_gain"), 2),
        format_short(evidence.get("p_value"), 2),
        format_percent(parse_number(evidence.get("stability"))),
        mark_text(status, "right" if candidate.named else "soft") if status else "",
    ]


def format_refit(stated: Sequence[Mapping[str, Any]]) -> Html:
    """A row a parameter that the model states, those at a bound first."""
    ordered = sorted(stated, key=lambda entry: not is_at_bound(entry))
    rows = [_format_refit_row(entry) for entry in ordered]
    head = ("parameter", "given", "re-fitted (90 % interval)", "change", "")
    first = max(_MOST_REFIT, sum(map(is_at_bound, stated)))
    shown = make_table(head, rows[:first], "lrlrl")
    if len(rows) <= first:
        return shown
    more = make_table(head, rows[first:], "lrlrl")
    return join_markup(shown, make_details(f"{len(rows) - first} more", more))


def _format_refit_row(entry: Mapping[str, Any]) -> list[object]:
    """A parameter's row."""
    change = _compute_change(entry)
    return [
        entry["parameter"],
        format_short(entry.get("given")),
        format_quantity(entry),
        f"{100 * change:+.1f}\N{NO-BREAK SPACE}%" if isfinite(change) else _DASH,
        mark_text("at its bound", "wrong") if is_at_bound(entry)
        else mark_text("not pinned down", "soft") if is_unidentified(entry) else "",
    ]  # fmt: skip


def _compute_change(entry: Mapping[str, Any]) -> float:
    """Change of a re-fitted value, relative to the given one; NaN if there is none."""
    given, value = parse_number(entry.get("given")), parse_number(entry.get("value"))
    return value / given - 1 if given else float("nan")


def is_at_bound(entry: Mapping[str, Any]) -> bool:
    """Whether a re-fitted value went as far as a careful user would let it."""
    return abs(_compute_change(entry)) >= (1 - _AT_BOUND) * relative_bound(
        entry["parameter"]
    )
