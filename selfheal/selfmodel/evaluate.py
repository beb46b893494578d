"""Evaluation: how badly candidate bodies explain what the robot has measured so far.

A channel row has what the robot's sensors say, see `engine.channels`. One simulation is
one candidate under one action, on any engine.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, Ints, count_centers_in_torso
from ..body.genome import Genomes, build_bodies
from ..engine.arrays import Race
from ..engine.channels import Loss, list_channels
from ..engine.readings import Engine

# Paper A: |lr| + |fb| [deg] + |clearance| [mm / 100]; papers.md 1.4.
PAPER_LOSS = Loss(np.array([1.0, 1.0, 0.01]), np.full(3, np.inf))
_MEMORY = 0.9  # of the running mean of each action's loss; chosen


@dataclass(frozen=True)
class Evidence:
    """What the robot did and measured.

    Attributes:
        tried: (n) indices of the actions, in the order tried.
        measured: (n, C) channels.
    """

    tried: tuple[int, ...]
    measured: Floats

    @classmethod
    def empty(cls, channels: int) -> "Evidence":
        """Nothing tried yet."""
        return cls((), np.zeros((0, channels)))

    def __len__(self) -> int:
        return len(self.tried)

    def add(self, action: int, measured: Floats) -> "Evidence":
        """This evidence and one more action, with its measured channels (C)."""
        return Evidence((*self.tried, action), np.vstack([self.measured, measured]))


class Evaluator:
    """Scores genomes on an engine, with early abandonment, and counts simulations.

    Attributes:
        actions: (A, P) the joint targets that the robot can try [rad].
        spent: simulations so far, abandoned or not.
        spent_choosing: simulations for choosing actions and for showing, counted apart.
        failed: of these, diverged.
        hardness: (A) recent mean loss of candidates under each action; the hardest
            first gives up wrong candidates soonest.
    """

    def __init__(
        self,
        anatomy: Anatomy,
        engine: Engine,
        *,
        actions: Floats,
        loss: Loss | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """`loss` None: that of all sensors; `progress` gets the simulations so far."""
        self.progress = progress or (lambda count: None)
        self.anatomy, self.engine, self.actions = anatomy, engine, actions
        self.loss = loss or list_channels(anatomy).loss
        self.spent, self.spent_choosing, self.failed = 0, 0, 0
        self._counts_as_choice = False
        self.hardness = np.full(len(actions), np.inf)

    @contextmanager
    def count_as_choice(self) -> Iterator[None]:
        """Count what is simulated meanwhile as `chosen`, not as `spent`."""
        self._counts_as_choice = True
        try:
            yield
        finally:
            self._counts_as_choice = False

    def _count(self, simulated: int) -> None:
        """Count simulations, and tell of those of the search."""
        if self._counts_as_choice:
            self.spent_choosing += simulated
            return
        self.spent += simulated
        self.progress(self.spent)

    def order_by_hardness(self, evidence: Evidence) -> Ints:
        """(n) positions in the evidence, hardest action first; untested ones lead."""
        return np.argsort(-self.hardness[list(evidence.tried)], kind="stable")

    def simulate_actions(self, bodies: Bodies, actions: Ints) -> Floats:
        """(N, C) channels of N bodies, each under an action (N); NaN where diverged."""
        readings = self.engine.simulate(bodies, self.actions[actions])
        self._count(len(actions))
        self.failed += int(readings.failed.sum())
        return readings.channels

    def compute_table(self, genomes: Genomes) -> Floats:
        """(N, A, C) channels of N genomes under every action; NaN where diverged."""
        return self.compute_body_table(build_bodies(self.anatomy, genomes))

    def compute_body_table(self, bodies: Bodies) -> Floats:
        """(N, A, C) channels of N bodies under every action; NaN where diverged."""
        count = len(self.actions)
        rows = np.repeat(np.arange(len(bodies)), count)
        flat = self.simulate_actions(
            bodies[rows], np.tile(np.arange(count), len(bodies))
        )
        return flat.reshape(len(bodies), count, -1)

    def compute_table_losses(self, table: Floats, evidence: Evidence) -> Floats:
        """(n) losses of a body under the actions tried, from its table (A, C)."""
        return self.loss(table[list(evidence.tried)], evidence.measured)

    def compute_losses(
        self, bodies: Bodies, evidence: Evidence, race: Race
    ) -> tuple[Floats, Floats]:
        """Losses over the evidence, abandoned once they reach a bound.

        Args:
            race: of positions in the evidence; `other_rest` counts where the engine
                has a race of its own.

        Returns:
            total: (N) loss of the candidates that stayed below, infinite for others.
            each: (N, n) loss under each action, by position in the evidence; NaN where
                not simulated, infinite where the simulation diverged.
        """
        each = np.full(race.order.shape, np.nan)
        sound = np.flatnonzero(count_centers_in_torso(bodies) == 0)  # papers.md 1.1
        if len(sound):
            some = bodies[sound], evidence, race.take_rows(sound)
            each[sound] = self._race_bodies(*some)
        run = np.cumsum(np.take_along_axis(each, race.order, axis=1), axis=1)
        complete = (run < race.bound).all(axis=1)  # false where anything is not known
        return np.where(complete, run[:, -1], np.inf), each

    def _race_bodies(self, bodies: Bodies, evidence: Evidence, race: Race) -> Floats:
        """(N, n) losses by position, NaN from where a body has reached its bound."""
        tried, run_race = list(evidence.tried), getattr(self.engine, "race", None)
        if run_race:
            known = self.actions[tried], evidence.measured
            each: Floats = run_race(bodies, known, self.loss, race)
            self._count(int((~np.isnan(each)).sum()))
            self.failed += int(np.isinf(each).sum())
        else:
            each = self._race_in_batches(bodies, evidence, race)
        self._update_hardness(tried, each)
        return each

    def _race_in_batches(
        self, bodies: Bodies, evidence: Evidence, race: Race
    ) -> Floats:
        """The race on an engine of fixed batch size: several actions at once."""
        tried, total = np.asarray(evidence.tried), np.zeros(len(bodies))
        each = np.full(race.order.shape, np.nan)
        alive, place = np.arange(len(bodies)), 0
        while place < len(tried) and len(alive):
            batch = getattr(self.engine, "batch", 1)
            now = race.order[alive, place : place + max(1, batch // len(alive))]
            width = now.shape[1]
            seen = self.simulate_actions(
                bodies[np.repeat(alive, width)], tried[now].reshape(-1)
            )
            measured = evidence.measured[now].reshape(len(seen), -1)
            gap = self.loss(seen, measured)
            gap = np.where(np.isnan(seen).any(axis=1), np.inf, gap).reshape(now.shape)
            each[alive[:, None], now] = gap
            place += width
            total[alive] += gap.sum(axis=1)
            alive = alive[total[alive] < race.bound[alive, place - 1]]
        return each

    def _update_hardness(self, actions: list[int], gap: Floats) -> None:
        """Keep a running mean of the loss (N, w) under each of w actions."""
        seen = np.isfinite(gap)
        count = seen.sum(axis=0)
        mean = np.where(seen, gap, 0).sum(axis=0) / np.maximum(count, 1)
        old = self.hardness[actions]
        blend = np.where(np.isinf(old), mean, _MEMORY * old + (1 - _MEMORY) * mean)
        self.hardness[actions] = np.where(count > 0, blend, old)
