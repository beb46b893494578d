"""Predicted readings are those of the moment at which they are read."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from tests.support.recorded_robots import ROBOTS, bench


@pytest.mark.parametrize("acting", [[], ["quadratic_damping", "joint_coupling"]])
def test_motion_is_sensed_to_second_order_in_the_step(acting, tmp_path):
    """A gyroscope's readings depend on pose and speed at once."""
    b = bench("gimbal", tmp_path, episodes=2, seconds=0.8, noise=0.0)
    terms = [find_effect(name).propose_terms(b.robot)[0] for name in acting]
    # little: a drag by the speed of half a step before is of first order
    values = 0.01 * np.concatenate([np.zeros(0), *(t.initial_values[0] for t in terms)])
    simulator, predicted = b.simulator, []
    for _ in range(3):
        segments = cut_segments(simulator.episodes, None)
        predicted.append(simulator.leapfrog.simulate(terms, values[None], segments)[0])
        simulator = simulator.with_half_step
    coarse, fine = (np.abs(a - b).max(axis=0) for a, b in pairwise(predicted))
    assert (coarse > 3 * fine - 1e-12).all()  # 2 if of first order, and 4


def test_torques_are_read_of_the_command_that_holds_then(tmp_path):
    """Commands jump between two steps; steps are whole ones and halves."""
    plain = ROBOTS["arm"].xml.replace('kp="10" kv="0.4"', 'kp="10"')
    b = bench(replace(ROBOTS["arm"], xml=plain), tmp_path, episodes=1, seconds=0.5)
    rng = np.random.default_rng(0)
    (first,) = b.recording.episodes.values()
    time = np.append(0, np.cumsum(rng.uniform(0.0047, 0.0062, first.time.size - 1)))
    ctrl = rng.normal(size=first.ctrl.shape)
    episode = replace(first, time=time, ctrl=ctrl)
    compiler = ModelCompiler(str(b.path))
    simulator = build_simulator(
        compiler, [replace(b.recording, episodes={"jumps": episode})]
    )
    (c,) = [c for c in simulator.channels if c.kind == "joint_torque"]
    a = compiler.nominal.actuator(c.target).id
    gain = compiler.nominal.actuator_gainprm[a, 0]
    q = next(i.first_column for i in simulator.channels if i.name == "elbow")
    for own in (simulator, simulator.with_half_step):
        segments = cut_segments(own.episodes, None)
        predicted = own.leapfrog.simulate((), np.zeros((1, 0)), segments)[0]
        servo = gain * (ctrl[:, a] - predicted[:, q])
        np.testing.assert_allclose(predicted[:, c.first_column], servo, atol=1e-9)
