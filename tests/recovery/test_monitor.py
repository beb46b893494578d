"""The monitor: silent while nothing changes, soon loud when something does."""

import numpy as np
import pytest

from selfheal.engine.walk import SAMPLE, list_channels
from selfheal.recovery.monitor import (
    PoseReadings,
    compute_threshold,
    learn_baseline,
    watch_poses,
    watch_walk,
)
from selfheal.robot.actions import load_published_body

CHANNELS = list_channels(load_published_body().anatomy)
CYCLE, COUNT = 1.2, len(CHANNELS.names)


def _walk(seconds, seed):
    """Channels of a made-up walk: a wave each, noise, and a place that moves on."""
    rng = np.random.default_rng(seed)
    time = np.arange(1, round(seconds / SAMPLE) + 1) * SAMPLE
    phase = 2 * np.pi * time[:, None] / CYCLE + np.arange(COUNT)
    out = 10 * np.sin(phase) + rng.normal(0, 1, (len(time), COUNT))
    touch = [k for k, name in enumerate(CHANNELS.names) if name.endswith("_touch")]
    out[:, touch] = out[:, touch] > 0
    out[:, -2:] = np.cumsum(rng.normal(5, 1, (len(time), 2)), axis=0)
    return out


MODEL = 0.9 * _walk(60, 0)  # a prediction that is a little off
KNOWN = learn_baseline(_walk(30, 1), MODEL[:600], CYCLE, CHANNELS)


def _watch(felt):
    return watch_walk(felt, MODEL[: len(felt)], KNOWN, CHANNELS)


def test_no_alarm_in_walks_like_those_learned_from():
    assert not any(_watch(_walk(60, seed)).alarm for seed in range(2, 22))


@pytest.mark.parametrize("channel", ["tilt left/right", "left_hip_position", "x"])
def test_a_change_is_noticed_in_two_cycles_and_named(channel):
    felt, onset = _walk(60, 30), 24.0
    rows = slice(round(onset / SAMPLE), None)
    k = CHANNELS.names.index(channel)
    if channel == "x":
        felt[rows, -2:] = felt[rows.start, -2:]  # it does not get on any more
    else:
        felt[rows, k] += 15
    alarm = _watch(felt).alarm
    assert alarm is not None
    assert onset <= alarm.time <= onset + 2 * CYCLE + 0.1
    assert alarm.since == pytest.approx(onset, abs=CYCLE)
    assert alarm.sensor == CHANNELS.sensors[k]
    assert alarm.p_value < 0.01


def test_a_dead_sensor_is_noticed():
    felt = _walk(60, 31)
    k = CHANNELS.names.index("clearance")
    felt[:, k] += 60
    known = learn_baseline(felt[:600], MODEL[:600], CYCLE, CHANNELS)
    felt[800:, k] = 0.0
    alarm = watch_walk(felt, MODEL, known, CHANNELS).alarm
    assert alarm is not None and alarm.sensor == "clearance"


def _missing_lifts(seconds, rate, rng):
    """A walk in which each foot lifts once a cycle, or by chance does not."""
    out, now = _walk(seconds, int(rng.integers(1e9))), np.arange(1200) * SAMPLE
    for k in [k for k, name in enumerate(CHANNELS.names) if name.endswith("_touch")]:
        lifts = rng.random(round(seconds / CYCLE) + 1) > rate
        share = now[: len(out)] / CYCLE
        # a lift lies across the end of a quarter: two windows see it, or neither
        in_lift = np.abs(share % 1 - 0.5) < 0.1
        out[:, k] = 1 - in_lift * lifts[share.astype(int)]
    return out


def test_a_foot_that_by_chance_stays_down_for_some_cycles_raises_no_alarm():
    rng, alarms = np.random.default_rng(40), 0
    for rate in rng.random(40):  # 40 minutes in all: under one alarm is allowed
        learned = _missing_lifts(30, rate, rng)
        known = learn_baseline(learned, MODEL[:600], CYCLE, CHANNELS)
        seen = watch_walk(_missing_lifts(60, rate, rng), MODEL, known, CHANNELS)
        alarms += seen.alarm is not None
    assert alarms <= 2


def test_the_threshold_is_higher_where_there_is_more_to_go_wrong():
    assert compute_threshold(0.6, CHANNELS) > compute_threshold(1.2, CHANNELS)


def test_poses_are_judged_each_by_itself():
    felt = np.random.default_rng(5).normal(size=(36, COUNT - 2))
    felt[:, 5] = np.nan
    readings = PoseReadings(felt, np.zeros_like(felt), np.ones(COUNT - 2))
    assert watch_poses(readings, CHANNELS) is None
    felt[20, 1] = 40.0
    alarm = watch_poses(readings, CHANNELS)
    assert alarm is not None
    assert (alarm.time, alarm.sensor) == (21.0, "vertical")
