"""Ranking: scores in, their order out, which all searches select by."""

import numpy as np
from numpy.typing import NDArray

from ..recording.data import Floats


def rank_best_first(scores: Floats) -> NDArray[np.int64]:
    """(N) indices of scores, the largest first.

    Of equal ones the earlier comes first, so that the same seed gives the same result.
    What is not finite failed, and never comes before what has a score.
    """
    return np.argsort(-np.where(np.isfinite(scores), scores, -np.inf), kind="stable")
