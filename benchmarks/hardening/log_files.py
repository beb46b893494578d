"""Small logs of all formats that are imported: a folder in; logs and maps in it out."""

import gzip
import io
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import savemat

from selfheal.example.simulate import Run
from selfheal.example.write_logs import write_lerobot, write_ros2_bag
from selfheal.export.export import export_recording
from selfheal.recording import read
from tests.support.logs.torch_files import Tensor, save_archive

Columns = dict[str, NDArray[Any]]
JOINTS = ("shoulder", "elbow")
# columns of the goals, the readings and, for want of others, the speeds
_VECTORS = (("goal_1", "goal_2"), *(("q_shoulder", "q_elbow"),) * 2)
MODEL, OUT = "model.xml", "imported.h5"
FILES = Path(__file__).parent / "files"  # models, and maps whose targets are the arm's


def make_columns(rows: int = 60) -> Columns:
    """Columns of a log of the arm, in two runs."""
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
    """Write a log of each format, and the maps.

    Args:
        folder: that holds the files of `write_small_files`.
    """
    for path in FILES.glob("*.toml"):
        shutil.copy(path, folder)
    columns = make_columns()
    for name, encode in ENCODERS.items():
        (folder / name).write_bytes(encode(columns))
    both = [{n: c[columns["run"] == k] for n, c in columns.items()} for k in (0, 1)]
    labelled = [{"label": f"run {k}", **_make_lists(r)} for k, r in enumerate(both)]
    document = {"robot": "arm", "dt": 0.01, "runs": labelled}
    (folder / "runs.json").write_text(json.dumps(document))
    numbers = pd.DataFrame(columns).select_dtypes("number")
    np.save(folder / "log.npy", numbers.to_records(index=False))
    tensors = {n: Tensor(c.to_numpy()) for n, c in numbers.items()}
    save_archive(folder / "log.pt", tensors)
    runs = [
        Run(
            run["t"] / 1e3,
            *(np.column_stack([run[n] for n in v]) / 60 for v in _VECTORS),
        )
        for run in both
    ]
    write_lerobot(folder / "lerobot", runs, JOINTS)
    _write_hdf5(folder / "log.hdf5", both)
    _write_bags(folder, runs)
    recording = read(folder / "arm.h5")
    export_recording(recording, folder / "json.mcap", to="mcap")


def _make_lists(columns: Columns) -> dict[str, list[Any]]:
    return {name: column.tolist() for name, column in columns.items()}


def encode_csv(columns: Columns, **more: Any) -> bytes:
    """A table as text, with further options of pandas."""
    text = pd.DataFrame(columns).to_csv(index=False, **more)
    return text.encode(errors="surrogateescape")


def _encode_parquet(columns: Columns) -> bytes:
    """A table of Parquet; what has no type of Arrow's is text."""
    table = pd.DataFrame(columns)
    try:
        return table.to_parquet(row_group_size=20)
    except (ValueError, TypeError, NotImplementedError, OverflowError):
        return table.astype(str).to_parquet(row_group_size=20)


def _encode_by(save: Callable[[IO[bytes], Any], None], columns: Columns) -> bytes:
    """What a function saves of columns whose texts are NumPy's."""
    buffer, texts = io.BytesIO(), {n: c for n, c in columns.items() if _is_text(c)}
    plain = columns | {n: c.astype("U") for n, c in texts.items()}
    save(buffer, {n[:31]: c for n, c in plain.items()})
    return buffer.getvalue()


def _is_text(column: NDArray[Any]) -> bool:
    return column.dtype.kind == "O"


# files whose columns can be changed before they are written
ENCODERS: Mapping[str, Callable[[Columns], bytes]] = {
    "log.csv": encode_csv,
    "log.txt": lambda c: b"# a robot's\n" + encode_csv(c).replace(b",", b"  "),
    "log.tsv": lambda c: (
        encode_csv(c, sep="\t", lineterminator="\r\n")
        .decode(errors="replace")
        .encode("utf-16")
    ),
    "log.csv.gz": lambda c: gzip.compress(encode_csv(c), mtime=0),
    "log.parquet": _encode_parquet,
    "log.npz": partial(_encode_by, lambda file, c: np.savez(file, **c)),
    "log.mat": partial(_encode_by, savemat),
    "log.json": lambda c: json.dumps(_make_lists(c), default=str).encode(),
    "log.jsonl": lambda c: "".join(
        f"{json.dumps(row, default=str)}\n"
        for row in pd.DataFrame(c).to_dict("records")
    ).encode(),
}


def _write_hdf5(path: Path, runs: Sequence[Columns]) -> None:
    """Runs in groups, as robomimic has them."""
    with h5py.File(path, "w") as file:
        for k, run in enumerate(runs):
            for name, values in run.items():
                plain = values.astype("S") if _is_text(values) else values
                file[f"data/demo_{k}/{name}"] = plain


def _write_bags(folder: Path, runs: Sequence[Run]) -> None:
    """A bag of ROS 2, one of ROS 1, and MCAP packed and not packed."""
    from rosbags.convert import convert

    write_ros2_bag(folder / "bag", runs, JOINTS)
    rest: Any = (None, "file", None, None, (), (), (), ())  # packing, types, topics
    for target, storage, version in (("log.bag", "", 1), ("mcap", "mcap", 9)):
        convert([folder / "bag"], folder / target, storage, version, *rest)
    (made,) = (folder / "bag").glob("*.db3")
    made.rename(folder / "log.db3")
    (made,) = (folder / "mcap").glob("*.mcap")
    tree = decode_mcap(made.read_bytes())
    for name, packing in (("log.mcap", "NONE"), ("packed.mcap", "ZSTD")):
        (folder / name).write_bytes(encode_mcap(tree, packing))
    for name in ("bag", "mcap"):
        shutil.rmtree(folder / name)


def decode_mcap(content: bytes) -> dict[str, Any]:
    """Channels by topic, each with its type and coding, and the messages."""
    from mcap.reader import make_reader

    channels, messages = dict[str, Any](), list[Any]()
    for schema, channel, message in make_reader(io.BytesIO(content)).iter_messages():
        assert schema is not None
        kind = [schema.name, schema.encoding, schema.data]
        channels[channel.topic] = [*kind, channel.message_encoding]
        messages.append([channel.topic, message.log_time, message.data])
    return {"channels": channels, "messages": messages}


def encode_mcap(tree: Any, packing: str = "NONE") -> bytes:
    """An MCAP of chunks without checksums, which damage would never get past.

    Args:
        tree: of `decode_mcap`; values of other types are left out.
        packing: of the chunks, "ZSTD" or none.
    """
    from mcap.writer import CompressionType, Writer

    buffer, size = io.BytesIO(), 2_000
    writer = Writer(buffer, size, CompressionType[packing], enable_crcs=False)
    writer.start("ros2")
    ids = dict[str, int]()
    channels = tree.get("channels")
    for topic, channel in channels.items() if isinstance(channels, dict) else ():
        if [*map(type, channel)] == [str, str, bytes, str]:
            made = writer.register_schema(*channel[:3])
            ids[topic] = writer.register_channel(topic, channel[3], made)
    for message in tree.get("messages") or ():
        topic, time, inner = (*message, 0, 0)[:3]
        if topic in ids and isinstance(time, int) and isinstance(inner, bytes):
            writer.add_message(ids[topic], time, inner, time)
    writer.finish()
    return buffer.getvalue()
