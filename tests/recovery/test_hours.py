"""Hours of walking: each heal goes on from the last, and every alarm is told once."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.damage.apply import Strike
from selfheal.damage.kinds import Damage
from selfheal.errors import InputError, RunFileError
from selfheal.gait.synthesis import measure_distance
from selfheal.recovery.hours import (
    PAUSE,
    check_hours,
    heal_for_hours,
    list_believed,
    list_events,
    list_walks,
)
from selfheal.recovery.phased_run import load_phased_run, save_phased_run
from selfheal.recovery.phases import LEARNING_TIME
from selfheal.recovery.record import HealRun, HealSettings
from selfheal.report.heal import describe_alarm
from selfheal.report.hours import format_events, make_hours_page
from tests.support.browser import draw_nothing
from tests.support.killed_process import format_run
from tests.support.short_heal import BODY, robot

pytestmark = pytest.mark.usefixtures("short_heal")
DEAD = Damage("sensor_dead", "sensor:clearance")
WEAK = Damage("weak_motor", "actuator:left_hip_servo", 0.3)
STRIKES = (Strike(80.0, DEAD), Strike(130.0, WEAK))
SETTINGS = HealSettings(
    "run.h5",
    tuple(s.damage for s in STRIKES),
    seed=1,
    hours=230 / 3600,
    onsets=tuple(s.time for s in STRIKES),
)


def _walk(run=None):
    return list(heal_for_hours(robot(), BODY, np.ones(1), SETTINGS, run=run))


@pytest.fixture(scope="module")
def steps(short_heal):
    """A dead sensor, then a weak motor, phase by phase."""
    return _walk()


def test_each_damage_is_noticed_and_found_on_top_of_the_last(steps):
    run = steps[-1]
    events = run.result["events"]
    assert [e["time"] for e in events] == [80.0, 130.0]
    for event in events:
        assert 0 <= event["delay"] <= 5
        assert event["right"]
    believed = list_believed(run.heals[:2])
    assert [d.place for d in believed] == [s.damage.place for s in STRIKES]
    assert run.result["false_alarms"] == 0


def test_the_next_heal_begins_at_the_alarm_with_the_gait_that_was_found(steps):
    first, second, *_ = steps[-1].heals
    assert second.phases["gait"] is first.phases["healed"]
    starts = [start for start, _, _ in list_walks(steps[-1])]
    assert first.phases["alarm"]["alarm"]["time"] in starts
    walks = list_walks(steps[-1])
    ends = [start + seconds for start, seconds, _ in walks]
    assert starts[1:] == pytest.approx(ends[:-1])


def test_terminal_page_and_json_have_the_alarm_from_one_field(steps):
    run = steps[-1]
    with draw_nothing():
        page = make_hours_page(run, BODY)
    for heal, event, row in zip(
        run.heals, run.result["events"], format_events(run.result), strict=False
    ):
        alarm = heal.phases["alarm"]["alarm"]
        assert event["alarm"]["time"] == alarm["time"]
        assert row[2] in describe_alarm(alarm, None)
        assert f">{row[2]}<" in page


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gait", "alarm of 1", "first of 1", "alarm of 2"])
def test_hours_that_were_killed_go_on_to_the_same_end(steps, tmp_path, name):
    (begun,) = (s for s in steps if [*s.phases][-1] == name and not s.result)
    save_phased_run(begun, tmp_path / "heal.h5")
    kept = load_phased_run(tmp_path / "heal.h5", HealRun)
    assert format_run(_walk(kept)[-1]) == format_run(steps[-1])


def test_a_file_of_hours_is_read_as_it_was_written(steps, tmp_path):
    save_phased_run(steps[-1], tmp_path / "heal.h5")
    kept = load_phased_run(tmp_path / "heal.h5", HealRun)
    assert kept.settings == SETTINGS
    assert format_run(kept) == format_run(steps[-1])


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"onsets": (80.0,)}, "onsets"), ({"hours": 0.0}, "onsets")],
)
def test_settings_whose_times_do_not_fit_are_refused(steps, tmp_path, changes, said):
    wrong = replace(steps[0], settings=replace(SETTINGS, **changes), phases={})
    save_phased_run(wrong, tmp_path / "heal.h5")
    with pytest.raises(RunFileError, match=said):
        load_phased_run(tmp_path / "heal.h5", HealRun)


def test_an_alarm_too_many_in_the_result_is_refused(steps, tmp_path):
    events = steps[-1].result["events"]
    wrong = {**steps[-1].result, "events": [*events, events[-1]]}
    save_phased_run(replace(steps[-1], result=wrong), tmp_path / "heal.h5")
    with pytest.raises(RunFileError, match="how many alarms"):
        load_phased_run(tmp_path / "heal.h5", HealRun)


def _make_run(alarms, strikes):
    """Hours with alarms at times and damages at others, and nothing else of note."""
    none = {"kind": "none", "target": "world", "value": 0.0, "probability": 1.0}
    phases = {"gait": {}}
    for k, time in enumerate([*alarms, None], 1):
        alarm = {"time": time, "sensor": "clearance", "p_value": 0.0}
        phases |= {
            f"whole of {k}": {"distance": 1.0},
            f"alarm of {k}": {"alarm": alarm if time else None},
            f"verdict of {k}": {"believed": [none]},
            f"healed of {k}": {},
            f"first of {k}": {"distance": 1.0},
            f"walked of {k}": {"damaged": 1.0, "healed": 1.0},
        }
    damage, onsets = (DEAD,) * len(strikes), tuple(map(float, strikes))
    return HealRun(HealSettings("", damage, hours=1.0, onsets=onsets), phases)


@pytest.mark.parametrize(
    ("alarms", "strikes", "expected"),
    [
        ([100.0], [99], [(99.0, 100.0)]),
        ([100.0], [], [(None, 100.0)]),  # false
        ([], [99], [(99.0, None)]),  # missed
        ([100.0], [50, 99], [(50.0, None), (99.0, 100.0)]),  # missed, noticed
        ([100.0, 200.0], [99], [(99.0, 100.0), (None, 200.0)]),
        ([100.0], [150], [(None, 100.0), (150.0, None)]),
        ([100.0], [5000], [(None, 100.0)]),  # it never came to that
    ],
)
def test_an_alarm_is_for_the_last_damage_before_it_or_false(alarms, strikes, expected):
    events = list_events(_make_run(alarms, strikes), 3600.0)
    onsets = [event["damage"] and event["time"] for event in events]
    alarmed = [event["alarm"] and event["alarm"]["time"] for event in events]
    assert list(zip(onsets, alarmed, strict=True)) == expected


@pytest.mark.parametrize("hours", [0.0, -1.0, 0.03, 1e9, np.nan])
def test_hours_that_make_no_sense_are_refused(hours):
    with pytest.raises(InputError, match=r"would fit: 0\.031 "):
        check_hours(hours)


def test_a_way_counts_where_it_curves_and_not_where_it_rocks_or_slides():
    time, still = 0.05 * np.arange(1, 601), np.zeros(600)
    turn = np.radians(1.5) * time  # 15 degrees in 10 s, along the tangent
    path = np.stack([np.sin(turn), 1 - np.cos(turn), still], axis=1)
    faced = np.stack([np.cos(turn / 2), still, still, np.sin(turn / 2)], axis=1)
    assert measure_distance(path, faced, 0.0) == pytest.approx(turn[-1], rel=0.02)
    back = measure_distance(path, faced, np.pi)
    assert back == pytest.approx(-measure_distance(path, faced, 0.0))
    ahead = np.tile([1.0, 0, 0, 0], (600, 1))
    for along in ([0.1 * np.sin(2 * np.pi * time), still], [still, time]):
        path = np.stack([*along, still], axis=1)
        assert abs(measure_distance(path, ahead, 0.0)) < 0.1
    assert LEARNING_TIME < PAUSE
