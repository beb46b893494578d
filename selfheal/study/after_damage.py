"""After damage: a robot whose right lower leg is a tenth; what each method says of it.

Everybody begins with the body that the authors chose for it (papers.md 1.3).
"""

from dataclasses import dataclass, replace
from itertools import islice
from typing import cast

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, measure_length_error, scale_parts
from ..body.genome import Genomes, build_bodies, decode_unit_genes
from ..recovery.predict_actions import infer_damage, predict_actions
from ..robot.base import Robot
from ..robot.simulated import SimulatedRobot
from ..schema import Count, Number
from ..selfmodel.scaled import estimate_scales
from .plan import Outcome, RunSettings
from .trees import HIDDEN, Series, open_study_robot

CYCLES = 16
_KNOWN_GENES = (
    0.177363,
    0.203348,
    0.208322,
    0.224044,
    0.28876,
    0.40069,
    0.477269,
    0.543136,
)
_PART, _SCALE = "right_lower", 0.1
_OURS = {"ours": True, "ours, random": False}
_INTERVAL_SHARE = 0.9  # share of belief of what is stated of a length


@dataclass(frozen=True)
class DamageOutcome:
    """What `run_after_damage` gives, as tables read it.

    Attributes:
        success: whether the right part is said to have changed.
        error: of the parts' lengths [cm], a number an action.
        actions: taken.
        evaluations: simulations of the search.
        lengths: low, high, belief and truth of each part's length; may be none.
    """

    success: bool
    error: Series
    actions: list[Count]
    evaluations: Count
    lengths: list[tuple[Number, Number, Number, Number]]


def _load_known_body(anatomy: Anatomy) -> Genomes:
    """The body to begin with."""
    return decode_unit_genes(anatomy, np.array([_KNOWN_GENES]))


def _open_robots(settings: RunSettings) -> tuple[Robot, Robot, Bodies]:
    """Before, after, and the true body after."""
    whole = open_study_robot(settings)
    assert whole.truth is not None
    scale = np.ones(whole.anatomy.size)
    scale[whole.anatomy.parts.index(_PART)] = _SCALE
    truth = scale_parts(whole.truth, scale)
    if settings["robot"] == HIDDEN:
        broken = replace(cast(SimulatedRobot, whole), truth=truth)
        return whole, cast(Robot, broken), truth
    return whole, open_study_robot(settings, "damaged.h5"), truth


def run_after_damage(settings: RunSettings) -> Outcome:
    """What is believed of the parts' lengths after each of 16 actions.

    `error` [cm]: mean over parts of |length - true length|, a number an action;
    `success`: the part that is said to have changed most is the one that did.
    """
    whole, broken, truth = _open_robots(settings)
    method = settings["method"]
    believe = _estimate_ours if method in _OURS else _estimate_released
    found = believe(whole, broken, settings)
    start = build_bodies(whole.anatomy, _load_known_body(whole.anatomy))
    scales = found.pop("scales")
    bodies = [scale_parts(start, scale) for scale in scales]
    part = whole.anatomy.parts.index(_PART)
    return {
        "success": int(np.argmax(np.abs(np.log(scales[-1])))) == part,
        "error": [round(float(measure_length_error(b, truth)[0]), 4) for b in bodies],
        "scale": scales[-1].round(4).tolist(),
        **found,
    }


def _estimate_released(whole: Robot, broken: Robot, settings: RunSettings) -> dict:
    """The 2006 search, by whatever rule."""
    steps = list(
        estimate_scales(
            broken,
            _load_known_body(whole.anatomy),
            method=settings["method"],
            cycles=CYCLES,
            seed=settings["seed"],
        )
    )
    return {
        "scales": [step.scale for step in steps],
        "actions": [step.action for step in steps],
        "evaluations": steps[-1].spent,
        "choice": steps[-1].spent_choosing,
        "lengths": [],
    }


def _estimate_ours(whole: Robot, broken: Robot, settings: RunSettings) -> dict:
    """Belief over one part's scale, from how readings changed."""
    anatomy = whole.anatomy
    known = predict_actions(
        whole, broken, build_bodies(anatomy, _load_known_body(anatomy))
    )
    rng = np.random.default_rng([settings["seed"], 12])
    chosen = _OURS[settings["method"]]
    steps = list(islice(infer_damage(known, rng, chosen=chosen), CYCLES))
    every = np.array([_list_scales(anatomy, d.name, d.value) for d in known.damages])
    # each damage is simulated at rest and, for its slopes, twice for every joint
    count = known.predicted.shape[0] * known.predicted.shape[1]
    return {
        "scales": [every[int(np.argmax(belief))] for _, belief in steps],
        "actions": [int(action) for action, _ in steps],
        "evaluations": count * (1 + 2 * anatomy.size),
        "choice": 0,
        "lengths": _state_intervals(every, steps[-1][1], anatomy),
    }


def _list_scales(anatomy: Anatomy, part: str, value: float) -> Floats:
    """(P) factors of a damage; ones where nothing happened."""
    scale = np.ones(anatomy.size)
    if part:
        scale[anatomy.parts.index(part)] = value
    return scale


def _state_intervals(
    every: Floats, belief: Floats, anatomy: Anatomy
) -> list[list[float]]:
    """(P, 4) of each part: low and high of 90 % of belief, the belief there, the truth.

    Factors on the length. Values between those that were looked at belong to the
    nearest one, so an interval reaches half-way to the next.
    """
    stated = []
    for k, part in enumerate(anatomy.parts):
        values, place = np.unique(every[:, k], return_inverse=True)
        share = np.bincount(place.ravel(), belief)
        order = np.argsort(-share, kind="stable")
        kept = order[
            : 1 + int(np.searchsorted(np.cumsum(share[order]), _INTERVAL_SHARE))
        ]
        edges = np.concatenate([[0.0], (values[1:] + values[:-1]) / 2, [np.inf]])
        true = _SCALE if part == _PART else 1.0
        low, high = edges[kept.min()], min(edges[kept.max() + 1], 10.0)
        stated.append([float(low), float(high), float(share[kept].sum()), true])
    return stated
