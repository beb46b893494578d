"""Logs of two joints as ten kinds of software write them, with something concealed."""

import io
import json
import shutil
from pathlib import Path

import h5py
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.io import savemat

from selfheal.example.simulate import Run
from tests.support.logs.newcomer_robots import StandingRun
from tests.support.logs.table_files import write_lerobot
from tests.support.logs.torch_files import Tensor, save_archive

CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
_POINT = "trajectory_msgs/JointTrajectoryPoint"
_DEFINITION = "std_msgs/Header header\nstring[] joint_names\n" + "".join(
    f"{_POINT} {name}\n" for name in ("reference", "feedback", "error", "output")
)


def write_numbers(path: Path, runs: list[Run], joints: list[str]) -> None:
    """A table of numbers without a header, run behind run: time, goals, readings."""
    tables = [np.column_stack([r.time, r.goal, r.position, r.velocity]) for r in runs]
    text = io.StringIO()
    np.savetxt(text, np.concatenate(tables), fmt="%.6f", delimiter=",")
    path.write_text(text.getvalue())


def write_controller_mcap(path: Path, runs: list[Run], joints: list[str]) -> None:
    """What ros2_control publishes: joints by the alphabet, and a state of goals."""
    shutil.rmtree(path, ignore_errors=True)
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_DEFINITION, CONTROLLER))
    types, none = store.types, np.empty(0)
    order = np.argsort(joints)
    zero = types["builtin_interfaces/msg/Duration"](0, 0)

    def point(values: np.ndarray) -> object:
        kind = types["trajectory_msgs/msg/JointTrajectoryPoint"]
        return kind(values, none, none, none, zero)

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        kinds = {
            "/joint_states": "sensor_msgs/msg/JointState",
            "/arm_controller/controller_state": CONTROLLER,
        }
        topics = [
            bag.add_connection(name, kind, typestore=store)
            for name, kind in kinds.items()
        ]
        start = 1_750_000_000.0
        for run in runs:
            for k, time in enumerate(start + run.time):
                stamp = round(1e9 * time)
                now = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
                head = types["std_msgs/msg/Header"](now, "")
                names, read = [joints[j] for j in order], (run.position, run.velocity)
                states = [values[k, order] for values in read]
                goal, angle = run.goal[k], run.position[k]
                points = [point(v) for v in (goal, angle, goal - angle, none)]
                messages = (
                    types["sensor_msgs/msg/JointState"](head, names, *states, none),
                    types[CONTROLLER](head, joints, *points),
                )
                for topic, message in zip(topics, messages, strict=True):
                    raw = store.serialize_cdr(message, message.__msgtype__)
                    bag.write(topic, stamp + 300_000, raw)
            start += run.time[-1] + 5.0


def write_lerobot3(
    path: Path, runs: list[Run], joints: list[str], *, limits, in_degrees: bool
) -> None:
    """A LeRobot folder, v3.0, whose last joint is a gripper, in percent.

    Args:
        limits: (J, 2) of the joints [rad].
        in_degrees: whether the others are in degrees, else in shares, -100 to 100.
    """
    low, high = np.transpose(limits)

    def convert(angles: np.ndarray) -> np.ndarray:
        share = np.clip((angles - low) / (high - low), 0, 1)  # as LeRobot does
        values = np.rad2deg(low + share * (high - low))
        values = values if in_degrees else 200 * share - 100
        values[:, -1] = 100 * share[:, -1]
        return values.astype("f4")

    names = [f"{n}.pos" for n in joints]
    vector = {"dtype": "float32", "shape": [len(names)], "names": names}
    info = {
        "codebase_version": "v3.0",
        "robot_type": "so101_follower",
        "fps": round(1 / (runs[0].time[1] - runs[0].time[0])),
        "total_episodes": len(runs),
        "chunks_size": 1000,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "features": {"action": vector, "observation.state": vector},
    }
    episodes = [
        {
            "action": convert(run.goal).tolist(),
            "observation.state": convert(run.position).tolist(),
            "timestamp": run.time.astype("f4"),
            "frame_index": np.arange(run.time.size),
            "episode_index": np.full(run.time.size, k),
        }
        for k, run in enumerate(runs)
    ]
    write_lerobot(path, info, *episodes)


def _join_buffers(runs: list[Run]) -> dict[str, np.ndarray]:
    """Arrays of all steps of runs that follow each other after 5 s."""
    starts = np.cumsum([0.0, *(run.time[-1] + 5.0 for run in runs[:-1])])
    buffers = {"time": [s + r.time for s, r in zip(starts, runs, strict=True)]}
    buffers |= {"dof_pos": [r.position for r in runs]}
    buffers |= {"dof_vel": [r.velocity for r in runs]}
    buffers |= {"dof_pos_target": [r.goal for r in runs]}
    return {name: np.concatenate(parts) for name, parts in buffers.items()}


def write_legged_gym(path: Path, runs: list[Run], joints: list[str]) -> None:
    """Buffers of all steps, as a deployment of legged_gym saves them."""
    buffers = _join_buffers(runs).items()
    save_archive(path, {name: Tensor(b.astype("f4")) for name, b in buffers})


def write_servo_json(path: Path, runs: list[Run], joints: list[str]) -> None:
    """Runs of one servo, as mauicv/servo-sysid writes them: its rate, no units."""
    usual = {"type": "chirp", "targets": []}
    pairs = [(run.goal[:, 0].tolist(), run.position[:, 0].tolist()) for run in runs]
    data = [{**usual, "actions": goal, "sensor_data": read} for goal, read in pairs]
    path.write_text(json.dumps({"config": {"action_hz": 50}, "data": data}))


def write_robomimic(path: Path, runs: list[Run], joints: list[str]) -> None:
    """Demonstrations, without a time: the rate is in the text of `env_args`."""
    rate = round(1 / (runs[0].time[1] - runs[0].time[0]))
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": rate}})
        for k, run in enumerate(runs):
            demo = data.create_group(f"demo_{k}")
            demo["actions"], demo["dones"] = run.goal, np.zeros(run.time.size, int)
            demo["obs/robot0_joint_pos"] = run.position
            demo["obs/robot0_joint_vel"] = run.velocity


def write_matlab(path: Path, runs: list[Run], joints: list[str]) -> None:
    """A structure array of trials: t, u, q and qd, columns as MATLAB has them."""
    kinds = [(name, "O") for name in ("t", "u", "q", "qd")]
    trials = [(r.time[:, None], r.goal, r.position, r.velocity) for r in runs]
    savemat(path, {"trial": np.array(trials, dtype=kinds)})


def write_standing(path: Path, runs: list[StandingRun], joints: list[str]) -> None:
    """Buffers of a quadruped and its base, whose quaternions end with w."""
    base = np.concatenate([run.base for run in runs])
    pose = {"base_pos": base[:, :3], "base_quat": base[:, [4, 5, 6, 3]]}
    np.savez(path, **_join_buffers(runs), **pose)
