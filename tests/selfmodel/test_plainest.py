"""Of bodies that no action tells apart, the one with parts in the middle is shown."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.genome import center_on_sides
from selfheal.selfmodel.evaluate import Evidence
from selfheal.selfmodel.plainest import find_plainest
from tests.support.stick_robot import truth_genome
from tests.support.stick_search import make_evaluator


@pytest.mark.parametrize("off, is_told", [(0.0, False), (0.004, False), (0.09, True)])
def test_a_part_goes_to_the_middle_unless_an_action_tells(off, is_told):
    truth, evaluator = center_on_sides(truth_genome()), make_evaluator()
    moved = replace(truth, placement=truth.placement + np.array([0, off, 0, 0]))
    table = evaluator.compute_table(moved)[0]
    evidence = Evidence((0, 3), table[[0, 3]])
    plain, seen = find_plainest(evaluator, moved, table, evidence)
    expected = moved if is_told else truth
    np.testing.assert_array_equal(plain.placement, expected.placement)
    np.testing.assert_array_equal(seen, evaluator.compute_table(plain)[0])


def test_each_part_is_asked_where_all_at_once_are_told():
    truth, evaluator = center_on_sides(truth_genome()), make_evaluator()
    shift = np.array([0.004, 0.09, 0, 0.004])
    moved = replace(truth, placement=truth.placement + shift)
    table = evaluator.compute_table(moved)[0]
    plain, _ = find_plainest(evaluator, moved, table, Evidence((1,), table[[1]]))
    middle = plain.placement == truth.placement
    assert middle[0, [0, 2]].all() and not middle[0, 1]


def test_readings_that_speak_against_the_middle_are_heard():
    truth, evaluator = center_on_sides(truth_genome()), make_evaluator()
    moved = replace(truth, placement=truth.placement + np.array([0.012, 0, 0, 0]))
    table = evaluator.compute_table(moved)[0]
    gap = np.abs(table - evaluator.compute_table(truth)[0]) * evaluator.loss.weight
    assert gap.max() < 1  # no single action tells
    every = tuple(range(len(table)))
    plain, _ = find_plainest(evaluator, moved, table, Evidence(every, table))
    assert (plain.placement == truth.placement).all() == (gap.sum() < 1)
