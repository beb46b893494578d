"""Parquet files and LeRobot's data sets, written by pyarrow."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from tests.support.logs.reading import check_rows, read_all, read_one
from tests.support.logs.table_files import write_lerobot, write_parquet

ROWS = 3_000
T = np.arange(ROWS) / 100


def test_columns_of_any_type_are_numbers_or_texts(tmp_path):
    start, numbers = datetime(1970, 1, 1, tzinfo=UTC), range(ROWS)
    path = write_parquet(
        tmp_path / "log.parquet",
        {
            "t": T,
            "n": pa.array([None, *range(ROWS - 1)], pa.int32()),
            "on": pa.array([k % 2 == 0 for k in numbers]),
            "when": pa.array([start + timedelta(seconds=k / 2) for k in numbers]),
            "took": pa.array([timedelta(milliseconds=k) for k in numbers]),
            "label": pa.array([f"run {k % 3}" for k in numbers]).dictionary_encode(),
            "leg": pa.array([{"q": k, "v": {"x": -k}, "png": b"0"} for k in numbers]),
            "picture": pa.array([b"\0" * 10] * ROWS),
        },
        row_group_size=700,
    )
    log = open_log(path)
    check_rows(log)
    assert log.streams[0].time == "when"
    assert log.streams[0].columns["when"] == log.streams[0].columns["took"] == "s"
    found = read_all(log)[""]
    assert " ".join(found) == "t n on when took label leg.q leg.v.x"
    np.testing.assert_array_equal(found["t"], T)
    np.testing.assert_equal(found["n"][:3], [np.nan, 0, 1])
    assert found["on"][:3].tolist() == [1, 0, 1]
    np.testing.assert_allclose(found["when"], np.arange(ROWS) / 2)
    np.testing.assert_allclose(found["took"], np.arange(ROWS) / 1000)
    assert found["label"][:4].tolist() == ["run 0", "run 1", "run 2", "run 0"]
    np.testing.assert_array_equal(found["leg.v.x"], -np.arange(ROWS))


@pytest.mark.parametrize(
    "kind",
    [pa.list_(pa.float32()), pa.list_(pa.float64(), 3), pa.large_list(pa.int8())],
)
def test_a_vector_is_a_column_for_each_element(tmp_path, kind):
    values = np.arange(3 * ROWS).reshape(ROWS, 3) % 100
    rows = values.tolist()
    rows[5] = None
    found = read_one(
        write_parquet(tmp_path / "log.parquet", {"q": pa.array(rows, kind)})
    )
    expected = np.where(np.arange(ROWS)[:, None] == 5, np.nan, values)
    np.testing.assert_array_equal(np.stack(list(found.values()), 1), expected)
    assert list(found) == ["q[0]", "q[1]", "q[2]"]


def test_vectors_that_are_short_lack_elements(tmp_path):
    rows = [[1.0, 2.0], [], [3.0], [4.0, None]]
    found = read_one(write_parquet(tmp_path / "log.parquet", {"q": rows}))
    np.testing.assert_equal(found["q[0]"], [1, np.nan, 3, 4])
    np.testing.assert_equal(found["q[1]"], [2, np.nan, np.nan, np.nan])


def _make_dataset(folder, version, names):
    """A LeRobot data set of two episodes of two joints."""
    vectors = {"dtype": "float32", "shape": [2], "names": names}
    times = {"dtype": "float32", "shape": [1], "names": None}
    info = {"codebase_version": version, "robot_type": "so101", "fps": 50}
    info["features"] = {"action": vectors, "timestamp": times}
    kind = pa.list_(pa.float32())
    episodes = [
        {
            "action": pa.array(np.full((40, 2), k + 0.5).tolist(), kind),
            "timestamp": pa.array(np.arange(40) / 50, pa.float32()),
            "episode_index": np.full(40, k),
            "index": np.arange(40) + 40 * k,
        }
        for k in range(2)
    ]
    return write_lerobot(folder, info, *episodes)


@pytest.mark.parametrize("version", ["v2.0", "v2.1", "v3.0"])
@pytest.mark.parametrize("names", [["hip", "knee"], {"motors": ["hip", "knee"]}, None])
def test_a_data_set_of_lerobot_is_a_stream_of_episodes(tmp_path, version, names):
    log = open_log(_make_dataset(tmp_path / "set", version, names))
    check_rows(log)
    (stream,) = log.streams
    assert (stream.time, stream.episode) == ("timestamp", "episode_index")
    assert (stream.period, stream.rows, log.robot) == (0.02, 80, "so101")
    assert stream.columns["timestamp"] == "s"
    found = read_all(log)[""]
    column = "action[knee]" if names else "action[1]"
    np.testing.assert_array_equal(found[column], [0.5] * 40 + [1.5] * 40)
    np.testing.assert_array_equal(found["index"], np.arange(80))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        *(("meta/info.json", content) for content in (b"{", b"[]", b"{}")),
        *(("data/chunk-000/file-000.parquet", content) for content in (b"PAR1", None)),
    ],
)
def test_a_data_set_that_lacks_something_is_refused(tmp_path, name, content):
    folder = _make_dataset(tmp_path / "set", "v3.0", None)
    if content is None:
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(content)
    with pytest.raises(InputError):
        read_all(open_log(folder))


def test_a_file_without_columns_of_numbers_is_refused(tmp_path):
    path = write_parquet(tmp_path / "log.parquet", {"picture": pa.array([b"\0"])})
    with pytest.raises(InputError, match="no columns"):
        open_log(path)
