"""Sureness: the stated probability that each attachment of the best body is right."""

from ..body.body import Floats, Ints

# Fitted to 68 simulated runs, no real reading among them (docs/results/sureness.md):
# the chance that the right body was not found, when its tree is new, and how often an
# attachment of a body that is not the right one is right all the same.
_MISSED_PROBABILITY, _RIGHT_BY_CHANCE = 0.25, 0.8


def compute_attachment_probability(
    parent: Ints, belief: Floats, best: Ints, *, survived: int, ordered: bool
) -> Floats:
    """(P) probability that each part hangs on the parent it has in the best body.

    Args:
        parent: (M, P) trees of bodies that might be it.
        belief: (M) in each, sum 1.
        best: (P) the tree believed in.
        survived: actions that this tree has stood as the best. The chance that the
            right body was not found is taken as 0.25 / (survived + 1).
    """
    seen = belief @ (parent == best)
    missed = _MISSED_PROBABILITY / (survived + 1)
    sure = seen * (1 - missed * (1 - _RIGHT_BY_CHANCE))
    if ordered:
        sure[0] = 1.0  # part 1 has nothing but the torso to hang on
    return sure
