"""Quasi-static engine: bodies and joint targets in, settled readings out."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, Ints
from ..machine import count_cores
from .channels import list_channels
from .readings import Readings, compute_readings, pack_inputs

# rows; handing work to a thread costs about as much as settling half of these
_LEAST_ROWS_PER_THREAD = 16


class Statics:
    """Settles each body by tipping it from contact to contact; see `_settle`.

    Attributes:
        name: "statics".
        substeps: of the joint ramp, each settled from the last one's rest.
    """

    name = "statics"

    def __init__(self, substeps: int = 8, threads: int = 0) -> None:
        """`substeps` >= 1: accuracy against speed; `threads`: 0 = every core.

        Of 1,500 random trees 94.5 % rest where `mujoco` says with 5, 95.2 % with 8,
        95.4 % with 10 and 95.3 % with 20; a pose takes 60 % longer with 8 than with 5.
        """
        self.substeps, self.threads = substeps, threads or count_cores()

    def simulate(self, bodies: Bodies, targets: Floats) -> Readings:
        """Readings (N) of N bodies, each under its own joint targets (N, P) [rad]."""
        from ._settle import settle_batch

        a = bodies.anatomy
        targets = np.ascontiguousarray(targets, float)
        out = np.empty((len(bodies), 4 + a.size))
        packed, known = inputs = pack_inputs(bodies)

        def run(rows: slice) -> None:
            settle_batch(
                *(x[rows] for x in packed), *known, targets[rows],
                self._count_substeps(a),
                out[rows],
            )  # fmt: skip

        self._run_in_threads(run, len(bodies))
        feet = out[:, 3 + np.asarray(a.feet, int)]
        return compute_readings(bodies, inputs, out[:, :3], out[:, 3], feet, targets)

    def _count_substeps(self, anatomy: Anatomy) -> int:
        """Sub-steps of the ramp; none of a robot that is bolted down."""
        return 0 if anatomy.fixed else self.substeps

    def race(
        self,
        bodies: Bodies,
        targets: Floats,
        felt: Floats,
        *,
        weight: Floats,
        cap: Floats,
        order: Ints,
        bound: Floats,
        other_rest: Floats | float = np.inf,
    ) -> Floats:
        """Loss of N bodies under n actions in turn, each given up at its bound.

        Args:
            targets: (n, P) joint targets of the actions [rad].
            felt: (n, C) channels measured, of the anatomy's sensors.
            weight: (C), and
            cap: (C) of the loss of an action, sum_c weight_c min(|gap_c|, cap_c).
            order: (N, n) in which each body's actions are tried.
            bound: (N, n) a body is given up whose loss before the first, second, ...
                action in its order is not below.
            other_rest: (N) or one: loss that is added where a body is put down as the
                robot's tilts say it lies; that sum counts where it is less.

        Returns:
            (N, n) loss under each action, NaN where it was not simulated, infinite
            where the simulation failed.
        """
        from ._settle import race_batch

        each = np.empty((len(bodies), len(targets)))
        channels = list_channels(bodies.anatomy)
        steps = self._count_substeps(bodies.anatomy)
        rest = np.full(len(bodies), np.inf if bodies.anatomy.fixed else other_rest)
        packed, known = pack_inputs(bodies)

        def run(rows: slice) -> None:
            race_batch(
                *(x[rows] for x in packed), *known, targets, felt, weight, cap,
                rest[rows], order[rows], bound[rows], steps, channels.columns,
                each[rows],
            )  # fmt: skip

        self._run_in_threads(run, len(bodies))
        return each

    def _run_in_threads(self, run: Callable[[slice], None], count: int) -> None:
        """Run over `count` rows, cut among the threads where that pays."""
        if count < self.threads * _LEAST_ROWS_PER_THREAD or self.threads == 1:
            run(slice(None))
            return
        edges = np.linspace(0, count, self.threads + 1).astype(int)
        first, *others = (slice(*edge) for edge in pairwise(edges.tolist()))
        pool = _open_pool(self.threads - 1, os.getpid())
        handed = [pool.submit(run, rows) for rows in others]
        run(first)
        for work in handed:
            work.result()


@cache
def _open_pool(threads: int, _: int) -> ThreadPoolExecutor:
    """The threads of a process; a fork of it does not share them."""
    return ThreadPoolExecutor(threads)
