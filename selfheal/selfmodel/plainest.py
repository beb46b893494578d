"""The plainest body: of those that no action tells apart, one with parts in the middle.

Readings say of a placement only how far it may be off. A part stands where it does by
chance of the search, within that; a robot's builder puts it in the middle of a side.
"""

from dataclasses import replace

import numpy as np

from ..body.body import Floats
from ..body.genome import Genomes, center_on_sides, concatenate_genomes
from .evaluate import Evaluator, Evidence
from .explore import DISTINGUISHABLE, TEMPERATURE
from .run import Cycle
from .space import is_same


def find_plainest(
    evaluator: Evaluator, genome: Genomes, table: Floats, evidence: Evidence
) -> tuple[Genomes, Floats]:
    """The body with as many parts as may be at the middle of their sides.

    Its channels differ from the given one's by no more than tells two bodies apart,
    under any action, and the readings make it no more than e times less likely.

    Args:
        genome: (1) the best body.
        table: (A, C) its channels under every action.

    Returns:
        The genome (1), and its table (A, C).
    """
    best, seen = genome, table
    most = float(evaluator.compute_table_losses(table, evidence).sum())
    off = np.abs(center_on_sides(genome).placement - genome.placement)[0]
    every = [np.flatnonzero(off > 0), *np.argsort(-off)[: (off > 0).sum(), None]]
    for parts in every if len(every[0]) else ():
        placement = best.placement.copy()
        placement[0, parts] = center_on_sides(best).placement[0, parts]
        moved = replace(best, placement=placement)
        if (placement == best.placement).all():
            continue
        with evaluator.count_as_choice():
            found = evaluator.compute_table(moved)[0]
        apart = np.abs(found - table) * evaluator.loss.weight
        loss = float(evaluator.compute_table_losses(found, evidence).sum())
        if (apart <= DISTINGUISHABLE).all() and loss < most + TEMPERATURE:
            best, seen = moved, found
    return best, seen


def put_plainest_first(cycle: Cycle, evaluator: Evaluator, evidence: Evidence) -> Cycle:
    """A cycle with the plainest of bodies like its best one before that."""
    best = cycle.genomes[:1]
    plain, table = find_plainest(evaluator, best, cycle.tables[0], evidence)
    if is_same(plain, best)[0]:
        return cycle
    loss = float(evaluator.compute_table_losses(table, evidence).sum())
    return replace(
        cycle,
        genomes=concatenate_genomes(plain, cycle.genomes),
        tables=np.concatenate([table[None], cycle.tables]),
        losses=np.append(loss, cycle.losses),
    )
