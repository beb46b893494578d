"""The loop: a robot and settings in, a run that grows by one action a turn out."""

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..body.body import Floats, Ints
from ..body.genome import Genomes, build_bodies
from ..engine import ENGINES, make_engine
from ..engine.channels import list_channels
from ..engine.mjx import Mjx
from ..errors import InputError, UnknownNameError, check_seed
from ..robot.base import Robot
from ..robot.rest_readings import read_rest_channels
from .attachment_probability import compute_attachment_probability
from .evaluate import PAPER_LOSS, Evaluator, Evidence
from .explore import measure_disagreement
from .paper import PaperSearch
from .plainest import put_plainest_first
from .rivals import RivalSet
from .run import Cycle, Run, Settings, suits_mjx, uses_second_engine
from .second_engine import Question, SecondEngine
from .space import BodySpace, find_space, keep_others
from .strategy import METHODS, ReleasedStrategy, RivalStrategy, Strategy

_MOST_CONFIRMED = 8  # rivals whose rank mjx confirms each cycle; chosen
# Cycles that the search may be ahead of mjx, which starts in the time of about five
# early ones; chosen
_MOST_WAITING = 6
_MOST_RECORDED = 16  # rivals kept in a cycle's record; chosen
# Chosen on simulated robots: until reading n of N the search spends a share of its
# simulations of ((n^2 + n) / (N^2 + N)) to this power, the second one where hinges are
# unknown: what is found on few readings seldom lasts, and there hardly ever.
_LATE_POWER, _HINGE_LATE_POWER = 2, 5

Progress = Callable[[int], None]


def check_settings(settings: Settings, robot: Robot) -> None:
    """Refuse settings that make no sense, before any work.

    Raises:
        InputError: says which, and what would do.
    """
    if settings.method not in METHODS:
        raise UnknownNameError("method", settings.method, METHODS)
    if settings.engine not in ENGINES:
        raise UnknownNameError("engine", settings.engine, ENGINES)
    find_space(settings.space)
    if settings.engine == "mjx" and not suits_mjx(robot.anatomy):
        raise InputError(
            "engine 'mjx' knows no robot that is bolted down, has bent parts or parts "
            f"in any order, as {robot.name!r}; would fit: statics or mujoco"
        )
    if settings.method != "default" and robot.anatomy.sensors != ("tilt", "clearance"):
        raise InputError(
            f"method {settings.method!r} knows only the sensors tilt and clearance; "
            "would fit: method default"
        )
    count = len(robot.actions)
    if not 1 <= settings.cycles <= count:
        raise InputError(
            f"cycles must be 1 to {count}, the actions that robot {robot.name!r} "
            f"offers; not {settings.cycles}"
        )
    if settings.budget < 1:
        raise InputError(f"the budget must be positive; not {settings.budget}")
    check_seed(settings.seed)
    if settings.method != "default" and settings.space != "free":
        raise InputError(f"method {settings.method!r} knows only the space 'free'")
    if settings.method != "default" and settings.random_actions:
        raise InputError(
            f"random actions go with method 'default', not {settings.method!r}; "
            "methods 'random-batch' and 'random-alternate' are the baselines of 2006"
        )
    if settings.known_lengths and settings.space != "full":
        raise InputError(
            f"known lengths go with space 'full'; in {settings.space!r} they are "
            "always known"
        )


def check_same_robot(run: Run, robot: Robot) -> None:
    """Refuse to go on with a run on a robot that is not the one it began with.

    Readings are asked for again only where they come from a recording.

    Raises:
        InputError: says what differs.
    """
    name = run.settings.recordings or f"robot {robot.name!r}"
    same_parts = run.anatomy.parts == robot.anatomy.parts
    if not (same_parts and np.array_equal(run.actions, robot.actions)):
        raise InputError(f"{name} has other parts or actions than when the run began")
    for k, cycle in enumerate(run.cycles if run.settings.recordings else ()):
        again = read_rest_channels(robot.act(cycle.action), robot.anatomy)
        if not np.array_equal(again, cycle.felt, equal_nan=True):
            said = "answers otherwise than when the run began, first in cycle"
            raise InputError(f"{name} {said} {k + 1}")


@dataclass(frozen=True)
class _Searched:
    """A cycle whose search is over; a second engine may not have confirmed it yet.

    Attributes:
        cycle: its record; of the rivals only by the search's own order and losses.
        candidates: trees (M, P) that might be right, and belief (M) in them.
    """

    cycle: Cycle
    evidence: Evidence
    candidates: tuple[Ints, Floats]
    question: Question | None
    counts: dict[str, int]
    state: dict[str, np.ndarray | str]


