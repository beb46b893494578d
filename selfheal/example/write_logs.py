"""Logs as robots' software writes them: runs of a robot in; files and folders out."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..extras import import_extra
from ..files import atomic_path, write_text
from .simulate import Run

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


def write_csv(path: Path, runs: Sequence[Run], joints: Sequence[str]) -> None:
    """A table in milliseconds and degrees, as a servo's software writes it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [f"{word} {name} [deg]" for word in ("goal", "angle") for name in joints]
    writer.writerow(["time [ms]", "run", *heads])
    for number, run in enumerate(runs):
        values = np.rad2deg(np.hstack([run.goal, run.position]))
        for time, row in zip(run.time, values, strict=True):
            cells = [f"{value:.3f}" for value in row]
            writer.writerow([f"{1000 * time:.0f}", f"run {number + 1}", *cells])
    write_text(path, text.getvalue())


def write_npz(path: Path, runs: Sequence[Run], joints: Sequence[str]) -> None:
    """Arrays of all joints together, as scripts of legged robots write them."""
    starts = np.cumsum([0.0, *(run.time[-1] + 5.0 for run in runs[:-1])])
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            time=np.concatenate(
                [s + r.time for s, r in zip(starts, runs, strict=False)]
            ),
            des_dof_pos=np.concatenate([run.goal for run in runs]),
            dof_pos=np.concatenate([run.position for run in runs]),
            dof_vel=np.concatenate([run.velocity for run in runs]),
        )


_DATA_PATH = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"


def write_lerobot(path: Path, runs: Sequence[Run], joints: Sequence[str]) -> None:
    """A LeRobot folder, v2.1: degrees, and the last joint in percent of its range."""
    import pyarrow
    from pyarrow import parquet

    rate = 1 / (runs[0].time[1] - runs[0].time[0])
    names = [f"{name}.pos" for name in joints]
    vector = {"dtype": "float32", "shape": [len(names)], "names": names}
    features = {"action": vector, "observation.state": vector}
    info = {
        "codebase_version": "v2.1",
        "robot_type": "desk_arm",
        "fps": round(rate),
        "total_episodes": len(runs),
        "total_frames": sum(run.time.size for run in runs),
        "chunks_size": 1000,
        "data_path": _DATA_PATH,
        "features": features,
    }
    for folder in ("meta", "data/chunk-000"):
        (path / folder).mkdir(parents=True, exist_ok=True)
    write_text(path / "meta" / "info.json", json.dumps(info, indent=2))
    for number, run in enumerate(runs):
        count = run.time.size
        table = pyarrow.table(
            {
                "action": _make_percent(run.goal).astype("f4").tolist(),
                "observation.state": _make_percent(run.position).astype("f4").tolist(),
                "timestamp": run.time.astype("f4"),
                "frame_index": np.arange(count),
                "episode_index": np.full(count, number),
            }
        )
        file = path / _DATA_PATH.format(episode_chunk=0, episode_index=number)
        with atomic_path(file) as temporary:
            parquet.write_table(table, temporary)


GRIPPER_RANGE = (-0.17, 1.7)  # [rad] of which a desk arm's gripper is commanded a share


def _make_percent(values: np.ndarray) -> np.ndarray:
    """Angles (T, J) [rad] as LeRobot has them: degrees, the gripper 0 to 100."""
    found = np.rad2deg(values)
    low, high = GRIPPER_RANGE
    found[:, -1] = 100 * (values[:, -1] - low) / (high - low)
    return found


def write_ros2_bag(path: Path, runs: Sequence[Run], joints: Sequence[str]) -> None:
    """A ROS 2 bag: the joints' states, and the commands as a topic of its own.

    Args:
        path: of the folder; one that is there is replaced.
    """
    import shutil

    rosbag2 = import_extra("rosbags.rosbag2", "logs", "a ROS 2 bag")
    stores = import_extra("rosbags.typesys", "logs", "a ROS 2 bag")
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    state, command = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray"
    shutil.rmtree(path, ignore_errors=True)
    with rosbag2.Writer(path, version=9) as bag:
        states = bag.add_connection("/joint_states", state, typestore=store)
        commands = bag.add_connection("/commands", command, typestore=store)
        start = 1_750_000_000.0  # [s] since 1970; any day
        for run in runs:
            for k, time in enumerate(start + run.time):
                stamp = round(1e9 * time)
                message = _make_joint_state(store, stamp, joints, run, k)
                bag.write(states, stamp, store.serialize_cdr(message, state))
                message = _make_array(store, run.goal[k])
                bag.write(commands, stamp, store.serialize_cdr(message, command))
            start += run.time[-1] + 5.0


def _make_joint_state(
    store: "Typestore", stamp: int, joints: Sequence[str], run: Run, row: int
) -> object:
    """A sensor_msgs/JointState of a row of a run."""
    types = store.types
    seconds, rest = divmod(stamp, 10**9)
    header = types["std_msgs/msg/Header"](
        types["builtin_interfaces/msg/Time"](seconds, rest), "base"
    )
    return types["sensor_msgs/msg/JointState"](
        header, list(joints), run.position[row], run.velocity[row], np.empty(0)
    )


def _make_array(store: "Typestore", values: np.ndarray) -> object:
    """A std_msgs/Float64MultiArray of numbers (J)."""
    types = store.types
    layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
    return types["std_msgs/msg/Float64MultiArray"](layout, values)
