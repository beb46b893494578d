"""Faults of columns about joints in lasting contact, which only simulations show."""

from ..context import Context
from ..fault import Fault

# shares that the log as it is must leave, and a corrected one may leave; chosen: a log
# that is right misses less than no prediction
LIMITS = (1.0, 0.5)
BASIS = (
    "Wilcoxon's signed-rank test of simulations of a tenth of a second, block by "
    "block, times the number of hypotheses tried"
)


def find(context: Context) -> list[Fault]:
    """Signs, units and exchanges, the one that explains most first."""
    if not context.balance.reason or context.rollouts.reason or context.is_late:
        return []
    # a servo's command says of its joint what there is to know
    names = [j.name for j in context.joints.values() if not j.servo]
    what = "simulations are right"
    return context.search(context.rollouts, names, LIMITS, BASIS, what)
