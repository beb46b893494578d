"""A trial of a walk: a self-modeling run and its robot in, a gait walked on it out."""

import numpy as np

from ..body.body import GRAVITY
from ..engine.plant import build_rated_plant
from ..gait.pattern import SECONDS
from ..gait.rival_bodies import select_rival_bodies
from ..gait.synthesis import (
    ONE_GAIT,
    GaitTask,
    LikelyPlants,
    Progress,
    project_on_heading,
    synthesize_gaits,
    walk_gait,
)
from ..robot.base import Walker
from ..robot.read_channels import read_position
from ..selfmodel.run import Run
from .phased_run import Document


def walk_trial(run: Run, robot: Walker, task: GaitTask, progress: Progress) -> Document:
    """Synthesize a gait from what a run believes, and walk it on the robot.

    Returns:
        What `selfheal gait --json` prints. Energy is the positive mechanical work of
        the motors in the self-model [J], cost of transport that over m g d [1].
    """
    models, weights = select_rival_bodies(run)
    plants = [build_rated_plant(models[[k]]) for k in range(len(models))]
    likely = LikelyPlants(plants, weights)
    (gait,) = synthesize_gaits(likely, task, ONE_GAIT, progress=progress)
    path = read_position(robot.move(gait.commands(run.anatomy.size)))
    along, across = project_on_heading(path[-1], task.heading)
    energy = float(walk_gait(plants[:1], gait).energy[0])
    known = models.anatomy
    parts = np.sum(models.mass[0]) + np.sum(known.block_mass)
    weight = GRAVITY * (known.torso_mass + float(parts))
    cost = energy / (weight * max(gait.predicted, 1e-3))
    return {
        "format": "selfheal-gait",
        "version": 1,
        "robot": robot.name,
        "seed": task.seed,
        "gait": gait.pattern,
        "heading": round(float(np.degrees(task.heading)), 3),
        "duration": SECONDS,
        "walked": round(float(along), 4),
        "across": round(float(across), 4),
        "speed": round(float(along) / SECONDS, 5),
        "predicted": {
            "distance": round(gait.predicted, 4),
            "low": round(gait.low, 4),
            "high": round(gait.high, 4),
            "energy": round(energy, 3),
            "cost_of_transport": round(cost, 3),
        },
        "cycle": round(gait.cycle, 3),
        "genes": [round(float(g), 5) for g in gait.genes],
        "simulations": gait.simulations,
        "failed": gait.failed,
    }
