"""Wrong orders of quaternions: x y z w, where the format has w x y z."""

from collections.abc import Iterator

import numpy as np

from ...recording.data import Floats
from ..contacts import collide
from ..context import Context
from ..fault import ColumnCorrection, Fault, format_columns
from ..relations import DEPENDENT_ROWS, MIN_ROWS, f_test
from ..rollouts import name_groups
from ..states import W_X_Y_Z, X_Y_Z_W, ColumnMap, compute_rates

# mean square of an error over that of what is predicted, above which the order is
# wrong, and ratio to that in the other order; chosen
DIFFERS, FAR_BETTER = 0.3, 0.25
SINKS = 0.03  # of a body's size, to which one that is read rightly sinks; chosen
BASIS = "F test of the squared errors in both orders, a tenth of the rows counted"
ORDERS = W_X_Y_Z, X_Y_Z_W
# mean squared errors as it is and in the other order, rows, what was compared
Errors = tuple[float, float, int, str]


def find(context: Context) -> Iterator[Fault]:
    """Orientations that kinematics or forces explain far better in the other order."""
    for (kind, body), name in context.signals.items():
        if kind == "body_orientation" and (fault := _check_order(context, body, name)):
            context.column_map |= ColumnMap(order={body: X_Y_Z_W})
            yield fault


def _check_order(context: Context, body: str, name: str) -> Fault | None:
    """The fault of the first measure by which the other order is far better."""
    turns = context.series.signals[name]
    measures = (_compare_spins, _compare_frames, _compare_depths, _compare_rollouts)
    for measure in (*measures, _compare_torques):
        errors = measure(context, body, turns)
        if errors is None:
            continue
        given, other, rows, what = errors
        if given > DIFFERS and other < FAR_BETTER * given and other < 1:
            seen = (
                f"{format_columns([name])} is written x y z w, not w x y z: {what} "
                f"are off by {given:.2g} of their mean square as it is, by "
                f"{other:.2g} in the other order"
            )
            count = rows / DEPENDENT_ROWS
            p = f_test(given, other, count, count)
            rule = ColumnCorrection(name, {"order": "xyzw"})
            where = context.series.episodes, (name,), body
            return Fault("quaternion_order", *where, seen, p, BASIS, (rule,))
    return None


def _compare_spins(context: Context, body: str, turns: Floats) -> Errors | None:
    """Angular velocities, by a gyroscope of the body."""
    rate = context.signals.get(("body_angular_velocity", body))
    if rate is None:
        return None
    measured = context.series.signals[rate][:, :, 0]
    known = np.isfinite(turns[:, 0, 0]) & np.isfinite(measured[:, 0])
    if known.sum() < MIN_ROWS:
        return None
    turns, measured = turns[known], measured[known]
    size = np.mean(measured**2) + 1e-12
    given, other = (
        float(np.mean((compute_rates(turns[:, list(order)])[1] - measured) ** 2) / size)
        for order in ORDERS
    )
    return given, other, len(turns), "angular velocities"


def _compare_frames(context: Context, body: str, turns: Floats) -> Errors | None:
    """A body's orientation, by the joints' positions."""
    states = context.states
    if states.reason or body in states.poses:
        return None
    rows = states.choose_rows(np.isfinite(turns[:, 0, 0]))
    if len(rows) < MIN_ROWS:
        return None
    frames = context.balance.predict(context.column_map, rows)[1]
    expected = frames[context.model.body(body).id]
    errors = []
    for order in ORDERS:
        unit = compute_rates(turns[rows][:, list(order)])[0]
        # 4 sin^2 of half the angle between the two: at most 4
        errors.append(float(np.mean(4 * (1 - (unit * expected).sum(axis=1) ** 2))))
    return errors[0], errors[1], len(rows), "orientations that the joints give"


def _compare_depths(context: Context, body: str, turns: Floats) -> Errors | None:
    """Depths to which a lone body sinks into what it touches."""
    states, model = context.states, context.model
    rows = states.choose_rows(np.isfinite(turns[:, 0, 0]))
    unfit = states.reason or body not in states.poses or states.joints
    if unfit or len(rows) < MIN_ROWS:
        return None
    geoms = model.geom_bodyid == model.body(body).id
    allowed = SINKS * float(np.max(model.geom_rbound[geoms], initial=1e-3))
    errors = []
    for order in ORDERS:
        column_map = context.column_map | ColumnMap(order={body: order})
        poses = states.compute(column_map, rows)[0]
        depths = (np.min(d.contact.dist, initial=0.0) for d in collide(model, poses))
        total = sum(depth**2 for depth in depths)
        errors.append(float(total) / len(rows) / allowed**2)
    return errors[0], errors[1], len(rows), "depths to which it sinks into others"


def _compare_rollouts(context: Context, body: str, turns: Floats) -> Errors | None:
    """Misses of short simulations, of a base in lasting contact."""
    if body not in context.states.poses or not context.balance.reason:
        return None
    rollouts = context.rollouts
    if rollouts.reason:
        return None
    own = [g for g, n in enumerate(rollouts.groups) if n in name_groups(body)]
    given = rollouts.evaluate(context.column_map).share[own]
    if given.max() < 1:  # better than no prediction
        return None
    turned = context.column_map | ColumnMap(order={body: X_Y_Z_W})
    other = rollouts.evaluate(turned).share[own]
    rows = len(rollouts.rows) * int(DEPENDENT_ROWS)  # each is a start anew
    return (float(given.mean()), float(other.mean()), rows, "simulations from its pose")


def _compare_torques(context: Context, body: str, turns: Floats) -> Errors | None:
    """What the balance of torques leaves, of a body that flies."""
    balance = context.balance
    if balance.reason or body not in context.states.poses:
        return None
    first = context.model.body(body).dofadr[0]
    dofs = [k for k, d in enumerate(balance.dofs) if d - first in (3, 4, 5)]
    given, other = (
        balance.evaluate(context.column_map | ColumnMap(order=order))
        for order in ({}, {body: X_Y_Z_W})
    )
    share = (other.share * other.size / given.size)[dofs]
    # errors are counted thrice: half of any inertia may be missing, which leaves
    # a quarter of a torque that should not be there
    shares = 3 * float(given.share[dofs].mean()), 3 * float(share.mean())
    return *shares, len(balance.rows), "torques of its flight"
