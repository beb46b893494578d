"""The second engine: questions asked while others wait, each prediction made once."""

import threading

import numpy as np
import pytest

from selfheal.body.genome import draw_genomes
from selfheal.engine.statics import Statics
from selfheal.selfmodel.evaluate import Evaluator, Evidence
from selfheal.selfmodel.second_engine import SecondEngine
from tests.support.star_robot import ACTIONS, ANATOMY

GENOMES = draw_genomes(ANATOMY, 5, np.random.default_rng(0), True)
EVIDENCE = Evidence.empty(3).add(3, np.zeros(3)).add(7, np.array([5.0, -5.0, np.nan]))


class Slow(Statics):
    """Starts when it is let; notes what it was asked for, and where it compiled."""

    def __init__(self, kept: bool) -> None:
        super().__init__()
        self.kept, self.rows, self.compiled = kept, 0, None
        self.may_start = threading.Event()

    def prepare(self, anatomy) -> bool:
        self.may_start.wait()
        return self.kept

    def compile(self, anatomy) -> None:
        self.compiled = threading.current_thread()

    def simulate(self, bodies, targets):
        assert self.kept or self.compiled
        self.rows += len(bodies)
        return super().simulate(bodies, targets)


@pytest.mark.parametrize("kept", [True, False])
def test_questions_asked_before_the_engine_runs_are_answered_as_later_ones(kept):
    engine = Slow(kept)
    evaluator = Evaluator(ANATOMY, Statics(), actions=ACTIONS)
    tables = evaluator.compute_table(GENOMES)
    second = SecondEngine(engine, evaluator)
    some = np.arange(3)
    questions = [
        second.ask(GENOMES[some], tables[some], EVIDENCE),
        second.ask(GENOMES, tables, EVIDENCE),
        second.ask(GENOMES, tables, EVIDENCE),
    ]
    assert not questions[0].is_answered
    engine.may_start.set()
    first, *others = (second.compute_losses(q) for q in questions)
    measured = evaluator.loss(tables[:, [3, 7]], EVIDENCE.measured).sum(axis=1)
    np.testing.assert_array_equal(first, measured[:3])
    for losses in others:
        np.testing.assert_array_equal(losses, measured)
    assert engine.rows == second.spent == 5 * 2 == len(second.known)
    assert kept or engine.compiled is threading.main_thread()


def test_what_was_answered_is_known_again():
    engine = Slow(True)
    engine.may_start.set()
    evaluator = Evaluator(ANATOMY, Statics(), actions=ACTIONS)
    tables = evaluator.compute_table(GENOMES)
    second = SecondEngine(engine, evaluator)
    losses = second.compute_losses(second.ask(GENOMES, tables, EVIDENCE))
    again = SecondEngine(engine, evaluator)
    again.restore_state(second.capture_state(), second.spent)
    question = again.ask(GENOMES, tables, EVIDENCE)
    assert question.is_answered
    np.testing.assert_array_equal(again.compute_losses(question), losses)
    assert again.spent == engine.rows == 10
