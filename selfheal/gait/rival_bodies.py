"""What a self-modeling run believes: a run in, the bodies the robot may have out."""

import numpy as np

from ..body.body import Bodies, Floats, measure_center_distance
from ..body.genome import Genomes, build_bodies, center_on_sides, concatenate_genomes
from ..engine.channels import list_channels
from ..engine.statics import Statics
from ..errors import InputError
from ..selfmodel.prior import compute_prior_cost
from ..selfmodel.run import Run
from ..selfmodel.space import find_space

_RIVALS = 3  # bodies that a gait has to suit; chosen
_SAME_BODY = 0.2  # [cm] centers nearer than this are the same body; chosen
# Tilts at rest say little of where on a side a part is, and a walk depends on it.
# Chosen on development seeds: a placement off the middle of its side must explain
# three degrees of loss more than the middle does.
_OFF_CENTER_COST = 3.0
_MIDDLE = 0.01  # [rounds] from the middle that still is the middle


def select_rival_bodies(run: Run) -> tuple[Bodies, Floats]:
    """The best bodies of a run (K) and how likely each is (K), best first.

    Every rival of the run stands as it is and with each part moved to the middle of
    its side.

    Raises:
        InputError: the run has no cycle yet.
    """
    if not run.cycles:
        raise InputError(
            "the run has no body yet; go on with it by 'selfheal identify --resume'"
        )
    rivals = run.cycles[-1].genomes
    genomes = concatenate_genomes(rivals, center_on_sides(rivals))
    bodies, loss = build_bodies(run.anatomy, genomes), _compute_losses(run, genomes)
    order = np.argsort(loss, kind="stable")
    weight, kept = np.exp(loss.min() - loss), [int(order[0])]
    for k in order[1:].tolist():
        near = measure_center_distance(bodies[[k]], bodies[kept]).min() < _SAME_BODY
        if weight[k] > 0.05 and not near and len(kept) < _RIVALS:
            kept.append(k)
    return bodies[kept], weight[kept] / weight[kept].sum()


def _compute_losses(run: Run, genomes: Genomes) -> Floats:
    """(N) of genomes on all that a run measured, with the prior [deg]."""
    bodies = build_bodies(run.anatomy, genomes)
    tried = run.actions[[cycle.action for cycle in run.cycles]]
    measured = np.array([cycle.felt for cycle in run.cycles])
    rows = np.repeat(np.arange(len(bodies)), len(tried))
    seen = Statics().simulate(bodies[rows], np.tile(tried, (len(bodies), 1)))
    table = seen.channels.reshape(len(bodies), len(tried), -1)
    gap = list_channels(run.anatomy).loss(table, measured)
    space = find_space(run.settings.space)
    off = np.abs((genomes.placement * 4) % 1 - 0.5) / 4 > _MIDDLE
    total = (
        gap.sum(axis=1)
        + compute_prior_cost(run.anatomy, space, genomes)
        + _OFF_CENTER_COST * off.sum(axis=1)
    )
    return np.where(np.isfinite(total), total, np.inf)
