"""Likely robots: a walk of the whole robot in, robots that walk as it did out.

How a broken robot walks, and whether it tips, depends on friction, delay, play and
strength that nobody measured. So a walk is predicted for several robots that walk as
the whole one did, and may have been any of them.
"""

from dataclasses import dataclass

import numpy as np

from ..body.body import Floats
from ..damage.apply import apply_damages
from ..damage.kinds import Damage
from ..engine.plant import Plant
from ..engine.walk import PERIOD, SAMPLE, list_channels
from ..evolution.ranking import rank_best_first
from ..gait.synthesis import randomize_plant
from .belief import compute_log_t
from .probes import Probe, extract_values, find_residual_scale, predict_values

_DRAWN_PLANTS, KEPT = 64, 3  # robots that are tried and kept; chosen


@dataclass(frozen=True)
class PlausiblePlants:
    """Robots that it may be.

    Attributes:
        plants: K.
        bias: (K, M) by which a walk of the whole robot is off their predictions.
        effective_share: share of a walk's M values that tell something of their own.
    """

    plants: tuple[Plant, ...]
    bias: Floats
    effective_share: float


def find_plausible_plants(
    plant: Plant, probe: Probe, measured: Floats, rng: np.random.Generator
) -> PlausiblePlants:
    """Robots that walk as the whole one did.

    Args:
        plant: what it is believed to be.
        measured: (S, C) channels of the whole robot, walking so for as long or longer.
        rng: draws what else it may be.
    """
    names = list_channels(plant.body.anatomy).names
    plants = [plant, *(randomize_plant(plant, rng) for _ in range(_DRAWN_PLANTS))]
    scale = find_residual_scale(probe, names)
    rows = round(len(probe.commands) * PERIOD / SAMPLE)
    whole = extract_values(probe, measured[:rows], names)
    predicted = predict_values(plants, probe, np.zeros(len(scale)))
    failed = np.isnan(predicted).any(axis=1)
    fit = compute_log_t((predicted - whole) / scale).sum(axis=1)
    best = rank_best_first(np.where(failed, -np.inf, fit))[:KEPT]
    likely, bias = tuple(plants[k] for k in best), whole - predicted[best]
    share = compute_effective_share(predicted[~failed] / scale)
    return PlausiblePlants(likely, bias, share)


def compute_effective_share(predicted: Floats) -> float:
    """How many independent values (N, M) are worth, as a share of M.

    The participation ratio of their correlations: whether a robot tips, say, changes
    all of its values at once.
    """
    varies = predicted[:, predicted.std(axis=0) > 0]
    together = np.corrcoef(varies, rowvar=False)
    return float(varies.shape[1] / np.sum(together**2))


def predict_walk(known: PlausiblePlants, damages: list[Damage], probe: Probe) -> Floats:
    """Predict a walk of every likely robot after every damage.

    Returns:
        (H, K, M) values that count.
    """
    tables = [
        predict_values([apply_damages(plant, d) for d in damages], probe, bias)
        for plant, bias in zip(known.plants, known.bias, strict=True)
    ]
    return np.stack(tables, axis=1)
