"""MCAP files without ROS messages, and those whose recorder was killed."""

import json
import re

import numpy as np
import pytest
from google.protobuf import (
    descriptor_pb2,
    descriptor_pool,
    message_factory,
    timestamp_pb2,
)
from mcap.reader import make_reader
from mcap.writer import CompressionType

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from tests.support.logs.bags import START, STEP, write_mcap
from tests.support.logs.reading import read_all, read_damaged

LATE = 5_000_000  # [ns] from the stamp of a message to its receipt


def _encode_json(k, stamp):
    parts = [("sec", stamp // 10**9), ("nanosec", stamp % 10**9)]
    head = {"stamp": dict(parts[:: 1 if k % 2 else -1])}  # in any order
    named = {"name": ["hip", "knee"], "position": [100.0 + k, 200 + k]}
    more = {"on": bool(k % 2), "note": "text", "none": None, "gains": [1, [2.5], "x"]}
    return json.dumps({"header": head, **named, **more}).encode()


def _write(
    path, coding="json", encode=_encode_json, schema=("Joints", b"{}"), count=10, **more
):
    """An MCAP of messages of one topic; name and definition of their type."""
    name, definition = schema
    form = {"json": "jsonschema"}.get(coding, coding)
    times = [START + k * STEP - LATE for k in range(count)]
    messages = [(0, encode(k, time)) for k, time in enumerate(times)]
    channels = [("/joints", coding)]
    return write_mcap(path, channels, (name, form, definition), messages, **more)


def _check_stamps(log, name):
    (stream,) = log.streams
    assert (stream.time, stream.columns[name]) == (name, "s")
    expected = (START - LATE + STEP * np.arange(10)) / 1e9
    np.testing.assert_allclose(read_all(log)["/joints"][name], expected, rtol=1e-15)


def test_messages_in_json_are_columns_by_their_paths(tmp_path):
    log = open_log(_write(tmp_path / "log.mcap"))
    _check_stamps(log, "header.stamp")
    found, k = read_all(log)["/joints"], np.arange(10)
    assert list(found) == [
        *("bag time", "header.stamp", "position[hip]", "position[knee]"),
        *("on", "gains[0]", "gains[1][0]"),
    ]
    np.testing.assert_array_equal(found["position[knee]"], 200.0 + k)
    np.testing.assert_array_equal(found["on"], k % 2)
    assert read_damaged(log.path)


@pytest.mark.parametrize("text", [b"", b"nothing", b"[" * 100_000, b"\xff"])
def test_what_is_no_json_is_refused(tmp_path, text):
    with pytest.raises(InputError, match="damaged"):
        read_all(open_log(_write(tmp_path / "log.mcap", encode=lambda *_: text)))


def test_a_message_as_large_as_a_picture_has_no_numbers(tmp_path):
    def encode(k, stamp):
        return b"[%s0]" % (b"0," * 3_000_000) if k == 4 else _encode_json(k, stamp)

    found = read_all(open_log(_write(tmp_path / "log.mcap", encode=encode)))["/joints"]
    has = np.isfinite(found["position[hip]"])
    assert has.sum() == 9 and not has[4] and np.isfinite(found["bag time"]).all()


def _define_joints():
    """A protobuf type with a time, names and numbers: its class, and its definition."""
    kinds = descriptor_pb2.FieldDescriptorProto
    many = {"label": kinds.LABEL_REPEATED}
    about = {"name": "joints.proto", "package": "robot", "syntax": "proto3"}
    used = ["google/protobuf/timestamp.proto"]
    file = descriptor_pb2.FileDescriptorProto(**about, dependency=used)
    made = file.message_type.add(name="Joints")
    stamp = {"type_name": ".google.protobuf.Timestamp"}
    made.field.add(name="timestamp", number=1, type=kinds.TYPE_MESSAGE, **stamp)
    made.field.add(name="names", number=2, type=kinds.TYPE_STRING, **many)
    made.field.add(name="q", number=3, type=kinds.TYPE_DOUBLE, **many)
    made.field.add(name="ticks", number=4, type=kinds.TYPE_INT64)
    stamps = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamps)
    pool = descriptor_pool.DescriptorPool()
    for part in (stamps, file):
        pool.Add(part)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("robot.Joints"))
    files = descriptor_pb2.FileDescriptorSet(file=[file, stamps])
    return kind, files.SerializeToString()


