"""Quasi-static engine: bodies and joint targets in, settled readings out."""

import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np

from ..body.body import Bodies, Floats
from .readings import Readings, from_rest

_WORTH_A_THREAD = 64  # rows; starting a thread costs about as much as settling these


class Statics:
    """Settles each body by tipping it from contact to contact; see `_settle`.

    Attributes:
        name: "statics".
        substeps: of the joint ramp, each settled from the last one's rest.
    """

    name = "statics"

    def __init__(self, substeps: int = 5, threads: int = 0) -> None:
        """`substeps` >= 1: accuracy against speed; `threads`: 0 = every core."""
        self.substeps, self.threads = substeps, threads or os.cpu_count() or 1

    def simulate(self, bodies: Bodies, targets: Floats) -> Readings:
        """Readings (N) of N bodies, each under its own joint targets (N, P) [rad]."""
        from ._settle import settle_batch

        a = bodies.anatomy
        targets = np.ascontiguousarray(targets, float)
        turn = np.stack([np.cos(bodies.heading), np.sin(bodies.heading)], axis=2)
        out = np.empty((len(bodies), 4 + a.size))
        known = (
            a.torso_half, a.torso_mass, a.block_half, a.block_center, a.block_mass,
        )  # fmt: skip

        def run(rows: slice) -> None:
            settle_batch(
                bodies.parent[rows], bodies.anchor[rows], turn[rows], bodies.axis[rows],
                bodies.length[rows], bodies.thickness[rows], bodies.mass[rows], known,
                a.radius, targets[rows], self.substeps, out[rows],
            )  # fmt: skip

        if len(bodies) < self.threads * _WORTH_A_THREAD:
            run(slice(None))
        else:
            edges = np.linspace(0, len(bodies), self.threads + 1).astype(int)
            rows = [slice(*edge) for edge in pairwise(edges.tolist())]
            with ThreadPoolExecutor(self.threads) as pool:
                list(pool.map(run, rows))
        feet = out[:, 3 + np.asarray(a.feet)]
        return from_rest(out[:, :3], out[:, 3], feet, targets, a.torso_half[2])
