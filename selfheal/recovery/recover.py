"""Recover: a legged robot that breaks in; a run that grows by one phase out.

Phases: original (a controller for the whole robot) and failure (it walks broken). Then
three times estimate-K (what broke), explore-K (a controller for that) and trial-K
(tried on the robot). Once no listed damage explains what trials made the sensors say,
there are only explore-K, a gait of the whole robot from a search of its own, and
trial-K. Without a model: hardware (evolution on the robot) in their place.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..body.body import Floats
from ..engine.reflex import STEPS, STEPS_PER_SAMPLE, Rollouts
from ..evolution.genetic import (
    Breeding,
    Population,
    Score,
    evolve_population,
    start_population,
)
from ..evolution.ranking import rank_best_first
from ..robot.base import DrivenRobot
from .belief import CandidateAction, choose_action
from .estimate import (
    GENES,
    VALUES,
    Hypothesis,
    Trial,
    decode_hypotheses,
    make_damage_score,
)
from .explain import estimate_damage, simulate_hypotheses
from .fit_physics import fit_physics
from .phased_run import Document, Phase, Progress, ignore_progress, run_phases
from .predictive_check import is_refuted
from .recover_run import (
    RecoverRun,
    RecoverSettings,
    read_hypotheses,
    read_posterior,
    serialize_hypotheses,
    summarize_run,
)

HARDWARE_GENERATIONS = 70  # generations on the robot itself (overview.txt 4.4)
AS_DESCRIBED = Breeding()
# of our searches; chosen: 10.9 m where 1 % reached 9.6, one case
OURS = replace(AS_DESCRIBED, mutation=0.03)
# of the best controllers of each search before; chosen: all crowd the new
_SEEDS_PER_SEARCH = 10
_SURE_PROBABILITY, _LEAST_PROBABILITY = 0.95, 0.05  # of a hypothesis; chosen
_MOST_HYPOTHESES = 3  # hypotheses that a controller has to suit; chosen
# A trial that separates hypotheses is one of so many controllers, of which none is
# predicted to lose more than this share of the best one's way; chosen
_CANDIDATES, _LEAST_SHARE, _MOST_SEPARATED = 12, 0.7, 8
# samples of a series for one that is compared in choosing: half a second
_SAMPLE_STRIDE = 10


def recover_robot(
    robot: DrivenRobot,
    settings: RecoverSettings,
    *,
    run: RecoverRun | None = None,
    progress: Progress = ignore_progress,
) -> Iterator[RecoverRun]:
    """Walk, break, find out what broke, walk again; a yield a phase, result at the end.

    Args:
        run: one to go on with, made by the same robot and settings; None = start.
        progress: called with the phase, what is done, and how much of it.
    """
    work = RecoverPhases(robot, settings, progress)
    return run_phases(run or RecoverRun(settings), work.run_next, summarize_run)


def _find_next_phase(run: RecoverRun) -> str:
    """The name of the next phase; none at the end."""
    settings, done = run.settings, list(run.phases)
    left = run.list_next_phases(done)
    tried = len(run.trials) - 1
    if settings.method != "ours" or tried < 1 or done[-1].startswith("explore"):
        return left[0] if left else ""
    last = run.phases[f"trial-{tried}"]
    if done[-1].startswith("trial") and last["refuted"]:
        return left[0]  # what is believed is wrong, even where the robot walks again
    most = settings.trials + settings.more_trials * run.unlisted
    # as far as ever: no need to go on
    ended = tried == most or last["way"] >= run.phases["original"]["way"]
    return "" if ended else left[-1 if run.unlisted else 0]


@dataclass(frozen=True)
class _Due:
    """A phase that comes next: its name, the run before it, and its chances."""

    name: str
    run: RecoverRun
    rng: np.random.Generator


class RecoverPhases:
    """One recovery in progress."""

    def __init__(
        self, robot: DrivenRobot, settings: RecoverSettings, progress: Progress
    ) -> None:
        self.intact, self.damaged = robot, robot.struck(settings.damage)
        self.legged, self.settings = robot.legged, settings
        self.progress = progress
        self.no_seeds = np.empty((0, self.legged.synapses))  # a search from nothing
        self.no_scaling = np.ones(2 + len(self.legged.motors))  # the model, not scaled

    def run_next(self, run: RecoverRun) -> tuple[str, Phase] | None:
        """The name of the next phase and what came of it; None at the end."""
        name = _find_next_phase(run)
        if not name:
            return None
        kind = name.partition("-")[0]
        # where the phase stands is part of its seed, how it is reached is not
        numbers = [self.settings.seed, self.settings.scenario, len(run.phases), 42]
        due = _Due(name, run, np.random.default_rng(numbers))
        step = {
            "original": self._evolve_original,
            "failure": self._run_failure,
            "estimate": self._estimate_damage,
            "explore": self._evolve_controller,
            "trial": self._run_trial,
            "hardware": self._evolve_on_robot,
        }[kind]
        return name, step(due)

    def _evolve_original(self, due: _Due) -> Phase:
        """A controller of the whole robot, and how it walks with it."""
        score = self._make_displacement_score([((), 1.0)], self.no_scaling)
        pool = self._run_search(due, score, self.no_seeds, AS_DESCRIBED)
        walk = self.intact.run_trials(pool.genomes[:1])
        found = _describe_walk(pool, walk)
        if self.settings.method == "ours":
            report = partial(self.progress, due.name, "fitting the model")
            found["trims"] = fit_physics(
                self.legged, pool.genomes[0], found["sensed"], due.rng, report
            )
        return found

    def _run_failure(self, due: _Due) -> Phase:
        """How the broken robot walks with the controller of the whole one."""
        weights = due.run.phases["original"]["weights"]
        return _serialize_rollout(self.damaged.run_trials(weights[None]))

    def _estimate_damage(self, due: _Due) -> Phase:
        """What may have broken."""
        if self.settings.method == "ours":
            return self._estimate_from_series(due)
        earlier = np.array([p["genome"] for p in due.run.estimates])
        seeds = earlier.reshape(-1, GENES * VALUES)
        score = make_damage_score(self.legged, due.run.trials)
        pool = self._run_search(due, score, seeds, AS_DESCRIBED)
        (best,) = decode_hypotheses(pool.genomes[:1], self.legged)
        return {
            "believed": serialize_hypotheses([best]),
            "probability": [1.0],
            "genome": pool.genomes[0],
            "best": pool.best,
            "asked": pool.evaluations,
        }

    def _estimate_from_series(self, due: _Due) -> Phase:
        """What may have broken, by the sensors' series."""
        whole, trials = due.run.phases["original"], due.run.trials
        report = partial(self.progress, due.name, f"{len(trials)} trials")
        known = [h for p in due.run.estimates for h in read_hypotheses(p)]
        belief = estimate_damage(
            self.legged, whole["trims"], trials, whole["sensed"], known, report
        )
        refuted = bool(due.run.last.get("refuted"))
        return {
            "believed": serialize_hypotheses(belief.hypotheses),
            "probability": belief.probability.tolist(),
            "scale": belief.scale,
            "unlisted": refuted
            and is_refuted(self.legged, whole["trims"], belief, trials, due.rng),
        }

    def _evolve_controller(self, due: _Due) -> Phase:
        """A controller for what may have broken."""
        if due.run.unlisted:
            return self._evolve_another(due)
        phase = due.run.last
        believed = list(zip(read_hypotheses(phase), phase["probability"], strict=True))
        if self.settings.method == "ours":
            pools = [p["pool"] for p in due.run.phases.values() if "pool" in p]
            searched = [pool[:_SEEDS_PER_SEARCH] for pool in pools]
            # every other search starts afresh: what crowds one basin leaves others out
            afresh = len(searched) % 2 == 0
            seeds = np.unique(np.concatenate(searched), axis=0)
            seeds = self.no_seeds if afresh else seeds
            scaling = due.run.phases["original"]["trims"][0]
            score = self._make_displacement_score(_keep_plausible(believed), scaling)
            pool = self._run_search(due, score, seeds, OURS)
            scale = phase["scale"]
            pick, why = self._choose_separating(pool, believed, scaling, scale, due.rng)
        else:
            seeds = np.array([trial.weights for trial in due.run.trials])
            score = self._make_displacement_score(believed, self.no_scaling)
            pool = self._run_search(due, score, seeds, AS_DESCRIBED)
            pick, why = 0, "the best one"
        return _describe_choice(pool, pick, why)

    def _evolve_another(self, due: _Due) -> Phase:
        """A gait of the whole robot that has nothing in common with earlier ones.

        What broke is not known, nor which gait does without it. Gaits of independent
        searches do without different things.
        """
        scaling = due.run.phases["original"]["trims"][0]
        score = self._make_displacement_score([((), 1.0)], scaling)
        pool = self._run_search(due, score, self.no_seeds, OURS)
        return _describe_choice(pool, 0, "another gait of the whole robot")

    def _run_trial(self, due: _Due) -> Phase:
        """The last controller on the broken robot."""
        weights = due.run.last["weights"]
        found = _serialize_rollout(self.damaged.run_trials(weights[None]))
        if self.settings.method == "ours":
            trial = Trial(weights, found["way"], found["sensed"])
            found["refuted"] = not due.run.unlisted and is_refuted(
                self.legged,
                due.run.phases["original"]["trims"],
                read_posterior(due.run.estimates[-1]),
                [trial],
                due.rng,
            )
        return found

    def _evolve_on_robot(self, due: _Due) -> Phase:
        """Evolution goes on, on the broken robot."""

        def score(genomes: Floats) -> Floats:
            return self.damaged.run_trials(genomes).displacement

        kept = due.run.phases["original"]["pool"]
        ways = score(kept)
        order = rank_best_first(ways)
        pool = Population(kept[order], ways[order], ways[order[:1]], len(kept))
        steps = evolve_population(
            pool, score, due.rng, AS_DESCRIBED, HARDWARE_GENERATIONS
        )
        for step, pool in enumerate(steps):
            share = (step + 1) / HARDWARE_GENERATIONS
            self.progress(due.name, f"best {pool.best[-1]:.2f} m", share)
        return _describe_walk(pool, self.damaged.run_trials(pool.genomes[:1]))

    def _run_search(
        self, due: _Due, score: Score, seeds: Floats, breeding: Breeding
    ) -> Population:
        """The search of 2004, from what earlier ones found."""
        pool = start_population(seeds, score, due.rng, breeding)
        count = self.settings.generations
        steps = evolve_population(pool, score, due.rng, breeding, count - 1)
        for step, pool in enumerate(steps):
            self.progress(due.name, f"best {pool.best[-1]:.2f} m", (step + 2) / count)
        return pool

    def _simulate_hypotheses(
        self, hypotheses: list[Hypothesis], weights: Floats, scaling: Floats
    ) -> Rollouts:
        """Controllers on the scaled model as hypotheses have it, one each."""
        rows = STEPS // STEPS_PER_SAMPLE
        return simulate_hypotheses(self.legged, scaling, hypotheses, weights, rows)

    def _make_displacement_score(
        self, believed: list[tuple[Hypothesis, float]], scaling: Floats
    ) -> Score:
        """How far controllers are expected to come on the scaled model [m]."""

        def score(genomes: Floats) -> Floats:
            said = [h for h, _ in believed for _ in genomes]
            weights = np.tile(genomes, (len(believed), 1))
            ways = self._simulate_hypotheses(said, weights, scaling).displacement
            return np.array([p for _, p in believed]) @ ways.reshape(-1, len(genomes))

        return score

    def _choose_separating(
        self,
        pool: Population,
        believed: list[tuple[Hypothesis, float]],
        scaling: Floats,
        scale: Floats,
        rng: np.random.Generator,
    ) -> tuple[int, str]:
        """Which controller to try, and why: in doubt, one whose trial ends it."""
        if believed[0][1] >= _SURE_PROBABILITY:
            return 0, "the best one"
        doubts = believed[:_MOST_SEPARATED]
        good = np.flatnonzero(pool.scores >= _LEAST_SHARE * pool.scores[0])
        good = good[:_CANDIDATES]
        if not len(good):  # even the best goes backward
            return 0, "the best one"
        said = [h for _ in good for h, _ in doubts]
        weights = np.repeat(pool.genomes[good], len(doubts), axis=0)
        sensors = self._simulate_hypotheses(said, weights, scaling).sensors
        thin = sensors[:, : len(scale) : _SAMPLE_STRIDE]
        tables = thin.reshape(len(good), len(doubts), 1, -1)
        spreads = scale[::_SAMPLE_STRIDE].ravel()
        weight = np.log(np.maximum([p for _, p in doubts], 1e-300))
        actions = [CandidateAction(table, spreads) for table in tables]
        pick, _ = choose_action(actions, weight, np.arange(len(doubts)), rng)
        return int(good[pick]), f"separates {len(doubts)} hypotheses"


