"""A model without actuators of a robot that something drives."""

from collections.abc import Iterator

import numpy as np

from ...recording import NO_ACTUATORS
from ..context import Context
from ..fault import Fault

# of the energy that a motion turns over, what drives it gives; chosen: half of it is
# given by motors that lift and lower, nothing by friction
GIVEN_SHARE = 0.25


def find(context: Context) -> Iterator[Fault]:
    """The energy of what nothing drives only decreases, whatever the friction.

    Of a robot that something unknown drives, its torques say nothing of columns: their
    faults are taken back.
    """
    balance = context.balance
    if context.model.nactuator or balance.reason or context.is_late:
        return
    others = [f for f in context.faults if f.basis != balance.basis]
    if any(f.is_decisive for f in others):
        return
    parts = balance.compute_torques(context.column_map, balance.rows)
    given = np.maximum((parts["all"] * parts["v"]).sum(axis=1), 0).sum()
    turned = np.abs(parts["hold"] * parts["v"]) + np.abs(parts["own"] * parts["v"])
    share = float(given / max(turned.sum(), 1e-12))
    if share > GIVEN_SHARE:
        context.faults = others
        seen = (
            "the model has no actuators, but something drives the robot: it gives "
            f"{share:.0%} of the energy that the motion turns over"
        )
        yield Fault(
            "no_actuator", context.episodes, (), "", seen, corrections=(NO_ACTUATORS,)
        )
