"""Values among which searches look for a damage: coarse ones, then finer ones."""

import math
from dataclasses import dataclass

import numpy as np

DEG = math.pi / 180
# what is tried first; chosen
AZIMUTHS = tuple(np.radians(np.arange(0, 360, 45.0)).tolist())
SCALES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.2, 1.5)
JAMS = tuple(np.radians(np.arange(-60, 61, 20.0)).tolist())
SLOPES = (5 * DEG, 10 * DEG, 15 * DEG)
SHARES, FRICTIONS = (0.15, 0.3, 0.45, 0.6, 0.75), (0.05, 0.1, 0.2, 0.3)


@dataclass(frozen=True)
class Values:
    """The values among which a search looks for a damage, in the value's unit.

    Attributes:
        grid: of the first hypotheses; empty: it is not looked for.
        step: of the first ones about the best of these; 0: there is nothing to refine.
        low, high: ends of all.
        finest: a step that is not halved any more.
    """

    grid: tuple[float, ...] = (0.0,)
    step: float = 0.0
    low: float = 0.0
    high: float = 0.0
    finest: float = 0.0
