"""Faults of logs and set-ups of drawn robots: a robot in, what its user has out."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.recordings import (
    edit_episodes,
    edit_values,
    join_readings,
    select_rows,
)
from benchmarks.telemetry.drawn_robots import DrawnRobot
from benchmarks.telemetry.faults import (
    DEGREES,
    change_columns,
    exchange_columns,
)
from selfheal.recording import Recording

FOREIGN = (0.05, 0.3)  # share of rows that another publisher sends
NARROW = (0.5, 0.8)  # a model's range over what the joint passes through
TURN = (20.0, 180.0)  # [degrees] of a board
RUNS = (0.3, 0.6)  # share of an episode after which it is aborted, and its length
Rng = np.random.Generator


@dataclass(frozen=True)
class Setup:
    """What a user has of a robot, with one fault or none.

    Attributes:
        name: of the fault; "" of none.
        kinds: of faults that name it rightly.
        columns: that are at fault, or the episode; empty where it is the model.
        recording: of the robot, as the log has it.
    """

    name: str
    kinds: tuple[str, ...]
    columns: frozenset[str]
    recording: Recording
    xml: str


Maker = Callable[[DrawnRobot, Rng], Setup | None]


def _choose(robot: DrawnRobot, rng: Rng, count: int = 1) -> list[str]:
    """Names of joints."""
    return [robot.joints[k] for k in rng.permutation(len(robot.joints))[:count]]


def _change_log(robot: DrawnRobot, name: str, kind: str, recording: Recording) -> Setup:
    """The robot with another log, which differs in the columns that changed."""
    first, old = (
        next(iter(r.episodes.values())).signals for r in (recording, robot.recording)
    )
    changed = {n for n, s in first.items() if s.values is not old[n].values}
    return Setup(name, (kind,), frozenset(changed), recording, robot.xml)


def _change_model(robot: DrawnRobot, name: str, kind: str, root: ET.Element) -> Setup:
    """The robot with another model."""
    xml = ET.tostring(root, encoding="unicode")
    return Setup(name, (kind,), frozenset(), robot.recording, xml)


def _find(root: ET.Element, path: str) -> ET.Element:
    found = root.find(path)
    assert found is not None
    return found


def make_unit(robot: DrawnRobot, rng: Rng) -> Setup:
    """Degrees: of all readings, of all readings and goals, or of one joint."""
    joints, of = robot.joints, rng.integers(3)
    if of == 2:
        joints = _choose(robot, rng)
    columns = [c for j in joints for c in robot.list_columns(j)]
    recording = change_columns(robot.recording, columns, lambda t, x: DEGREES * x)
    if of == 1 and robot.gains:
        recording = edit_episodes(
            recording, lambda e: replace(e, ctrl=DEGREES * e.ctrl)
        )
    return _change_log(robot, "unit", "unit", recording)


def make_range(robot: DrawnRobot, rng: Rng) -> Setup:
    """A model's range narrower than the robot's."""
    (joint,) = _choose(robot, rng)
    column = f"{joint}_position"
    low, high = np.quantile(join_readings(robot.recording, column), [0.005, 0.995])
    share = rng.uniform(*NARROW)
    start = low + rng.uniform(0, 1 - share) * (high - low)
    root = ET.fromstring(robot.xml)
    limits = f"{start:.4f} {start + share * (high - low):.4f}"
    _find(root, f".//joint[@name='{joint}']").set("range", limits)
    setup = _change_model(robot, "range", "joint_range", root)
    return replace(setup, columns=frozenset([column]))


def make_sign(robot: DrawnRobot, rng: Rng) -> Setup:
    """A joint that is read with the other sign."""
    columns = robot.list_columns(*_choose(robot, rng))
    recording = change_columns(robot.recording, columns, lambda t, x: -x)
    return _change_log(robot, "sign", "sign", recording)


def make_exchange(robot: DrawnRobot, rng: Rng) -> Setup:
    """Two joints whose columns are exchanged."""
    one, other = (robot.list_columns(j) for j in _choose(robot, rng, 2))
    pairs = dict(zip([*one, *other], [*other, *one], strict=True))
    recording = exchange_columns(robot.recording, pairs)
    return _change_log(robot, "exchange", "exchange", recording)


def make_frame(robot: DrawnRobot, rng: Rng) -> Setup:
    """A board that is turned against its site, by quarters or anyhow."""
    if rng.random() < 0.5:
        turn = Rotation.create_group("O")[int(rng.integers(1, 24))]
    else:
        axis = rng.normal(size=3)
        angle = np.deg2rad(rng.uniform(*TURN))
        turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle)
    board = ["gyro", "acc"]
    recording = change_columns(robot.recording, board, lambda t, x: turn.apply(x))
    return _change_log(robot, "frame", "sensor_frame", recording)


def make_foreign(robot: DrawnRobot, rng: Rng) -> Setup:
    """Rows of zeros that another program sends for all joints."""
    columns = [c for j in robot.joints for c in robot.list_columns(j)]
    every = round(1 / rng.uniform(*FOREIGN))

    def silence(time: np.ndarray, values: np.ndarray) -> np.ndarray:
        out = values.copy()
        out[every // 2 :: every] = 0.0
        return out

    recording = change_columns(robot.recording, columns, silence)
    return _change_log(robot, "foreign rows", "zeros", recording)


def make_goals(robot: DrawnRobot, rng: Rng) -> Setup | None:
    """Goals, sent to what the model has as torque motors."""
    if not robot.gains:
        return None
    root = ET.fromstring(robot.xml)
    for drive in root.iter("position"):
        drive.tag = "motor"
        for name in ("kp", "kv"):
            del drive.attrib[name]
    return _change_model(robot, "goals to motors", "actuator_type", root)


def make_no_actuators(robot: DrawnRobot, rng: Rng) -> Setup:
    """A model without actuators."""
    root = ET.fromstring(robot.xml)
    root.remove(_find(root, "actuator"))
    return _change_model(robot, "no actuators", "no_actuator", root)


def make_free_base(robot: DrawnRobot, rng: Rng) -> Setup:
    """A model whose trunk floats, of a robot that is bolted down."""
    root = ET.fromstring(robot.xml)
    trunk = _find(root, ".//body[@name='trunk']")
    trunk.insert(0, ET.Element("freejoint", name="root"))
    return _change_model(robot, "unread base", "free_base", root)


def make_contact(robot: DrawnRobot, rng: Rng) -> Setup:
    """A first link whose shape reaches into the trunk's in the model."""
    root = ET.fromstring(robot.xml)
    names = "trunk", robot.joints[0]
    shapes = [_find(root, f".//geom[@name='{name}_shape']") for name in names]
    for shape in shapes:
        shape.attrib |= {"contype": "1", "conaffinity": "1"}
    ends = shapes[1].get("fromto", "").split()
    start = ["0 0", f"{-rng.uniform(0, 0.03):.4f}"]
    shapes[1].set("fromto", " ".join([*start, *ends[3:]]))
    return _change_model(robot, "standing contact", "permanent_contact", root)


