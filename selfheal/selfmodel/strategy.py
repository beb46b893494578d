"""Methods: a way to search and a way to choose, behind one signature for the loop."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.random import Generator

from ..body.body import Floats, Ints
from ..body.genome import Genomes
from .evaluate import Evaluator, Evidence
from .explore import (
    DISAGREEMENT_TEMPERATURE,
    choose_action,
    choose_first_action,
    choose_random_action,
    compute_plausibility,
    draw_voters,
    find_indistinguishable,
    predict_belief,
    score_actions,
)
from .neighborhood import Hypotheses, Neighborhood
from .paper import CEILING, GENERATIONS, VOTING_CLIMBERS, Climbers, PaperSearch
from .rivals import RivalSet
from .search import RivalSearch
from .space import BodySpace
from .symmetry import SymmetryGroup

METHODS = {
    "default": "rivals climbed from many starts; actions that tell their trees apart",
    "paper": "the 2006 rule: fifteen climbers, actions by its released score",
    "disagreement": "the 2006 search, actions by plain disagreement",
    "random-batch": "baseline 1 of 2006: all actions random, then the 2006 search",
    "random-alternate": "baseline 2 of 2006: a random action, the 2006 search, in turn",
}
BUDGETS = {name: CEILING for name in METHODS} | {"default": 262_000}

# Chosen: of the vote, for bodies that are not known; bodies that climbs start from.
_UNKNOWN_SHARE, _SEEDED = 0.05, 8


Arrays = Mapping[str, np.ndarray]


class Strategy(Protocol):
    """What the loop asks of a method."""

    def choose_action(self, evidence: Evidence, rng: Generator) -> tuple[int, str]:
        """The next action, and one sentence on why."""
        ...

    def search_bodies(self, evidence: Evidence, limit: int, rng: Generator) -> None:
        """Look for bodies that explain the evidence.

        Args:
            limit: about the number of simulations to have spent since the start.
        """
        ...

    def list_rivals(self) -> RivalSet:
        """Rivals, best first; tables are NaN where the method keeps none."""
        ...

    def list_candidates(self) -> tuple[Ints, Floats]:
        """Trees (M, P) of the bodies that might be the right one, and belief (M)."""
        ...

    def predict_tables(self) -> tuple[Floats, Floats]:
        """Tables (M, A, C) of bodies that might be right, and weights (M) of them."""
        ...

    def list_indistinguishable(self, table: Floats) -> Genomes:
        """Bodies that may be right and that no action tells from a table's (A, C)."""
        ...

    def compute_prior(self, genomes: Genomes) -> Floats:
        """(N) what a prior adds to the losses of bodies; rivals are ranked by both."""
        ...

    def capture_state(self) -> Arrays:
        """Arrays from which `restore_state` goes on."""
        ...

    def restore_state(self, state: Arrays, evidence: Evidence) -> None:
        """Go on from a state, and what was measured until then."""
        ...


class RivalStrategy:
    """Our method; see `search` and `explore`."""

    def __init__(
        self, evaluator: Evaluator, space: BodySpace, *, random_actions: bool
    ) -> None:
        """`random_actions` leaves the choice to chance, for comparison."""
        twins = SymmetryGroup.from_actions(
            evaluator.anatomy, evaluator.actions, hinges_known=not space.hinges
        )
        self.evaluator, self.random_actions = evaluator, random_actions
        self.finder = RivalSearch(space, evaluator, twins)
        self.neighborhood = Neighborhood(self.finder)
        self.found: Hypotheses | None = None  # on the evidence so far

    def choose_action(self, evidence: Evidence, rng: Generator) -> tuple[int, str]:
        """The action that best tells the hypotheses apart, their trees first."""
        actions = self.evaluator.actions
        if self.random_actions:
            action = choose_random_action(len(actions), evidence.tried, rng)
            return action, "random: asked to be random"
        if not self.found:
            action = choose_first_action(self.finder.twins, actions, rng)
            return action, "random, of those that move like parts differently"
        some, belief = draw_voters(self.found, rng)
        # a part of the vote is the same for all: those known are not all there are
        belief = (1 - _UNKNOWN_SHARE) * belief + _UNKNOWN_SHARE / len(belief)
        weight = self.evaluator.loss.weight
        tree, body = predict_belief(some.tables, some.genomes.parent, belief, weight)
        action = choose_action(score_actions(tree, body, belief), evidence.tried)
        return action, (
            f"of {len(self.found):,} bodies that might be it, leaves "
            f"{100 * tree[action] @ belief:.0f} % belief in the right tree"
        )

    def search_bodies(self, evidence: Evidence, limit: int, rng: Generator) -> None:
        """Climb (see `RivalSearch.search`), and look at what is near the peaks."""
        self.finder.search(evidence, limit, rng)
        self.neighborhood.update(self.finder.rivals, evidence)
        self.found = self.neighborhood.list_hypotheses(evidence)
        # the search goes on from the best hypotheses too
        best = self.found[np.arange(min(_SEEDED, len(self.found)))]
        genomes, tables, crowd = best.genomes, best.tables, self.finder.rivals
        for k, loss in enumerate(best.losses):
            crowd = crowd.add_rival(genomes[[k]], tables[k], float(loss))
        self.finder.rivals = crowd
        self.finder.keep_best(self.finder.size + _SEEDED)

    def list_rivals(self) -> RivalSet:
        """The rivals by loss and prior."""
        crowd = self.finder.rivals
        costs = crowd.losses + self.compute_prior(crowd.genomes)
        return crowd[np.argsort(costs, kind="stable")]

    def list_candidates(self) -> tuple[Ints, Floats]:
        """Parents (N, P) and belief (N) of rivals, their neighbors and all twins."""
        if not self.found:
            crowd = self.finder.rivals
            return crowd.genomes.parent, np.full(len(crowd), 1 / len(crowd))
        return self.found.genomes.parent, compute_plausibility(self.found.costs)

    def predict_tables(self) -> tuple[Floats, Floats]:
        """Tables (N, A, C) and belief (N) of some candidates, equal whenever asked."""
        if not self.found:
            return self.finder.rivals.tables, np.ones(len(self.finder.rivals))
        some, belief = draw_voters(
            self.found, np.random.default_rng(0), DISAGREEMENT_TEMPERATURE
        )
        return some.tables, belief

    def list_indistinguishable(self, table: Floats) -> Genomes:
        """Hypotheses that no action tells from the body of a table (A, C)."""
        assert self.found is not None
        weight = self.evaluator.loss.weight
        return find_indistinguishable(self.found, table, weight).genomes

    def compute_prior(self, genomes: Genomes) -> Floats:
        """Cost (N) of each body by its code length: few rules are likelier."""
        return self.finder.compute_prior(genomes)

    def capture_state(self) -> Arrays:
        """The arrays of the crowd and of its kin, and the climbs in vain."""
        kin = _to_arrays(self.neighborhood.bodies)
        return {
            "vain": np.array(self.finder.vain),
            **_to_arrays(self.finder.rivals),
            **{f"kin_{name}": value for name, value in kin.items()},
        }

    def restore_state(self, state: Arrays, evidence: Evidence) -> None:
        """Go on from a state."""
        self.finder.rivals = _from_arrays(state, "")
        self.finder.vain = int(state["vain"])
        kin = _from_arrays(state, "kin_")
        self.neighborhood.add_bodies(kin.genomes, kin.tables)
        self.found = self.neighborhood.list_hypotheses(evidence)


