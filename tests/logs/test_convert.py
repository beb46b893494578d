"""Logs become recordings: values, times, commands and episodes are those of the log."""

import mujoco
import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.logs.convert import import_logs
from selfheal.recording import read
from tests.support.logs.table_log import LEG, TableLog, make_map

MODEL = mujoco.MjModel.from_xml_string(LEG)
COMMANDS = """
[[signals]]
kind = "command"
columns = ["u_hip", "u_knee"]
targets = ["hip", "knee"]
"""
POSITION = """
[[signals]]
kind = "joint_position"
columns = ["q_hip"]
targets = ["hip"]
"""
ALL = f'[time]\ncolumn = "t"\n{COMMANDS}{POSITION}'


def _table(rows=50, start=0.0):
    rng = np.random.default_rng(rows)
    columns = ("u_hip", "u_knee", "q_hip", "v")
    table = {"t": start + 0.01 * np.arange(rows)}
    return table | {name: rng.normal(size=rows) for name in columns}


def _import(log, text, tmp_path, **more):
    logs = log if isinstance(log, list) else [log]
    made = import_logs(logs, make_map(text), MODEL, tmp_path / "rec.h5", **more)
    return read(tmp_path / "rec.h5"), made


def test_a_table_comes_back_as_it_was(tmp_path):
    table = _table(start=12.3)
    recording, made = _import(TableLog({"": table}), ALL, tmp_path)
    (episode,) = recording.episodes.values()
    assert episode.ctrl_names == ("hip", "knee")
    assert (episode.ctrl == np.column_stack([table["u_hip"], table["u_knee"]])).all()
    signal = episode.signals["hip_position"]
    assert (signal.kind, signal.target, signal.unit) == ("joint_position", "hip", "rad")
    assert (signal.values == table["q_hip"]).all()
    assert episode.time == pytest.approx(table["t"] - 12.3)
    assert made.episodes[0].start == 12.3
    commands = ["command of hip", "command of knee"]
    positions = ["joint_position of hip"]
    assert made.assumed == {"the model's unit": commands, "rad": positions}


def test_blocks_of_a_long_log_make_one_recording(tmp_path):
    time, late = np.arange(450_000) / 1000, np.arange(90_000) / 200 + 0.0005
    table = {"t": time} | {
        n: np.sin(time + k) for k, n in enumerate(("u_hip", "u_knee"))
    }
    streams = {"a": table, "b": {"t": late, "w": late}}
    text = (
        f'[time]\ncolumn = "t"\n{COMMANDS}[[signals]]\nkind = "joint_velocity"\n'
        'columns = "b:w"\ntargets = ["knee"]\n'
    )
    recording, _ = _import(TableLog(streams, piece=50_000), text, tmp_path)
    episode = recording.episodes["000"]
    assert episode.time == pytest.approx(np.union1d(time, late), abs=1e-9)
    speeds = episode.signals["knee_velocity"].values
    is_read = np.isin(np.union1d(time, late), late)
    np.testing.assert_array_equal(speeds, np.where(is_read, episode.time, np.nan))
    held = np.searchsorted(time, episode.time + 1e-9, side="right") - 1
    np.testing.assert_array_equal(episode.ctrl[:, 1], table["u_knee"][held])


@pytest.mark.parametrize(
    "rule, expected",
    [
        ('unit = "deg"', np.deg2rad),
        ("sign = -1\noffset = 0.5", lambda x: 0.5 - x),
        ("scale = [2.0]\nunit = 'turn'", lambda x: 4 * np.pi * x),
        ("from_range = [0, 100]\nto_range = [-1, 1.5]", lambda x: -1 + x / 40),
        (
            "from_range = [0, 100]\nto_range = [-1, 1.5]\nsign = -1",
            lambda x: -1 - x / 40,
        ),
    ],
)
def test_a_column_is_converted_as_its_rule_says(rule, expected, tmp_path):
    table = _table()
    text = f'[time]\ncolumn = "t"\n{COMMANDS}{POSITION}{rule}\n'
    recording, _ = _import(TableLog({"": table}), text, tmp_path)
    values = recording.episodes["000"].signals["hip_position"].values
    assert values == pytest.approx(expected(table["q_hip"]), abs=1e-12)