def _keep_plausible(
    believed: list[tuple[Hypothesis, float]],
) -> list[tuple[Hypothesis, float]]:
    """The hypotheses that a controller has to suit, their probabilities made whole."""
    likely = [b for b in believed[:_MOST_HYPOTHESES] if b[1] >= _LEAST_PROBABILITY]
    kept = likely or believed[:1]
    total = sum(p for _, p in kept)
    return [(h, p / total) for h, p in kept]


def _describe_choice(pool: Population, pick: int, why: str) -> Phase:
    """What a phase keeps of a search, and of the controller that is tried next."""
    return {
        **_serialize_population(pool),
        "weights": pool.genomes[pick],
        "why": why,
        "predicted": float(pool.scores[pick]),
    }


def _describe_walk(pool: Population, walk: Rollouts) -> Document:
    """What a phase keeps of a search, and of a run under its best controller."""
    best = {"weights": pool.genomes[0]}
    return {**_serialize_population(pool), **best, **_serialize_rollout(walk)}


def _serialize_population(pool: Population) -> Phase:
    """What a phase keeps of a search."""
    kept = pool.genomes[: AS_DESCRIBED.kept]
    return {"pool": kept, "best": pool.best, "asked": pool.evaluations}


def _serialize_rollout(drives: Rollouts) -> Document:
    """What a phase keeps of one run of the robot."""
    way = float(drives.displacement[0])
    return {"way": way, "sensed": drives.sensors[0], "path": drives.path[0]}
