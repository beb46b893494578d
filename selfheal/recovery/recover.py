"""Recover: a legged robot that breaks in; a run that grows by one phase out.

Phases: original (a controller for the whole robot), failure (it walks broken), and then
three times estimate-K (what broke), explore-K (a controller for that), trial-K (tried
on the robot); or, without a model, hardware (evolution on the robot).
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..body.body import Floats
from ..body.damage import INTACT, Damage
from ..body.legged import essential
from ..engine.reflex import Drives, damaged, drive, trimmed
from ..gait.genetic import KEPT, MUTATION, Pool, Score, begin, evolve
from ..robot.driven import Driven
from .belief import Candidate, choose
from .estimate import GENES, VALUES, Hypothesis, decode, explained
from .explain import explain
from .phased import Phase, grown
from .recover_run import (
    RecoverRun,
    RecoverSettings,
    hypotheses_document,
    hypotheses_of,
)
from .trim import trims

HARDWARE = 70  # generations on the robot itself (overview.txt 4.4)
_MUTATION = 0.03  # of our searches; chosen: 10.9 m where 1 % reached 9.6, one case
_SEEDS = 10  # of the best controllers of each search before; chosen: all crowd the new
_SURE, _LIKELY = 0.95, 0.05  # of a hypothesis; chosen
_SUITED = 3  # hypotheses that a controller has to suit; chosen
# A trial that separates hypotheses is one of so many controllers, of which none is
# predicted to lose more than this share of the best one's way; chosen
_CANDIDATES, _WORTH, _DOUBTS = 12, 0.7, 8
_THIN = 10  # samples of a series for one that is compared in choosing: half a second

Progress = Callable[[str, str, float], None]


def recover(
    robot: Driven,
    settings: RecoverSettings,
    *,
    run: RecoverRun | None = None,
    progress: Progress = lambda phase, what, share: None,
) -> Iterator[RecoverRun]:
    """Walk, break, find out what broke, walk again; a yield a phase, result at the end.

    Args:
        robot: while it is whole.
        settings: what to do.
        run: one to go on with, made by the same robot and settings; None = start.
        progress: told the phase, what is done, and how much of it.
    """
    work = _Phases(robot, settings, progress)
    return grown(run or RecoverRun(settings), work.next, _result)


def _next(run: RecoverRun) -> str:
    """The name of the next phase; none at the end."""
    settings, done = run.settings, list(run.phases)
    if settings.method == "hardware-only":
        names = ["original", "failure", "hardware"]
    else:
        turns = [f"{what}-{k}" for k in range(1, settings.trials + 1)
                 for what in ("estimate", "explore", "trial")]  # fmt: skip
        names = ["original", "failure", *turns]
    left = names[len(done) :]
    if settings.method == "ours" and done and done[-1].startswith("trial"):
        ways = [run.phases[name]["way"] for name in ("original", done[-1])]
        left = left if ways[1] < ways[0] else []  # as far as ever: no need to go on
    return left[0] if left else ""


class _Phases:
    """One recovery in progress."""

    def __init__(
        self, robot: Driven, settings: RecoverSettings, progress: Progress
    ) -> None:
        self.whole, self.broken = robot, robot.struck(settings.damage)
        self.legged, self.settings = robot.legged, settings
        self.progress = progress
        self.built = np.ones(2 + len(self.legged.motors))  # the model, not trimmed

    def next(self, run: RecoverRun) -> tuple[str, Phase] | None:
        """The name of the next phase and what came of it; None at the end."""
        name = _next(run)
        if not name:
            return None
        kind = name.partition("-")[0]
        # where the phase stands is part of its seed, how it is reached is not
        numbers = [self.settings.seed, self.settings.scenario, len(run.phases), 42]
        rng = np.random.default_rng(numbers)
        return name, getattr(self, f"_{kind}")(name, run, rng)

    def _original(self, name: str, run: RecoverRun, rng: np.random.Generator) -> Phase:
        """A controller of the whole robot, and how it walks with it."""
        pool = self._search(name, self._ways([((), 1.0)], self.built), rng, None)
        walk = self.whole.trials(pool.genomes[:1])
        found = {**_pool(pool), "weights": pool.genomes[0], **_walk(walk)}
        if self.settings.method == "ours":
            found["trims"] = self._trims(name, found, rng)
        return found

    def _trims(self, name: str, walk: Phase, rng: np.random.Generator) -> Floats:
        """How the robot may be off its model, by how it walked."""

        def told(share: float) -> None:
            self.progress(name, "fitting the model", share)

        return trims(self.legged, walk["weights"], walk["sensed"], rng, told)

    def _failure(self, name: str, run: RecoverRun, rng: np.random.Generator) -> Phase:
        """How the broken robot walks with the controller of the whole one."""
        return _walk(self.broken.trials(run.phases["original"]["weights"][None]))

    def _estimate(self, name: str, run: RecoverRun, rng: np.random.Generator) -> Phase:
        """What may have broken."""
        if self.settings.method == "ours":
            return self._explain(name, run)
        earlier = [p["genome"] for p in run.estimates]
        score = explained(self.legged, run.trials)
        pool = self._search(name, score, rng, np.array(earlier) if earlier else None,
                            size=GENES * VALUES)  # fmt: skip
        (best,) = decode(pool.genomes[:1], self.legged)
        return {"believed": hypotheses_document([best]), "probability": [1.0],
                "genome": pool.genomes[0], "best": pool.best,
                "asked": pool.asked}  # fmt: skip

    def _explain(self, name: str, run: RecoverRun) -> Phase:
        """What may have broken, by the sensors' series."""
        whole = run.phases["original"]

        def told(share: float) -> None:
            self.progress(name, f"{len(run.trials)} trials", share)

        known = [h for p in run.estimates for h in hypotheses_of(p)]
        belief = explain(self.legged, whole["trims"], run.trials, whole["sensed"],
                         known, told)  # fmt: skip
        chance = belief.probability.tolist()
        return {"believed": hypotheses_document(belief.hypotheses),
                "probability": chance, "scale": belief.scale}  # fmt: skip

    def _explore(self, name: str, run: RecoverRun, rng: np.random.Generator) -> Phase:
        """A controller for what may have broken."""
        phase = list(run.phases.values())[-1]
        believed = list(zip(hypotheses_of(phase), phase["probability"], strict=True))
        if self.settings.method == "ours":
            searched = [p["pool"][:_SEEDS] for p in run.phases.values() if "pool" in p]
            # every other search starts afresh: what crowds one basin leaves others out
            afresh = len(searched) % 2 == 0
            seeds = None if afresh else np.unique(np.concatenate(searched), axis=0)
            trim = run.phases["original"]["trims"][0]
            score = self._ways(_likely(believed), trim)
            pool = self._search(name, score, rng, seeds, mutation=_MUTATION)
            scale = phase["scale"]
            pick, why = self._separating(pool, believed, trim, scale, rng)
        else:
            seeds = np.array([trial.weights for trial in run.trials])
            pool = self._search(name, self._ways(believed, self.built), rng, seeds)
            pick, why = 0, "the best one"
        return {**_pool(pool), "weights": pool.genomes[pick], "why": why,
                "predicted": float(pool.scores[pick])}  # fmt: skip

    def _trial(self, name: str, run: RecoverRun, rng: np.random.Generator) -> Phase:
        """The last controller on the broken robot."""
        weights = list(run.phases.values())[-1]["weights"]
        return _walk(self.broken.trials(weights[None]))

    def _hardware(self, name: str, run: RecoverRun, rng: np.random.Generator) -> Phase:
        """Evolution goes on, on the broken robot."""

        def score(genomes: Floats) -> Floats:
            return self.broken.trials(genomes).way

        kept = run.phases["original"]["pool"]
        ways = score(kept)
        order = np.argsort(-ways, kind="stable")
        pool = Pool(kept[order], ways[order], ways[order[:1]], len(kept))
        steps = evolve(pool, score, rng, HARDWARE)
        for step, pool in enumerate(steps):
            self.progress(name, f"best {pool.best[-1]:.2f} m", (step + 1) / HARDWARE)
        walk = self.broken.trials(pool.genomes[:1])
        return {**_pool(pool), "weights": pool.genomes[0], **_walk(walk)}

    def _search(
        self,
        name: str,
        score: Score,
        rng: np.random.Generator,
        seeds: Floats | None,
        size: int = 0,
        mutation: float = MUTATION,
    ) -> Pool:
        """The search of 2004, of controllers if no other size is given."""
        pool = begin(size or self.legged.synapses, score, rng, seeds)
        count = self.settings.generations
        steps = evolve(pool, score, rng, count - 1, mutation)
        for step, pool in enumerate(steps):
            self.progress(name, f"best {pool.best[-1]:.2f} m", (step + 2) / count)
        return pool

    def _drive(
        self, hypotheses: list[Hypothesis], weights: Floats, trim: Floats
    ) -> Drives:
        """Controllers on the trimmed robot as hypotheses have it, one each."""
        return drive(trimmed(damaged(self.legged, hypotheses), trim), weights)

    def _ways(self, believed: list[tuple[Hypothesis, float]], trim: Floats) -> Score:
        """How far controllers are expected to come on the trimmed robot [m]."""

        def score(genomes: Floats) -> Floats:
            said = [h for h, _ in believed for _ in genomes]
            weights = np.tile(genomes, (len(believed), 1))
            ways = self._drive(said, weights, trim).way
            return np.array([p for _, p in believed]) @ ways.reshape(-1, len(genomes))

        return score

    def _separating(
        self,
        pool: Pool,
        believed: list[tuple[Hypothesis, float]],
        trim: Floats,
        scale: Floats,
        rng: np.random.Generator,
    ) -> tuple[int, str]:
        """Which controller to try, and why: in doubt, one whose trial ends it."""
        if believed[0][1] >= _SURE:
            return 0, "the best one"
        doubts = believed[:_DOUBTS]
        good = np.flatnonzero(pool.scores >= _WORTH * pool.scores[0])[:_CANDIDATES]
        if not len(good):  # even the best goes backward
            return 0, "the best one"
        said = [h for _ in good for h, _ in doubts]
        weights = np.repeat(pool.genomes[good], len(doubts), axis=0)
        thin = self._drive(said, weights, trim).sensed[:, : len(scale) : _THIN]
        tables = thin.reshape(len(good), len(doubts), 1, -1)
        spreads = scale[::_THIN].ravel()
        weight = np.log(np.maximum([p for _, p in doubts], 1e-300))
        actions = [Candidate(table, spreads) for table in tables]
        pick, _ = choose(actions, weight, np.arange(len(doubts)), rng)
        return int(good[pick]), f"separates {len(doubts)} hypotheses"


