"""What broke, from sensor series, also where robot and model differ."""

from dataclasses import replace

import pytest

from selfheal.damage.kinds import Damage
from selfheal.recovery import explain as ours
from selfheal.recovery.estimate import Trial
from selfheal.recovery.explain import estimate_damage
from selfheal.robot.simulated_legs import SimulatedLegs
from tests.support.short_recover import (
    BUILT,
    DEAF,
    FLAT,
    JAM,
    LOST,
    LOWER,
    QUADRUPED,
    ignore_progress,
    walk_before,
    walk_damaged,
)

MOTOR = Damage("weak_motor", "actuator:right_front_hip_servo", 0.4)
WORLD = [Damage("slope", value=0.1), Damage("ground_friction", value=0.2)]
MOTORS = [replace(MOTOR, value=0.3), replace(MOTOR, value=0.6)]
KNOWN = [LOST, LOWER, JAM, DEAF, *MOTORS, *WORLD]


@pytest.mark.parametrize(
    "damage",
    [
        (),
        (DEAF,),
        *(
            pytest.param(d, marks=pytest.mark.slow)
            for d in ((MOTOR,), (LOST, JAM, DEAF))
        ),
    ],
)
def test_sensor_series_identify_what_broke(damage, walker, monkeypatch):
    monkeypatch.setattr(ours, "list_single_damages", lambda robot: KNOWN)
    trial, before = walk_damaged(damage, walker), walk_before(walker)
    belief = estimate_damage(QUADRUPED, BUILT, [trial], before, (), ignore_progress)
    best = {d.place for d in belief.hypotheses[0]}
    assert best == {d.place for d in damage}
    assert belief.probability[0] == belief.probability.max()
    assert belief.probability.sum() == pytest.approx(1)


def test_nothing_broke_where_robot_and_model_differ(walker):
    robot = SimulatedLegs(QUADRUPED, 3, gap=0.1)
    before = robot.run_trials(walker[None]).sensors[0]
    trial = Trial(walker, 0.0, before)
    belief = estimate_damage(QUADRUPED, BUILT, [trial], before, (), ignore_progress)
    assert belief.hypotheses[0] == ()
    assert (belief.scale[-1] > FLAT[-1]).all()


@pytest.mark.slow
@pytest.mark.parametrize("damage", [(LOST,), (DEAF,)])
def test_a_mismatched_model_adds_no_damage_to_what_is_there(
    damage, walker, mismatched, monkeypatch
):
    world = [
        d for d in ours.list_single_damages(QUADRUPED) if d.kind in ("slope", "wind")
    ]
    monkeypatch.setattr(ours, "list_single_damages", lambda robot: [*KNOWN, *world])
    robot, before, found = mismatched
    drives = robot.struck(damage).run_trials(walker[None])
    trial = Trial(walker, float(drives.displacement[0]), drives.sensors[0])
    belief = estimate_damage(QUADRUPED, found, [trial], before, (), ignore_progress)
    assert belief.hypotheses[0] == damage
    assert 1 <= len(belief.scale) < len(before)  # no longer than predictions hold
