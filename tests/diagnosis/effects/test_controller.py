"""What controllers do that models do not say: clocks, torque constants, servos."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.commands import CommandGrid
from tests.support.effect_robots import find_elbow_term, make_effect_bench, predict
from tests.support.recorded_robots import ROBOTS


def test_two_clocks_delay_the_commands_of_all_actuators_alike(benches):
    b = benches["arm"]
    (shift,) = find_effect("clock_shift").propose_terms(b.robot)
    *_, shared = find_effect("command_delay").propose_terms(b.robot)
    assert shift.targets == ("world",) and len(shared.targets) == 2
    np.testing.assert_allclose(
        predict(b, (shift, 0.03)), predict(b, (shared, 0.03)), atol=1e-12
    )


def test_servos_of_one_make_have_one_rate_limit(benches):
    b = benches["arm"]
    *single, shared = find_effect("rate_limit").propose_terms(b.robot)
    assert len(shared.targets) == len(single) == 2
    np.testing.assert_allclose(
        predict(b, (shared, 0.4)),
        predict(b, (single[0], 0.4), (single[1], 0.4)),
        atol=1e-12,
    )


def test_a_slide_and_a_hinge_have_no_rate_in_common(tmp_path):
    robot = ROBOTS["arm"]
    hinge = '<joint name="elbow" type="hinge"'
    xml = robot.xml.replace(hinge, hinge.replace("hinge", "slide"))
    b = make_effect_bench(replace(robot, xml=xml), tmp_path)
    terms = find_effect("rate_limit").propose_terms(b.robot)
    assert [len(t.targets) for t in terms] == [1, 1]
    assert {t.parameters[0].unit for t in terms} == {"rad/s", "m/s"}


def test_commands_that_come_early_undo_late_ones(benches):
    b = benches["arm"]
    (shift,) = find_effect("clock_shift").propose_terms(b.robot)
    grid = np.sin(np.arange(400) / 20)[None, :, None] * np.ones(2)
    late, early = (
        shift.effect.transform_command(
            grid, CommandGrid(0.002), shift.places[0], np.array([[s]])
        )
        for s in (0.02, -0.02)
    )
    np.testing.assert_allclose(late[0, 20:], early[0, :-20], atol=1e-12)


def test_a_drive_reports_the_torque_that_it_commands(benches):
    """Motors of 0.6 of their gains move alike, and report 0.6 of the torque."""
    b = benches["arm"]
    (term,) = find_effect("torque_constant").propose_terms(b.robot)
    weak = find_effect("servo_gain").propose_terms(b.robot)
    gains = (0.6 * np.array([p.nominal for p in t.parameters]) for t in weak)
    by_constant = predict(b, (term, 0.6))
    by_gains = predict(b, *zip(weak, gains, strict=True))
    (torque,) = (c for c in b.simulator.channels if c.kind == "joint_torque")
    by_gains[:, torque.columns] /= 0.6
    np.testing.assert_allclose(by_constant, by_gains, atol=1e-9)


def test_a_servo_that_feeds_forward_what_its_damping_takes_lags_less(tmp_path):
    def ramp(t, rng):
        return 0.5 * t[:, None] * np.ones(2)

    xml = ROBOTS["arm"].xml.replace('kv="0.4"', 'kv="2"')
    robot = replace(
        ROBOTS["arm"],
        xml=xml.replace("<option ", '<option gravity="0 0 0" '),
        command=ramp,
        begin=lambda rng: (np.zeros(2), np.zeros(2)),
    )
    b = make_effect_bench(robot, tmp_path)
    term = find_elbow_term(b, "velocity_feedforward")
    assert term.initial_values == ((0.2,),)
    (elbow,) = (c for c in b.simulator.channels if c.name == "elbow")
    last = b.segments.sample_steps == b.segments.sample_steps.max()
    goal = 0.5 * 0.79
    plain, fed = b.plain[last], predict(b, (term, 0.2))[last]
    lag, left = (np.abs(x[:, elbow.columns] - goal).max() for x in (plain, fed))
    assert lag > 0.08 and left < 0.3 * lag


@pytest.mark.parametrize(("width", "moves"), [(0.2, True), (3.0, False)])
def test_below_a_dead_band_nothing_moves(width, moves, tmp_path):
    """The cart's motor pushes with 2 N at most."""
    b = make_effect_bench(
        replace(ROBOTS["cart_pole"], begin=lambda rng: (np.zeros(2), np.zeros(2))),
        tmp_path,
    )
    (term,) = find_effect("dead_band").propose_terms(b.robot)
    assert (np.abs(predict(b, (term, width))).max() > 1e-3) == moves


def test_a_servos_error_within_its_dead_band_is_not_corrected(tmp_path):
    still = '<option gravity="0 0 0" '
    robot = replace(
        ROBOTS["pendulum"],
        xml=ROBOTS["pendulum"].xml.replace("<option ", still),
        command=lambda t, rng: np.full((t.size, 1), 0.1),
        begin=lambda rng: (np.zeros(1), np.zeros(1)),
    )
    b = make_effect_bench(robot, tmp_path)
    (term,) = find_effect("dead_band").propose_terms(b.robot)
    kp = 3
    assert np.abs(predict(b, (term, 0.11 * kp))).max() < 1e-9
    # from beyond the band it moves to within it
    left = 0.1 - predict(b, (term, 0.06 * kp))[-1, 0]
    assert abs(left) < 0.062
