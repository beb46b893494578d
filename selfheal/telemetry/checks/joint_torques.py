"""Faults of columns about joints that only the balance of torques shows."""

from collections.abc import Iterable

from ..context import Context
from ..fault import Fault


def find(context: Context) -> Iterable[Fault]:
    """Signs, units and exchanges, the one that explains most first."""
    if context.balance.reason or context.is_late:
        return ()
    return context.search(context.balance, list(context.joints))
