"""Faults of logs and set-ups of drawn robots: a robot in, what its user has out."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.telemetry.drawn_robots import DrawnRobot
from benchmarks.telemetry.faults import change_columns, exchange_columns
from selfheal.recording import Recording

Values = np.ndarray
DEGREES = 180 / np.pi
FOREIGN = (0.05, 0.3)  # share of rows that another publisher sends
NARROW = (0.5, 0.8)  # a model's range over what the joint passes through
TURN = (20.0, 180.0)  # [degrees] of a board
RUNS = (0.3, 0.6)  # share of an episode after which it is aborted, and its length


@dataclass(frozen=True)
class Setup:
    """What a user has of a robot, with one fault or none.

    Attributes:
        name: of the fault; "" of none.
        kinds: of faults that name it rightly.
        columns: that are at fault, or the episode; empty where it is the model.
        recording: of the robot, as the log has it.
        xml: of the model.
    """

    name: str
    kinds: tuple[str, ...]
    columns: frozenset[str]
    recording: Recording
    xml: str


Maker = Callable[[DrawnRobot, np.random.Generator], Setup | None]


def _choose(robot: DrawnRobot, rng: np.random.Generator, count: int = 1) -> list[str]:
    """Names of joints."""
    joints = list_joints(robot)
    return [joints[k] for k in rng.permutation(len(joints))[:count]]


def list_joints(robot: DrawnRobot) -> list[str]:
    """Names of a robot's joints."""
    signals = next(iter(robot.recording.episodes.values())).signals.values()
    return [s.target for s in signals if s.kind == "joint_position"]


def _list_columns(robot: DrawnRobot, joint: str) -> list[str]:
    """Signals of a joint."""
    signals = next(iter(robot.recording.episodes.values())).signals
    return [n for n, s in signals.items() if s.target == joint]


def _edit(
    robot: DrawnRobot,
    columns: list[str],
    change: Callable[[Values], Values],
    ctrl: Callable[[Values], Values] | None = None,
) -> Recording:
    """The recording with changed columns.

    Args:
        ctrl: of all commands (T, n).
    """
    recording = change_columns(
        robot.recording, frozenset(columns), lambda _, x: change(x)
    )
    if ctrl is None:
        return recording
    episodes = recording.episodes.items()
    return replace(
        recording, episodes={k: replace(e, ctrl=ctrl(e.ctrl)) for k, e in episodes}
    )


