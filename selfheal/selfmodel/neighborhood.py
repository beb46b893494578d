"""Neighborhood: bodies near the best rivals, and all their twins, that might be right.

The search keeps the few peaks that it climbs. Whether an action settles the tree
depends on everything else that explains the readings: the changes around the peaks
that lose next to nothing. So does how sure one may be of the tree. Their tables are
simulated once, beside the search, and serve for every later reading.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ..body.body import Floats, Ints, RowBatch
from ..body.genome import Genomes, build_bodies, concatenate_genomes
from ..engine.arrays import plan_race
from .evaluate import Evidence
from .rivals import RivalSet
from .search import RivalSearch
from .space import list_neighbors
from .symmetry import SymmetryGroup

_CENTERS = 4  # best bodies whose changes are looked at after each reading; chosen
_LOSS_MARGIN = 3.0  # loss by which such a change may be behind the best; chosen
_MOST_NEW = 96  # of them are simulated under every action, each time; chosen
_MOST_KEPT = 192  # bodies, besides their twins; chosen
_WINDOW = 8.0  # loss behind the best at which belief, exp(-8), is nothing; chosen


@dataclass(frozen=True)
class Hypotheses(RowBatch):
    """Distinct bodies (N), by the body that was simulated and which twin of it.

    Attributes:
        row: (N) of the kin.
        turn: (N), and
        trade: (N) that make the twin.
        losses: (N) over the evidence.
        costs: (N) losses and prior.
    """

    simulated: RivalSet
    twins: SymmetryGroup
    row: Ints
    turn: Ints
    trade: Ints
    losses: Floats
    costs: Floats

    @property
    def genomes(self) -> Genomes:
        """(N) their genomes."""
        return self.twins.map_genomes(
            self.simulated.genomes[self.row], self.turn, self.trade
        )

    @property
    def tables(self) -> Floats:
        """(N, A, C) their channels under every action."""
        return self.twins.map_tables(
            self.simulated.tables[self.row], self.turn, self.trade
        )


class Neighborhood:
    """The bodies simulated; see the module."""

    def __init__(self, finder: RivalSearch) -> None:
        """Nobody yet; the search knows the space, the twins and the prior."""
        self.finder = finder
        self.evaluator, self.twins = finder.evaluator, finder.twins
        self.bodies = RivalSet.empty(finder.evaluator)
        self._family: list[int] = []  # a name that all twins of a body share
        self._distinct: list[Ints] = []  # twins (flat) that differ from one another
        self._scored: Evidence | None = None  # on which the losses below are
        self._losses: dict[int, Floats] = {}  # of the distinct twins of each family

    def update(self, rivals: RivalSet, evidence: Evidence) -> None:
        """Take in the rivals, and what is around the best, given new evidence."""
        with self.evaluator.count_as_choice():
            if not len(self.bodies):
                likely = self.finder.alike[:_MOST_KEPT]
                self.add_bodies(likely, self.evaluator.compute_table(likely))
            self.add_bodies(rivals.genomes, rivals.tables)
            losses = self._prune_bodies(self._compute_losses(evidence))
            near = self._find_neighbors(losses, evidence)
            new = self._find_unknown_rows(near)[:_MOST_NEW]
            if len(new):
                self.add_bodies(near[new], self.evaluator.compute_table(near[new]))

    def list_hypotheses(self, evidence: Evidence) -> Hypotheses:
        """Every distinct twin that is not far behind the best one, best first.

        None if every body diverged under some action tried.
        """
        losses, extra = self._compute_losses(evidence), self._compute_prior_costs()
        best = min(x.min() + e for x, e in zip(losses, extra, strict=True))
        found = []
        for row, (loss, e) in enumerate(zip(losses, extra, strict=True)):
            close = np.flatnonzero((loss + e <= best + _WINDOW) & np.isfinite(loss))
            flat = self._distinct[row][close]
            turn, trade = np.divmod(flat, len(self.twins.trade))
            costs = loss[close], loss[close] + e
            found.append((np.full_like(flat, row), turn, trade, *costs))
        columns = [np.concatenate(x) for x in zip(*found, strict=True)]
        order = np.argsort(np.round(columns[-1], 6), kind="stable")
        return Hypotheses(self.bodies, self.twins, *(x[order] for x in columns))

    def add_bodies(self, genomes: Genomes, tables: Floats) -> None:
        """Take in bodies (N) with tables (N, A, C), if no twin of theirs is known."""
        for row in range(len(genomes)):
            family, distinct = self._identify_family(genomes[[row]])
            if family not in self._family:
                self._family.append(family)
                self._distinct.append(distinct)
                body = genomes[[row]], tables[row]
                self.bodies = self.bodies.append(*body, np.inf)

    def _identify_family(self, genome: Genomes) -> tuple[int, Ints]:
        """The name of a body's family, and its twins that differ from one another."""
        trades = np.flatnonzero(self.twins.find_valid_trades(genome.parent[0]))
        names = self._hash_twins(genome, trades).ravel()
        names, first = np.unique(names, return_index=True)
        turn, trade = np.divmod(np.sort(first), len(trades))
        return int(names[0]), turn * len(self.twins.trade) + trades[trade]

    def _name_family(self, genome: Genomes) -> int:
        """The name of a body's family."""
        trades = np.flatnonzero(self.twins.find_valid_trades(genome.parent[0]))
        return int(self._hash_twins(genome, trades).min())

    def _hash_twins(self, genome: Genomes, trades: Ints) -> Ints:
        """(G, T) a number for each twin of a body (1), the same for equal bodies.

        Equal to a thousandth of a turn and a tenth of a millimeter. It sums salted
        genes. A trade only moves them from part to part, so salts are moved instead.
        """
        twins = self.twins
        every = np.arange(len(twins.turns))
        turned = twins.turn_genomes(genome[np.zeros_like(every)], every)
        to = twins.trade[trades]
        parent, placement, hinge, length = np.split(_draw_salts(to.shape[1]), 4)
        label = np.hstack([np.zeros((len(to), 1), np.int64), to + 1])
        with np.errstate(over="ignore"):
            turn = np.round(turned.placement * 1000).astype(np.int64) % 1000
            names = turn @ placement[to].T
            names += turned.hinge @ hinge[to].T
            names += (label[:, genome.parent[0]] * parent[to]).sum(axis=1)
            names += np.round(genome.length * 1e4).astype(np.int64) @ length[to].T
        return names

    def _compute_losses(self, evidence: Evidence) -> list[Floats]:
        """Losses of the distinct twins of every body; infinite where not known."""
        if evidence is not self._scored:
            self._scored, self._losses = evidence, {}
        for row, (family, distinct) in enumerate(
            zip(self._family, self._distinct, strict=True)
        ):
            if family not in self._losses:
                parent, table = self.bodies.genomes.parent[row], self.bodies.tables[row]
                loss = self.evaluator.loss
                each = self.twins.compute_losses(parent, table, evidence, loss)
                self._losses[family] = each.ravel()[distinct]
        return [self._losses[family] for family in self._family]

    def _compute_prior_costs(self) -> Floats:
        """(K) what the prior adds to the loss of every body and of its twins."""
        return self.finder.compute_prior(self.bodies.genomes)

    def _prune_bodies(self, losses: list[Floats]) -> list[Floats]:
        """Keep the best, and none that is hopelessly behind; the losses of those."""
        best = np.array([x.min() for x in losses])
        costs = best + self._compute_prior_costs()
        order = np.argsort(costs, kind="stable")[:_MOST_KEPT]
        order = order[costs[order] <= costs.min() + 1.5 * _WINDOW]
        self.bodies = replace(self.bodies, losses=best)[order]
        self._family = [self._family[k] for k in order]
        self._distinct = [self._distinct[k] for k in order]
        return [losses[k] for k in order]

    def _find_neighbors(self, losses: list[Floats], evidence: Evidence) -> Genomes:
        """Changes of the best bodies that lose next to nothing, best first."""
        best = (self.bodies.losses + self._compute_prior_costs()).min()
        around = []
        for row in range(min(_CENTERS, len(losses))):
            flat = self._distinct[row][[np.argmin(losses[row])]]
            which = np.divmod(flat, len(self.twins.trade))
            twin = self.twins.map_genomes(self.bodies.genomes[[row]], *which)
            around.append(list_neighbors(self.finder.space, twin))
        genomes = concatenate_genomes(*around)
        prior = self.finder.compute_prior(genomes)
        bodies = build_bodies(self.evaluator.anatomy, genomes)
        bound = (best + _LOSS_MARGIN - prior)[:, None]
        race = plan_race(len(bodies), self.evaluator.order_by_hardness(evidence), bound)
        total, _ = self.evaluator.compute_losses(bodies, evidence, race)
        order = np.argsort(np.round(total + prior), kind="stable")
        return genomes[order[np.isfinite(total[order])]]

    def _find_unknown_rows(self, genomes: Genomes) -> Ints:
        """Rows of which none is a twin of another or of a body that is known."""
        seen, rows = set(self._family), []
        for row in range(len(genomes)):
            family = self._name_family(genomes[[row]])
            if family not in seen:
                seen.add(family)
                rows.append(row)
            if len(rows) == _MOST_NEW:
                break
        return np.array(rows, np.int64)


@cache
def _draw_salts(parts: int) -> Ints:
    """(4 P) an odd number for each gene of a body."""
    return np.random.default_rng(0).integers(1, 2**62, 4 * parts) | 1
