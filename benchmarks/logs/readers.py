"""Readers of large logs: `python -m benchmarks.logs.readers READER PATH`.

Reads all of a log. Prints as JSON the time [s], the processor time of the process [s]
and its peak memory [B].
"""

import json
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path


def read_by_selfheal(path: str) -> None:
    """All columns of all streams, in pieces."""
    from selfheal.logs.open_log import open_log

    log = open_log(path)
    for _ in log.read({stream.name: list(stream.columns) for stream in log.streams}):
        pass


def import_by_selfheal(path: str) -> None:
    """All columns into a recording: the time, and angles of as many joints."""
    import tempfile

    import mujoco

    from selfheal.logs.convert import import_logs
    from selfheal.logs.log_map import parse_map
    from selfheal.logs.open_log import open_log

    log = open_log(path)
    chosen = [
        (stream.name, [c for c in stream.columns if c[:1] in ("q", "p")])
        for stream in log.streams
    ]
    joints = {
        f"{s}:{c}": f"j{k}"
        for k, (s, c) in enumerate((s, c) for s, columns in chosen for c in columns)
    }
    bodies = "".join(
        f'<body><joint name="{name}"/><geom size="1"/></body>'
        for name in joints.values()
    )
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"
    )
    several = len(log.streams) > 1
    signals = [
        {
            "kind": "joint_position",
            "columns": [f"{stream}:{c}" if several else c for c in columns],
            "targets": [joints[f"{stream}:{c}"] for c in columns],
        }
        for stream, columns in chosen
        if columns
    ]
    time = {} if several else {"column": "time"}
    log_map = parse_map({"signals": signals, "time": time}, "map")
    with tempfile.TemporaryDirectory(dir=Path(path).parent) as folder:
        import_logs([log], log_map, model, Path(folder) / "r.h5")


def read_by_pandas(path: str) -> None:
    """All columns at once."""
    import pandas

    pandas.read_csv(path)


def read_by_pyarrow(path: str) -> None:
    """All columns, in pieces."""
    from pyarrow import csv

    for _ in csv.open_csv(path):
        pass


def read_by_rosbags(path: str) -> None:
    """All messages decoded, one at a time."""
    from rosbags.highlevel import AnyReader

    with AnyReader([Path(path)]) as reader:
        for connection, _, content in reader.messages():
            reader.deserialize(content, connection.msgtype)


def read_by_mcap(path: str) -> None:
    """All messages as bytes, none decoded."""
    from mcap.reader import make_reader

    with open(path, "rb") as file:
        for _ in make_reader(file).iter_messages():
            pass


def measure_peak() -> int:
    """The most memory that this process had at a time [B]."""
    status = Path("/proc/self/status").read_text()
    (line,) = (line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024  # from [kB]


READERS: Mapping[str, Callable[[str], None]] = {
    "csv selfheal": read_by_selfheal,
    "csv selfheal recording import": import_by_selfheal,
    "csv pandas": read_by_pandas,
    "csv pyarrow": read_by_pyarrow,
    "mcap selfheal": read_by_selfheal,
    "mcap selfheal recording import": import_by_selfheal,
    "mcap rosbags": read_by_rosbags,
    "mcap mcap, nothing decoded": read_by_mcap,
}

if __name__ == "__main__":
    _, name, place = sys.argv
    begin = time.perf_counter()
    READERS[name](place)
    figures = {
        "seconds": time.perf_counter() - begin,
        "processor": time.process_time(),
        "memory": measure_peak(),
    }
    print(json.dumps(figures))