def make_short_run(robot: DrawnRobot, rng: Rng) -> Setup:
    """An episode that ends early, its drives off before that."""
    odd = str(rng.choice(list(robot.recording.episodes)))
    e = robot.recording.episodes[odd]
    at, end = (round(share * e.time.size) for share in RUNS)
    model = mujoco.MjModel.from_xml_string(robot.xml)
    data = mujoco.MjData(model)
    data.qpos[:] = [e.signals[f"{j}_position"].values[at] for j in robot.joints]
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    values = {n: s.values[:end].copy() for n, s in e.signals.items()}
    steps = round((e.time[1] - e.time[0]) / model.opt.timestep)
    for k in range(at, end):
        mujoco.mj_forward(model, data)
        for i, j in enumerate(robot.joints):
            values[f"{j}_position"][k] = data.qpos[i] + rng.normal(0, 3e-4)
            if f"{j}_velocity" in values:
                values[f"{j}_velocity"][k] = data.qvel[i] + rng.normal(0, 0.01)
        values["gyro"][k] = data.sensor("gyro").data + rng.normal(0, 5e-3, 3)
        values["acc"][k] = data.sensor("acc").data + rng.normal(0, 0.04, 3)
        mujoco.mj_step(model, data, steps)
    short = edit_values(select_rows(e, slice(end)), lambda n, x: values[n])
    episodes = {**robot.recording.episodes, odd: short}
    return Setup(
        "short run",
        ("odd_episode",),
        frozenset([odd]),
        replace(robot.recording, episodes=episodes),
        robot.xml,
    )


MAKERS: tuple[Maker, ...] = (
    *(make_unit, make_range, make_sign, make_exchange, make_frame, make_foreign),
    *(make_goals, make_no_actuators, make_free_base, make_contact, make_short_run),
)


def draw_setup(number: int, robot: DrawnRobot) -> Setup | None:
    """A fault of a robot, each kind in turn; None where it cannot have that."""
    return MAKERS[number % len(MAKERS)](robot, np.random.default_rng(number))
