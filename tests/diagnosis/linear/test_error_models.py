"""Laws of the errors that linear models are made of."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.base import Onset
from selfheal.diagnosis.linear.cross_validation import compute_gains
from selfheal.diagnosis.linear.fit import add_terms, start_fit
from selfheal.diagnosis.linear.measurement import measure_motion
from selfheal.diagnosis.linear.ranking import propose_directions, rank
from selfheal.diagnosis.linear.search import Search
from selfheal.diagnosis.linear.segment_errors import SegmentErrors
from selfheal.diagnosis.linear.torque_balance import TorqueBalance
from tests.support.problems import list_nominal_terms, make_problem
from tests.support.recorded_robots import ROBOTS, bench

NAMES = ("coulomb_friction", "viscous_friction", "armature", "command_delay")


@pytest.fixture(scope="module")
def balance(tmp_path_factory):
    """The balance of torques of an arm, and its terms by effect."""
    how = {"episodes": 3, "seconds": 4.0, "seed": 4}
    b = bench(ROBOTS["arm"], tmp_path_factory.mktemp("arm"), **how)
    motion = measure_motion(b.simulator, np.random.default_rng(0))
    return TorqueBalance(motion), b.robot


def propose(robot, name: str):
    """The effect's first term."""
    return find_effect(name).propose_terms(robot)[0]


@pytest.mark.parametrize("name", ["joint_coupling", "cogging"])
def test_a_force_law_changes_errors_as_forward_dynamics_say(name, balance):
    model, robot = balance
    term = propose(robot, name)
    values = np.array(term.initial_values[:2], float)
    errors = model.compute_errors((), np.zeros((1, 0)))
    short = model.compute_changes((term,), values, errors).values
    long = model.compute_errors((term,), values).values - errors.values
    assert np.abs(long).max() > 0
    assert short == pytest.approx(long, abs=1e-6 * np.abs(long).max())


def test_friction_under_load_sees_the_load(balance):
    model, robot = balance
    term = propose(robot, "load_dependent_friction")
    errors = model.compute_errors((), np.zeros((1, 0)))
    changes = model.compute_changes((term,), np.array([[0.1], [0.2]]), errors).values
    assert np.linalg.norm(changes[0]) > 0.01 * np.linalg.norm(errors.values)
    assert np.linalg.norm(changes[1]) > 1.5 * np.linalg.norm(changes[0])


def test_what_sets_in_changes_nothing_before(balance):
    model, robot = balance
    term, onset = propose(robot, "viscous_friction"), Onset(1, "1", 2.0, 1.9, 2.1)
    values = np.array([[0.5]])
    without, always, later = (
        model.compute_errors(terms, v).values.reshape(model.rows, -1)
        for terms, v in (
            ((), np.zeros((1, 0))),
            ((term,), values),
            ((replace(term, onset=onset),), values),
        )
    )
    acts = model.motion.find_active_terms([replace(term, onset=onset)])[:, 0]
    assert 0.3 < acts.mean() < 0.7
    assert later[acts] == pytest.approx(always[acts], abs=1e-9)
    assert later[~acts] == pytest.approx(without[~acts], abs=1e-9)


def test_predictions_of_segments_tell_what_is_missing_and_where(arm):
    dry, late = (
        find_effect(name).propose_terms(arm.robot)[1]
        for name in ("coulomb_friction", "command_delay")
    )
    problem = make_problem(arm, (dry, late), (0.1, 0.012))
    candidates = [t for n in NAMES for t in find_effect(n).propose_terms(arm.robot)]
    start = start_fit(SegmentErrors(problem), list_nominal_terms(arm))
    fit = Search(start, candidates).run()
    found = {t.key: v for t, v in zip(fit.named, fit.named_values, strict=True)}
    assert set(found) == {dry.key, late.key}
    assert found[dry.key] == pytest.approx([0.1], rel=0.15)
    assert found[late.key] == pytest.approx([0.012], rel=0.15)


def test_only_what_is_missing_predicts_blocks_better(arm):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)
    problem = make_problem(arm, (dry[1],), (0.1,))
    fit = start_fit(SegmentErrors(problem), list_nominal_terms(arm))

    def add(before, term):
        found = propose_directions(before, term)
        _, move, coordinates = rank(before, [(d,) for d in found])[0]
        return add_terms(before, move, coordinates)

    right = add(fit, dry[1])
    gains = compute_gains(fit, right)
    assert gains.sum() > 2 * gains.std() * np.sqrt(len(gains)) > 0
    gains = compute_gains(right, add(right, dry[0]))
    assert gains.sum() < 2 * gains.std() * np.sqrt(len(gains))
