"""Evaluation: how badly candidate bodies explain what the robot has felt so far.

A channel row is (left/right tilt [deg], forward/back tilt [deg], clearance [mm]).
One simulation is one candidate under one action, on any engine.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, Ints, centers_in_torso
from ..body.genome import Genomes, build
from ..engine.readings import Readings


class Engine(Protocol):
    """Anything that predicts readings of bodies under joint targets."""

    name: str

    def simulate(self, bodies: Bodies, targets: Floats) -> Readings:
        """Readings (N) of N bodies, each under its own joint targets (N, P) [rad]."""
        ...


def channels(readings: Readings) -> Floats:
    """(N, 3) the channels compared: two tilts [deg] and clearance [mm]."""
    return np.column_stack([np.degrees(readings.tilt), 1000 * readings.clearance])


def paper_loss(predicted: Floats, measured: Floats) -> Floats:
    """Paper A's error of one action: |lr| + |fb| [deg] + |clearance| [mm / 100].

    Args:
        predicted: (..., 3) channels.
        measured: (..., 3) channels, NaN where a sensor gave nothing.
    """
    return np.nansum(np.abs(predicted - measured) * [1, 1, 0.01], axis=-1)


# Chosen: beyond 8 degrees a pose is another rest of the body, and how far off it is
# says nothing more; 1 mm of clearance counts like half a degree of tilt, the ratio of
# their residuals on a body that is right (2006 readings: 0.2 deg a tilt, 0.8 mm).
_CAP, _CLEARANCE_WEIGHT = 8.0, 0.5


def capped_loss(predicted: Floats, measured: Floats) -> Floats:
    """Our error of one action: min(|lr|, 8) + min(|fb|, 8) + min(|mm|, 8) / 2."""
    gap = np.minimum(np.abs(predicted - measured), _CAP)
    return np.nansum(gap * [1, 1, _CLEARANCE_WEIGHT], axis=-1)


_MEMORY = 0.9  # of the running mean of each action's loss; chosen


@dataclass(frozen=True)
class Evidence:
    """What the robot did and felt.

    Attributes:
        tried: (n) indices of the actions, in the order tried.
        felt: (n, 3) channels measured.
    """

    tried: tuple[int, ...] = ()
    felt: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.tried)

    def add(self, action: int, felt: Floats) -> "Evidence":
        """This and one more action."""
        return Evidence((*self.tried, action), np.vstack([self.felt, felt]))


class Evaluator:
    """Scores genomes on an engine, with early abandonment, and counts simulations.

    Attributes:
        anatomy: of the robot.
        engine: the predictions come from it.
        actions: (A, P) the joint targets that the robot can try [rad].
        loss: of one action, from predicted and measured channels.
        spent: simulations so far, abandoned or not.
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
        loss: Callable[[Floats, Floats], Floats],
    ) -> None:
        """See the class."""
        self.anatomy, self.engine, self.actions = anatomy, engine, actions
        self.loss = loss
        self.spent, self.failed = 0, 0
        self.hardness = np.full(len(actions), np.inf)

    def hardest_first(self, evidence: Evidence) -> Ints:
        """Positions in the evidence, hardest action first; untested ones lead."""
        return np.argsort(-self.hardness[list(evidence.tried)], kind="stable")

    def simulate(self, bodies: Bodies, actions: Ints) -> Floats:
        """(N, 3) channels of N bodies, each under one action (N); NaN where diverged."""
        readings = self.engine.simulate(bodies, self.actions[actions])
        self.spent += len(actions)
        self.failed += int(readings.failed.sum())
        return channels(readings)

    def table(self, genomes: Genomes) -> Floats:
        """(N, A, 3) channels of N genomes under every action; NaN where diverged."""
        count = len(self.actions)
        bodies = build(self.anatomy, genomes)[np.repeat(np.arange(len(genomes)), count)]
        flat = self.simulate(bodies, np.tile(np.arange(count), len(genomes)))
        return flat.reshape(len(genomes), count, 3)

    def losses(
        self, genomes: Genomes, evidence: Evidence, *, bound: Floats, order: Ints
    ) -> tuple[Floats, np.ndarray]:
        """Sum of losses over the evidence, abandoned once it reaches the bound.

        Args:
            genomes: N candidates.
            evidence: n actions and readings.
            bound: (N) a candidate is given up when its loss reaches this.
            order: positions in the evidence, first to last to be simulated.

        Returns:
            total: (N) loss, or the part of it at which a candidate was given up;
                infinite where a simulation diverged.
            complete: (N) whether every action was simulated below the bound.
        """
        bodies = build(self.anatomy, genomes)
        inside = centers_in_torso(bodies)
        total = np.where(inside > 0, 100.0 + inside, 0.0)  # papers.md 1.1, not simulated
        alive = np.flatnonzero((inside == 0) & (total < bound))
        complete = np.zeros(len(genomes), bool)
        batch = getattr(self.engine, "batch", 1)
        place = 0
        while place < len(order) and len(alive):
            # an engine of fixed batch size takes several actions at once
            count = max(1, batch // len(alive))
            wave = np.asarray(order[place : place + count])
            place += count
            rows = np.repeat(alive, len(wave))
            which = np.tile(wave, len(alive))
            seen = self.simulate(bodies[rows], np.asarray(evidence.tried)[which])
            gap = self.loss(seen, evidence.felt[which])
            gap = np.where(np.isnan(seen).any(axis=1), np.inf, gap)
            gap = gap.reshape(len(alive), -1)
            self._note(np.asarray(evidence.tried)[wave], gap)
            total[alive] += gap.sum(axis=1)
            alive = alive[total[alive] < bound[alive]]
        complete[alive] = True
        return total, complete

    def _note(self, actions: Ints, gap: Floats) -> None:
        """Keep a running mean of the loss (N, w) under each of w actions."""
        seen = np.isfinite(gap)
        mean = np.where(seen, gap, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        old = np.where(np.isfinite(self.hardness), self.hardness, np.nan)[actions]
        blend = np.where(np.isnan(old), mean, _MEMORY * old + (1 - _MEMORY) * mean)
        self.hardness[actions] = blend
