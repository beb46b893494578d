"""Uncertain initial states: what they explain is taken from residuals, and no more."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.by_target import WorldEffect
from selfheal.diagnosis.effects.declaration import Proposal
from selfheal.diagnosis.effects.places import Place
from selfheal.diagnosis.effects.protocols import ModelEdit
from selfheal.diagnosis.estimation import marginalization
from selfheal.diagnosis.estimation.jacobian import respond_to_initial_states
from selfheal.diagnosis.estimation.marginalization import (
    is_horizon_informative,
    marginalize_initial_states,
)
from selfheal.diagnosis.estimation.multiple_shooting import build_initial_state_offsets
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.estimation.regime import CONTACT
from selfheal.diagnosis.estimation.settings import FIT
from tests.support.problems import (
    NOISE,
    MeasuredStatesProblem,
    as_type,
    make_misread_problem,
    make_problem,
    with_contact,
)
from tests.support.recorded_robots import bench


def test_marginalization_removes_what_uncertain_initial_states_explain(arm):
    plain = make_problem(arm)
    problem = marginalize_initial_states(plain, (), np.zeros(0))
    offset = build_initial_state_offsets(arm.simulator, plain.segments)
    none = np.zeros((len(offset), 0))
    raw, white = (
        p.compute_residuals((), none, initial_state_offset=offset)
        for p in (plain, problem)
    )
    for n in range(1, len(offset)):
        before = plain.sum_by_segment((raw[n] - raw[0]) ** 2)
        after = problem.sum_by_segment((white[n] - white[0]) ** 2)
        assert (after <= before + 1e-9).all()
        # an error of one standard deviation costs no more than it is likely
        assert (after < 1.01).all()


def test_marginalization_leaves_what_no_initial_state_explains(arm):
    problem = make_problem(arm)
    white = marginalize_initial_states(problem, (), np.zeros(0))
    bias = find_effect("sensor_bias").propose_terms(arm.robot)[0]
    values = np.array([[0.0], [10 * NOISE]])
    moved = [
        np.diff(p.compute_residuals((bias,), values), axis=0) for p in (problem, white)
    ]
    assert np.linalg.norm(moved[1]) > 0.3 * np.linalg.norm(moved[0])


def test_after_impacts_initial_states_are_searched_where_they_are_likeliest(tmp_path):
    b = bench("box", tmp_path, episodes=6, seconds=0.6, noise=1e-3, states=False)
    plain, values = make_problem(b), np.zeros(0)
    rng = np.random.default_rng(0)
    offset = build_initial_state_offsets(b.simulator, plain.segments)
    off = (offset.sum(axis=0) * rng.normal(size=offset.shape[1:]))[None]
    predicted = b.simulator.leapfrog.simulate(
        (), values[None], plain.segments, initial_state_offset=off
    )[0]
    noise = NOISE * rng.normal(size=predicted.shape)
    problem = replace(
        plain, segments=replace(plain.segments, readings=predicted + noise)
    )
    sought = marginalize_initial_states(problem, (), values)
    still = as_type(problem, MeasuredStatesProblem)
    linear = marginalize_initial_states(still, (), values)
    cost = [float((p.residuals_at((), values) ** 2).sum()) for p in (linear, sought)]
    readings = np.isfinite(problem.segments.readings).sum()
    assert cost[1] < 2 * readings < 0.5 * cost[0]
    # and from there they are not lost again
    again = marginalize_initial_states(sought, (), values).residuals_at((), values)
    assert again @ again < 1.01 * cost[1]


def test_in_contact_known_slopes_of_initial_states_serve_other_weights(tmp_path):
    b = bench("box", tmp_path, episodes=6, seconds=0.6, noise=1e-3, states=False)
    first = marginalize_initial_states(with_contact(make_problem(b)), (), np.zeros(0))
    known = replace(first, sigma=1.5 * first.sigma)
    counts, costs = [], []
    for problem in known, replace(known, state_slopes=()):
        begun = b.simulator.counter.count
        again = marginalize_initial_states(problem, (), np.zeros(0))
        counts.append(b.simulator.counter.count - begun)
        costs.append(float((again.residuals_at((), np.zeros(0)) ** 2).sum()))
    assert counts[0] < 0.5 * counts[1]
    assert costs[0] < 1.1 * costs[1]


def test_initial_speeds_are_searched_where_a_robot_sticks_or_slips(sticky, monkeypatch):
    b, term, values = sticky
    count = len(make_problem(b).segments)
    speeds = np.zeros((count, 2))
    speeds[::4, 0], speeds[2::4, 0] = -2, 2
    problem = make_misread_problem(b, term, values, speeds)
    cost = []
    for odd in (np.inf, 4.0):
        monkeypatch.setattr(marginalization, "FIT", replace(FIT, outlier_ratio=odd))
        white = marginalize_initial_states(problem, (term,), values)
        cost.append(white.sum_by_segment(white.residuals_at((term,), values) ** 2))
    lost = cost[0] > 3 * np.median(cost[0])
    assert lost.any() and (cost[1] < 3 * np.median(cost[0])).all()


def test_responses_to_initial_states_are_smoothed_in_contact(tmp_path):
    """Initial states would explain the roughness of one simulation, and of no other."""
    b = bench("box", tmp_path, episodes=1, seconds=0.6)
    rng, size, width = np.random.default_rng(0), 4000, 12

    def residuals(terms, values, offset):
        return rng.normal(size=(len(offset), size))

    jumps = SimpleNamespace(
        regime=CONTACT,
        simulator=b.simulator,
        compute_residuals=residuals,
        segment_of_residual=np.zeros(size, int),
        select=lambda chosen: jumps,
        split_by_segment=lambda values: [values],
    )
    nothing, one = np.zeros((1, width)), np.ones((1, width))
    ((r, moved),) = respond_to_initial_states(jumps, (), np.zeros(0), nothing, one)
    assert moved.shape == (size, width)
    assert np.abs(moved.T @ r).max() < 0.1 * (r @ r)


def test_a_horizon_is_informative_while_errors_of_initial_states_stay_small(pendulum):
    problem = make_problem(pendulum)
    assert is_horizon_informative(problem, problem, (), np.zeros(0))
    simulator = problem.simulator
    signals = tuple(
        replace(c, noise=np.full(c.width, 0.3 * c.spread)) for c in simulator.channels
    )
    loud = replace(problem, simulator=replace(simulator, channels=signals))
    assert not is_horizon_informative(loud, loud, (), np.zeros(0))


def _pieces(b, steps: int) -> Problem:
    width = sum(c.width for c in b.simulator.channels)
    return Problem(
        b.simulator, cut_segments(b.simulator.episodes, steps), np.full(width, NOISE)
    )


class Reversal(WorldEffect, ModelEdit[Place]):
    name = "reversal"

    def propose_terms(self, robot):
        return [self.make_term("world", Place(), Proposal((), ((),)))]

    def edit_model(self, model, place, values):
        model.opt.gravity[:] *= -1


def test_a_horizon_is_uninformative_where_errors_of_initial_states_grow(
    pendulum, tmp_path
):
    pole = bench("cart_pole", tmp_path, episodes=2, seconds=3.0, seed=3)
    short, long = (_pieces(pole, steps) for steps in (50, 300))
    standing = Reversal().propose_terms(pole.robot)  # the pole falls
    held = [_pieces(pendulum, steps) for steps in (300, 50)]
    assert is_horizon_informative(*held, (), np.zeros(0))
    assert is_horizon_informative(short, short, standing, np.zeros(0))
    assert not is_horizon_informative(long, short, standing, np.zeros(0))
