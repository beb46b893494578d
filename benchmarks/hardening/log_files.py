"""Small logs of all formats that are imported: a folder in; logs and maps in it out."""

import gzip
import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]
MODEL, OUT = "model.xml", "imported.h5"
# maps by the names of their files; the targets are those of the arm
MAPS = {
    "map.toml": '''version = 1

[time]
column = "t"
unit = "ms"
offset = 0.5
start = 0.1
end = 0.9

[episodes]
column = "run"

[[signals]]
kind = "command"
columns = ["goal_1", "goal_2"]
targets = ["shoulder_servo", "elbow_servo"]
unit = "deg"
sign = [1, 1]

[[signals]]
kind = "joint_position"
columns = "q_*"
unit = "deg"
scale = 1.0
offset = [0.0, 0.1]
delay = 0.01

[[signals]]
kind = "joint_velocity"
columns = ["share"]
targets = ["elbow"]
from_range = [0, 100]
to_range = [-1.5, 1.5]
''',
    "lerobot.toml": '''version = 1

[[signals]]
kind = "command"
columns = ["action[1]", "action[2]"]
targets = ["shoulder_servo", "elbow_servo"]

[[signals]]
kind = "joint_position"
columns = ["observation.state[shoulder]", "observation.state[elbow]"]
targets = ["shoulder", "elbow"]
''',
    "bag.toml": '''version = 1

[time.streams."/goals"]
column = "bag time"
offset = 0.01

[[signals]]
kind = "command"
columns = ["/goals:data[0]", "/goals:data[1]"]
targets = ["shoulder_servo", "elbow_servo"]

[[signals]]
kind = "joint_position"
columns = "/joint_states:position[*]"
''',
}  # fmt: skip