class _IdentifyLoop:
    """One run in progress: the parts of it that a run file does not hold."""

    def __init__(
        self, robot: Robot, settings: Settings, progress: Progress | None
    ) -> None:
        self.robot, self.settings = robot, settings
        name = settings.engine
        space = find_space(settings.space)
        lengths = space.lengths and not settings.known_lengths
        self.space = replace(space, lengths=lengths, ordered=robot.anatomy.ordered)
        self.evaluator = Evaluator(
            robot.anatomy,
            make_engine("statics" if name == "auto" else name),
            actions=robot.actions,
            loss=None if settings.method == "default" else PAPER_LOSS,
            progress=progress,
        )
        self.strategy = _make_strategy(settings, self.evaluator, self.space)
        self.rng = np.random.default_rng([settings.seed, 10])
        self.second: SecondEngine | None = None
        if uses_second_engine(settings, robot.anatomy):
            self.second = SecondEngine(Mjx(), self.evaluator)
        self.channels, self.seconds = list_channels(robot.anatomy), 0.0
        self.evidence = Evidence.empty(len(self.channels))

    def search_cycle(self) -> _Searched:
        """One action more, and the search on what it measured."""
        start = time.perf_counter()
        action, why = self.strategy.choose_action(self.evidence, self.rng)
        reading = read_rest_channels(self.robot.act(action), self.robot.anatomy)
        self.evidence = self.evidence.add(action, reading)
        n, cycles = len(self.evidence), self.settings.cycles
        late = _HINGE_LATE_POWER if self.space.hinges else _LATE_POWER
        share = (n * (n + 1)) ** late, (cycles * (cycles + 1)) ** late
        limit = self.settings.budget * share[0] // share[1]
        self.strategy.search_bodies(self.evidence, limit, self.rng)
        rivals = self._list_rivals()
        left = np.setdiff1d(np.arange(len(self.robot.actions)), self.evidence.tried)
        tables, belief = self.strategy.predict_tables()
        predicted = self.channels.weigh_shown(tables[:, left])
        cycle = Cycle(
            action=action,
            why=why,
            felt=reading,
            **vars(rivals),
            sureness=np.full(self.robot.anatomy.size, np.nan),
            tilt_error=np.nan,
            disagreement=measure_disagreement(predicted, belief),
            spent=self.evaluator.spent,
            seconds=np.nan,
        )
        question = None
        if self.second:
            top = rivals[np.arange(min(_MOST_CONFIRMED, len(rivals)))]
            question = self.second.ask(top.genomes, top.tables, self.evidence)
        candidates = self.strategy.list_candidates()
        counts, state = self._count_simulations(), self._capture_search()
        self.seconds += time.perf_counter() - start
        return _Searched(cycle, self.evidence, candidates, question, counts, state)

    def is_confirmed(self, searched: list[_Searched]) -> bool:
        """Whether the first of these cycles need not wait, or has waited for long."""
        question = searched[0].question
        return not question or question.is_answered or len(searched) > _MOST_WAITING

    def _list_rivals(self) -> RivalSet:
        """The rivals that are recorded, best first, with tables of the best five."""
        rivals = self.strategy.list_rivals()
        rivals = rivals[np.arange(min(_MOST_RECORDED, len(rivals)))]
        if np.isnan(rivals.tables[:1]).any():  # a method that keeps no tables
            with self.evaluator.count_as_choice():
                rivals.tables[:5] = self.evaluator.compute_table(rivals.genomes[:5])
        return rivals

    def confirm_cycle(self, run: Run, searched: _Searched) -> Run:
        """The run and one more cycle, its rivals ranked by the second engine too."""
        start, cycle = time.perf_counter(), searched.cycle
        counts, state = searched.counts, searched.state
        if self.second and searched.question:
            second = self.second.compute_losses(searched.question)
            cycle = self._rank_rivals(cycle, second)
            counts = counts | {"mjx": self.second.spent}
            state = {**state, **self.second.capture_state()}
        tried, measured = list(searched.evidence.tried), searched.evidence.measured
        gap = self.channels.weigh_shown(np.abs(cycle.tables[0, tried] - measured))
        cycle = replace(
            cycle,
            sureness=compute_attachment_probability(
                *searched.candidates,
                cycle.genomes.parent[0],
                survived=_count_survived(run, cycle.genomes),
                ordered=run.anatomy.ordered,
            ),
            tilt_error=float(gap.sum(axis=1).mean()),
        )
        self.seconds += time.perf_counter() - start
        cycle = replace(cycle, seconds=self.seconds)
        cycles = *run.cycles, cycle
        return replace(run, cycles=cycles, counts=counts, state=state)

    def _rank_rivals(self, cycle: Cycle, second: Floats) -> Cycle:
        """A cycle whose best rivals are in the order of a second engine's losses."""
        losses, count = cycle.losses.copy(), len(second)
        losses[:count] = second
        costs = second + self.strategy.compute_prior(cycle.genomes[:count])
        order = np.arange(len(losses))
        order[:count] = np.argsort(costs, kind="stable")
        ranked = RivalSet(cycle.genomes, cycle.tables, losses)[order]
        return replace(cycle, **vars(ranked))

    def _count_simulations(self) -> dict[str, int]:
        """Simulations by engine; "choice" and "failed" apart."""
        e = self.evaluator
        apart = {"choice": e.spent_choosing, "failed": e.failed}
        return {e.engine.name: e.spent, **apart}

    def _capture_search(self) -> dict[str, np.ndarray | str]:
        """What `restore_state` needs besides the cycles and the second engine."""
        # copies: the search goes on, and what was yielded must not
        kept = {f"strategy_{k}": v for k, v in self.strategy.capture_state().items()}
        kept["hardness"] = self.evaluator.hardness
        random = json.dumps(self.rng.bit_generator.state)
        return {**{k: np.array(v) for k, v in kept.items()}, "random": random}

    def restore_state(self, run: Run) -> None:
        """Stand where a run stopped."""
        state, e = {k: np.asarray(v) for k, v in run.state.items()}, self.evaluator
        self.seconds = run.cycles[-1].seconds
        for cycle in run.cycles:
            self.evidence = self.evidence.add(cycle.action, cycle.felt)
        start = "strategy_"
        self.strategy.restore_state(
            {k.removeprefix(start): v for k, v in state.items() if k.startswith(start)},
            self.evidence,
        )
        self.rng.bit_generator.state = json.loads(str(state["random"]))
        e.hardness = state["hardness"].copy()
        e.spent, e.spent_choosing = run.counts[e.engine.name], run.counts["choice"]
        e.failed = run.counts["failed"]
        if self.second:
            self.second.restore_state(state, run.counts["mjx"])


