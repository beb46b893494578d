"""Large logs, each written by its format's own library."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

_COLUMNS, _ROWS = 13, 10_000  # of the CSV; of a piece of it
_START, _STEP = 1_700_000_000_000_000_000, 2_000_000  # [ns], 500 Hz


def write_csv(path: Path, size: float) -> None:
    """A CSV of time and twelve random columns, by pyarrow.

    Args:
        size: [B] at which it ends.
    """
    import pyarrow as pa
    from pyarrow import csv

    random, done = np.random.default_rng(0), 0
    names = ["time", *(f"q{k}" for k in range(1, _COLUMNS))]
    schema = pa.schema([(name, pa.float64()) for name in names])
    with csv.CSVWriter(path, schema) as writer:
        while not done or path.stat().st_size < size:
            values = random.normal(size=(_COLUMNS, _ROWS))
            values[0] = (done + np.arange(_ROWS)) * _STEP / 1e9
            writer.write_batch(pa.record_batch(list(values), schema=schema))
            done += _ROWS


def write_mcap(path: Path, size: float) -> None:
    """An MCAP of joint states of seven joints and IMU messages, by mcap.

    Args:
        size: [B] at which it ends, or nearly.
    """
    from mcap.writer import Writer

    made = _MessageMaker()
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        channels = {}
        for topic, kind in _KINDS.items():
            text, _ = made.store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        number = 0
        while file.tell() < size:
            time = _START + number * _STEP
            for topic, message in made.make_messages(time).items():
                writer.add_message(channels[topic], time, message, time)
            number += 1
        writer.finish()


_KINDS = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/imu": "sensor_msgs/msg/Imu",
}


class _MessageMaker:
    """Messages of two topics, encoded."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store: Any = get_typestore(Stores.ROS2_HUMBLE)
        self._random = np.random.default_rng(0)

    def make_messages(self, time: int) -> Mapping[str, bytes]:
        """One message of each topic, at a time [ns]."""
        types = self.store.types
        stamp = types["builtin_interfaces/msg/Time"](time // 10**9, time % 10**9)
        header = types["std_msgs/msg/Header"](stamp, "base")
        q, v, tau = self._random.normal(size=(3, 7))
        names = [f"joint_{k}" for k in range(7)]
        turn = types["geometry_msgs/msg/Quaternion"](*self._random.normal(size=4))
        vector, zeros = types["geometry_msgs/msg/Vector3"], np.zeros(9)
        rate, force = (vector(*self._random.normal(size=3)) for _ in range(2))
        messages = {
            "/joint_states": types[_KINDS["/joint_states"]](header, names, q, v, tau),
            "/imu": types[_KINDS["/imu"]](
                header, turn, zeros, rate, zeros, force, zeros
            ),
        }
        return {
            topic: bytes(self.store.serialize_cdr(message, _KINDS[topic]))
            for topic, message in messages.items()
        }


WRITERS: Mapping[str, Callable[[Path, float], None]] = {
    "csv": write_csv,
    "mcap": write_mcap,
}
