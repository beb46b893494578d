"""Tables of a self-modeling run, and of a diagnosis: either in, markup out."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from math import floor, isfinite, log10

import numpy as np

from ..body.body import Bodies
from ..body.genome import HINGE_NAMES
from ..diagnosis.effects.nominal import is_unidentified, relative_bound
from ..diagnosis.output.result import Candidate
from ..diagnosis.output.schema import (
    Document,
    Finding,
    Refit,
    SignalShare,
    StatedParameter,
)
from ..engine.channels import list_channels
from ..selfmodel.run import Run
from .facts import (
    DASH,
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
    make_note,
    make_paragraph,
    make_table,
    mark_text,
)

_MOST_RIVALS = 12  # rows of the table; chosen
_MOST_CHANNELS = 3  # that fit on a page; chosen
_MOST_CANDIDATES, _MOST_REFIT = 12, 12  # rows that need no click; chosen
_AT_BOUND = 0.01  # share of the distance to a bound that counts as none; chosen
GROWTH = "error without it"  # the head of a column
_BREAK = Html("<br>")


def format_tree(run: Run) -> Html:
    """A row a part: its parent, where on it, how long, how sure, right or wrong."""
    best, numbers = run.cycles[-1].genomes, range(run.anatomy.size)
    parents, lengths = best.parent[0].tolist(), best.length[0]
    columns: dict[str, tuple[str, Iterable[object]]] = {
        "#": ("r", (i + 1 for i in numbers)),
        "part": ("l", run.anatomy.parts),
        "hangs on": ("l", (name_part(run, parent) for parent in parents)),
        "at its side": ("l", (SIDES[side] for side in best.side[0])),
        "length [mm]": ("r", (f"{1000 * length:.0f}" for length in lengths)),
    }
    if run.settings.space == "full":
        columns["hinge"] = "l", (HINGE_NAMES[hinge] for hinge in best.hinge[0])
    columns["sureness"] = "r", map(format_percent, run.cycles[-1].sureness)
    if run.truth is not None:
        columns["truth"] = "l", (_judge_attachment(run, run.truth, i) for i in numbers)
    align, cells = zip(*columns.values(), strict=True)
    return make_table(list(columns), zip(*cells, strict=True), "".join(align))


def _judge_attachment(run: Run, truth: Bodies, i: int) -> Html:
    """Whether a part's attachment is right, and what is true if it is not."""
    best = run.cycles[-1].genomes
    parent, side = int(truth.parent[0, i]), int(find_true_side(truth)[0, i])
    if best.parent[0, i] != parent:
        true = f": truly on {name_part(run, parent)}, {SIDES[side]}"
        return join_markup(mark_text("wrong", "wrong"), true)
    true = "" if best.side[0, i] == side else f", but truly at its {SIDES[side]}"
    return join_markup(mark_text("correct", "right"), true)


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
    head = ["rank", "loss", "extra an action", "what differs from the best one"]
    head += ["away [cm]", "most apart [deg]"]
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
    return join_markup(make_table(head, rows, align), make_note(note))


def _format_rival(run: Run, rival: Rival) -> list[object]:
    """A rival's row."""
    differs = "; ".join(rival.differs) or "nothing worth naming"
    correct = [] if rival.right is None else [f"{rival.right} of {run.anatomy.size}"]
    return [
        rival.rank,
        format_number(rival.loss),
        format_number(rival.excess),
        differs if rival.rank > 1 else mark_text("the best one", "soft"),
        format_number(rival.away, 1),
        format_number(rival.apart, 1),
        *correct,
    ]


def parse_number(value: object) -> float:
    """A number of a document; NaN where it says that there is none."""
    return float(value) if isinstance(value, int | float) else float("nan")


def format_short(value: object, digits: int = 3) -> str:
    """A number of a document by its leading digits, or a dash."""
    known = parse_number(value)
    return f"{known:.{digits}g}" if isfinite(known) else DASH


def format_quantity(stated: Mapping[str, object]) -> str:
    """A value with its unit and interval, to the digits that the interval gives.

    Args:
        stated: value, low, high and unit, as diagnosis.json has them; of a vector the
            interval is left out.
    """
    numbers = [np.array(stated.get(k), float) for k in ("value", "low", "high")]
    unit = f" {stated.get('unit') or ''}".removesuffix(" 1").rstrip()
    if numbers[0].ndim:
        each = np.stack(np.broadcast_arrays(*numbers), axis=-1).tolist()
        written = [_choose_digits(*x)(x[0]) for x in each]
        return f"({', '.join(written)}){unit}"
    value, low, high = map(float, numbers)
    write = _choose_digits(value, low, high)
    is_known = isfinite(low) and isfinite(high)
    interval = f" ({write(low)} to {write(high)})" if is_known else ""
    return f"{write(value)}{unit}{interval}"


