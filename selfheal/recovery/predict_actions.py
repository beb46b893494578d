"""Damage from recordings alone: readings at rest of a robot before and after in.

For a robot of which only recorded poses are known, as the one of 2006: belief
goes from reading to reading, each compared with the reading when whole.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..body.body import Bodies, Floats, concatenate_bodies
from ..damage.apply import apply_damages
from ..damage.kinds import INTACT, KINDS, Damage
from ..engine.plant import build_rated_plant
from ..engine.statics import Statics
from ..robot.base import Robot
from ..robot.rest_readings import read_rest_channels
from .belief import (
    CandidateAction,
    ResidualNoise,
    choose_action,
    compute_log_likelihood,
    compute_posterior,
    widen_scale,
)
from .hypotheses import group_damages
from .probes import DRIFT, EDGE_SLOPE, NUDGE, TILT_SCALE

_SCALES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.15, 1.3, 1.5, 1.8)
_INTACT_PRIOR = 0.1  # prior that nothing happened; chosen


@dataclass(frozen=True)
class ActionTables:
    """What every scale of every part would have shown in every action.

    Attributes:
        damages: H.
        predicted: (H, A, 2) tilts [deg]: the reading when whole, and the change that
            the model predicts.
        slope: (H, A, 2, P) their change with each joint's zero [deg/deg].
        measured: (A, 2) tilts of the damaged robot [deg].
    """

    damages: tuple[Damage, ...]
    predicted: Floats
    slope: Floats
    measured: Floats


def predict_actions(whole: Robot, broken: Robot, model: Bodies) -> ActionTables:
    """Read both robots' every action, and predict it for every damage.

    Args:
        model: of the whole robot (1).
    """
    plant, parts = build_rated_plant(model), whole.anatomy.parts
    damages = (INTACT, *KINDS["part_scale"].list_damages(parts, _SCALES))
    bodies = concatenate_bodies(*(apply_damages(plant, d).body for d in damages))

    def tilts(targets: Floats) -> Floats:
        rows = np.repeat(np.arange(len(bodies)), len(targets))
        rest = Statics().simulate(bodies[rows], np.tile(targets, (len(bodies), 1)))
        return np.degrees(rest.tilt).reshape(len(bodies), len(targets), 2)

    seen, turn = tilts(whole.actions), np.radians(NUDGE) * np.eye(len(parts))
    slope = [tilts(whole.actions + t) - tilts(whole.actions - t) for t in turn]
    slopes = np.stack(slope, axis=-1) / (2 * NUDGE)
    before, after = (
        np.array(
            [
                read_rest_channels(robot.act(a), robot.anatomy)[:2]
                for a in range(len(robot.actions))
            ]
        )
        for robot in (whole, broken)
    )
    slopes = np.where(np.abs(slopes) > EDGE_SLOPE, 0.0, slopes)
    return ActionTables(damages, seen - seen[:1] + before, slopes, after)


def infer_damage(
    known: ActionTables, rng: np.random.Generator, *, chosen: bool
) -> Iterator[tuple[int, Floats]]:
    """Belief after one more action each, until every action was taken.

    Args:
        known: see `tables`.
        rng: draws the first action, and all where they are not chosen.
        chosen: whether actions are chosen.

    Yields:
        The action, and the probability (H) of each damage.
    """
    _, group = group_damages(known.damages)
    share = (1 - _INTACT_PRIOR) / (len(known.damages) - 1)
    prior = np.log([_INTACT_PRIOR, *[share] * (len(known.damages) - 1)])
    weight, tried = prior, list[int]()
    scale = np.full(2, TILT_SCALE)
    while len(tried) < len(known.measured):
        left = np.setdiff1d(np.arange(len(known.measured)), tried)
        if chosen:
            blur = [widen_scale(scale, known.slope[0, a], DRIFT) for a in left]
            candidates = [
                CandidateAction(known.predicted[:, None, a], b)
                for a, b in zip(left, blur, strict=True)
            ]
            pick, _ = choose_action(candidates, weight, group, rng)
            tried.append(int(left[pick]))
        else:
            tried.append(int(rng.choice(left)))
        count = len(known.damages), 2 * len(tried)
        fit = compute_log_likelihood(
            known.predicted[:, tried].reshape(count),
            known.slope[:, tried].reshape(*count, -1),
            known.measured[tried].ravel(),
            ResidualNoise(np.tile(scale, len(tried)), DRIFT),
        )
        weight = prior + fit
        yield tried[-1], compute_posterior(weight)
