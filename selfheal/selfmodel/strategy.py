"""Methods: a way to search and a way to choose, behind one signature for the loop."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from ..body.body import Floats, Ints
from ..body.genome import Genomes
from ..engine.channels import list_channels
from .evaluate import PAPER_LOSS, Evaluator, Evidence, Loss, make_capped_loss
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
from .space import find_space
from .symmetry import SymmetryGroup

METHODS = {
    "default": "rivals climbed from many starts; actions that tell their trees apart",
    "paper": "the 2006 rule: fifteen climbers, actions by its released score",
    "disagreement": "the 2006 search, actions by plain disagreement",
    "random-batch": "baseline 1 of 2006: all actions random, then the 2006 search",
    "random-alternate": "baseline 2 of 2006: a random action, the 2006 search, in turn",
}
BUDGETS = {name: CEILING for name in METHODS} | {"default": 262_000}

# Chosen: of the vote, for bodies that are not known; bodies the search is told of.
_UNKNOWN_SHARE, _SEEDED = 0.05, 8


class Strategy(Protocol):
    """What the loop asks of a method."""

    loss: Loss

    def choose_action(
        self, evidence: Evidence, rng: np.random.Generator
    ) -> tuple[int, str]:
        """The next action, and one sentence on why."""
        ...

    def search_bodies(
        self, evidence: Evidence, limit: int, rng: np.random.Generator
    ) -> None:
        """Look for bodies that explain the evidence.

        Args:
            limit: about the number of simulations to have spent since the start.
        """
        ...

    def list_rivals(self) -> tuple[Genomes, Floats, Floats]:
        """Genomes (K), tables (K, A, C) and losses (K), best first."""
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

    def capture_state(self) -> dict[str, Any]:
        """Arrays from which `restore_state` goes on."""
        ...

    def restore_state(self, state: Mapping[str, Any], evidence: Evidence) -> None:
        """Go on from a state, and what was felt until then."""
        ...


class RivalStrategy:
    """Our method; see `search` and `explore`."""

    def __init__(self, evaluator: Evaluator, *, space: str, known_lengths: bool,
                 random_actions: bool) -> None:  # fmt: skip
        """`random_actions` leaves the choice to chance, for comparison."""
        self.loss, self.evaluator = make_capped_loss(evaluator.anatomy), evaluator
        anatomy = evaluator.anatomy
        where = find_space(space, known_lengths=known_lengths, ordered=anatomy.ordered)
        twins = SymmetryGroup.from_actions(
            anatomy, evaluator.actions, hinges_known=not where.hinges
        )
        self.finder = RivalSearch(where, evaluator, twins)
        self.neighborhood = Neighborhood(self.finder)
        self.found: Hypotheses | None = None  # on the evidence so far
        self.random_actions = random_actions

    def choose_action(
        self, evidence: Evidence, rng: np.random.Generator
    ) -> tuple[int, str]:
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
        weight = self.loss.weight
        tree, body = predict_belief(some.tables, some.genomes.parent, belief, weight)
        action = choose_action(score_actions(tree, body, belief), evidence.tried)
        return action, (
            f"of {len(self.found):,} bodies that might be it, leaves "
            f"{100 * tree[action] @ belief:.0f} % belief in the right tree"
        )

    def search_bodies(
        self, evidence: Evidence, limit: int, rng: np.random.Generator
    ) -> None:
        """Climb (see `RivalSearch.search`), and look at what is near the peaks.

        Args:
            limit: number of simulations of the climbers since the start.
        """
        self.finder.search(evidence, limit, rng)
        self.neighborhood.update(self.finder.rivals, evidence)
        self.found = self.neighborhood.list_hypotheses(evidence)
        self._seed_search()

    def _seed_search(self) -> None:
        """Let the search go on from the best hypotheses too."""
        assert self.found is not None
        best = self.found[np.arange(min(_SEEDED, len(self.found)))]
        genomes, tables, crowd = best.genomes, best.tables, self.finder.rivals
        for k, loss in enumerate(best.losses):
            crowd.add_rival(genomes[[k]], tables[k], float(loss))
        self.finder.keep_best(self.finder.size + _SEEDED)

    def list_rivals(self) -> tuple[Genomes, Floats, Floats]:
        """The rivals by loss and prior: genomes, tables (K, A, C) and losses (K)."""
        crowd = self.finder.rivals
        order = np.argsort(
            crowd.losses + self.compute_prior(crowd.genomes), kind="stable"
        )
        return crowd.genomes[order], crowd.tables[order], crowd.losses[order]

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
        return find_indistinguishable(self.found, table, self.loss.weight).genomes

    def compute_prior(self, genomes: Genomes) -> Floats:
        """Cost (N) of each body by its code length: few rules are likelier."""
        return self.finder.compute_prior(genomes)

    def capture_state(self) -> dict[str, Any]:
        """The arrays of the crowd and of its kin, and the climbs in vain."""
        return (
            {"vain": self.finder.vain}
            | _to_arrays(self.finder.rivals)
            | {
                f"kin_{name}": value
                for name, value in _to_arrays(self.neighborhood.bodies).items()
            }
        )

    def restore_state(self, state: Mapping[str, Any], evidence: Evidence) -> None:
        """Go on from a state."""
        self.finder.rivals = _from_arrays(state, "")
        self.finder.vain = int(state["vain"])
        kin = _from_arrays(state, "kin_")
        self.neighborhood.add_bodies(kin.genomes, kin.tables)
        self.found = self.neighborhood.list_hypotheses(evidence)


def _to_arrays(crowd: RivalSet) -> dict[str, Floats | Ints]:
    """The arrays of a crowd by name."""
    genes = {f.name: getattr(crowd.genomes, f.name) for f in fields(Genomes)}
    return genes | {name: getattr(crowd, name) for name in ("tables", "losses")}


def _from_arrays(state: Mapping[str, Any], prefix: str) -> RivalSet:
    """The crowd whose arrays stand under a prefix."""
    genomes = Genomes(*(state[prefix + f.name] for f in fields(Genomes)))
    return RivalSet(genomes, state[prefix + "tables"], state[prefix + "losses"])


@dataclass
class ReleasedRule:
    """When climbers climb, and which action is next, in 2006.

    Attributes:
        finder: the climbers.
        method: any of `METHODS` but "default".
        cycles: actions in all.
        weight: of the score at the next choice but one; see `Climbers.score`.
    """

    finder: Climbers
    method: str
    cycles: int
    weight: float = 0.5

    def choose_action(
        self, evidence: Evidence, rng: np.random.Generator
    ) -> tuple[int, str]:
        """By the released score, by disagreement, or at random in the baselines."""
        if self.method.startswith("random") or not len(evidence):
            count = len(self.finder.evaluator.actions)
            return choose_random_action(count, evidence.tried, rng), "random"
        if self.method == "disagreement":
            score, _ = self.finder.score_actions(0.0, rng)
            action = choose_action(score, evidence.tried)
            return (
                action,
                f"disagreement of the {VOTING_CLIMBERS} best: {score[action]:.1f}",
            )
        self.weight /= 1.5
        score, _ = self.finder.score_actions(self.weight, rng)
        action = choose_action(score, evidence.tried)
        return action, (
            f"disagreement of the {VOTING_CLIMBERS} best less its unreliability: "
            f"{score[action]:.1f} degrees"
        )

    def search_bodies(self, evidence: Evidence, rng: np.random.Generator) -> None:
        """200 generations; in the batch, all of them after the last action."""
        if self.method != "random-batch":
            self.finder.climb(evidence, GENERATIONS, rng)
        elif len(evidence) == self.cycles:
            # as many simulations as 200 generations after each action, at most
            self.finder.climb(evidence, GENERATIONS * (self.cycles + 1) // 2, rng)
        else:
            self.finder.climb(evidence, 0, rng)


class ReleasedStrategy:
    """The 2006 rule, with plain disagreement, and its two random baselines."""

    def __init__(self, finder: PaperSearch, *, method: str, cycles: int) -> None:
        """`method` is any of `METHODS` but "default"."""
        self.loss, self.finder = PAPER_LOSS, finder
        self.rule = ReleasedRule(finder, method, cycles)

    def choose_action(
        self, evidence: Evidence, rng: np.random.Generator
    ) -> tuple[int, str]:
        """By the rule."""
        return self.rule.choose_action(evidence, rng)

    def search_bodies(
        self, evidence: Evidence, limit: int, rng: np.random.Generator
    ) -> None:
        """Search by the rule of 2006, whatever the limit.

        Args:
            limit: not heeded.
        """
        self.rule.search_bodies(evidence, rng)

    def list_rivals(self) -> tuple[Genomes, Floats, Floats]:
        """The climbers: genomes, tables (K, A, C) and losses (K).

        The rule keeps no tables, so these are NaN.
        """
        genomes = self.finder.genomes
        evaluator = self.finder.evaluator
        channels = len(list_channels(evaluator.anatomy))
        shape = (len(genomes), len(evaluator.actions), channels)
        return genomes, np.full(shape, np.nan), self.finder.losses

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

    def capture_state(self) -> dict[str, Any]:
        """The climbers."""
        return {"genes": self.finder.genes, "losses": self.finder.losses,
                "weight": self.rule.weight}  # fmt: skip

    def restore_state(self, state: Mapping[str, Any], evidence: Evidence) -> None:
        """Go on from a state."""
        self.finder.genes, self.finder.losses = state["genes"], state["losses"]
        self.rule.weight = float(state["weight"])
