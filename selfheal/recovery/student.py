"""Student's t: how far off a reading is in, how likely that is out."""

import numpy as np

from ..body.body import Floats

FREEDOM = 4.0  # heavier tails than any sensor's; chosen


def log_t(z: Floats) -> Floats:
    """(...) log density without its constant at z (...) [1]; NaN counts nothing."""
    return -(FREEDOM + 1) / 2 * np.log1p(np.nan_to_num(z) ** 2 / FREEDOM)