def test_a_command_is_held_and_a_reading_is_not(tmp_path):
    streams = {
        "/cmd": {"t": [0.0, 0.1, 0.2], "a": [1.0, 2.0, 3.0], "b": [4.0, np.nan, 6.0]},
        "/state": {"t": [-0.05, 0.05, 0.1, 0.15], "q": [9.0, 7.0, 8.0, np.nan]},
    }
    text = (
        '[time]\ncolumn = "t"\n[[signals]]\nkind = "command"\ncolumns = ["a", "b"]\n'
        'targets = ["hip", "knee"]\n[[signals]]\nkind = "joint_position"\n'
        'columns = "q"\ntargets = ["hip"]\n'
    )
    recording, made = _import(TableLog(streams), text, tmp_path)
    episode = recording.episodes["000"]
    assert episode.time == pytest.approx([0, 0.05, 0.1, 0.15, 0.2])
    assert episode.ctrl.T.tolist() == [[1, 1, 2, 2, 3], [4, 4, 4, 4, 6]]
    nan = np.nan
    np.testing.assert_array_equal(
        episode.signals["hip_position"].values, [nan, 7, 8, nan, nan]
    )
    assert made.before_command == 1


def test_commands_of_two_streams_begin_with_what_was_held(tmp_path):
    first, second = (
        {"t": [0.0, 1.0], "x": [1.0, 2.0]},
        {"t": [0.5, 1.5], "y": [3.0, 4.0]},
    )
    streams = {"a": first, "b": second}
    text = "".join(
        f'[[signals]]\nkind = "command"\ncolumns = "{c}"\ntargets = ["{j}"]\n'
        for c, j in (("y", "knee"), ("x", "hip"))
    )
    text = f'[time]\ncolumn = "t"\nunit = "s"\n{text}'
    recording, _ = _import(TableLog(streams), text, tmp_path)
    episode = recording.episodes["000"]
    assert episode.ctrl.tolist() == [[1, 3], [2, 3], [2, 4]]


@pytest.mark.parametrize("start", [1e10, 1e16, -1e300])
def test_a_command_at_a_time_of_any_size_is_found(start, tmp_path):
    table = _table(3) | {"t": start * np.ones(3)}
    recording, made = _import(TableLog({"": table}), ALL, tmp_path)
    assert recording.episodes["000"].ctrl.tolist() == [
        [table["u_hip"][0], table["u_knee"][0]]
    ]
    assert made.dropped == 2


def test_what_a_damaged_log_lost_is_told(tmp_path):
    log = TableLog({"": _table()})
    log.losses = ["the last line is cut off"] * 2
    made = _import(log, ALL, tmp_path)[1]
    assert made.losses == {"run.csv": ["the last line is cut off"]}


def test_a_delay_and_a_clock_move_rows_in_time(tmp_path):
    streams = {"a": _table(20), "b": {"n": np.arange(10.0), "w": np.arange(10.0)}}
    text = (
        f'[time]\ncolumn = "t"\n[time.streams.b]\ncolumn = "n"\nunit = "ms"\n'
        f'offset = 0.1\nstretch = 20.0\n{COMMANDS}[[signals]]\nkind = "sensor"\n'
        'columns = ["b:w", "b:w", "b:w"]\ntargets = ["gyro"]\ndelay = 0.02\n'
    )
    recording, _ = _import(TableLog(streams), text, tmp_path)
    episode = recording.episodes["000"]
    rows = np.isfinite(episode.signals["gyro"].values).all(axis=1)
    assert episode.time[rows] == pytest.approx(0.08 + 0.02 * np.arange(10))
    assert episode.signals["gyro"].values[rows][:, 1].tolist() == list(range(10))


def test_episodes_come_of_a_column_a_gap_a_stream_and_a_time_that_begins_again(
    tmp_path,
):
    def ids(log, text):
        recording, _ = _import(log, f"{text}{COMMANDS}{POSITION}", tmp_path)
        return {k: e.time.size for k, e in recording.episodes.items()}

    table = _table(30)
    labels = np.array(["a"] * 10 + ["b/c"] * 12 + ["a"] * 8, dtype=object)
    log = TableLog({"": table | {"run": labels}})
    text = '[time]\ncolumn = "t"\n[episodes]\n'
    assert ids(log, f'{text}column = "run"\n') == {"a": 10, "b_c": 12, "a_2": 8}
    table["t"][20:] += 1
    assert ids(log, f"{text}gap = 0.5\n") == {"000": 20, "001": 10}
    table["t"] = np.concatenate([np.arange(12), np.arange(18)]) * 0.01
    log = TableLog({"": table})
    assert ids(log, '[time]\ncolumn = "t"\n') == {"000": 12, "001": 18}
    table = _table(30)
    marked = TableLog({"/s": table, "/start": {"t": [0.1, 0.2]}})
    got = ids(marked, f'{text}stream = "/start"\n')
    assert got == {"000": 10, "001": 10, "002": 10}