def format_onset(finding: Finding) -> str:
    """When it set in, to the digits that the interval gives; empty if it always was."""
    onset = (finding.get("where") or {}).get("onset")
    if not onset:
        return ""
    numbers = [parse_number(onset.get(key)) for key in ("time", "low", "high")]
    time = _choose_digits(*numbers)(numbers[0])
    return f"since {time} s of episode {onset['episode']}"


def _choose_digits(value: float, low: float, high: float) -> Callable[[float], str]:
    """How to write a value and its interval."""
    half, size = (high - low) / 2, max(abs(low), abs(high), abs(value))
    if not (isfinite(half) and half > 0 and 1e-4 <= size < 1e6):
        return format_short
    places = min(max(0, -floor(log10(half / 2))), 8)
    return lambda x: format_number(x, places)


def format_findings(document: Document) -> Html:
    """A row a finding: what, where, how much, and where it shows, largest first."""
    rows = [
        (
            found["effect"],
            found["target"],
            _BREAK.join(map(format_parameter, found["parameters"])),
            format_growth(found),
            _BREAK.join(map(_format_signal, _list_signals(found))),
        )
        for found in document["findings"]
    ]
    head = ("effect", "where", "value (90 % interval)", GROWTH)
    return make_table((*head, "seen in (share of error)"), rows, "lllrl")


def format_growth(finding: Finding) -> str:
    """How many times as large the held-out error is without a finding."""
    times = (finding.get("evidence") or {}).get("heldout_error_growth")
    return DASH if times is None else f"{format_number(times, 2)} times"


def format_parameter(stated: StatedParameter) -> str:
    """Its name and value."""
    return f"{stated['name']} {format_quantity(stated)}"


def _list_signals(found: Finding) -> Sequence[SignalShare]:
    """The signals that a finding shows in, at most three."""
    return (found.get("where") or {}).get("signals", [])[:3]


def _format_signal(signal: SignalShare) -> str:
    share = format_percent(parse_number(signal.get("share_of_error")))
    return f"{signal['name']} ({share}, p {format_short(signal.get('p_value'), 2)})"


def format_candidates(chosen: Sequence[Candidate], found: Sequence[Finding]) -> Html:
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
        rows.append(_format_candidate(DASH, candidate, [f], rivals))
    head = ("rank", "effect", "where", "error left", "gain [nats]", "p", "stability")
    return make_table((*head, ""), rows, "rllrrrrl")


def _matches_finding(candidate: Candidate, finding: Finding) -> bool:
    """Whether a finding is that candidate, or one place of it."""
    places = candidate.target.split(", ")
    return finding["effect"] == candidate.effect and finding["target"] in places


def _format_candidate(
    rank: object,
    candidate: Candidate,
    own: Sequence[Finding],
    rivals: Collection[str],
) -> list[object]:
    """A candidate's row."""
    evidence = own[0].get("evidence") or {} if own else {}
    status = "named" if candidate.named else ""
    if not status and candidate.effect in rivals:
        status = "indistinguishable"
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


def format_refit(stated: Sequence[Refit]) -> Html:
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


def _format_refit_row(entry: Refit) -> list[object]:
    """A parameter's row."""
    change, note = _compute_change(entry), Html("")
    if is_at_bound(entry):
        note = mark_text("at its bound", "wrong")
    elif is_unidentified(entry):
        note = mark_text("not pinned down", "soft")
    return [
        entry["parameter"],
        format_short(entry.get("given")),
        format_quantity(entry),
        f"{100 * change:+.1f}\N{NO-BREAK SPACE}%" if isfinite(change) else DASH,
        note,
    ]


def _compute_change(entry: Refit) -> float:
    """Change of a re-fitted value, relative to the given one; NaN if there is none."""
    given, value = parse_number(entry.get("given")), parse_number(entry.get("value"))
    return value / given - 1 if given else float("nan")


def is_at_bound(entry: Refit) -> bool:
    """Whether a re-fitted value went as far as a careful user would let it."""
    return abs(_compute_change(entry)) >= (1 - _AT_BOUND) * relative_bound(
        entry["parameter"]
    )
