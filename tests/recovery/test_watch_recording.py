"""Watching a recorded walk: when it stopped fitting the robot's body."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.errors import RecordingError
from selfheal.recording import read
from selfheal.recovery.watch_recording import watch_recording
from tests.support.short_heal import BODY


def test_watch_says_when_a_recording_stopped_fitting(walks):
    whole, broken = (watch_recording(BODY, walk)[0] for walk in walks)
    assert whole["alarm"] is None
    assert whole["cycle"] == pytest.approx(1.4, abs=0.02)
    assert broken["alarm"]["time"] == pytest.approx(26.5, abs=1.5)


def test_watch_bears_missing_samples_and_a_clock_that_starts_late(walks):
    (episode,) = walks[1].episodes.values()
    signals = dict(episode.signals)
    del signals["clearance"]
    gaps = signals["vertical"].values.copy()
    gaps[3::7] = np.nan
    signals["vertical"] = replace(signals["vertical"], values=gaps)
    late = replace(episode, time=episode.time + 1000, signals=signals)
    found = watch_recording(BODY, replace(walks[1], episodes={"late": late}))[0]
    assert found["alarm"]["time"] == pytest.approx(1026.5, abs=1.5)


@pytest.mark.parametrize("name, width", [("vertical", 2), ("clearance", 3)])
def test_watch_refuses_a_signal_with_too_many_or_too_few_columns(walks, name, width):
    (episode,) = walks[0].episodes.values()
    values = np.zeros((episode.time.size, width))
    signals = episode.signals | {
        name: replace(episode.signals[name], values=values, kind="sensor")
    }
    wrong = replace(walks[0], episodes={"a": replace(episode, signals=signals)})
    with pytest.raises(RecordingError, match=f"signal '{name}': shape .*would fit"):
        watch_recording(BODY, wrong)


def test_watch_distinguishes_the_damaged_robot_of_2006_from_the_whole_one(
    shared_recordings,
):
    folder = shared_recordings / "starfish_2006"
    whole, broken = (
        watch_recording(BODY, read(folder / name))[0]
        for name in ("intact.h5", "damaged.h5")
    )
    assert whole["alarm"] is None
    assert broken["episode"] == "down_1_3"
    assert broken["alarm"]["sensor"] == "vertical"
