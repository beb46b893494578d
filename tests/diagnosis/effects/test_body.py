"""Effects of bodies: where they have a place, and how large they may be."""

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.simulation.build import build_simulator, summarize_robot
from tests.support.effect_robots import make_pendulum
from tests.support.problems import make_problem
from tests.support.recorded_robots import bench, change_readings


def test_a_hand_may_bear_as_much_as_all_that_moves(benches):
    b = benches["arm"]
    for term in find_effect("payload").propose_terms(b.robot):
        assert term.high[0] >= sum(body.mass for body in b.robot.bodies)


def test_a_hand_carries_what_the_arm_that_it_is_fixed_to_does_not(tmp_path):
    hand = """<body name="hand" pos="0 0 -0.2"><geom size="0.03" mass="0.1"/>
      <body name="tip" pos="0 0 -0.05"/></body></body></worldbody>"""
    b = make_pendulum(tmp_path, **{"</body>\n  </worldbody>": hand})
    targets = {
        name: [t.targets for t in find_effect(name).propose_terms(b.robot)]
        for name in ("payload", "com_shift", "mount_shift")
    }
    assert targets == {
        "payload": [("body:hand",)],
        "com_shift": [("body:rod",), ("body:hand",)],
        "mount_shift": [("body:hand",)],  # the tip weighs nothing
    }


def test_a_joint_that_stops_moving_may_have_jammed_where_it_stays(tmp_path):
    effect = find_effect("joint_jam")
    b = bench("arm", tmp_path, episodes=4, seconds=1.0)
    assert not effect.propose_terms(b.robot)
    angle, noise = 0.3, 1e-3
    rng = np.random.default_rng(0)
    recording = change_readings(
        b.recording,
        lambda values: angle + noise * rng.normal(size=values.shape),
        episodes=[list(b.recording.episodes)[-1]],
        signals=["elbow"],
    )
    simulator = build_simulator(b.simulator.compiler, [recording])
    (jam,) = effect.propose_terms(summarize_robot(simulator))
    assert jam.targets == ("joint:elbow",)
    assert jam.initial_values[0][0] == pytest.approx(angle, abs=3 * noise)


@pytest.mark.parametrize("name", ["com_shift", "mount_shift", "payload"])
def test_some_initial_value_of_each_shift_changes_the_motion(arm, name):
    """A score test goes by the responses to initial values alone."""
    problem = make_problem(arm)
    none = problem.compute_residuals((), np.zeros((1, 0)))
    for term in find_effect(name).propose_terms(arm.robot):
        values = np.array(term.initial_values)
        changed = problem.compute_residuals((term,), values) - none
        assert np.abs(changed).max() > 0.1, term.label