def _likely(believed: list[tuple[Hypothesis, float]]) -> list[tuple[Hypothesis, float]]:
    """The hypotheses that a controller has to suit, their probabilities made whole."""
    kept = [b for b in believed[:_SUITED] if b[1] >= _LIKELY] or believed[:1]
    total = sum(p for _, p in kept)
    return [(h, p / total) for h, p in kept]


def _pool(pool: Pool) -> dict[str, Any]:
    """What a phase keeps of a search."""
    return {"pool": pool.genomes[:KEPT], "best": pool.best, "asked": pool.asked}


def _walk(drives: Drives) -> dict[str, Any]:
    """What a phase keeps of one run of the robot."""
    return {"way": float(drives.way[0]), "sensed": drives.sensed[0],
            "path": drives.path[0]}  # fmt: skip


def _result(run: RecoverRun) -> dict[str, Any]:
    """What `recover --json` prints (contract section 3)."""
    s, p = run.settings, run.phases
    tried = [name for name in p if name.startswith("trial")]
    ways = [p[name]["way"] for name in tried]
    broken = p["failure"]["way"]
    if s.method == "hardware-only":
        healed, spent = p["hardware"]["way"], p["hardware"]["asked"]
    else:
        # 2004 judges by the last trial; we stay with what went farthest
        healed = max([broken, *ways]) if s.method == "ours" else ways[-1]
        spent = len(ways)
    predicted = [p[name.replace("trial", "explore")]["predicted"] for name in tried]
    distance = {"intact": p["original"]["way"], "damaged": broken, "healed": healed}
    return {
        "format": "selfheal-recover",
        "version": 1,
        "robot": s.robot,
        "seed": s.seed,
        "scenario": s.scenario,
        "method": s.method,
        "damage": [d.document for d in s.damage],
        "alarm": None,  # the robot is told that it failed, in scenario 9 falsely
        "hypotheses": _marginals(run),
        "actions": spent,
        "trials": [{"predicted": _finite(a), "walked": _finite(b)}
                   for a, b in zip(predicted, ways, strict=True)],
        "distance": {k: _finite(v) for k, v in distance.items()} | {"best_known": None},
        "predicted": {
            "intact": _finite(p["original"]["best"][-1]),
            "healed": _finite(predicted[int(np.argmax(ways))]) if ways else None,
        },
        "seconds": round(run.seconds, 1),
    }  # fmt: skip


