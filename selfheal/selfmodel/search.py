"""Our search: climbers that start from rivals, and a crowd of the rivals they reach.

A climber tries small changes round and round, a few at a time, and takes the best that
gains enough. Each body's table under every action holds thousands of twins (see
`symmetry`): a climber that has come some way, or stands at a peak, is simulated under
every action once, and goes on from its best twin. A peak joins the crowd, where it
competes only with bodies of the same structure until the crowd is full (deterministic
crowding, Mahfoud 1995, with the tree as the distance).
"""

from dataclasses import dataclass, field

import numpy as np

from ..body.body import Floats, Ints
from ..body.genome import Genomes, at_sides, concatenate
from ..errors import EngineError
from .evaluate import Evaluator, Evidence
from .space import (
    Space,
    changes,
    crossed,
    kicked,
    nudges,
    others,
    random_bodies,
    same,
)
from .symmetry import Twins

# Chosen: fine changes do not make up for twice the best loss.
_HOPELESS = 2.0
# Chosen on simulated robots: a climb from the best of 64 bodies takes half as many
# simulations a success as one from a single body, where placements are free.
_DRAWN = 64
# Chosen on simulated robots: a change is tried on the actions that the climber explains
# worst first, and given up where it has fallen _BEHIND or half of what there is still
# to gain, for an action explained to _WELL has nothing to give.
_BEHIND, _HOPE, _WELL = 1.0, 0.5, 1.0
# Chosen on simulated robots: a discrete change must gain this loss. With less a climber
# drifts among bodies that differ by noise, and tries all changes again each time.
_GAIN = 0.5
# Chosen on simulated robots: rivals that climb again on new evidence; the others are
# kept as they are. Six took most of the simulations where hinges are unknown.
_AGAIN = 2
_FAVOR = 1.0  # [deg] an action: better rivals start climbs more often; chosen
_FRUITLESS = 1000  # diverged simulations, and no other, end the search; chosen


@dataclass
class Crowd:
    """Rivals: peaks of different structure, best first.

    Attributes:
        genomes: (K).
        tables: (K, A, 3) their channels under every action.
        losses: (K) over the evidence so far.
    """

    genomes: Genomes
    tables: Floats
    losses: Floats

    @classmethod
    def empty(cls, parts: int, actions: int) -> "Crowd":
        """No rivals yet."""
        whole = np.zeros((0, parts), np.int64)
        real = np.zeros((0, parts))
        nobody = Genomes(whole, real, whole, real)
        return cls(nobody, np.zeros((0, actions, 3)), np.zeros(0))

    def __len__(self) -> int:
        return len(self.losses)

    def take(self, rows: Ints) -> None:
        """Keep these rows, in this order."""
        self.genomes, self.tables = self.genomes[rows], self.tables[rows]
        self.losses = self.losses[rows]

    def add(self, genome: Genomes, table: Floats, loss: float) -> None:
        """Take in a peak; of two equal structures the better one stays."""
        twin = np.flatnonzero(_alike(self.genomes, genome))
        if len(twin) and self.losses[twin[0]] <= loss:
            return
        keep = np.setdiff1d(np.arange(len(self)), twin)
        self.take(keep)
        self.genomes = concatenate(self.genomes, genome)
        self.tables = np.concatenate([self.tables, table[None]])
        self.losses = np.append(self.losses, loss)

    def cut(self, size: int) -> None:
        """Sort, and keep the best `size`."""
        self.take(np.argsort(self.losses, kind="stable")[:size])


def _alike(genomes: Genomes, one: Genomes) -> np.ndarray:
    """(N) whether a genome has the tree, sides and hinges of another (1)."""
    equal = (genomes.parent == one.parent) & (genomes.side == one.side)
    return (equal & (genomes.hinge == one.hinge)).all(axis=1)


