"""Verdicts: when a replay of held-out episodes refutes what was named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.marginalization import marginalize_initial_states
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.selection.hypotheses import Hypothesis
from selfheal.diagnosis.selection.verdict import (
    Outcome,
    decide_verdict,
    is_replay_off,
    predicts_worse,
    removes_too_little,
)
from selfheal.diagnosis.simulation import score
from tests.support.diagnosis_folder import score_model
from tests.support.problems import NOISE, STEPS, name_effect
from tests.support.recorded_robots import bench


def _make_hypothesis(b, value: float | None = None) -> Hypothesis:
    """Dry friction of the last joint beside the model: fitted, or of this value."""
    segments = cut_segments(b.simulator.episodes, STEPS)
    sigma = np.full(segments.readings.shape[1], 5 * NOISE)
    problem = marginalize_initial_states(
        Problem(b.simulator, segments, sigma), (), np.zeros(0)
    )
    term = find_effect("coulomb_friction").propose_terms(b.robot)[-1]
    nominal = fit_parameters(problem, (), np.zeros(0))
    if value is None:
        final = fit_parameters(problem, (term,), np.array([0.05]))
    else:
        final = fit_parameters(problem, (term,), np.array([value]), iterations=0)
    return Hypothesis(nominal, final, (name_effect(term),), ())


def _bench_with_friction(robot: str, folder, dry: float):
    def change(model):
        model.dof_frictionloss[-1] = dry

    return bench(robot, folder, episodes=3, seconds=1.2, seed=2, change=change)


@pytest.mark.parametrize("dry", [0.0, 0.1])
def test_a_replay_that_decides_nothing_refutes_no_name_that_segments_support(
    dry, tmp_path
):
    b = _bench_with_friction("arm", tmp_path, dry)
    naming = _make_hypothesis(b)

    def little(patched: float) -> bool:
        numbers = {"refit": 0.2, "patched": patched, "floor": 0.1}
        return removes_too_little(
            SimpleNamespace(
                numbers=numbers,
                segments=naming.problem.segments,
                dataset=SimpleNamespace(held_out=b.simulator),
                hypothesis=naming,
            )
        )

    assert not little(0.1)
    assert little(0.2) == (dry == 0.0)


@pytest.mark.parametrize(
    "horizons, is_worse",
    [
        ([(0.2, 0.1, 0.01)], False),
        ([(0.2, 0.205, 0.01)], False),
        ([(0.2, 0.22, 0.01)], True),
        ([(0.2, 0.22, 0.22)], False),
        ([(0.2, 0.1, 0.01), (0.4, 0.45, 0.01)], True),
        ([(0.2, np.inf, 0.01)], True),
        ([(0.2, np.nan, 0.01)], True),
        ([(np.inf, np.inf, 0.01)], False),
    ],
)
def test_what_predicts_worse_over_any_horizon_is_known(horizons, is_worse):
    names = ("given", "patched", "floor")
    each = [dict(zip(names, h, strict=True)) for h in horizons]
    others = tuple(SimpleNamespace(numbers=h) for h in each)
    scores = SimpleNamespace(numbers=each[0], horizons=others)
    assert predicts_worse(scores) is is_worse


def _is_off(b, floor: float, off=()) -> bool:
    """Whether a replay of the model is off; some episodes are read elsewhere."""
    held = replace(b.simulator, has_contact=b.robot.has_contact)
    segments = score.cut_replay_segments(held)
    none = SimpleNamespace(terms=(), values=np.zeros(0))
    spread = np.repeat(
        [c.spread for c in held.channels], [c.width for c in held.channels]
    )
    moved = np.isin(segments.episode, off)[segments.segment_of_sample]
    segments = replace(segments, readings=segments.readings + np.outer(moved, spread))
    squares = score.sum_squared_errors(held, segments, none.terms, none.values)
    count = score.count_readings(held, segments)
    patched = score.compute_score(held, squares, count)
    numbers = {"patched": patched, "floor": floor}
    assert patched > 6 * floor
    return is_replay_off(
        SimpleNamespace(
            segments=segments,
            count=count,
            squares={"patched": squares},
            numbers=numbers,
            dataset=SimpleNamespace(held_out=held),
            hypothesis=SimpleNamespace(final=none),
        )
    )


@pytest.mark.parametrize("robot, off, is_off", [
    ("box", [3], False),  # fell on another side
    ("box", [0, 2, 3], True),
    ("arm", [3], True),
])  # fmt: skip
def test_a_replay_is_off_where_chance_is_no_reason(robot, off, is_off, tmp_path):
    b = bench(robot, tmp_path, episodes=5, seconds=0.8)
    assert _is_off(b, 0.05, off) is is_off


def test_a_coarse_time_step_makes_no_replay_off(tmp_path):
    b = bench("pendulum", tmp_path, episodes=2, seconds=2.0, finer=20)
    _, each, _ = score_model(b.path, b.recording)
    assert not _is_off(b, each[0] / 8)


CLEAN = Outcome(
    has_names=False,
    has_quantization=False,
    has_structure=False,
    explained=0.0,
    is_replay_off=False,
    floor_ratios=(1.0, 1.1),
    removed=(None, None),
    is_stopped=False,
)
NAMED = replace(CLEAN, has_names=True, explained=0.99, removed=(0.97, 0.95))


@pytest.mark.parametrize("outcome, verdict", [
    (CLEAN, "nothing"),
    (replace(CLEAN, is_stopped=True), "nothing"),
    (replace(CLEAN, floor_ratios=(), removed=()), "nothing"),
    (replace(CLEAN, has_structure=True), "unlisted"),
    (replace(CLEAN, is_replay_off=True), "unlisted"),
    (replace(CLEAN, floor_ratios=(1.1, 4.0)), "unlisted"),
    (replace(CLEAN, has_structure=True, is_stopped=True), "undecided"),
    (NAMED, "explained"),
    (replace(NAMED, is_stopped=True), "explained"),
    (replace(NAMED, has_structure=True), "explained"),
    (replace(NAMED, has_structure=True, explained=0.7), "partly"),
    (replace(NAMED, explained=0.7), "explained"),
    (replace(NAMED, removed=(0.97, 0.6)), "partly"),
    (replace(NAMED, removed=(0.97, None)), "explained"),
    (replace(NAMED, is_replay_off=True), "partly"),
    (replace(CLEAN, has_quantization=True), "explained"),
    (replace(CLEAN, has_quantization=True, has_structure=True), "partly"),
])  # fmt: skip
def test_each_outcome_has_its_verdict(outcome, verdict):
    assert decide_verdict(outcome) == verdict