def test_messages_of_protobuf_are_columns_by_their_paths(tmp_path):
    kind, definition = _define_joints()

    def encode(k, stamp):
        q = [0.0, np.nan if k == 3 else k / 4]
        message = kind(names=["hip", "knee"], q=q, ticks=k * 10**12)
        message.timestamp.FromNanoseconds(stamp)
        return message.SerializeToString()

    path = tmp_path / "log.mcap"
    log = open_log(_write(path, "protobuf", encode, ("robot.Joints", definition)))
    _check_stamps(log, "timestamp")
    found, k = read_all(log)["/joints"], np.arange(10)
    assert list(found) == ["bag time", "timestamp", "q[hip]", "q[knee]", "ticks"]
    np.testing.assert_array_equal(found["q[knee]"], np.where(k == 3, np.nan, k / 4))
    np.testing.assert_array_equal(found["ticks"], k * 1e12)
    assert read_damaged(path)


@pytest.mark.parametrize("coding", ["protobuf", "flatbuffer", "cbor"])
def test_of_a_coding_that_is_not_known_only_the_time_is_read(tmp_path, coding):
    path = tmp_path / "log.mcap"
    _write(path, coding, lambda k, _: bytes([k]), ("Joints", b"no definition"))
    assert list(read_all(open_log(path))["/joints"]) == ["bag time"]


@pytest.mark.parametrize(
    "settings", [{"compression": CompressionType.ZSTD}, {"use_chunking": False}]
)
def test_of_a_file_that_is_cut_off_all_that_is_whole_is_read(tmp_path, settings):
    path = _write(tmp_path / "log.mcap", count=30, **settings)
    content, rows, lost = path.read_bytes(), [], []
    assert not open_log(path).losses
    for size in range(0, len(content), 97):
        path.write_bytes(content[:size])
        try:
            log = open_log(path)
        except InputError as error:
            assert not rows, error
            continue
        times = read_all(log).get("/joints", {"bag time": np.empty(0)})["bag time"]
        rows.append(len(times))
        expected = START / 1e9 + 0.01 * np.arange(len(times))
        np.testing.assert_allclose(times, expected, rtol=1e-15)
        lost.append(int(re.search(r"last (\d+) bytes", log.losses[0])[1]))
    assert rows == sorted(rows) and rows[-1] == 30 and len(set(rows)) > 5
    assert 0 < max(lost) < 2_000


def test_room_that_a_recorder_kept_for_more_is_no_message(tmp_path):
    path = _write(tmp_path / "log.mcap", count=30)
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    path.write_bytes(path.read_bytes()[: chunks[4].chunk_start_offset] + bytes(5_000))
    log = open_log(path)
    assert 10 < len(read_all(log)["/joints"]["bag time"]) < 30
    assert "last 5000 bytes" in log.losses[0]


def test_messages_that_the_index_of_a_file_misses_are_told(tmp_path):
    path = _write(tmp_path / "log.mcap", count=30)
    with path.open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[3]
    content = bytearray(path.read_bytes())
    start = content.rindex(chunk.chunk_start_offset.to_bytes(8, "little"))
    content[start - 25] = 0x7F  # a kind of record that nobody knows
    path.write_bytes(content)
    log = open_log(path)
    rows = len(read_all(log)["/joints"]["bag time"])
    assert 20 < rows < 30
    assert log.losses == [f"{30 - rows} messages that it lists are not found"]