@dataclass(eq=False)
class _Climber:
    """A body on its way up, and the changes it has not tried.

    Attributes:
        each: (n) its loss under each action, None where not known.
        around: all changes of the kind in turn.
        order: in which they are tried, round and round.
        place: in the order.
        left: changes not tried since the body changed.
        fine: whether it tries small changes of continuous genes.
        peak: loss at which the last coarse climb ended.
    """

    genome: Genomes
    loss: float
    each: Floats | None = None
    around: Genomes | None = None
    order: Ints | None = None
    place: int = 0
    left: int = 0
    fine: bool = False
    peak: float = np.inf

    @property
    def stuck(self) -> bool:
        """Whether every change of the kind in turn was tried in vain."""
        return self.around is not None and self.left <= 0

    def route(self, count: int) -> tuple[Ints, Floats]:
        """The order of `count` actions, and what a loss must stay below after each."""
        if self.each is None:
            return np.arange(count), np.full(count, self.loss)
        order = np.argsort(-self.each, kind="stable")
        mine = self.each[order]
        room = np.maximum(mine - _WELL, 0)
        left = room.sum() - np.cumsum(room)
        behind = np.minimum(_BEHIND, _HOPE * left)
        return order, np.cumsum(mine) + behind - (1e-9 if self.fine else _GAIN)

    def changes(self, space: Space, count: int, rng: np.random.Generator) -> Genomes:
        """The next few changes to try; of a body not yet simulated, itself."""
        if self.each is None:
            return self.genome
        if self.around is None:
            fine = self.fine
            self.around = (
                nudges(space, self.genome, rng) if fine else changes(space, self.genome)
            )
            self.left = len(self.around)
            if fine or self.order is None or len(self.order) != self.left:
                self.order, self.place = rng.permutation(self.left), 0
        assert self.order is not None
        steps = self.place + np.arange(min(count, self.left))
        self.place, self.left = self.place + count, self.left - count
        return others(self.around[self.order[steps % len(self.order)]], self.genome)

    def move(self, genome: Genomes, loss: float, each: Floats) -> None:
        """Be another body."""
        self.genome, self.loss, self.each, self.around = genome, loss, each, None