_GENES = [f.name for f in fields(Genomes)]


def _to_arrays(crowd: RivalSet) -> Arrays:
    """The arrays of a crowd by name."""
    genes = {name: getattr(crowd.genomes, name) for name in _GENES}
    return genes | {"tables": crowd.tables, "losses": crowd.losses}


def _from_arrays(state: Arrays, prefix: str) -> RivalSet:
    """The crowd whose arrays stand under a prefix."""
    genomes = Genomes(*(state[prefix + name] for name in _GENES))
    return RivalSet(genomes, state[prefix + "tables"], state[prefix + "losses"])


@dataclass
class ReleasedRule:
    """When climbers climb, and which action is next, in 2006.

    Attributes:
        method: any of `METHODS` but "default".
        cycles: actions in all.
        weight: of the score at the next choice but one; see `Climbers.score_actions`.
    """

    finder: Climbers
    method: str
    cycles: int
    weight: float = 0.5

    def choose_action(self, evidence: Evidence, rng: Generator) -> tuple[int, str]:
        """By the released score, by disagreement, or at random in the baselines."""
        if self.method.startswith("random") or not len(evidence):
            count = len(self.finder.evaluator.actions)
            return choose_random_action(count, evidence.tried, rng), "random"
        why, weight = f"disagreement of the {VOTING_CLIMBERS} best", 0.0
        if self.method != "disagreement":
            self.weight /= 1.5
            why, weight = f"{why} less its unreliability", self.weight
        score, _ = self.finder.score_actions(weight, rng)
        action = choose_action(score, evidence.tried)
        return action, f"{why}: {score[action]:.1f} degrees"

    def search_bodies(self, evidence: Evidence, limit: int, rng: Generator) -> None:
        """200 generations, whatever the limit; in the batch after the last action."""
        generations = GENERATIONS
        if self.method == "random-batch":
            # as many simulations as 200 generations after each action, at most
            last = len(evidence) == self.cycles
            generations = GENERATIONS * (self.cycles + 1) // 2 if last else 0
        self.finder.climb(evidence, generations, rng)


class ReleasedStrategy(ReleasedRule):
    """The 2006 rule, with plain disagreement, and its two random baselines."""

    finder: PaperSearch

    def list_rivals(self) -> RivalSet:
        """The climbers, whose tables are NaN: the rule keeps none."""
        genomes, evaluator = self.finder.genomes, self.finder.evaluator
        nothing = RivalSet.empty(evaluator).tables
        tables = np.full((len(genomes), *nothing.shape[1:]), np.nan)
        return RivalSet(genomes, tables, self.finder.losses)

    def list_candidates(self) -> tuple[Ints, Floats]:
        """Parents (K, P) and belief (K) of the climbers."""
        return self.finder.genomes.parent, compute_plausibility(self.finder.losses)

    def predict_tables(self) -> tuple[Floats, Floats]:
        """Tables (K, A, C) and belief (K) of the climbers."""
        evaluator = self.finder.evaluator
        with evaluator.count_as_choice():
            tables = evaluator.compute_table(self.finder.genomes)
        return tables, compute_plausibility(
            self.finder.losses, DISAGREEMENT_TEMPERATURE
        )

    def list_indistinguishable(self, table: Floats) -> Genomes:
        """None, whatever the table (A, C): the climbers' tables are not simulated."""
        return self.finder.genomes[:0]

    def compute_prior(self, genomes: Genomes) -> Floats:
        """Cost (N) of zero for each body: the rule of 2006 has no prior."""
        return np.zeros(len(genomes))

    def capture_state(self) -> Arrays:
        """The climbers."""
        finder, weight = self.finder, np.array(self.weight)
        return {"genes": finder.genes, "losses": finder.losses, "weight": weight}

    def restore_state(self, state: Arrays, evidence: Evidence) -> None:
        """Go on from a state."""
        self.finder.genes, self.finder.losses = state["genes"], state["losses"]
        self.weight = float(state["weight"])
