"""Searches for what a whole drive lacks, and for what only long segments show."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.diagnose import diagnose
from tests.support.recorded_robots import NO_COMMAND, ROBOTS, Robot, record

ANGLES = ("shoulder", "elbow")
ARM = replace(ROBOTS["arm"], signals={n: ("joint_position", n, "rad") for n in ANGLES})
DRY, ROTOR = (0.12, 0.05), (0.03, 0.008)
FREE = """<mujoco model="free"><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body name="rod"><joint name="hinge" axis="0 1 0"/>
<geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/>
</body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """An arm of which the model lacks dry friction and a rotor at both joints."""

    def change(model):
        model.dof_frictionloss[:] = DRY
        model.dof_armature[:] += ROTOR

    path = tmp_path_factory.mktemp("arm") / "model.xml"
    path.write_text(ARM.xml)
    return diagnose(path, [record(ARM, episodes=3, seconds=3.0, seed=4, change=change)])


@pytest.mark.slow
def test_all_that_a_drive_lacks_is_named_at_every_joint(drive):
    found = {(f["effect"], f["target"]): f for f in drive.document["findings"]}
    joints = ("joint:shoulder", "joint:elbow")
    assert set(found) == {
        (effect, joint)
        for effect in ("coulomb_friction", "armature")
        for joint in joints
    }
    assert drive.document["verdict"] == "explained"
    for joint, value in zip(joints, DRY, strict=True):
        (friction,) = found["coulomb_friction", joint]["parameters"]
        assert friction["value"] == pytest.approx(value, rel=0.15)


@pytest.mark.slow
def test_errors_are_given_over_longer_and_longer_segments(drive):
    horizons = drive.document["fit"]["horizons"]
    seconds = [h["seconds"] for h in horizons]
    assert len(seconds) > 1 and seconds == sorted(seconds)
    for horizon in horizons:
        assert horizon["floor"] <= horizon["patched"] < horizon["refit"]


@pytest.mark.slow
def test_a_free_pendulum_that_loses_its_energy_slowly_is_heard(tmp_path):
    """Half a second shows nothing of it."""
    robot = Robot(
        FREE,
        {"angle": ("joint_position", "hinge", "rad")},
        NO_COMMAND,
        lambda rng: (rng.uniform(0.5, 1.0, 1), np.zeros(1)),
    )
    damping = 2e-4

    def change(model):
        model.dof_damping[0] = damping

    path = tmp_path / "model.xml"
    path.write_text(FREE)
    recording = record(robot, episodes=3, seconds=9.0, seed=1, change=change)
    said = diagnose(path, [recording]).document
    (finding,) = said["findings"]
    assert finding["effect"] == "viscous_friction"
    (value,) = finding["parameters"]
    assert value["low"] < damping < value["high"]
