"""Reference engine: the full articulated body in native MuJoCo, on CPU threads."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Bodies, Floats, Ints
from .arrays import pack_bodies
from .readings import Readings, compute_readings

if TYPE_CHECKING:
    from ..body.mjcf import Physics

# Joints move from 0 to their target, then hold [s]. Chosen: 15 degrees a second, a
# quarter of the real servos' speed, so that a body rests where it is set down and not
# where its momentum threw it. The 2006 program took 0.5 s and 0.5 s (papers.md 1.1).
RAMP, HOLD = 2.0, 1.0


class MuJoCo:
    """Simulates each body's own compiled model; different trees at once."""

    name = "mujoco"

    def __init__(
        self, physics: "Physics | None" = None, ramp: float = RAMP, hold: float = HOLD
    ) -> None:
        """`physics` None: the defaults; times in seconds."""
        self.physics, self.ramp, self.hold = physics, ramp, hold

    def simulate(self, bodies: Bodies, targets: Floats) -> Readings:
        """Readings (N) of N bodies, each under its own joint targets (N, P) [rad].

        Equal bodies in a row are compiled once.
        """
        targets = np.asarray(targets, float)
        starts = np.flatnonzero(_differs_from_previous(bodies))
        groups = np.split(np.arange(len(bodies)), starts[1:])
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            settle = partial(self._simulate_to_rest, bodies, targets)
            rests = list(pool.map(settle, groups))
        up, height, tips, angles = (np.concatenate(x) for x in zip(*rests, strict=True))
        return compute_readings(bodies, pack_bodies(bodies), up, height, tips, angles)

    def _simulate_to_rest(
        self, bodies: Bodies, every: Floats, rows: Ints
    ) -> tuple[Floats, ...]:
        """Up (n, 3), height (n), foot heights (n, F), angles (n, P) of one body."""
        import mujoco
        from mujoco import rollout

        from ..body.mjcf import build_spec
        from ..mujoco_files import silence_mujoco

        silence_mujoco()
        a, targets = bodies.anatomy, every[rows]
        try:
            # the compiler would take a mass that is NaN for one not given
            if np.isnan(bodies.mass[rows[0]]).any():
                raise ValueError("a part has no mass")
            model = build_spec(bodies, rows[0], self.physics).compile()
        except ValueError:  # e.g. NaN sizes: a failed candidate, not an error
            shapes = ((3,), (), (len(a.feet),), (a.size,))
            return tuple(np.full((len(rows), *s), np.nan) for s in shapes)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        data = mujoco.MjData(model)
        steps = round((self.ramp + self.hold) / model.opt.timestep)
        share = np.minimum(np.arange(1, steps + 1) * model.opt.timestep / self.ramp, 1)
        start = np.empty(
            mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        )
        mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        state, sensors = rollout.rollout(
            model, data, start, targets[:, None, :] * share[:, None]
        )
        rest, sensors = state[:, -1], sensors[:, -1]
        tips = sensors[:, 4 + a.size :].reshape(len(rows), len(a.feet), 3)[..., 2]
        feet = np.asarray(a.feet, int) - 1
        tips = tips - (a.radius * bodies.thickness[rows[0]])[feet]
        height = rest[:, 3]  # of the free torso
        if a.fixed:
            height = np.full(len(rows), a.torso_half[2])
        return sensors[:, :3], height, tips, sensors[:, 4 : 4 + a.size]


def _differs_from_previous(bodies: Bodies) -> np.ndarray:
    """(N) whether a row is another body than the row before; the first one is."""
    columns = (getattr(bodies, f.name) for f in fields(bodies)[1:])
    flat = np.hstack([c.reshape(len(bodies), -1) for c in columns])
    return np.append(True, (flat[1:] != flat[:-1]).any(axis=1))
