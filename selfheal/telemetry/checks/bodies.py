"""Bodies and model sensors: takes states, finds columns that kinematics contradicts.

The rates of a pose, and what sensors say of it (frames, gyroscopes, accelerometers),
follow from positions alone: no force takes part.
"""

from collections.abc import Iterator

import numpy as np

from ...recording.data import Floats
from ..boards import find_turned
from ..context import Context
from ..fault import Changes, ColumnCorrection, Fault, format_columns, multiply
from ..relations import (
    DEPENDENT_ROWS,
    MIN_ROWS,
    Relation,
    correlation_p_value,
    find_exchanges,
    name_unit,
    relate,
)
from ..states import compute_rates

BASIS = "correlation, Fisher's z, a tenth of the rows counted"
# MuJoCo's sensors that follow from positions, rates and accelerations
KINEMATIC = (
    *("ACCELEROMETER", "GYRO", "VELOCIMETER", "FRAMEPOS", "FRAMEXAXIS", "FRAMEYAXIS"),
    *("FRAMEZAXIS", "FRAMELINVEL", "FRAMEANGVEL", "SUBTREECOM"),
)


def find(context: Context) -> Iterator[Fault]:
    """Signs, units and exchanges of rates, poses and sensors, and boards turned."""
    turned = {f.target for f in context.faults if f.kind == "quaternion_order"}
    series, signals = context.series, context.signals
    for (kind, body), name in signals.items():
        place = signals.get(("body_position", body))
        turn = signals.get(("body_orientation", body))
        if kind == "body_linear_velocity" and place:
            rates = series.signals[place][:, :, 1]
            yield from _compare(context, name, rates, "the derivative of its position")
        elif kind == "body_angular_velocity" and turn and body not in turned:
            rates = compute_rates(series.signals[turn])[1]
            yield from _compare(context, name, rates, "the rate of its orientation")
    if not turned and not context.states.reason:
        yield from _check_predicted(context)


def _check_predicted(context: Context) -> Iterator[Fault]:
    """Model sensors and poses against what the joints' positions give."""
    import mujoco

    states, model, series = context.states, context.model, context.series
    rows = states.choose_rows(True)
    if len(rows) < MIN_ROWS:
        return
    readings, _, places = context.balance.predict(context.column_map, rows)
    expected, sensors = dict[str, Floats](), dict[str, str]()
    for (kind, target), name in context.signals.items():
        if kind == "sensor":
            s = model.sensor(target)
            if mujoco.mjtSensor(s.type[0]).name[7:] not in KINEMATIC:
                continue
            first, sensors[name] = int(s.adr[0]), target
            values = readings[:, first : first + int(s.dim[0])]
        elif kind == "body_position" and target not in states.poses:
            values = places[model.body(target).id]
        else:
            continue
        expected[name] = np.full((len(series.episode), values.shape[1]), np.nan)
        expected[name][rows] = values
    yield from find_turned(model, series, sensors, expected)
    for name, values in expected.items():
        yield from _compare(context, name, values, "what the positions give")


def _compare(
    context: Context, name: str, expected: Floats, what: str
) -> Iterator[Fault]:
    """Signs, units and exchanges of a signal's columns against expected ones (N, d)."""
    read = context.series.signals[name][:, :, 0]
    if read.shape[1] != expected.shape[1]:
        return
    episode, every = context.series.episode, range(read.shape[1])
    own, exchanged = find_exchanges(
        every, lambda i, k: relate(expected[:, i], read[:, k], episode, range(1))
    )
    said = format_columns([name])
    flipped = [i for i in every if own[i].is_flipped]
    scaled = [r for r in own.values() if r.has_other_unit]
    found = list[tuple[str, Relation, Changes, str]]()
    if flipped:
        first, signs = own[flipped[0]], [-1 if i in flipped else 1 for i in every]
        seen = (
            f"columns {flipped} of {said} are the opposite of {what} (correlation "
            f"{first.r:.2f})"
        )
        found.append(("sign", first, {"sign": signs}, seen))
    elif scaled:
        ratio = float(np.median([abs(r.ratio) for r in scaled]))
        unit = name_unit(ratio) or "another unit"
        seen = f"{said} is {ratio:.4g} times {what}: {unit}"
        found.append(("unit", scaled[0], multiply(1 / ratio), seen))
    for i, k, across in exchanged:
        seen = (
            f"columns {i} and {k} of {said} are exchanged: each follows what the other "
            f"should be, {what} (correlation {across.r:.2f})"
        )
        places = [{i: k, k: i}.get(place, place) for place in every]
        found.append(("exchange", across, {"columns": places}, seen))
    target = next(t for (_, t), n in context.signals.items() if n == name)
    for kind, relation, change, seen in found:
        p = correlation_p_value(relation, DEPENDENT_ROWS)
        rule = ColumnCorrection(name, change)
        where = context.series.episodes, (name,), target
        yield Fault(kind, *where, seen, p, BASIS, (rule,))