@pytest.mark.parametrize("missing", [[], [0, 1], [13, 20, 21, 49]])
def test_a_row_without_an_episode_belongs_to_the_one_before(missing, tmp_path):
    run = np.repeat([3.0, 5.0], [20, 30])
    run[missing] = np.nan
    text = f'[time]\ncolumn = "t"\n[episodes]\ncolumn = "run"\n{COMMANDS}{POSITION}'
    recording, _ = _import(TableLog({"": _table() | {"run": run}}), text, tmp_path)
    sizes = {name: e.time.size for name, e in recording.episodes.items()}
    late = 20 in missing  # the first row of an episode
    assert sizes == {"003": 22 if late else 20, "005": 28 if late else 30}


@pytest.mark.parametrize("label", [0.5, np.inf, 1e300])
def test_an_episode_that_is_no_whole_number_is_refused(label, tmp_path):
    text = f'[time]\ncolumn = "t"\n[episodes]\ncolumn = "run"\n{COMMANDS}'
    table = _table() | {"run": np.full(50, label)}
    with pytest.raises(
        InputError, match=r"run\.csv: column 'run' tells episodes apart"
    ):
        _import(TableLog({"": table}), text, tmp_path)


def test_rows_that_came_late_are_sorted_in_and_counted(tmp_path):
    table = _table(30)
    order = np.arange(30)
    order[[10, 11]] = order[[11, 10]]
    order[20] = 19
    log = TableLog({"": {name: values[order] for name, values in table.items()}})
    recording, made = _import(log, ALL, tmp_path)
    assert list(recording.episodes) == ["000"]
    values = recording.episodes["000"].signals["hip_position"].values
    assert (values == np.delete(table["q_hip"], 20)).all()
    assert (made.sorted, made.dropped) == (1, 1)


def test_files_become_episodes_with_their_names(tmp_path):
    logs = [TableLog({"": _table(k)}, f"drop-{k}.csv") for k in (10, 20)]
    text = f"[time]\nrate = 50\n{COMMANDS}{POSITION}"
    recording, _ = _import(logs, text, tmp_path)
    assert {k: e.time[-1] for k, e in recording.episodes.items()} == pytest.approx(
        {"drop-10_000": 0.18, "drop-20_000": 0.38}
    )


def test_a_command_may_be_a_constant(tmp_path):
    text = (
        '[time]\ncolumn = "t"\n[[signals]]\nkind = "command"\ncolumns = []\n'
        f'targets = ["knee", "hip"]\noffset = [1, 2]\n{POSITION}'
    )
    recording, _ = _import(TableLog({"": _table(5)}), text, tmp_path)
    assert recording.episodes["000"].ctrl.tolist() == [[2, 1]] * 5


@pytest.mark.parametrize(
    "text, said",
    [
        (POSITION + COMMANDS, r'no time.*\[time\] column = "..." or rate'),
        (f"[time]\nrate=9\n{POSITION}", "no columns for the command of hip, knee"),
        ("[time]\nrate=9\n" + COMMANDS.replace("u_knee", "x"), "unknown column 'x'"),
        (COMMANDS.replace('"knee"]', '"toe"]'), "unknown actuator of the model 'toe'"),
        (COMMANDS + POSITION.replace('"]', '", "v"]', 1), "2 columns do not fit 1 t"),
        (COMMANDS + POSITION + "unit = 'm'", "unit 'm' does not fit 'hip'; .*deg"),
        (COMMANDS + POSITION + "unit = 'yd'", "unknown unit 'yd'"),
        (COMMANDS + POSITION + "sign = 2", "sign must be 1 or -1"),
        (COMMANDS + POSITION + POSITION, "'hip' has columns already"),
        (COMMANDS + POSITION + "from_range = [0, 1]", "needs to_range"),
        (f'[time]\ncolumn = "z"\n{COMMANDS}', "no column 'z' for the time"),
        (f"[time]\nrate = 9\nstart = 99\n{COMMANDS}", "no row is left to import"),
    ],
)
def test_what_does_not_fit_is_said_and_nothing_is_written(text, said, tmp_path):
    with pytest.raises(InputError, match=said):
        _import(TableLog({"": _table(5)}), text, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_star_takes_all_columns_that_differ_there(tmp_path):
    table = {f"pos[{j}]": np.ones(4) * k for k, j in enumerate(("knee", "hip"))}
    table["t"] = 0.01 * np.arange(4)
    text = '[time]\ncolumn = "t"\n' + "".join(
        f'[[signals]]\nkind = "{kind}"\ncolumns = "pos[*]"\n'
        for kind in ("command", "joint_position")
    )
    recording, _ = _import(TableLog({"": table}), text, tmp_path)
    episode = recording.episodes["000"]
    assert episode.ctrl[0].tolist() == [1, 0]
    assert episode.signals["knee_position"].values[0] == 0
