"""Hypotheses: what may have happened to a robot, as a list that grows finer."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ..body.body import Anatomy, Floats, Ints
from ..body.damage import INTACT, Damage, list_sensors

_SCALES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.2, 1.5)  # paper A: 0.1 to 2
_JAMS = np.radians(np.arange(-60, 61, 20.0))
STRENGTHS = (0.15, 0.3, 0.45, 0.6, 0.75)
_SLOPES, AZIMUTHS = np.radians((5.0, 10.0, 15.0)), np.radians(np.arange(0, 360, 45.0))
_FRICTIONS = (0.05, 0.1, 0.2, 0.3)
# Prior of each kind, spread evenly over its targets; chosen: an alarm is seldom false,
# and nothing else is likelier than another.
_INTACT_PRIOR = 0.05
# A value is not refined beyond this: 5 mm on the longest part, a degree; chosen
_DEG = np.pi / 180
_FINE = {"part_scale": 0.03, "joint_jam": _DEG, "weak_motor": 0.04, "slope": _DEG,
         "weak_sensor": 0.04, "ground_friction": 0.02}  # fmt: skip
_FIRST = {"joint_jam": 8 * _DEG, "slope": 5 * _DEG}  # first steps
_RANGES = {"part_scale": (0.05, 2.0), "joint_jam": (-96 * _DEG, 96 * _DEG),
           "weak_motor": (0.05, 1.0), "weak_sensor": (0.05, 1.0),
           "slope": (0.0, 30 * _DEG), "ground_friction": (0.02, 1.5)}  # fmt: skip


def list_damages(
    anatomy: Anatomy, angles: Floats, gone: Collection[str] = ()
) -> list[Damage]:
    """Everything that may have happened, coarsely; nothing comes first.

    Args:
        angles: (P) of the joints when the alarm was raised [rad]: a jam may be there.
        gone: targets to which nothing more can happen.
    """
    sensors = [f"sensor:{name}" for name in list_sensors(anatomy)]
    parts = [f"body:{part}" for part in anatomy.parts]
    servos = [f"actuator:{joint}_servo" for joint in anatomy.joints]
    joints = [
        (f"joint:{joint}", float(angle))
        for joint, now in zip(anatomy.joints, angles, strict=True)
        for angle in (now, *_JAMS)
    ]
    found = [
        INTACT,
        *(Damage("part_scale", part, s) for part in parts for s in _SCALES),
        *(Damage("limb_loss", part) for part in parts),
        *(Damage("joint_jam", joint, angle) for joint, angle in joints),
        *(Damage("weak_motor", servo, s) for servo in servos for s in STRENGTHS),
        *(Damage("sensor_dead", name) for name in sensors),
        *(Damage("weak_sensor", name, s) for name in sensors for s in STRENGTHS),
        *list_ground_damages(),
    ]
    return [damage for damage in found if damage.target not in gone]


def list_ground_damages() -> list[Damage]:
    """What the ground may have become, coarsely."""
    slopes = [
        Damage("slope", "world", float(s), float(a)) for s in _SLOPES for a in AZIMUTHS
    ]
    return [*slopes, *(Damage("ground_friction", "world", f) for f in _FRICTIONS)]


def group_damages(damages: Sequence[Damage]) -> tuple[list[tuple[str, str]], Ints]:
    """Kind and target of each group, and the group (H) of each hypothesis."""
    names = list(dict.fromkeys((d.kind, d.target) for d in damages))
    place = {name: k for k, name in enumerate(names)}
    return names, np.array([place[d.kind, d.target] for d in damages])


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
    for g in np.argsort(-peak, kind="stable")[:count]:
        if peak[g] < peak.max() - 6:  # hardly believed any more; chosen
            continue
        members = [k for k in range(len(damages)) if group[k] == g]
        best = damages[max(members, key=lambda k: float(log_weight[k]))]
        if best.kind in _FINE:
            new += _bisect_neighbors(best, [damages[k] for k in members])
    return new


def _bisect_neighbors(best: Damage, known: list[Damage]) -> list[Damage]:
    """New hypotheses half-way from the best one to its neighbors in value."""
    fine, (low, high) = _FINE[best.kind], _RANGES[best.kind]
    values = np.array([d.value for d in known if d.azimuth == best.azimuth])
    first = _FIRST.get(best.kind, 0.1)
    below, above = values[values < best.value], values[values > best.value]
    ends = (
        below.max() if len(below) else best.value - 2 * first,
        above.min() if len(above) else best.value + 2 * first,
    )
    middle = [
        (best.value + end) / 2 for end in ends if abs(end - best.value) > 1.5 * fine
    ]
    found = [replace(best, value=float(np.clip(v, low, high))) for v in middle]
    if best.kind == "slope":
        turns = np.array([d.azimuth - best.azimuth for d in known])
        turns = np.abs(np.angle(np.exp(1j * turns)))
        step = turns[turns > 1e-6].min() / 2
        if step > np.radians(5):
            found += [replace(best, azimuth=best.azimuth + s) for s in (-step, step)]
    return [d for d in found if d not in known]