def _count_survived(run: Run, genomes: Genomes) -> int:
    """How many actions in a row the tree of the best body has been the best."""
    trees = [cycle.genomes.parent[0] for cycle in reversed(run.cycles)]
    same = [bool((tree == genomes.parent[0]).all()) for tree in trees]
    return (*same, False).index(False)


def _make_strategy(
    settings: Settings, evaluator: Evaluator, space: BodySpace
) -> Strategy:
    """The method of the settings."""
    if settings.method == "default":
        at_random = settings.random_actions
        return RivalStrategy(evaluator, space, random_actions=at_random)
    return ReleasedStrategy(PaperSearch(evaluator), settings.method, settings.cycles)


def identify_body(
    robot: Robot,
    settings: Settings,
    *,
    run: Run | None = None,
    progress: Progress | None = None,
) -> Iterator[Run]:
    """Find out what a robot's body is, a yield a cycle; the last one has the result.

    Args:
        run: one to go on with, made by the same robot and settings; None = start.
        progress: called with the search's simulations so far now and then.

    Raises:
        InputError: settings or recordings that make no sense.
    """
    check_settings(settings, robot)
    run = run or Run(settings, robot.anatomy, robot.actions, truth=robot.truth)
    check_same_robot(run, robot)
    if run.result:
        yield run
        return
    loop = _IdentifyLoop(robot, settings, progress)
    if run.cycles:
        loop.restore_state(run)
    searched: list[_Searched] = []
    for _ in range(len(run.cycles), settings.cycles):
        searched.append(loop.search_cycle())
        while searched and loop.is_confirmed(searched):
            run = loop.confirm_cycle(run, searched.pop(0))
            yield run
    for last in searched:
        run = loop.confirm_cycle(run, last)
        yield run
    yield _finish_run(loop, run)


def _finish_run(loop: _IdentifyLoop, run: Run) -> Run:
    """The run and its result: its best body is checked on the reference engine."""
    settings, robot = run.settings, loop.robot
    last = run.cycles[-1]
    if settings.method == "default":
        last = put_plainest_first(last, loop.evaluator, loop.evidence)
    every = np.arange(len(robot.actions))
    best = build_bodies(robot.anatomy, last.genomes[:1])
    reference = make_engine("mujoco")
    seen = reference.simulate(best[np.zeros_like(every)], robot.actions).channels
    counts = dict(run.counts) | {"choice": loop.evaluator.spent_choosing}
    counts["mujoco"] = counts.get("mujoco", 0) + len(every)
    tried = list(loop.evidence.tried)
    gap = np.abs(seen[tried] - loop.evidence.measured)
    gap = loop.channels.weigh_shown(gap).sum(axis=1)
    gap = gap[np.isfinite(gap)]
    alike = loop.strategy.list_indistinguishable(last.tables[0])
    alike = keep_others(loop.space, alike, last.genomes[:1])
    result = {
        "format": "selfheal-identify",
        "version": 1,
        "robot": settings.robot,
        "method": settings.method,
        "seed": settings.seed,
        "parent": best.parent[0].tolist(),
        "sureness": np.round(last.sureness, 4).tolist(),
        "length": np.round(best.length[0], 6).tolist(),
        "tilt_error": float(gap.mean()) if len(gap) else last.tilt_error,
        "actions": [_format_action(robot.actions, a) for a in tried],
        "simulations": counts,
    }
    return replace(
        run,
        cycles=(*run.cycles[:-1], last),
        counts=counts,
        result=result,
        indistinguishable=alike.parent,
    )


def _format_action(actions: Floats, action: int) -> list[int] | list[float]:
    """An action as the joints that go down, or as joint angles if it is no 2006 one."""
    target = actions[action]
    if np.allclose(np.abs(actions), np.abs(actions).max()):
        down: Ints = np.flatnonzero(target < 0)
        return [int(j) for j in down]
    return [float(x) for x in target]
