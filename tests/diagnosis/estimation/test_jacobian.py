"""Trees that nothing couples: their values, states and candidates share simulations."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation import multiple_shooting
from selfheal.diagnosis.estimation.jacobian import (
    compute_jacobian,
    respond_to_initial_states,
)
from selfheal.diagnosis.estimation.problem import initial_state_std
from selfheal.diagnosis.estimation.settings import FIT
from tests.support.problems import list_nominal_terms, make_problem
from tests.support.recorded_robots import Robot, bench

THREE_ARMS = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="left" pos="0 0.5 1">
      <joint name="a" axis="0 1 0" damping="0.03" armature="0.002"/>
      <geom name="left" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
    </body>
    <body name="right" pos="0 -0.5 1">
      <joint name="b" axis="0 1 0" damping="0.05" armature="0.004"/>
      <geom name="right" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.4"/>
    </body>
    <body name="middle" pos="0 0 1">
      <joint name="c" axis="0 1 0" damping="0.04" armature="0.003"/>
      <geom name="middle" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/>
    </body>
  </worldbody>
  {coupling}
  <actuator>
    <position name="servo_a" joint="a" kp="3" kv="0.1"/>
    <position name="servo_b" joint="b" kp="4" kv="0.1"/>
    <position name="servo_c" joint="c" kp="3" kv="0.1"/>
  </actuator>
</mujoco>
"""
COUPLED = '<equality><joint joint1="a" joint2="b"/></equality>'
SIGNALS = {joint: ("joint_position", joint, "rad") for joint in "abc"}


def _command(t, rng):
    return np.sin(np.outer(t, rng.uniform(2, 6, 3)))


def _begin(rng):
    return rng.normal(size=1).repeat(3), np.zeros(3)


def _record(folder, coupling: str):
    """Arms side by side."""
    robot = Robot(THREE_ARMS.format(coupling=coupling), SIGNALS, _command, _begin)
    return bench(robot, folder, episodes=2, seconds=1.0, seed=1)


def _make_problem(folder, coupling: str):
    """Arms side by side, what they state, and dry friction of all."""
    arms = _record(folder, coupling)
    dry = find_effect("coulomb_friction").propose_terms(arms.robot)
    terms = (*list_nominal_terms(arms), *dry)
    values = np.append(np.ones(len(terms) - 3), [0.02, 0.01, 0.02])
    return make_problem(arms, dry, (0.03, 0.02, 0.03)), terms, values


def _count(problem, compute):
    """What is computed, and how many simulations it took."""
    counter, before = problem.simulator.counter, problem.simulator.counter.count
    found = compute()
    return found, (counter.count - before) / len(problem.segments)


@pytest.mark.parametrize("coupling", ["", COUPLED])
def test_the_jacobian_is_that_of_each_value_alone(coupling, tmp_path):
    problem, terms, values = _make_problem(tmp_path, coupling)
    residuals = problem.residuals_at(terms, values)
    step = 1e-3  # the same for all, so that only the grouping differs
    found, simulated = _count(
        problem,
        lambda: compute_jacobian(
            problem, terms, values, residuals, difference_step=step
        ),
    )
    moved = np.tile(values, (len(values), 1))
    scale = np.concatenate([t.scale for t in terms])
    reach = step * np.maximum(scale, 0.01 * np.abs(values))
    moved[np.diag_indices(len(values))] += reach
    each = (problem.compute_residuals(terms, moved) - residuals).T / reach
    assert np.allclose(found, each, rtol=1e-6, atol=1e-6 * np.abs(each).max())
    few = len(values) / 3 + 4  # one of each arm at a time, and the test of coupling
    assert (simulated <= few) == (not coupling)


@pytest.mark.parametrize("coupling", ["", COUPLED])
def test_responses_to_initial_states_are_those_of_each_alone(coupling, tmp_path):
    problem, terms, values = _make_problem(tmp_path, coupling)
    std = initial_state_std(problem.simulator, problem.segments)
    none = np.zeros_like(std)
    found, simulated = _count(
        problem, lambda: respond_to_initial_states(problem, terms, values, none, std)
    )
    moves = np.concatenate([np.zeros((1, 1, 6)), np.eye(6)[:, None]]) * std
    rows = np.tile(values, (len(moves), 1))
    before, *after = problem.compute_residuals(terms, rows, moves)
    assert np.allclose(np.concatenate([r for r, _ in found]), before)
    response = np.concatenate([s for _, s in found])
    each = (np.array(after) - before).T
    assert np.allclose(response, each, atol=1e-6 * np.abs(each).max())
    assert (simulated < 1 + 6) == (not coupling)


def test_random_errors_of_many_states_cause_what_each_causes_alone(
    tmp_path, monkeypatch
):
    problem, *_ = _make_problem(tmp_path, COUPLED)
    sums = []
    for draws in 6, 5:  # one state at a time, or random signs of all
        monkeypatch.setattr(multiple_shooting, "FIT", replace(FIT, state_draws=draws))
        offsets = multiple_shooting.build_initial_state_offsets(
            problem.simulator, problem.segments
        )
        assert len(offsets) == 1 + draws
        rows = np.zeros((len(offsets), 0))
        before, *after = problem.compute_residuals((), rows, offsets)
        sums.append(((np.array(after) - before) ** 2).sum())
    assert sums[1] == pytest.approx(sums[0], rel=0.4)