def make_columns(rows: int = 60) -> Columns:
    """Columns of a log of the arm, in two runs.

    Args:
        rows: how many.
    """
    t = 10.0 * np.arange(rows)  # [ms]
    wave = np.sin(t / 200.0)
    return {
        "t": t,
        "run": (np.arange(rows) >= rows // 2).astype(np.int64),
        "goal_1": 40.0 * wave,
        "goal_2": -30.0 * wave,
        "q_shoulder": np.roll(38.0 * wave, 2),
        "q_elbow": np.roll(-29.0 * wave, 2),
        "share": 50.0 - 20.0 * wave,
        "state": np.array(["moves", "rests"] * (rows // 2), dtype=object),
    }


def write_logs(folder: Path) -> None:
    """Write a log of each format, and the maps."""
    for name, text in MAPS.items():
        (folder / name).write_text(text)
    columns = make_columns()
    for name, encode in ENCODERS.items():
        (folder / name).write_bytes(encode(columns))
    (folder / "log.jsonl").write_bytes(_encode_lines(columns))
    (folder / "runs.json").write_bytes(_encode_runs(columns))
    (folder / "log.npy").write_bytes(_encode_npy(columns))
    _write_archive(folder / "log.pt", columns)
    _write_lerobot(folder / "lerobot", columns)
    _write_hdf5(folder / "log.hdf5", columns)
    _write_bags(folder, columns)


def encode_csv(columns: Mapping[str, Any]) -> bytes:
    """A CSV with a header."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
    return "".join(f"{line}\n" for line in lines).encode(errors="surrogateescape")


def _encode_blanks(columns: Mapping[str, Any]) -> bytes:
    """A table with comments, and blanks between its cells."""
    return b"# a robot's\n" + encode_csv(columns).replace(b",", b"  ")


def _encode_utf16(columns: Mapping[str, Any]) -> bytes:
    """A table of tabs, as Windows writes it."""
    text = encode_csv(columns).decode(errors="replace").replace(",", "\t")
    return text.replace("\n", "\r\n").encode("utf-16")


def _encode_gzip(columns: Mapping[str, Any]) -> bytes:
    return gzip.compress(encode_csv(columns), mtime=0)


def _encode_parquet(columns: Mapping[str, Any]) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    buffer = io.BytesIO()
    table = pa.table({n: _make_arrow(column) for n, column in columns.items()})
    parquet.write_table(table, buffer, row_group_size=20)
    return buffer.getvalue()


def _make_arrow(column: NDArray[Any]) -> Any:
    """A column of Arrow; vectors are lists, what has no type is text."""
    import pyarrow as pa

    values = column.tolist()
    try:
        return pa.array(values)
    except (pa.ArrowException, OverflowError):
        return pa.array([str(value) for value in values])


def _encode_npz(columns: Mapping[str, Any]) -> bytes:
    buffer = io.BytesIO()
    texts = {n: c.astype("U") for n, c in columns.items() if c.dtype.kind == "O"}
    np.savez(buffer, allow_pickle=False, **{**columns, **texts})
    return buffer.getvalue()


def _encode_mat(columns: Mapping[str, Any]) -> bytes:
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, {name[:31]: column for name, column in columns.items()})
    return buffer.getvalue()


def _encode_arrays(columns: Mapping[str, Any]) -> bytes:
    """A JSON document of arrays by name."""
    lists = {name: column.tolist() for name, column in columns.items()}
    return json.dumps(lists, default=str).encode(errors="replace")


# files whose columns can be changed before they are written
ENCODERS: Mapping[str, Callable[[Mapping[str, Any]], bytes]] = {
    "log.csv": encode_csv,
    "log.txt": _encode_blanks,
    "log.tsv": _encode_utf16,
    "log.csv.gz": _encode_gzip,
    "log.parquet": _encode_parquet,
    "log.npz": _encode_npz,
    "log.mat": _encode_mat,
    "log.json": _encode_arrays,
}


def _encode_lines(columns: Columns) -> bytes:
    """JSON lines, an object a row."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = (json.dumps(dict(zip(columns, row, strict=True))) for row in rows)
    return "".join(f"{line}\n" for line in lines).encode()


def _encode_runs(columns: Columns) -> bytes:
    """A JSON document of runs, each of arrays."""
    runs = [
        {"label": f"run {k}",
         **{n: c[columns["run"] == k].tolist() for n, c in columns.items()}}
        for k in (0, 1)
    ]  # fmt: skip
    return json.dumps({"robot": "arm", "dt": 0.01, "runs": runs}).encode()


def _encode_npy(columns: Columns) -> bytes:
    """An array of records."""
    numeric = {n: c for n, c in columns.items() if c.dtype.kind != "O"}
    records = np.zeros(len(columns["t"]), [(n, c.dtype) for n, c in numeric.items()])
    for name, column in numeric.items():
        records[name] = column
    buffer = io.BytesIO()
    np.save(buffer, records)
    return buffer.getvalue()


def _write_archive(path: Path, columns: Columns) -> None:
    """Tensors, as torch.save writes them."""
    from tests.support.logs.torch_files import Tensor, save_archive

    save_archive(path, {n: Tensor(c) for n, c in columns.items() if n != "state"})


def _write_lerobot(folder: Path, columns: Columns) -> None:
    """A data set of LeRobot."""
    import pyarrow as pa
    from pyarrow import parquet

    data, meta = folder / "data/chunk-000", folder / "meta"
    for place in (data, meta):
        place.mkdir(parents=True)
    goals = np.column_stack([columns["goal_1"], columns["goal_2"]]) / 60
    angles = np.column_stack([columns["q_shoulder"], columns["q_elbow"]]) / 60
    table = pa.table({
        "action": goals.tolist(), "observation.state": angles.tolist(),
        "timestamp": columns["t"] / 1e3, "episode_index": columns["run"],
    })  # fmt: skip
    parquet.write_table(table, data / "file-000.parquet")
    names = {"action": ["1", "2"], "observation.state": ["shoulder", "elbow"]}
    info = {"codebase_version": "v3.0", "robot_type": "arm", "fps": 100,
            "features": {n: {"dtype": "float32", "shape": [2], "names": names[n]}
                         for n in names}}  # fmt: skip
    (meta / "info.json").write_text(json.dumps(info))


def _write_hdf5(path: Path, columns: Columns) -> None:
    """Runs in groups, as robomimic has them."""
    with h5py.File(path, "w") as file:
        for k in (0, 1):
            for name, column in columns.items():
                values = column[columns["run"] == k]
                file[f"data/demo_{k}/{name}"] = (
                    values.astype("S") if values.dtype.kind == "O" else values
                )


def _write_bags(folder: Path, columns: Columns) -> None:
    """Bags of ROS 1 and 2, and MCAP packed and not packed."""
    from mcap.writer import CompressionType
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    for version, name in ((1, "log.bag"), (2, "bag")):
        store = get_typestore(
            Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE
        )
        writer: Any = (
            Writer1(folder / name) if version == 1
            else Writer2(folder / name, version=9, storage_plugin=StoragePlugin.SQLITE3)
        )  # fmt: skip
        encode = store.serialize_ros1 if version == 1 else store.serialize_cdr
        with writer:
            made = dict[str, Any]()
            for time, topic, message in _list_messages(store, columns):
                kind = message.__msgtype__
                if topic not in made:
                    made[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(made[topic], time, bytes(encode(message, kind)))
    (folder / "bag/bag.db3").rename(folder / "log.db3")
    (folder / "bag/metadata.yaml").unlink()
    (folder / "bag").rmdir()
    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = list(_list_messages(store, columns))
    for compression in (CompressionType.NONE, CompressionType.ZSTD):
        name = "log.mcap" if compression is CompressionType.NONE else "packed.mcap"
        _write_mcap(folder / name, store, messages, compression)
    _write_documents(folder / "json.mcap", messages)


def _list_messages(store: Any, columns: Columns) -> Any:
    """Time [ns], topic and message of all that a bag of the arm holds."""
    types = store.types
    for k, milliseconds in enumerate(columns["t"]):
        time = 1_700_000_000_000_000_000 + int(1e6 * milliseconds)
        seconds = divmod(time - 2_000_000, 10**9)
        stamp = types["builtin_interfaces/msg/Time"](*seconds)
        head = types["std_msgs/msg/Header"]
        named = "seq" in head.__dataclass_fields__
        header = head(*((k,) if named else ()), stamp, "base")
        angles = np.array([columns["q_shoulder"][k], columns["q_elbow"][k]]) / 60
        goals = np.array([columns["goal_1"][k], columns["goal_2"][k]]) / 60
        layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
        yield time, "/goals", types["std_msgs/msg/Float64MultiArray"](layout, goals)
        empty = np.empty(0)
        yield (
            time,
            "/joint_states",
            types["sensor_msgs/msg/JointState"](
                header, ["shoulder", "elbow"], angles, empty, empty
            ),
        )


def _write_documents(path: Path, messages: Any) -> None:
    """An MCAP of the same messages in JSON."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2_000)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        channels = {topic: writer.register_channel(topic, "json", schema)
                    for topic in dict.fromkeys(topic for _, topic, _ in messages)
                    }  # fmt: skip
        for time, topic, message in messages:
            keys = ("name", "position") if topic == "/joint_states" else ("data",)
            document = {key: list(getattr(message, key)) for key in keys}
            content = json.dumps(document).encode()
            writer.add_message(channels[topic], time, content, time)
        writer.finish()


def _write_mcap(path: Path, store: Any, messages: Any, compression: Any) -> None:
    """An MCAP of chunks without checksums, which damage would never get past."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2_000, compression=compression,
                        enable_crcs=False)  # fmt: skip
        writer.start("ros2")
        channels = dict[str, int]()
        for time, topic, message in messages:
            kind = message.__msgtype__
            if topic not in channels:
                text, _ = store.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            content = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], time, content, time)
        writer.finish()
