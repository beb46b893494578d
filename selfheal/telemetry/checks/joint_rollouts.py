"""Faults of columns about joints in lasting contact, which only simulations show."""

from collections.abc import Iterable

from ..context import Context
from ..fault import Fault


def find(context: Context) -> Iterable[Fault]:
    """Signs, units and exchanges, the one that explains most first."""
    if not context.balance.reason or context.rollouts.reason or context.is_late:
        return ()
    # a servo's command says of its joint what there is to know
    names = [j.name for j in context.joints.values() if not j.servo]
    return context.search(context.rollouts, names)
