"""What predictions leave unexplained of readings, compiled with numba."""

import numba
import numpy as np

from ..body.body import Floats, Ints
from ._hull import JIT
from .channels import Loss


@numba.njit(inline="always", **JIT)
def _miss(predicted: float, measured: float, weight: float, cap: float) -> float:
    """Loss of a channel: none where nothing was measured, infinite where unknown."""
    if np.isnan(measured):
        return 0.0
    gap = min(abs(predicted - measured), cap)
    return np.inf if np.isnan(predicted) else weight * gap


@numba.njit(**JIT)
def compute_loss(predicted: Floats, measured: Floats, loss: Loss) -> float:
    """Loss of an action.

    Args:
        predicted: (C) channels; NaN = not known, an infinite loss.
        measured: (C) channels measured; NaN = unknown, and free.
    """
    total = 0.0
    for c in range(measured.shape[0]):
        total += _miss(predicted[c], measured[c], loss.weight[c], loss.cap[c])
    return total


@numba.njit(**JIT)
def fill_twin_losses(
    tables: Floats,
    source: Ints,
    column: Ints,
    measured: Floats,
    loss: Loss,
    out: Floats,
) -> None:
    """Fill in the losses of the twins of a body, see `selfmodel.symmetry`.

    Args:
        tables: (G, A, C) channels of the body, turned and mirrored, under its actions.
        source: (T, n) the action of the body for each trade and action tried.
        column: (T, C) its column for each trade and channel.
        measured: (n, C) channels measured; NaN = unknown, and free.
        out: (G, T) to fill: infinite where a prediction is not known.
    """
    tried, channels = measured.shape
    weight, cap = loss.weight, loss.cap
    moves = np.zeros(channels, np.bool_)  # with the parts that trade
    for t in range(column.shape[0]):
        for c in range(channels):
            moves[c] |= column[t, c] != c
    # what channels measured that do not move
    free = np.where(moves, np.nan, measured)
    still = np.empty((tried, tables.shape[1]))
    for g in range(out.shape[0]):
        for k in range(tried):
            for a in range(tables.shape[1]):
                still[k, a] = compute_loss(tables[g, a], free[k], loss)
        for t in range(out.shape[1]):
            total = 0.0
            for k in range(tried):
                row = tables[g, source[t, k]]
                total += still[k, source[t, k]]
                for c in range(channels):
                    if moves[c]:
                        total += _miss(
                            row[column[t, c]], measured[k, c], weight[c], cap[c]
                        )
            out[g, t] = total
