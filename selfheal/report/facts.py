"""What a report says of a run, in words and numbers: a Run in, values out."""

from dataclasses import dataclass

import numpy as np

from ..body.body import (
    Bodies,
    compute_edge_f1,
    measure_center_distance,
    measure_length_error,
    measure_tip_distance,
)
from ..body.genome import HINGE_NAMES, Genomes, build_bodies
from ..engine.channels import list_channels
from ..selfmodel.run import Run

DASH = "\N{EN DASH}"  # where there is no number
SIDES = ("left", "front", "right", "back")
# Rivals are called equal within the step in which tilts were read, 0.1 degrees an
# action (papers.md 1.1), and near within five steps; both chosen.
EQUAL, NEAR = 0.1, 0.5
_MOVED, _LONGER = 5.0, 2.0  # [mm] what counts as another place, another length; chosen


def choose_channels(run: Run, most: int) -> list[int]:
    """Channels to show: those of the stated error, at most the worst predicted ones.

    Channels that no action read are left out, unless there are no others.
    """
    channels = list_channels(run.anatomy)
    measured = np.array([cycle.felt for cycle in run.cycles])
    predicted = run.cycles[-1].tables[0][[cycle.action for cycle in run.cycles]]
    known = np.isfinite(measured).any(axis=0)
    gap = np.nan_to_num(np.abs(predicted - measured)).mean(axis=0)
    gap = gap * channels.loss.weight
    worst = np.lexsort((-gap, channels.shown == 0, ~known))[:most]
    return sorted(int(k) for k in worst if known[k] or not known.any())


def format_thousands(count: float) -> str:
    """A number as short as an axis needs it: 950, 12k, 1.3M."""
    if count < 1000:
        return f"{count:.0f}"
    if count < 999_500:
        return f"{count / 1e3:.3g}k"
    return f"{count / 1e6:.3g}M"


def format_number(value: float, digits: int = 2) -> str:
    """A number, or a dash where there is none."""
    whole = round(value, digits) + 0.0  # no -0.0
    return f"{whole:.{digits}f}" if np.isfinite(value) else DASH


def format_percent(value: float) -> str:
    """A probability, or a dash where there is none."""
    return f"{100 * value:.0f}\N{NO-BREAK SPACE}%" if np.isfinite(value) else DASH


def name_action(run: Run, action: int) -> str:
    """The joints that an action sends down."""
    down = np.flatnonzero(run.actions[action] < 0)
    return " + ".join(run.anatomy.joints[i] for i in down) or "all up"


def name_part(run: Run, part: int) -> str:
    """A part's name from its number, 0 = the torso."""
    return run.anatomy.parts[part - 1] if part else "torso"


def find_right_edges(run: Run, bodies: Bodies) -> np.ndarray | None:
    """(N, P) whether each attachment is to the true parent; None if nobody knows."""
    return None if run.truth is None else bodies.parent == run.truth.parent


def list_errors(run: Run, bodies: Bodies) -> list[tuple[str, str]]:
    """The first body's distances to the truth, by name; none if nobody knows it."""
    if run.truth is None:
        return []
    best, truth = bodies[:1], run.truth
    measures = {
        "mean distance of part centers": measure_center_distance,
        "mean distance of part tips": measure_tip_distance,
        "mean error of lengths": measure_length_error,
    }
    edges = f"{compute_edge_f1(best, truth)[0]:.3f}"
    return [
        ("attachments correct (edge F1)", edges),
        *((name, f"{find(best, truth)[0]:.2f} cm") for name, find in measures.items()),
    ]


def find_true_side(bodies: Bodies) -> np.ndarray:
    """(N, P) 0..3, the side of its parent that a part's direction points out of."""
    turn = 0.75 * np.pi - bodies.heading  # as `genome.build` turns it
    return np.floor(turn / (np.pi / 2) + 1e-9).astype(np.int64) % 4


@dataclass(frozen=True)
class Rival:
    """A candidate that the data do not rule out.

    Attributes:
        rank: among the candidates, from 1; 1 is the best.
        loss: over the actions so far.
        excess: loss an action above the best one's.
        differs: what is different from the best one, a phrase an item.
        away: mean distance of its parts' centers from the best one's [cm].
        apart: most that any action could tell it from the best one by
            |left/right| + |forward/back| [deg]; NaN if not simulated.
        right: how many attachments are right, None if nobody knows.
    """

    rank: int
    loss: float
    excess: float
    differs: tuple[str, ...]
    away: float
    apart: float
    right: int | None


def list_rivals(run: Run) -> list[Rival]:
    """Candidates within `NEAR` loss an action of the best one, which is the first."""
    last = run.cycles[-1]
    bodies = build_bodies(run.anatomy, last.genomes)
    away = measure_center_distance(bodies, bodies[:1])
    gap = np.abs(last.tables - last.tables[:1])
    gap = list_channels(run.anatomy).weigh_shown(gap).sum(axis=2)
    apart = np.where(np.isnan(gap).all(axis=1), np.nan, np.nan_to_num(gap).max(axis=1))
    with np.errstate(invalid="ignore"):  # a diverged candidate's loss is infinite
        excess = (last.losses - last.losses[0]) / len(run.cycles)
    excess[0] = 0.0
    right = find_right_edges(run, bodies)
    return [
        Rival(
            rank=k + 1,
            loss=float(last.losses[k]),
            excess=float(excess[k]),
            differs=tuple(list_differences(run, last.genomes, k)),
            away=float(away[k]),
            apart=float(apart[k]),
            right=None if right is None else int(right[k].sum()),
        )
        for k in np.flatnonzero(excess <= NEAR).tolist()
    ]


def list_differences(run: Run, genomes: Genomes, row: int) -> list[str]:
    """What sets a body apart from the first one, a phrase a part."""
    bodies = build_bodies(run.anatomy, genomes[np.array([0, row])])
    moved = 1000 * np.linalg.norm(bodies.anchor[1] - bodies.anchor[0], axis=1)
    turned = np.degrees(bodies.heading[1] - bodies.heading[0])
    turned = np.abs((turned + 180) % 360 - 180)
    longer = 1000 * (bodies.length[1] - bodies.length[0])
    found = []
    for i in range(run.anatomy.size):
        phrases = []
        if bodies.parent[0, i] != bodies.parent[1, i]:
            phrases.append(f"on {name_part(run, bodies.parent[1, i])}")
        elif genomes.side[0, i] != genomes.side[row, i]:
            phrases.append(f"on the {SIDES[genomes.side[row, i]]} side")
        elif moved[i] > _MOVED:
            phrases.append(f"{moved[i]:.0f} mm and {turned[i]:.0f} degrees away")
        if genomes.hinge[0, i] != genomes.hinge[row, i]:
            phrases.append(f"hinge {HINGE_NAMES[genomes.hinge[row, i]]}")
        if abs(longer[i]) > _LONGER:
            phrases.append(f"{longer[i]:+.0f} mm long")
        if phrases:
            found.append(f"{name_part(run, i + 1)} {', '.join(phrases)}")
    return found
