"""Exports are opened by the formats' own readers, and hold what was recorded."""

import json
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from selfheal.errors import InputError, UnknownNameError
from selfheal.export.export import FORMATS, export_recording
from selfheal.logs.open_log import open_log
from selfheal.recording import Recording
from selfheal.recording.table import find_unit
from tests.support.logs.reading import read_all


@pytest.fixture
def predicted(recording):
    """Every reading and 1; of the voltage, which no model predicts, none."""

    def change(name, signal):
        shift = np.nan if name == "voltage" else 1.0
        return replace(signal, values=np.nan_to_num(signal.values) + shift)

    episodes = {
        n: replace(e, signals={k: change(k, s) for k, s in e.signals.items()})
        for n, e in recording.episodes.items()
    }
    return replace(recording, episodes=episodes)


def _list_expected(recording, predicted):
    """Values (T) of each column that a table must have, by episode and name."""
    found = {}
    for name, episode in recording.episodes.items():
        columns = {"time": episode.time}
        for actuator, commands in zip(episode.ctrl_names, episode.ctrl.T, strict=True):
            columns[f"ctrl/{actuator}"] = commands
        groups = {"signals": episode, "predicted": predicted.episodes[name]}
        for group, part in groups.items():
            for signal, s in part.signals.items():
                if (group, signal) == ("predicted", "voltage"):
                    continue
                column = f"{group}/{signal}"
                if s.values.ndim == 1:
                    columns[column] = s.values
                else:
                    columns |= {f"{column}[{k}]": c for k, c in enumerate(s.values.T)}
        found[name] = columns
    return found


def _check_frame(frame, recording, predicted):
    expected = _list_expected(recording, predicted)
    assert list(frame["episode"].unique()) == list(expected)
    for episode, columns in expected.items():
        rows = frame[frame["episode"] == episode]
        assert sorted(columns) == sorted(set(frame.columns) - {"episode"})
        for name, values in columns.items():
            np.testing.assert_array_equal(rows[name].to_numpy(float), values)


def test_a_csv_is_the_table_with_units_in_its_head(recording, predicted, tmp_path):
    path = tmp_path / "out.csv"
    export_recording(recording, path, to="csv", predicted=predicted)
    frame = pd.read_csv(path, dtype={"episode": str})
    assert {"time [s]", "ctrl/motor", "signals/up[2] [1]"} <= set(frame.columns)
    frame.columns = [name.partition(" [")[0] for name in frame.columns]
    _check_frame(frame, recording, predicted)


def test_a_parquet_is_the_table_with_units_as_metadata(recording, predicted, tmp_path):
    path = tmp_path / "out.parquet"
    export_recording(recording, path, to="parquet", predicted=predicted)
    table = pq.read_table(path)
    _check_frame(table.to_pandas(), recording, predicted)
    units = {f.name: find_unit(f) for f in table.schema}
    assert (units["time"], units["signals/tip_speed[0]"]) == ("s", "m/s")


def test_an_mcap_has_a_message_for_each_sample(recording, predicted, tmp_path):
    path = tmp_path / "out.mcap"
    export_recording(recording, path, to="mcap", predicted=predicted)
    found, begun, stamps = {}, [], []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content = json.loads(message.data)
            stamps.append(message.log_time)
            known = json.loads(schema.data)["properties"]
            assert content.keys() <= known.keys()
            if channel.topic == "/episode":
                begun.append(content["id"])
            else:
                found.setdefault(channel.topic, []).append((begun[-1], content))
    assert begun == list(recording.episodes) and stamps == sorted(stamps)
    groups = {"/signals": recording, "/predicted": predicted}
    for topic, source in groups.items():
        for name, episode in source.episodes.items():
            messages = [content for id, content in found[topic] if id == name]
            assert [m["time"] for m in messages] == list(episode.time)
            for key, signal in episode.signals.items():
                for message, value in zip(messages, signal.values, strict=True):
                    if np.isnan(value).all():
                        assert key not in message
                    else:
                        np.testing.assert_array_equal(message[key], value)
    motor = [content["motor"] for _, content in found["/ctrl"]]
    expected = [e.ctrl[:, 0] for e in recording.episodes.values()]
    np.testing.assert_array_equal(motor, np.concatenate(expected))


