"""What is known of a robot's joints from its model and recordings."""

import pytest

from tests.support.recorded_robots import bench


def test_what_neither_weighs_nor_is_driven_is_loaded_as_it_moves(tmp_path):
    """Else no effect could be as large there as what is hidden."""
    for joint in bench("gimbal", tmp_path, episodes=1, seconds=1.0).robot.joints:
        assert joint.speed > 1 and joint.torque > joint.inertia * joint.speed


def test_what_no_reading_tells_moves_as_the_model_does(tmp_path):
    """An elbow that is not read is as large, fast and loaded as one that is."""
    full, half = (
        bench(name, _made(tmp_path / name), episodes=1, seconds=2.0, seed=4).robot
        for name in ("arm", "half_seen_arm")
    )
    seen, unseen = (s.joints[1] for s in (full, half))
    assert seen.measured and not unseen.measured
    for part in ("range", "speed", "torque"):
        expected = getattr(seen, part)
        assert getattr(unseen, part) == pytest.approx(expected, rel=0.3), part


def _made(folder):
    folder.mkdir()
    return folder