def _finite(value: float) -> float | None:
    """A rounded number, None for a run that failed."""
    return round(float(value), 4) if np.isfinite(value) else None


def _marginals(run: RecoverRun) -> list[dict[str, Any]]:
    """Each damage of the best hypothesis, and how likely it is by itself."""
    if not run.estimates:
        return []
    last = run.estimates[-1]
    believed, chance = hypotheses_of(last), last["probability"]

    def share(damage: Damage) -> float:
        said = [any((d.kind, d.target) == (damage.kind, damage.target) for d in h)
                or (h == () and damage == INTACT) for h in believed]  # fmt: skip
        return sum(p for p, one in zip(chance, said, strict=True) if one)

    told = [{**d.document, "probability": round(share(d), 4)}
            for d in believed[0] or (INTACT,)]  # fmt: skip
    return sorted(told, key=lambda d: -float(d["probability"]))


def named(run: RecoverRun) -> bool | None:
    """Whether the damage believed is of the true kinds and places; for reports.

    None where nothing is believed, or no hypothesis could say what is true.
    """
    true = essential(run.settings.legged, run.settings.damage)
    if not run.estimates or any(d.kind == "neuron_dead" for d in true):
        return None
    said = hypotheses_of(run.estimates[-1])[0]
    return {(d.kind, d.target) for d in said} == {(d.kind, d.target) for d in true}
