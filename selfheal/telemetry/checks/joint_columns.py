"""Columns of a joint that contradict each other: which of them is at fault."""

from collections.abc import Iterator

import numpy as np

from ..comparisons import Disagreement
from ..context import Context, make_fault
from ..fault import ColumnCorrection, Fault, format_columns
from ..hypotheses import CLEARLY, MAX_P_VALUE, Hypothesis, list_read, suppose
from ..joints import JointColumns
from ..relations import UNIT_RATIO, list_units
from .ranges import INNER, list_fitting

BASES = {
    "command": "correlation of the joint with its command, Fisher's z",
    "velocity": "correlation of velocity and derived position, Fisher's z",
}
Seen = dict[str, Disagreement]  # by "velocity" and "command": against the position


def find(context: Context) -> Iterator[Fault]:
    """Signs, units and exchanges, then delays and velocities that are no derivative."""
    by_joint: dict[tuple[str, tuple[str, ...]], Seen] = {}
    drifting = {c for f in context.faults if f.kind == "clock_drift" for c in f.columns}
    for one in context.disagreements:
        drifts = drifting & {*context.joints[one.joint].columns}
        if not (drifts and one.kind in ("delay", "derivative")):
            pair = tuple(filter(None, (one.joint, one.partner)))
            by_joint.setdefault((one.kind, pair), {})[one.what] = one
    late_last = sorted(by_joint.items(), key=lambda item: item[0][0] == "delay")
    for (kind, pair), seen in late_last:
        if kind == "delay":
            for one in seen.values():
                if one.what == "velocity" or not context.is_balanced(one.joint):
                    yield _report_delay(context.joints[one.joint], one)
        elif kind != "derivative":
            yield _locate(context, kind, pair, seen)
        elif "velocity" in seen:
            yield _report_derivative(context.joints[pair[0]], seen["velocity"])


def _locate(context: Context, kind: str, pair: tuple[str, ...], seen: Seen) -> Fault:
    """The column that is at fault, of those that contradict each other."""
    best, others = _choose(context, _list_options(context, kind, pair, seen))
    context.column_map |= best.column_map
    what = "command" if "command" in seen else "velocity"
    one = seen[what]
    r, ratio = one.relation.r, one.relation.ratio
    measured = {
        "sign": f"correlation {r:.3f}",
        "unit": f"{abs(ratio):.4g} times as large, correlation {abs(r):.3f}",
        "exchange": f"correlation {r:.3f} across, low within each",
    }[kind]
    columns = {
        "command": f"joint {pair[0]!r} and its command",
        "velocity": f"the velocity and the position of joint {pair[0]!r}",
    }[what]
    test = one.p_value, BASES[what]
    return make_fault(best, others, f"{columns}: {measured}", test, one.episodes)


def _list_options(
    context: Context, kind: str, pair: tuple[str, ...], seen: Seen
) -> list[Hypothesis]:
    """What could explain a disagreement, the usual one first."""
    joint = context.joints[pair[0]]
    if "command" not in seen:
        ratio = seen["velocity"].relation.ratio
        options: list[tuple[tuple[str, ...], float]] = [(("velocity",), ratio)]
        if not joint.servo:  # else the position agrees with its command
            options.append((("position",), 1 / ratio))
    else:
        ratio = _round_unit(context, joint, seen["command"].relation.ratio)
        # a velocity that is too large, and a position that is too small, look alike
        options = [(("position",), ratio)]
        if "velocity" not in seen:
            options = [(list_read(joint), ratio), (("command",), 1 / ratio)]
    return [suppose(context.joints, kind, pair, *option) for option in options]


def _round_unit(context: Context, joint: JointColumns, ratio: float) -> float:
    """The ratio of the one unit in which readings are within the joint's range.

    Of those that a weak or strong servo could make of the given ratio of the position
    to what is commanded; else that ratio.
    """
    if not joint.range:
        return ratio
    position = context.series.signals[joint.position][:, 0, 0]
    low, high = (float(x) for x in np.nanquantile(position, [1 - INNER, INNER]))
    units, fitting = list_units(joint.span), list_fitting(joint, low, high)
    ratios = [units[name] for name in fitting]
    near = [r for r in ratios if abs(np.log(abs(ratio) / r)) < np.log(UNIT_RATIO)]
    return float(np.sign(ratio)) * near[0] if len(near) == 1 else ratio


def _choose(
    context: Context, options: list[Hypothesis]
) -> tuple[Hypothesis, list[Hypothesis]]:
    """The option that balances the torques best, and those as good."""
    if len(options) == 1 or context.balance.reason:
        return options[0], options[1:]
    maps = [context.column_map | option.column_map for option in options]
    tried = [context.balance.evaluate(one) for one in maps]
    best = 0
    for k in range(1, len(options)):
        gain, p = tried[k].gain_over(tried[best])
        if gain > CLEARLY and p < MAX_P_VALUE:
            best = k
    gains = [tried[best].gain_over(residuals)[0] for residuals in tried]
    equal = [k for k, gain in enumerate(gains) if k != best and gain < CLEARLY]
    return options[best], [options[k] for k in equal]


def _report_delay(joint: JointColumns, one: Disagreement) -> Fault:
    late, what = one.lag, one.what
    name = joint.velocity if what == "velocity" and late > 0 else joint.position
    after = "its position" if name == joint.velocity else f"its {what}"
    seen = (
        f"{format_columns([name])} is {abs(late):.2f} s late against {after} "
        f"(correlation {one.relation.r:.3f} there, {one.relation.here:.3f} at the "
        "same time)"
    )
    test, change = (
        (one.p_value, BASES[what]),
        ColumnCorrection(name, {"delay": abs(late)}),
    )
    return Fault("delay", one.episodes, (name,), one.joint, seen, *test, (change,))


def _report_derivative(joint: JointColumns, one: Disagreement) -> Fault:
    columns, test = joint.columns[::-1], (one.p_value, BASES["velocity"])
    seen = (
        f"{format_columns([joint.velocity])} is not the derivative of "
        f"{format_columns([joint.position])} (correlation {one.relation.r:.2f} at "
        "best)"
    )
    change = ColumnCorrection(joint.velocity, {"skip": True})
    return Fault("derivative", one.episodes, columns, one.joint, seen, *test, (change,))
