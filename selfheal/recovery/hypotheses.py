"""Hypotheses: what may have happened to a robot, as a list that grows finer."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ..body.body import Anatomy, Floats, Ints
from ..damage.kinds import INTACT, KINDS, Damage
from ..damage.words import list_names
from ..evolution.ranking import rank_best_first

# Prior of each kind, spread evenly over its targets; chosen: an alarm is seldom false,
# and nothing else is likelier than another.
_INTACT_PRIOR = 0.05
_FINEST_TURN = np.radians(5)  # steps of azimuths are not halved any more


def list_damages(
    anatomy: Anatomy, angles: Floats, gone: Collection[str] = ()
) -> list[Damage]:
    """Everything that may have happened, coarsely; nothing comes first.

    Args:
        angles: (P) of the joints when the alarm was raised [rad]: a jam may be there.
        gone: targets to which nothing more can happen.
    """
    joints = dict(zip(anatomy.joints, angles.tolist(), strict=True))
    found = [INTACT]
    for kind in KINDS.values():
        for name in list_names(anatomy).get(kind.sort, ()):
            now = (joints[name],) if kind.sort == "joint" else ()
            found += kind.list_damages([name], (*now, *kind.heal_values.grid))
    return [damage for damage in found if damage.target not in gone]


def group_damages(damages: Sequence[Damage]) -> tuple[list[tuple[str, str]], Ints]:
    """Kind and target of each group, and the group (H) of each hypothesis."""
    names = list(dict.fromkeys(damage.place for damage in damages))
    number = {name: k for k, name in enumerate(names)}
    return names, np.array([number[damage.place] for damage in damages])


def compute_log_prior(damages: Sequence[Damage]) -> Floats:
    """(H) each kind alike, within it each target, within that each value."""
    names, group = group_damages(damages)
    kinds = [kind for kind, _ in names]
    share = [
        _INTACT_PRIOR
        if kind == "none"
        else (1 - _INTACT_PRIOR) / (len(set(kinds)) - 1) / kinds.count(kind)
        for kind in kinds
    ]
    return np.log(np.array(share) / np.bincount(group))[group]


def refine_damages(
    damages: Sequence[Damage], log_weight: Floats, count: int = 3
) -> list:
    """Hypotheses between the best ones of the likeliest groups and their neighbors.

    Args:
        log_weight: (H) belief in each.

    Returns:
        New ones, none where all are fine enough.
    """
    names, group = group_damages(damages)
    peak = np.array([log_weight[group == g].max() for g in range(len(names))])
    new: list[Damage] = []
    for g in rank_best_first(peak)[:count]:
        if peak[g] < peak.max() - 6:  # hardly believed any more; chosen
            continue
        members = [k for k in range(len(damages)) if group[k] == g]
        best = damages[max(members, key=lambda k: float(log_weight[k]))]
        if KINDS[best.kind].heal_values.step:
            new += _bisect_neighbors(best, [damages[k] for k in members])
    return new


def _bisect_neighbors(best: Damage, known: list[Damage]) -> list[Damage]:
    """New hypotheses half-way from the best one to its neighbors in value."""
    kind = KINDS[best.kind]
    by = kind.heal_values
    values = np.array([d.value for d in known if d.azimuth == best.azimuth])
    below, above = values[values < best.value], values[values > best.value]
    ends = (
        below.max() if len(below) else best.value - 2 * by.step,
        above.min() if len(above) else best.value + 2 * by.step,
    )
    middle = [
        (best.value + end) / 2
        for end in ends
        if abs(end - best.value) > 1.5 * by.finest
    ]
    found = [replace(best, value=float(np.clip(v, by.low, by.high))) for v in middle]
    if kind.has_azimuth:
        turns = np.array([d.azimuth - best.azimuth for d in known])
        turns = np.abs(np.angle(np.exp(1j * turns)))
        step = turns[turns > 1e-6].min() / 2
        if step > _FINEST_TURN:
            found += [replace(best, azimuth=best.azimuth + s) for s in (-step, step)]
    return [d for d in found if d not in known]