def make_unit(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """Degrees: of all readings, of all readings and goals, or of one joint."""
    joints, of = list_joints(robot), rng.integers(3)
    if of == 2:
        joints = _choose(robot, rng)
    columns = [c for j in joints for c in _list_columns(robot, j)]
    both = of == 1 and bool(robot.gains)
    scale: Callable[[Values], Values] = lambda x: x * DEGREES  # noqa: E731
    recording = _edit(robot, columns, scale, scale if both else None)
    return Setup("unit", ("unit",), frozenset(columns), recording, robot.xml)


def make_range(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """A model's range narrower than the robot's."""
    (joint,) = _choose(robot, rng)
    x = np.concatenate(
        [
            e.signals[f"{joint}_position"].values
            for e in robot.recording.episodes.values()
        ]
    )
    low, high = np.quantile(x, [0.005, 0.995])
    share = rng.uniform(*NARROW)
    start = low + rng.uniform(0, 1 - share) * (high - low)
    root = ET.fromstring(robot.xml)
    found = root.find(f".//joint[@name='{joint}']")
    assert found is not None
    found.set("range", f"{start:.4f} {start + share * (high - low):.4f}")
    columns = frozenset([f"{joint}_position"])
    return Setup("range", ("joint_range",), columns, robot.recording, _text(root))


def make_sign(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """A joint that is read with the other sign."""
    columns = _list_columns(robot, *_choose(robot, rng))
    recording = _edit(robot, columns, np.negative)
    return Setup("sign", ("sign",), frozenset(columns), recording, robot.xml)


def make_exchange(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """Two joints whose columns are exchanged."""
    one, other = (_list_columns(robot, j) for j in _choose(robot, rng, 2))
    pairs = dict(zip([*one, *other], [*other, *one], strict=True))
    recording = exchange_columns(robot.recording, pairs)
    return Setup("exchange", ("exchange",), frozenset(pairs), recording, robot.xml)


def make_frame(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """A board that is turned against its site, by quarters or anyhow."""
    if rng.random() < 0.5:
        turn = Rotation.create_group("O")[int(rng.integers(1, 24))]
    else:
        axis = rng.normal(size=3)
        turn = Rotation.from_rotvec(
            axis / np.linalg.norm(axis) * np.deg2rad(rng.uniform(*TURN))
        )
    recording = _edit(robot, ["gyro", "acc"], turn.apply)
    columns = frozenset(["gyro", "acc"])
    return Setup("frame", ("sensor_frame",), columns, recording, robot.xml)


def make_foreign(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """Rows of zeros that another program sends for all joints."""
    columns = [c for j in list_joints(robot) for c in _list_columns(robot, j)]
    share = rng.uniform(*FOREIGN)
    every = round(1 / share)

    def silence(values: Values) -> Values:
        out = values.copy()
        out[every // 2 :: every] = 0.0
        return out

    recording = _edit(robot, columns, silence)
    return Setup("foreign rows", ("zeros",), frozenset(columns), recording, robot.xml)


def _set_model(robot: DrawnRobot, name: str, kind: str, root: ET.Element) -> Setup:
    """The robot's recording with another model, which is named by one kind of fault."""
    return Setup(name, (kind,), frozenset(), robot.recording, _text(root))


def make_goals(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """Goals, sent to what the model has as torque motors."""
    if not robot.gains:
        return None
    root = ET.fromstring(robot.xml)
    for drive in root.iter("position"):
        drive.tag = "motor"
        for name in ("kp", "kv"):
            del drive.attrib[name]
    return _set_model(robot, "goals to motors", "actuator_type", root)


def make_no_actuators(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """A model without actuators."""
    root = ET.fromstring(robot.xml)
    drives = root.find("actuator")
    assert drives is not None
    root.remove(drives)
    return _set_model(robot, "no actuators", "no_actuator", root)


def make_free_base(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """A model whose trunk floats, of a robot that is bolted down."""
    root = ET.fromstring(robot.xml)
    trunk = root.find(".//body[@name='trunk']")
    assert trunk is not None
    trunk.insert(0, ET.Element("freejoint", name="root"))
    return _set_model(robot, "unread base", "free_base", root)


def make_contact(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """A first link whose shape reaches into the trunk's in the model."""
    root = ET.fromstring(robot.xml)
    shapes = [
        root.find(f".//geom[@name='{n}_shape']")
        for n in ("trunk", list_joints(robot)[0])
    ]
    for shape in shapes:
        assert shape is not None
        shape.set("contype", "1")
        shape.set("conaffinity", "1")
    assert shapes[1] is not None
    ends = shapes[1].get("fromto", "").split()
    shapes[1].set(
        "fromto", " ".join(["0 0", f"{-rng.uniform(0, 0.03):.4f}", *ends[3:]])
    )
    return _set_model(robot, "standing contact", "permanent_contact", root)


def make_short_run(robot: DrawnRobot, rng: np.random.Generator) -> Setup | None:
    """An episode that ends early, its drives off before that."""
    episodes = dict(robot.recording.episodes)
    odd = str(rng.choice(list(episodes)))
    e = episodes[odd]
    at, end = (round(share * e.time.size) for share in RUNS)
    model = mujoco.MjModel.from_xml_string(robot.xml)
    data = mujoco.MjData(model)
    joints = list_joints(robot)
    data.qpos[:] = [e.signals[f"{j}_position"].values[at] for j in joints]
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    signals = {n: s.values[:end].copy() for n, s in e.signals.items()}
    for k in range(at, end):
        mujoco.mj_forward(model, data)
        for i, j in enumerate(joints):
            noise = rng.normal(0, 3e-4)
            signals[f"{j}_position"][k] = data.qpos[i] + noise
            if f"{j}_velocity" in signals:
                signals[f"{j}_velocity"][k] = data.qvel[i] + rng.normal(0, 0.01)
        signals["gyro"][k] = data.sensor("gyro").data + rng.normal(0, 5e-3, 3)
        signals["acc"][k] = data.sensor("acc").data + rng.normal(0, 0.04, 3)
        step = (e.time[1] - e.time[0]) / model.opt.timestep
        mujoco.mj_step(model, data, round(step))
    episodes[odd] = replace(
        e,
        time=e.time[:end],
        ctrl=e.ctrl[:end],
        signals={n: replace(s, values=signals[n]) for n, s in e.signals.items()},
    )
    recording = replace(robot.recording, episodes=episodes)
    columns = frozenset([odd])
    return Setup("short run", ("odd_episode",), columns, recording, robot.xml)


MAKERS: tuple[Maker, ...] = (
    make_unit,
    make_range,
    make_sign,
    make_exchange,
    make_frame,
    make_foreign,
    make_goals,
    make_no_actuators,
    make_free_base,
    make_contact,
    make_short_run,
)


def draw_setup(number: int, robot: DrawnRobot) -> Setup | None:
    """A fault of a robot, each kind in turn; None where it cannot have that."""
    return MAKERS[number % len(MAKERS)](robot, np.random.default_rng(number))


def _text(root: ET.Element) -> str:
    return ET.tostring(root, encoding="unicode")
