"""JSON documents of the shapes that people write, and JSON lines."""

import json

import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from tests.support.logs.reading import (
    FIELD,
    check_rows,
    needs_field,
    read_all,
    read_one,
)
from tests.support.logs.table_files import write_json

Q = [0.0, 0.5, 1.5, 2.0]
ROWS = [{"t": k / 10, "q": q, "leg": {"v": [q, -q]}} for k, q in enumerate(Q)]


@pytest.fixture
def write(tmp_path):
    return lambda document, name="log.json": write_json(tmp_path / name, document)


def test_runs_are_episodes_by_their_labels(write):
    runs = [
        {"type": "chirp", "targets": [], "actions": Q, "measured": [1, None, 3, 4]},
        {"type": "drop", "targets": ["kp"], "measured": [7.0, 8.0, 9.0]},
        {"type": "chirp", "actions": [Q[0]] * 5, "measured": [2.0] * 5},
    ]
    document = {"config": {"action_hz": 50, "limits": [-1, 1]}, "data": runs}
    log = open_log(write(document))
    (stream,) = log.streams
    assert (stream.period, stream.episode, stream.rows) == (0.02, "episode", 12)
    check_rows(log)
    found = read_all(log)[""]
    labels = ["chirp"] * 4 + ["drop"] * 3 + ["chirp_2"] * 5
    assert found["episode"].tolist() == labels
    np.testing.assert_equal(found["measured"][:4], [1, np.nan, 3, 4])
    assert np.isnan(found["actions"][4:7]).all()


def test_entries_of_bam_are_rows_in_seconds(write):
    usual = {"speed": 0, "torque_enable": True, "input_volts": 7.3}
    entries = [
        {"position": q, "goal_position": q, "timestamp": k * 0.02, **usual}
        for k, q in enumerate(Q)
    ]
    log = open_log(write({"mass": 0.49, "motor": "xl330", "entries": entries}))
    assert log.streams[0].time == "timestamp"
    assert log.streams[0].columns["timestamp"] == "s"
    found = read_all(log)[""]
    assert found["position"].tolist() == Q
    assert found["torque_enable"].tolist() == [1] * 4


@pytest.mark.parametrize(
    ("document", "columns"),
    [
        (ROWS, ["t", "q", "leg.v[0]", "leg.v[1]"]),
        ({"log": ROWS}, ["t", "q", "leg.v[0]", "leg.v[1]"]),
        ({"t": Q, "x": {"q": Q}, "gains": [1, 2, 3, 4, 5], "mass": 2}, None),
        ({"q": [[1, 2], [3, 4], [5]]}, ["q[0]", "q[1]"]),
        ({"runs": [{"rows": ROWS}, {"rows": ROWS}]}, None),
    ],
)
def test_rows_and_arrays_are_columns(write, document, columns):
    log = open_log(write(document))
    found = read_all(log)
    if columns:
        assert list(found[""]) == columns
    assert all(len(v) for rows in found.values() for v in rows.values())


def test_runs_by_name_are_episodes_and_parts_of_a_robot_are_not(write):
    runs = {"walk 1": {"t": Q, "q": Q}, "walk 2": {"t": Q[1:], "q": Q[1:]}}
    found = read_one(write(runs))
    assert found["episode"].tolist() == ["walk 1"] * 4 + ["walk 2"] * 3
    found = read_one(write({"run1": {"t": Q}, "run2": {"t": Q}}, "named.json"))
    assert found["episode"].tolist() == ["run1"] * 4 + ["run2"] * 4
    found = read_one(write({"left": {"q": Q}, "right": {"q": Q}}, "parts.json"))
    assert list(found) == ["left.q", "right.q"]


def test_lists_of_rows_of_several_names_are_streams(write):
    log = open_log(write({"robot": "ant", "joints": ROWS, "commands": ROWS[:2]}))
    assert log.robot == "ant"
    assert {s.name: s.rows for s in log.streams} == {"joints": 4, "commands": 2}
    check_rows(log)


def test_iso_8601_times_are_seconds_since_1970(write):
    rows = [{"when": f"1970-01-01T00:00:0{k}.5Z", "q": 1} for k in range(3)]
    assert read_one(write(rows))["when"].tolist() == [0.5, 1.5, 2.5]


@pytest.mark.parametrize("name", ["log.jsonl", "log.txt", "log.json"])
def test_json_lines_are_rows(write, name):
    lines = [json.dumps(row) for row in ROWS * 3000]
    path = write("\n".join(lines) + "\n", name)
    found = read_one(path)
    assert found["q"].tolist() == Q * 3000
    assert found["leg.v[1]"].tolist() == [-q for q in Q] * 3000
    assert len(list(open_log(path).read({"": ["q"]}))) > 1


def test_the_last_of_json_lines_may_be_cut_off(write):
    text = "".join(json.dumps(row) + "\n" for row in ROWS) + '{"t": 0.4, "q'
    log = open_log(write(text, "log.jsonl"))
    assert len(read_all(log)[""]["q"]) == 4
    assert log.losses == ["the last line is cut off"]


DEEP = ["[" * 100_000, '{"a":' * 100_000]
MANY = json.dumps([{str(k): 1} for k in range(3000)])
LONG = '{"a": [' + "1" * 5000 + "]}"


@pytest.mark.parametrize(
    "text",
    ["{", "[]", "{}", "[1, 2", '{"a": 1}', '{"a": 1}\n[1]\n', *DEEP, MANY, LONG],
)
def test_what_is_no_log_is_refused(write, text):
    with pytest.raises(InputError):
        read_all(open_log(write(text)))


RUNS = {"dataset": 100, "response": 96, "real-action-state-dataset": 32}
RUNS |= {f"drop-response-{k}": 1 for k in range(1, 5)}


@needs_field
@pytest.mark.parametrize(("name", "runs"), RUNS.items())
def test_public_servo_runs_are_read(name, runs):
    log = open_log(FIELD / "servo_50hz" / f"{name}.json")
    check_rows(log)
    (stream,) = log.streams
    assert list(stream.columns) == ["actions", "sensor_data", "episode"]
    assert (stream.period, stream.episode) == (0.02, "episode")
    assert len(set(read_all(log)[""]["episode"])) == runs
