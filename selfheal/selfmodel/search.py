"""Our search: climbers that start from rivals, and the set of rivals they reach.

A climber tries small changes round and round, a few at a time, and takes the best that
gains enough. Each body's table under every action holds thousands of twins (see
`symmetry`). So a climber that has come some way, or stands at a peak, is simulated
under every action once, and goes on from its best twin. A peak joins the rivals. It
competes only with bodies of its structure until the set is full (deterministic
crowding, Mahfoud 1995, with the tree as the distance).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from ..body.body import Floats, Ints
from ..body.genome import Genomes, build_bodies, center_on_sides, concatenate_genomes
from ..engine.arrays import Race, plan_race
from ..engine.channels import OTHER_REST
from ..errors import EngineError
from .evaluate import Evaluator, Evidence
from .prior import compute_prior_cost, draw_alike_genomes
from .rivals import RivalSet
from .space import (
    BodySpace,
    cross_genomes,
    draw_nudges,
    draw_space_genomes,
    find_others,
    is_same,
    is_valid,
    list_changes,
    perturb_genome,
)
from .symmetry import SymmetryGroup

# Chosen: fine changes do not make up for twice the best loss.
_HOPELESS_RATIO = 2.0
# Chosen on simulated robots: a climb from the best of 64 bodies takes half as many
# simulations a success as one from a single body, where placements are free.
_RANDOM_STARTS = 64
# Chosen on simulated robots: a change is tried on the actions that the climber explains
# worst first. It is given up where it has fallen behind by _GIVE_UP_LOSS, or by half of
# what is still to gain: an action explained to _EXPLAINED_LOSS has nothing to give.
_GIVE_UP_LOSS, _GIVE_UP_SHARE, _EXPLAINED_LOSS = 1.0, 0.5, 1.0
# Chosen on simulated robots: a discrete change must gain this loss. With less a climber
# drifts among bodies that differ by noise, and tries all changes again each time.
_LEAST_GAIN = 0.5
# Chosen on simulated robots: rivals that climb again on new evidence; the others are
# kept as they are. Six took most of the simulations where hinges are unknown.
_CLIMB_AGAIN = 2
# Drawn from the prior: twice as many as a starfish of known hinges has; chosen
_ALIKE = 1000
# Climbs in a row that led to no other tree, after which fewer than 5 % of climbs would,
# at 95 % confidence (rule of three, Hanley and Lippman-Hand 1983): 3 / 0.05.
_CLIMBS_IN_VAIN = 60
_PUT_DOWN = 0.5  # of new climbs, in which bodies are put down as the robot lies
_FAVOR_SCALE = 1.0  # [deg] an action: better rivals start climbs more often; chosen
_MOST_DIVERGED = 1000  # diverged simulations, and no other, end the search; chosen


@dataclass(eq=False)
class _Climber:
    """A body on its way up, and the changes it has not tried.

    Attributes:
        each: (n) its loss under each action, None where not known.
        around: all changes of the kind in turn, and
        sound: (N) which of them are valid and other bodies.
        order: in which they are tried, round and round.
        place: in the order.
        left: changes not tried since the body changed.
        fine: whether it tries small changes of continuous genes.
        peak: loss at which the last coarse climb ended.
        other_rest: loss of a pose that a body can rest in, though it comes to another.
    """

    genome: Genomes
    loss: float
    each: Floats | None = None
    around: Genomes | None = None
    sound: np.ndarray = field(default_factory=lambda: np.empty(0, bool))
    order: Ints | None = None
    place: int = 0
    left: int = 0
    fine: bool = False
    peak: float = np.inf
    other_rest: float = np.inf

    @property
    def is_stuck(self) -> bool:
        """Whether every change of the kind in turn was tried in vain."""
        return self.around is not None and self.left <= 0

    def plan_race(self, count: int) -> tuple[Ints, Floats]:
        """The order of `count` actions, and what a loss must stay below after each."""
        if self.each is None:
            return np.arange(count), np.full(count, self.loss)
        order = np.argsort(-self.each, kind="stable")
        mine = self.each[order]
        room = np.maximum(mine - _EXPLAINED_LOSS, 0)
        left = room.sum() - np.cumsum(room)
        behind = np.minimum(_GIVE_UP_LOSS, _GIVE_UP_SHARE * left)
        return order, np.cumsum(mine) + behind - (1e-9 if self.fine else _LEAST_GAIN)

    def propose_changes(self, space: BodySpace, count: int, rng: Generator) -> Genomes:
        """The next few changes to try; of a body not yet simulated, itself."""
        if self.each is None:
            return self.genome
        if self.around is None:
            fine, one = self.fine, (space, self.genome)
            self.around = draw_nudges(*one, rng) if fine else list_changes(*one)
            self.left = len(self.around)
            self.sound = find_others(space, self.around, self.genome)
            if fine or self.order is None or len(self.order) != self.left:
                self.order, self.place = rng.permutation(self.left), 0
        assert self.order is not None
        steps = self.place + np.arange(min(count, self.left))
        self.place, self.left = self.place + count, self.left - count
        rows = self.order[steps % len(self.order)]
        return self.around[rows[self.sound[rows]]]

    def move_to(self, genome: Genomes, loss: float, each: Floats) -> None:
        """Be another body."""
        self.genome, self.loss, self.each, self.around = genome, loss, each, None


@dataclass
class RivalSearch:
    """The default search; see the module.

    Attributes:
        climbers: that climb side by side, `children` changes each at a time.
        alike: bodies whose like parts hang alike, drawn from the prior.
        vain: climbs that ended since the best rival has its tree.
    """

    space: BodySpace
    evaluator: Evaluator
    twins: SymmetryGroup
    size: int = 16
    climbers: int = 4
    children: int = 16
    rivals: RivalSet = field(init=False)
    alike: Genomes = field(init=False)
    vain: int = 0

    def __post_init__(self) -> None:
        """Start with nobody."""
        self.rivals = RivalSet.empty(self.evaluator)
        self.alike = draw_alike_genomes(
            self.evaluator.anatomy, self.space, _ALIKE, np.random.default_rng(0)
        )

    def search(self, evidence: Evidence, limit: int, rng: Generator) -> None:
        """Search until the evaluator has spent its simulations, or no tree is better.

        It ends early where the best rival explains every reading and many climbs led
        to no better tree. The best rivals climb again before that.

        Args:
            limit: number of simulations since the start.
        """
        best = self._find_best_tree()
        queue = self._rescore_rivals(evidence)
        self._count_climb(best, 0)
        active: list[_Climber] = []
        while self.evaluator.spent < limit or not self._has_rivals(active):
            ended = self.vain >= _CLIMBS_IN_VAIN and self._explains(evidence)
            while len(active) < self.climbers and (queue or not ended):
                active.append(
                    queue.pop(0) if queue else self._start_climber(evidence, rng)
                )
            if not active:
                break
            self._step_climbers(active, evidence, rng)
            if self.evaluator.failed >= max(_MOST_DIVERGED, self.evaluator.spent):
                raise EngineError(f"all of {self.evaluator.spent} simulations diverged")
            stuck = [c for c in active if c.is_stuck and not self._switch_changes(c)]
            for climber in stuck:
                active.remove(climber)
                best = self._find_best_tree()
                again = self._add_peak(climber, evidence)
                self._count_climb(best, 1)
                if again:
                    active.append(again)
        for climber in active:
            if np.isfinite(climber.loss):
                self._add_peak(climber, evidence)

    def compute_prior(self, genomes: Genomes) -> Floats:
        """(N) what the prior adds to the losses of bodies."""
        return compute_prior_cost(self.evaluator.anatomy, self.space, genomes)

    def keep_best(self, size: int) -> None:
        """Keep the best rivals, `size` of them."""
        prior = self.compute_prior(self.rivals.genomes)
        self.rivals = self.rivals.keep_best(size, prior)

    def _find_best_tree(self) -> bytes:
        """A name of the best rival's tree."""
        return self.rivals.genomes.parent[:1].tobytes()

    def _count_climb(self, best: bytes, count: int) -> None:
        """Count climbs in vain, anew if the best tree is not what it was."""
        self.vain = self.vain + count if best == self._find_best_tree() else 0

    def _explains(self, evidence: Evidence) -> bool:
        """Whether the best rival has no reading that only another rest explains."""
        gap = np.abs(self.rivals.tables[0, list(evidence.tried)] - evidence.measured)
        return bool(np.all(np.nan_to_num(gap) < self.evaluator.loss.cap))

    def _has_rivals(self, active: list[_Climber]) -> bool:
        """Whether there is any body to go on with."""
        return len(self.rivals) > 0 or any(np.isfinite(c.loss) for c in active)

    def _switch_changes(self, climber: _Climber) -> bool:
        """Whether a stuck climber goes on, by fine changes or by coarse ones again."""
        best = self.rivals.losses[0] if len(self.rivals) else np.inf
        discrete = self.space.sides and not self.space.lengths
        if (
            discrete
            or climber.loss > _HOPELESS_RATIO * best
            or climber.loss == climber.peak
        ):
            return False
        if climber.fine:
            climber.peak = climber.loss
        climber.fine, climber.around = not climber.fine, None
        return True

    def _rescore_rivals(self, evidence: Evidence) -> list[_Climber]:
        """Score the rivals on the evidence, each as its best twin; all climb again."""
        old, self.rivals = self.rivals, RivalSet.empty(self.evaluator)
        for row in range(len(old)):
            self.rivals = self.rivals.add_rival(
                *self._find_best_twin(old.genomes[[row]], old.tables[row], evidence)
            )
        self.keep_best(self.size)
        finite = np.flatnonzero(np.isfinite(self.rivals.losses))
        return [
            _Climber(self.rivals.genomes[[k]], np.inf) for k in finite[:_CLIMB_AGAIN]
        ]

    def _find_best_twin(
        self, genome: Genomes, table: Floats, evidence: Evidence
    ) -> tuple[Genomes, Floats, float]:
        """The twin that explains the evidence best: genome, table, loss."""
        loss = self.evaluator.loss
        losses = self.twins.compute_losses(genome.parent[0], table, evidence, loss)
        turn, trade = np.unravel_index(int(np.argmin(losses)), losses.shape)
        if losses[turn, trade] > losses[0, 0] - 1e-6:
            return genome, table, float(losses[0, 0])
        which = np.array([turn]), np.array([trade])
        twin = self.twins.map_genomes(genome, *which)
        table = self.twins.map_tables(table[None], *which)[0]
        return twin, table, float(losses[turn, trade])

    def _start_climber(self, evidence: Evidence, rng: Generator) -> _Climber:
        """A new climber, of every other one the bodies are put down; see `Statics`."""
        climber = self._draw_start(evidence, rng)
        climber.other_rest = OTHER_REST if rng.random() < _PUT_DOWN else np.inf
        return climber

    def _draw_start(self, evidence: Evidence, rng: Generator) -> _Climber:
        """The best of some random bodies, a kicked rival, or a child of two rivals."""
        dice = rng.random()
        if np.isfinite(self.rivals.losses).sum() < 4 or dice < 0.3:
            return self._start_from_random(evidence, rng)
        gap = self.rivals.losses + self.compute_prior(self.rivals.genomes)
        gap -= gap.min()
        weight = np.exp(-gap / (_FAVOR_SCALE * len(evidence)))
        pick = rng.choice(len(weight), 2, replace=False, p=weight / weight.sum())
        first, second = self.rivals.genomes[pick[:1]], self.rivals.genomes[pick[1:]]
        if dice < 0.65:
            return _Climber(perturb_genome(self.space, first, rng), np.inf)
        child = cross_genomes(first, second, rng)
        if not is_valid(self.space, child)[0]:
            child = perturb_genome(self.space, first, rng)
        return _Climber(child, np.inf)

    def _start_from_random(self, evidence: Evidence, rng: Generator) -> _Climber:
        """The best of some random bodies; half of them have like parts alike."""
        anatomy, half = self.evaluator.anatomy, _RANDOM_STARTS // 2
        alike = self.alike[rng.integers(len(self.alike), size=half)]
        genomes = concatenate_genomes(
            alike, center_on_sides(draw_space_genomes(anatomy, self.space, half, rng))
        )[rng.permutation(2 * half)]
        bodies, best, loss, parts = build_bodies(anatomy, genomes), 0, np.inf, None
        for rows in np.split(np.arange(len(genomes)), [_RANDOM_STARTS // 8]):
            order = self.evaluator.order_by_hardness(evidence)
            race = plan_race(len(rows), order, loss)
            total, each = self.evaluator.compute_losses(bodies[rows], evidence, race)
            if total.min() < loss:
                row = int(np.argmin(total))
                best, loss, parts = int(rows[row]), float(total[row]), each[row]
        return _Climber(genomes[[best]], loss, parts)

    def _step_climbers(
        self, active: list[_Climber], evidence: Evidence, rng: Generator
    ) -> None:
        """Each climber tries a few changes and takes the best that gains enough."""
        batches = [c.propose_changes(self.space, self.children, rng) for c in active]
        sizes = [len(b) for b in batches]
        plans = [(*c.plan_race(len(evidence)), c.other_rest) for c in active]
        columns = zip(*plans, strict=True)
        race = Race(*(np.repeat(rows, sizes, axis=0) for rows in columns))
        genomes = concatenate_genomes(*batches)
        bodies = build_bodies(self.evaluator.anatomy, genomes)
        total, each = self.evaluator.compute_losses(bodies, evidence, race)
        edges = np.cumsum([0, *sizes])
        for climber, low, high in zip(active, edges[:-1], edges[1:], strict=True):
            best = low + int(np.argmin(total[low:high])) if high > low else low
            if high > low and total[best] < climber.loss:
                climber.move_to(genomes[[best]], float(total[best]), each[best])
            elif climber.each is None:
                climber.around = climber.genome[:0]  # an impossible start: give up

    def _add_peak(self, climber: _Climber, evidence: Evidence) -> _Climber | None:
        """Take a climber's peak into the crowd; a climber to go on with, if any."""
        if not np.isfinite(climber.loss):
            return None
        if is_same(self.rivals.genomes, climber.genome).any():
            return None
        table = self.evaluator.compute_table(climber.genome)[0]
        genome, table, loss = self._find_best_twin(climber.genome, table, evidence)
        self.rivals = self.rivals.add_rival(genome, table, loss)
        self.keep_best(self.size)
        if genome is climber.genome:
            return None
        return _Climber(genome, np.inf, other_rest=climber.other_rest)
