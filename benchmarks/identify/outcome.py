"""What a run is worth: a finished run in, a record for the results out."""

import numpy as np

from benchmarks.suites import Record
from selfheal.body.body import Bodies, compute_edge_f1, measure_center_distance
from selfheal.body.genome import build_bodies
from selfheal.engine.channels import list_channels
from selfheal.engine.statics import Statics
from selfheal.robot.base import Robot
from selfheal.selfmodel.explore import DISTINGUISHABLE
from selfheal.selfmodel.run import Run

NEAR = 1.5  # [cm] mean distance of the parts' centers: the same body
_SAME_AXIS = np.cos(np.radians(10.0))  # chosen


def _predict_channels(body: Bodies, actions: np.ndarray) -> np.ndarray:
    """(A, 3) channels of one body under every action, by statics."""
    copies = body[np.zeros(len(actions), int)]
    return Statics(threads=1).simulate(copies, actions).channels


def compare_with_truth(run: Run, robot: Robot) -> Record:
    """How a run's best body compares with the truth.

    `apart` is the largest difference that statics predicts between the two bodies in
    a channel over all actions, in degrees of tilt or as much of another channel as
    counts like it. `loss` and `truth_loss` are what the two leave unexplained of the
    actions tried (our capped loss).
    """
    truth, last = robot.truth, run.cycles[-1]
    if truth is None:
        raise ValueError(f"robot {robot.name!r} does not say its true body")
    best = build_bodies(run.anatomy, last.genomes[:1])
    tables = [_predict_channels(body, run.actions) for body in (best, truth)]
    loss_of = list_channels(run.anatomy).loss
    apart = np.abs(tables[0] - tables[1]).max(axis=0) * loss_of.weight
    tried = [cycle.action for cycle in run.cycles]
    measured = np.array([cycle.felt for cycle in run.cycles])
    loss, truth_loss = (float(loss_of(t[tried], measured).sum()) for t in tables)
    right = best.parent[0] == truth.parent[0]
    axes = (best.axis * truth.axis).sum(axis=2)[0] > _SAME_AXIS
    return {
        "exact": bool(right.all()),
        "parent": best.parent[0].tolist(),
        "truth": truth.parent[0].tolist(),
        "side": last.genomes.side[0].tolist(),
        "hinge": last.genomes.hinge[0].tolist(),
        "axes": int(axes.sum()),
        "stated": last.sureness.round(4).tolist(),
        "right": right.tolist(),
        "edge_f1": float(compute_edge_f1(best, truth)[0]),
        "distance": float(measure_center_distance(best, truth)[0]),
        "apart": float(apart.max()),
        "loss": loss,
        "truth_loss": truth_loss,
        "tilt_error": float(run.result["tilt_error"]),
        "simulations": dict(run.counts),
    }


def explain_likeness(record: Record) -> str:
    """Why a wrong tree is as good as the true one, "" if it is not.

    Centers at zero angles say nothing of hinges, so that "near" needs them right.
    """
    if record["apart"] <= DISTINGUISHABLE:
        return "no action tells them apart"
    if record["distance"] <= NEAR and record["settings"]["space"] != "full":
        return f"within {10 * NEAR:g} mm"
    return ""


def explain_inexact_run(record: Record) -> str:
    """In words, what a run ended at that did not find the true tree."""
    if why := explain_likeness(record):
        return why
    if record["loss"] <= record["truth_loss"]:
        return "fits the actions tried no worse than the true body"
    return "not explained: the true body fits better and was not found"
