"""Quasi-static engine: bodies and joint targets in, settled readings out."""

import numpy as np

from ..body.body import Bodies, Floats
from .readings import Readings, from_rest


class Statics:
    """Settles each body by tipping it from contact to contact; see `_settle`.

    Attributes:
        name: "statics".
        substeps: of the joint ramp, each settled from the last one's rest.
    """

    name = "statics"

    def __init__(self, substeps: int = 5) -> None:
        """`substeps` >= 1: accuracy against speed."""
        self.substeps = substeps

    def simulate(self, bodies: Bodies, targets: Floats) -> Readings:
        """Readings (N) of N bodies, each under its own joint targets (N, P) [rad]."""
        from ._settle import settle_batch

        a = bodies.anatomy
        targets = np.ascontiguousarray(targets, float)
        out = np.empty((len(bodies), 4 + a.size))
        known = (
            a.torso_half, a.torso_mass, a.block_half, a.block_center, a.block_mass,
        )  # fmt: skip
        settle_batch(
            bodies.parent, bodies.anchor, bodies.heading, bodies.axis, bodies.length,
            bodies.thickness, bodies.mass, known, a.radius, targets, self.substeps, out,
        )  # fmt: skip
        feet = out[:, 3 + np.asarray(a.feet)]
        return from_rest(out[:, :3], out[:, 3], feet, targets, a.torso_half[2])
