"""Methods: a way to search and a way to choose, behind one signature for the loop."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Protocol

import numpy as np

from ..body.body import Floats
from ..body.genome import Genomes
from .evaluate import CAPPED_LOSS, PAPER_LOSS, Evaluator, Evidence, Loss
from .explore import (
    choose,
    hypotheses,
    new_contrasts,
    plausibility,
    random_action,
    telling_apart,
)
from .paper import CEILING, GENERATIONS, JUDGES, PaperSearch, Slips
from .search import Crowd, RivalSearch
from .space import space_of
from .symmetry import Twins

METHODS = {
    "default": "rivals climbed from many starts; actions that tell them apart",
    "paper": "the 2006 rule: fifteen climbers, actions by its released score",
    "random-batch": "baseline 1 of 2006: all actions random, then the 2006 search",
    "random-alternate": "baseline 2 of 2006: a random action, the 2006 search, in turn",
}
BUDGETS = {name: CEILING for name in METHODS} | {"default": 262_000}

# Chosen on simulated robots: a first contrast between all like parts is worth half of
# telling two bodies apart for certain.
_CONTRAST = 0.5


class Strategy(Protocol):
    """What the loop asks of a method."""

    loss: Loss

    def choose(self, evidence: Evidence, rng: np.random.Generator) -> tuple[int, str]:
        """The next action, and one sentence on why."""
        ...

    def search(self, evidence: Evidence, limit: int, rng: np.random.Generator) -> None:
        """Look for bodies until about `limit` simulations were spent in all."""
        ...

    def rivals(self) -> tuple[Genomes, Floats, Floats]:
        """Genomes (K), tables (K, A, 3) and losses (K), best first."""
        ...

    def candidates(self, evidence: Evidence) -> tuple[Genomes, Floats]:
        """Genomes (M) and losses (M) of every body that might be the right one."""
        ...

    def state(self) -> dict[str, Any]:
        """Arrays from which `restore` goes on."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        ...


class Rivals:
    """Our method; see `search` and `explore`."""

    def __init__(self, evaluator: Evaluator, *, space: str, known_lengths: bool,
                 random_actions: bool) -> None:  # fmt: skip
        """`random_actions` leaves the choice to chance, for comparison."""
        self.loss, self.evaluator = CAPPED_LOSS, evaluator
        twins = Twins.of(evaluator.anatomy, evaluator.actions)
        self.finder = RivalSearch(
            space_of(space, known_lengths=known_lengths), evaluator, twins
        )
        self.random_actions = random_actions

    def choose(self, evidence: Evidence, rng: np.random.Generator) -> tuple[int, str]:
        """The action that best tells the rivals and their twins apart."""
        count = len(self.evaluator.actions)
        if not len(evidence) or self.random_actions:
            why = "nothing is known yet" if not len(evidence) else "asked to be random"
            return random_action(count, evidence.tried, rng), f"random: {why}"
        genomes, tables, losses = hypotheses(
            self.finder.crowd, self.finder.twins, evidence, self.evaluator
        )
        belief = plausibility(losses)
        # a tenth of the vote is the same for all: those known are not all there are
        belief = 0.9 * belief + 0.1 / len(belief)
        apart = telling_apart(tables, belief)
        contrast = new_contrasts(
            self.finder.twins, self.evaluator.actions, evidence.tried
        )
        action = choose(apart + _CONTRAST * contrast, evidence.tried)
        return action, (
            f"tells two of {len(genomes)} candidate bodies apart with probability "
            f"{apart[action]:.2f}, {100 * contrast[action]:.0f} % of like parts for "
            "the first time"
        )

    def search(self, evidence: Evidence, limit: int, rng: np.random.Generator) -> None:
        """Climb; see `RivalSearch.run`."""
        self.finder.run(evidence, limit, rng)

    def rivals(self) -> tuple[Genomes, Floats, Floats]:
        """The crowd."""
        crowd = self.finder.crowd
        return crowd.genomes, crowd.tables, crowd.losses

    def candidates(self, evidence: Evidence) -> tuple[Genomes, Floats]:
        """The rivals and their twins."""
        genomes, _, losses = hypotheses(
            self.finder.crowd, self.finder.twins, evidence, self.evaluator
        )
        return genomes, losses

    def state(self) -> dict[str, Any]:
        """The crowd's arrays."""
        crowd = self.finder.crowd
        genes = {f.name: getattr(crowd.genomes, f.name) for f in fields(Genomes)}
        names = ("tables", "losses")
        return genes | {name: getattr(crowd, name) for name in names}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        genomes = Genomes(*(state[f.name] for f in fields(Genomes)))
        self.finder.crowd = Crowd(genomes, state["tables"], state["losses"])


class Released:
    """The 2006 rule and its two random baselines; see `paper`."""

    def __init__(self, evaluator: Evaluator, *, method: str, cycles: int,
                 slips: Slips | None = None) -> None:  # fmt: skip
        """`method` is "paper", "random-batch" or "random-alternate"."""
        self.loss, self.evaluator = PAPER_LOSS, evaluator
        self.finder = PaperSearch(evaluator, slips or Slips())
        self.method, self.cycles, self.weight = method, cycles, 0.5

    def choose(self, evidence: Evidence, rng: np.random.Generator) -> tuple[int, str]:
        """By the released score, or at random in the baselines."""
        if self.method != "paper" or not len(evidence):
            action = random_action(len(self.evaluator.actions), evidence.tried, rng)
            return action, "random"
        self.weight /= 1.5
        score, _ = self.finder.score(self.weight, rng)
        action = choose(score, evidence.tried)
        return action, (
            f"disagreement of the {JUDGES} best less its unreliability: "
            f"{score[action]:.1f} degrees"
        )

    def search(self, evidence: Evidence, limit: int, rng: np.random.Generator) -> None:
        """200 generations; in the batch, all of them after the last action."""
        if self.method != "random-batch":
            self.finder.run(evidence, GENERATIONS, rng)
        elif len(evidence) == self.cycles:
            # as many simulations as 200 generations after each action, at most
            self.finder.run(evidence, GENERATIONS * (self.cycles + 1) // 2, rng)
        else:
            self.finder.run(evidence, 0, rng)

    def rivals(self) -> tuple[Genomes, Floats, Floats]:
        """The climbers; their tables are not simulated, for the rule has none."""
        genomes = self.finder.genomes
        shape = (len(genomes), len(self.evaluator.actions), 3)
        return genomes, np.full(shape, np.nan), self.finder.losses

    def candidates(self, evidence: Evidence) -> tuple[Genomes, Floats]:
        """The climbers."""
        return self.finder.genomes, self.finder.losses

    def state(self) -> dict[str, Any]:
        """The climbers."""
        return {"genes": self.finder.genes, "losses": self.finder.losses,
                "weight": self.weight}  # fmt: skip

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.finder.genes, self.finder.losses = state["genes"], state["losses"]
        self.weight = float(state["weight"])