@dataclass
class RivalSearch:
    """The default search; see the module.

    Attributes:
        space: which genes are unknown.
        evaluator: simulates and counts.
        twins: of the anatomy and its actions.
        size: of the crowd.
        climbers: that climb side by side, `children` changes each at a time.
    """

    space: Space
    evaluator: Evaluator
    twins: Twins
    size: int = 16
    climbers: int = 4
    children: int = 16
    crowd: Crowd = field(init=False)

    def __post_init__(self) -> None:
        """Start with nobody."""
        actions, parts = self.evaluator.actions.shape
        self.crowd = Crowd.empty(parts, actions)

    def run(self, evidence: Evidence, limit: int, rng: np.random.Generator) -> None:
        """Search until the evaluator has spent `limit` simulations."""
        queue = self._relearn(evidence)
        active: list[_Climber] = []
        while self.evaluator.spent < limit or not self._any(active):
            while len(active) < self.climbers:
                active.append(queue.pop(0) if queue else self._start(evidence, rng))
            self._step(active, evidence, rng)
            if self.evaluator.failed >= max(_FRUITLESS, self.evaluator.spent):
                raise EngineError(f"all of {self.evaluator.spent} simulations diverged")
            for climber in [c for c in active if c.stuck and not self._turn(c)]:
                active.remove(climber)
                again = self._peak(climber, evidence)
                if again:
                    active.append(again)
        for climber in active:
            if np.isfinite(climber.loss):
                self._peak(climber, evidence)

    def _any(self, active: list[_Climber]) -> bool:
        """Whether there is any body to go on with."""
        return len(self.crowd) > 0 or any(np.isfinite(c.loss) for c in active)

    def _turn(self, climber: _Climber) -> bool:
        """Whether a stuck climber goes on, by fine changes or by coarse ones again."""
        best = self.crowd.losses[0] if len(self.crowd) else np.inf
        discrete = self.space.sides and not self.space.lengths
        if discrete or climber.loss > _HOPELESS * best or climber.loss == climber.peak:
            return False
        if climber.fine:
            climber.peak = climber.loss
        climber.fine, climber.around = not climber.fine, None
        return True

    def _relearn(self, evidence: Evidence) -> list[_Climber]:
        """Score the rivals on the evidence, each as its best twin; all climb again."""
        old, self.crowd = self.crowd, Crowd.empty(*self.evaluator.actions.shape[::-1])
        for row in range(len(old)):
            self.crowd.add(
                *self._best_twin(old.genomes[[row]], old.tables[row], evidence)
            )
        self.crowd.cut(self.size)
        finite = np.flatnonzero(np.isfinite(self.crowd.losses))
        return [
            self._climber(self.crowd.genomes[[k]], self.crowd.tables[k], evidence)
            for k in finite[:_AGAIN]
        ]

    def _climber(self, genome: Genomes, table: Floats, evidence: Evidence) -> _Climber:
        """A climber that starts from a body whose table is known."""
        each = self.evaluator.loss(table[list(evidence.tried)], evidence.felt)
        return _Climber(genome, float(each.sum()), each)

    def _best_twin(
        self, genome: Genomes, table: Floats, evidence: Evidence
    ) -> tuple[Genomes, Floats, float]:
        """The twin that explains the evidence best: genome, table, loss."""
        losses = self.twins.losses(
            genome.parent[0],
            table,
            np.asarray(evidence.tried),
            evidence.felt,
            self.evaluator.loss,
        )
        turn, trade = np.unravel_index(int(np.argmin(losses)), losses.shape)
        if losses[turn, trade] > losses[0, 0] - 1e-6:
            return genome, table, float(losses[0, 0])
        twin = self.twins.genome(genome, 0, int(turn), int(trade))
        table = self.twins.table(table, int(turn), int(trade))
        return twin, table, float(losses[turn, trade])

    def _start(self, evidence: Evidence, rng: np.random.Generator) -> _Climber:
        """The best of some random bodies, a kicked rival, or a child of two rivals."""
        dice = rng.random()
        if np.isfinite(self.crowd.losses).sum() < 4 or dice < 0.3:
            return self._random_start(evidence, rng)
        gap = self.crowd.losses - self.crowd.losses.min()
        weight = np.exp(-gap / (_FAVOR * len(evidence)))
        pick = rng.choice(len(weight), 2, replace=False, p=weight / weight.sum())
        first, second = self.crowd.genomes[pick[:1]], self.crowd.genomes[pick[1:]]
        if dice < 0.65:
            return _Climber(kicked(self.space, first, rng), np.inf)
        return _Climber(crossed(first, second, rng), np.inf)

    def _random_start(self, evidence: Evidence, rng: np.random.Generator) -> _Climber:
        """The best of some random bodies with parts at the middle of sides."""
        genomes = at_sides(
            random_bodies(self.evaluator.anatomy, self.space, _DRAWN, rng)
        )
        best, loss, parts = 0, np.inf, None
        for rows in (slice(0, _DRAWN // 8), slice(_DRAWN // 8, _DRAWN)):
            total, each = self.evaluator.losses(
                genomes[rows],
                evidence,
                bound=np.full(len(genomes[rows]), loss),
                order=self.evaluator.hardest_first(evidence),
            )
            if total.min() < loss:
                row = int(np.argmin(total))
                best, loss, parts = rows.start + row, float(total[row]), each[row]
        return _Climber(genomes[[best]], loss, parts)

    def _step(
        self, active: list[_Climber], evidence: Evidence, rng: np.random.Generator
    ) -> None:
        """Each climber tries a few changes and takes the best that gains enough."""
        batches = [c.changes(self.space, self.children, rng) for c in active]
        sizes = [len(b) for b in batches]
        routes = zip(*(c.route(len(evidence)) for c in active), strict=True)
        order, bound = (np.repeat(rows, sizes, axis=0) for rows in routes)
        genomes = concatenate(*batches)
        total, each = self.evaluator.losses(genomes, evidence, bound=bound, order=order)
        edges = np.cumsum([0, *sizes])
        for climber, low, high in zip(active, edges[:-1], edges[1:], strict=True):
            best = low + int(np.argmin(total[low:high])) if high > low else low
            if high > low and total[best] < climber.loss:
                climber.move(genomes[[best]], float(total[best]), each[best])
            elif climber.each is None:
                climber.around = climber.genome[:0]  # an impossible start: give up

    def _peak(self, climber: _Climber, evidence: Evidence) -> _Climber | None:
        """Take a climber's peak into the crowd; a climber to go on with, if any."""
        if not np.isfinite(climber.loss):
            return None
        if same(self.crowd.genomes, climber.genome).any():
            return None
        table = self.evaluator.table(climber.genome)[0]
        genome, table, loss = self._best_twin(climber.genome, table, evidence)
        better = loss < climber.loss - 1e-6
        self.crowd.add(genome, table, loss)
        self.crowd.cut(self.size)
        return self._climber(genome, table, evidence) if better else None
