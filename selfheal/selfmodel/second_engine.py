"""A second engine's view of the best rivals, asked for while the search goes on."""

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..body.body import Bodies, Floats
from ..body.genome import Genomes, build_bodies
from ..engine.mjx import Mjx
from ..engine.readings import Readings
from .evaluate import Evaluator, Evidence
from .space import make_genome_key


@dataclass(frozen=True)
class Question:
    """Rivals (N) whose readings under every action tried the engine was asked for.

    Attributes:
        tables: (N, A, C) what the first engine predicts.
        keys: of each rival under each action (N n).
        new: the keys that were never asked for before.
        rows: bodies (M) and joint targets (M, P) [rad] of the new ones.
        answer: their readings; None where there are none.
    """

    tables: Floats
    evidence: Evidence
    keys: list[bytes]
    new: list[bytes]
    rows: tuple[Bodies, Floats]
    answer: Future[Readings | None] | None

    @property
    def is_answered(self) -> bool:
        """Whether nothing has to be waited for."""
        return self.answer is None or self.answer.done()


class SecondEngine:
    """Predicts in a thread of its own; every prediction is made once.

    Attributes:
        known: channels (C) by key, of questions that were answered.
        spent: simulations for these.
    """

    def __init__(self, engine: Mjx, evaluator: Evaluator) -> None:
        """The engine starts while the first searches run."""
        self.engine, self.evaluator = engine, evaluator
        self.known: dict[bytes, Floats] = {}
        self.spent = 0
        self._asked: set[bytes] = set()  # not answered yet
        self._thread = ThreadPoolExecutor(1)
        self._started = self._thread.submit(engine.prepare, evaluator.anatomy)
        self._is_compiled = False

    def ask(self, genomes: Genomes, tables: Floats, evidence: Evidence) -> Question:
        """Begin to simulate rivals (N) under every action tried.

        Args:
            tables: (N, A, C) what the first engine predicts.
        """
        if self._started.done():
            self._compile()
        pairs = [*product(range(len(genomes)), evidence.tried)]
        bodies = [make_genome_key(genomes, row) for row in range(len(genomes))]
        keys = [bodies[row] + action.to_bytes(4, "little") for row, action in pairs]
        old = self.known.keys() | self._asked
        new = [i for i, key in enumerate(keys) if key not in old]
        rows, actions = np.array(pairs)[new].T
        built = build_bodies(self.evaluator.anatomy, genomes)[rows]
        asked = built, self.evaluator.actions[actions]
        answer = self._thread.submit(self._simulate, *asked) if new else None
        names = [keys[i] for i in new]
        self._asked.update(names)
        return Question(tables, evidence, keys, names, asked, answer)

    def _compile(self) -> None:
        """Have the engine compiled, in this thread where no earlier run did it."""
        if not self._started.result():
            self.engine.compile(self.evaluator.anatomy)
        self._is_compiled = True

    def _simulate(self, bodies: Bodies, targets: Floats) -> Readings | None:
        """Readings (N) of bodies (N) under joint targets (N, P) [rad].

        None where the engine must be compiled first, which this thread must not do.
        """
        if self._started.result() or self._is_compiled:
            return self.engine.simulate(bodies, targets)
        return None

    def compute_losses(self, question: Question) -> Floats:
        """(N) where the engines differ, the one nearer to the reading counts.

        Such a pose is a coin's toss for the robot too; a right body must not lose by
        it. Waits for the answer.
        """
        if question.answer:
            readings = question.answer.result()
            if readings is None:
                self._compile()
                readings = self.engine.simulate(*question.rows)
            self.known.update(zip(question.new, readings.channels, strict=True))
            self._asked.difference_update(question.new)
            self.spent += len(question.new)
        tables, evidence = question.tables, question.evidence
        shape = (len(tables), len(evidence), evidence.measured.shape[1])
        second = np.array([self.known[key] for key in question.keys]).reshape(shape)
        first = tables[:, list(evidence.tried)]
        both = np.stack([first, second])
        each = self.evaluator.loss(both, evidence.measured)
        each = np.where(np.isnan(both).any(axis=3), np.inf, each)
        return each.min(axis=0).sum(axis=1)

    def capture_state(self) -> dict[str, np.ndarray]:
        """What `restore_state` needs."""
        keys = np.frombuffer(b"".join(self.known), np.uint8)
        return {
            "judge_keys": keys.reshape(len(self.known), -1),
            "judge_values": np.array(list(self.known.values())),
        }

    def restore_state(self, state: Mapping[str, np.ndarray], spent: int) -> None:
        """Know again what was answered, by so many simulations."""
        self.spent = spent
        rows = zip(state["judge_keys"], state["judge_values"], strict=True)
        self.known = {key.tobytes(): value for key, value in rows}
