"""Faults of columns about joints that only the balance of torques shows."""

from ..context import MAX_LEFT, Context
from ..fault import Fault

MIN_LEFT = 0.015  # that the log as it is must leave; chosen
BASIS = (
    "Wilcoxon's signed-rank test of the balance of torques, block by block, times the "
    "number of hypotheses tried"
)


def find(context: Context) -> list[Fault]:
    """Signs, units and exchanges, the one that explains most first."""
    balance, limits = context.balance, (MIN_LEFT, MAX_LEFT)
    if balance.reason or context.is_late:
        return []
    names, what = list(context.joints), "torques are balanced"
    return context.search(balance, names, limits, BASIS, what)