def test_an_rrd_has_an_entity_for_each_column(recording, predicted, tmp_path):
    chunk = pytest.importorskip("rerun.chunk")
    path = tmp_path / "out.rrd"
    export_recording(recording, path, to="rrd", predicted=predicted)
    read = {}
    for part in chunk.RrdReader(path).stream():
        batch = part.to_record_batch()
        if "Scalars:scalars" in batch.schema.names:
            time = batch["time"].cast("int64").to_numpy() / 1e9
            values = batch["Scalars:scalars"].flatten().to_numpy()
            read.setdefault(part.entity_path, []).append((time, values))
    for episode, columns in _list_expected(recording, predicted).items():
        time = columns.pop("time")
        for name, values in columns.items():
            entity = f"/{episode}/{name}".replace("[", r"\[").replace("]", r"\]")
            parts = zip(*read.pop(entity), strict=True)
            stamps, numbers = map(np.concatenate, parts)
            known = np.isfinite(values)
            np.testing.assert_allclose(stamps, time[known], atol=1e-9)
            np.testing.assert_array_equal(numbers, values[known])
    assert not read


@pytest.mark.parametrize("form", ["csv", "mcap", "parquet"])
def test_an_export_is_a_log_that_is_imported_again(recording, tmp_path, form):
    path = tmp_path / f"out.{form}"
    export_recording(recording, path, to=form)
    columns = {
        name: values
        for rows in read_all(open_log(path)).values()
        for name, values in rows.items()
    }
    (position,) = [v for n, v in columns.items() if "arm_position" in n]
    expected = [e.signals["arm_position"].values for e in recording.episodes.values()]
    np.testing.assert_array_equal(position, np.concatenate(expected))


@pytest.mark.parametrize(
    ("form", "module", "library"),
    [("mcap", "mcap.writer", "mcap"), ("rrd", "rerun", "rerun-sdk")],
)
def test_a_missing_library_is_named_and_nothing_is_left(
    recording, tmp_path, monkeypatch, form, module, library
):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=f"pip install '{library}"):
        export_recording(recording, tmp_path / "out", to=form)
    assert not list(tmp_path.iterdir())


def test_a_format_that_is_none_is_refused_with_the_list(recording, tmp_path):
    with pytest.raises(UnknownNameError, match=", ".join(sorted(FORMATS))):
        export_recording(recording, tmp_path / "out", to="xlsx")


def test_commands_of_one_actuator_are_numbered():
    time = np.arange(3.0)
    ctrl = np.arange(9.0).reshape(3, 3)
    made = Recording.from_arrays(time, {"a": time}, {})
    (episode,) = made.episodes.values()
    both = replace(episode, ctrl=ctrl, ctrl_names=("arm", "lift", "arm"))
    frame = Recording({"000": both}).to_dataframe()
    assert list(frame.columns[2:]) == ["ctrl/arm[0]", "ctrl/lift", "ctrl/arm[1]"]
    np.testing.assert_array_equal(frame["ctrl/arm[1]"], ctrl[:, 2])


def test_a_signal_whose_unit_changes_is_refused(recording):
    def turn(name, unit):
        episode = recording.episodes[name]
        arm = replace(episode.signals["arm_position"], unit=unit)
        return replace(episode, signals={"arm_position": arm})

    mixed = Recording({"a": turn("zeta", "rad"), "b": turn("alpha", "m")})
    with pytest.raises(InputError, match="arm_position is in 'm' in episode 'b'"):
        mixed.to_dataframe()
