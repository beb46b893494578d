"""ROS bags written by rosbags and mcap, and read back."""

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from tests.support.logs.bags import START, STEP, write_bag, write_mcap
from tests.support.logs.reading import check_rows, read_all, read_damaged

CUSTOM = "std_msgs/Header header\nfloat32 effort\nuint8[] blob\nMotor[2] motors\n"
CUSTOM += "bool class_ok\nstring note\n" + "=" * 80 + "\nMSG: my_msgs/Motor\n"
CUSTOM += "float64 q\nint16[3] raw\n"
JOINTS = "sensor_msgs/msg/JointState"


@pytest.fixture(scope="module")
def store():
    found = get_typestore(Stores.ROS2_HUMBLE)
    found.register(get_types_from_msg(CUSTOM, "my_msgs/msg/State"))
    return found


def _stamp(store, time):
    return store.types["builtin_interfaces/msg/Time"](time // 10**9, time % 10**9)


def _header(store, time):
    return store.types["std_msgs/msg/Header"](_stamp(store, time), "base")


def _make_joints(store, k, names=("hip", "knee"), stamp=None):
    """A joint state whose values tell joint and message; when it was measured."""
    value = {"hip": 100.0, "knee": 200.0, "gripper": 300.0}
    q = np.array([value[name] + k for name in names])
    stamp = START + k * STEP - 5_000_000 if stamp is None else stamp
    none = np.array([])
    return store.types[JOINTS](_header(store, stamp), list(names), q, -q, none)


def _list_joints(store, count=30):
    return [("/joints", _make_joints(store, k)) for k in range(count)]


def _check_joints(found, count=30):
    k = np.arange(count)
    assert list(found) == [
        *("bag time", "header.stamp", "position[hip]", "position[knee]"),
        *("velocity[hip]", "velocity[knee]"),
    ]
    np.testing.assert_allclose(found["bag time"], START / 1e9 + k * 0.01, rtol=1e-15)
    np.testing.assert_allclose(found["header.stamp"], START / 1e9 + k * 0.01 - 0.005)
    np.testing.assert_array_equal(found["position[knee]"], 200.0 + k)
    np.testing.assert_array_equal(found["velocity[hip]"], -100.0 - k)


@pytest.mark.parametrize("plugin", StoragePlugin)
@pytest.mark.parametrize("mode", [None, CompressionMode.MESSAGE, CompressionMode.FILE])
@pytest.mark.parametrize("lone", [False, True])
def test_joint_states_are_columns_by_the_names_of_joints(
    tmp_path, store, plugin, mode, lone
):
    packed = {"fmt": CompressionFormat.ZSTD, "mode": mode} if mode else {}
    path = write_bag(tmp_path / "bag", store, _list_joints(store), plugin, **packed)
    if lone:
        (path,) = (file for file in path.iterdir() if file.suffix != ".yaml")
    log = open_log(path)
    (stream,) = log.streams
    assert (stream.name, stream.rows, stream.time) == ("/joints", 30, "header.stamp")
    assert stream.columns["header.stamp"] == stream.columns["bag time"] == "s"
    check_rows(log)
    _check_joints(read_all(log)["/joints"])


@pytest.mark.parametrize("names", [("knee", "hip"), ("hip", "gripper", "knee")])
def test_joints_that_change_their_places_keep_their_columns(tmp_path, store, names):
    messages = _list_joints(store, 10)
    messages[4:8] = [("/joints", _make_joints(store, k, names)) for k in range(4, 8)]
    found = read_all(open_log(write_bag(tmp_path / "bag", store, messages)))["/joints"]
    np.testing.assert_array_equal(found["position[hip]"], 100.0 + np.arange(10))
    np.testing.assert_array_equal(found["position[knee]"], 200.0 + np.arange(10))
    if "gripper" in names:
        has = np.isfinite(found["position[gripper]"])
        assert has.nonzero()[0].tolist() == [4, 5, 6, 7]


@pytest.mark.parametrize("step", [0, -STEP])
def test_without_stamps_that_increase_the_time_of_receipt_counts(tmp_path, store, step):
    stamps = [(START + k * step) * bool(step) for k in range(5)]
    messages = [
        ("/joints", _make_joints(store, k, stamp=stamp))
        for k, stamp in enumerate(stamps)
    ]
    log = open_log(write_bag(tmp_path / "bag", store, messages))
    assert log.streams[0].time == "bag time"
    assert "header.stamp" in log.streams[0].columns


def test_a_type_of_ones_own_is_read_by_its_definition(tmp_path, store):
    motor, state = (store.types[f"my_msgs/msg/{name}"] for name in ("Motor", "State"))
    blob, messages = np.zeros(3, np.uint8), []
    for k in range(6):
        raw = [np.array(values, np.int16) for values in ([k, 0, 0], [0, 0, k])]
        motors = [motor(k + 10.0, raw[0]), motor(k + 20.0, raw[1])]
        header = _header(store, START + k)
        made = state(header, k / 2, blob, motors, bool(k % 2), "text")
        messages.append(("/state", made))
    found = read_all(open_log(write_bag(tmp_path / "bag", store, messages)))["/state"]
    assert set(found) == {
        *("bag time", "header.stamp", "effort", "class_ok"),
        *(
            f"motors[{m}].{x}"
            for m in "01"
            for x in ("q", "raw[0]", "raw[1]", "raw[2]")
        ),
    }
    np.testing.assert_array_equal(found["effort"], np.arange(6) / 2)
    np.testing.assert_array_equal(found["motors[1].q"], np.arange(6) + 20)
    np.testing.assert_array_equal(found["motors[1].raw[2]"], np.arange(6))


def _list_usual(store):
    """A message of each usual type, and a column with its value."""
    types = store.types
    get = lambda name: types[name.replace("/", "/msg/")]  # noqa: E731
    vector = get("geometry_msgs/Vector3")
    turn = get("geometry_msgs/Quaternion")(0.0, 0.0, 0.6, 0.8)
    pose = get("geometry_msgs/Pose")(get("geometry_msgs/Point")(1.0, 2.0, 3.0), turn)
    twist = get("geometry_msgs/Twist")(vector(1.0, 2.0, 3.0), vector(4.0, 5.0, 6.0))
    header, zeros = _header(store, START), np.zeros(36)
    layout = get("std_msgs/MultiArrayLayout")([], 0)
    duration = get("builtin_interfaces/Duration")(2, 500_000_000)
    point = get("trajectory_msgs/JointTrajectoryPoint")(
        np.array([7.0, 8.0]), np.array([]), np.array([]), np.array([]), duration
    )
    rates, nine = (vector(1.0, 2.0, 3.0), vector(4.0, 5.0, 6.0)), np.zeros(9)
    imu = get("sensor_msgs/Imu")(header, turn, nine, rates[0], nine, rates[1], nine)
    with_covariance = get("geometry_msgs/PoseWithCovariance")(pose, zeros)
    moving = get("geometry_msgs/TwistWithCovariance")(twist, zeros)
    odometry = get("nav_msgs/Odometry")(header, "foot", with_covariance, moving)
    wrench = get("geometry_msgs/Wrench")(vector(1.0, 2.0, 3.0), vector(4.0, 5.0, 6.0))
    trajectory = get("trajectory_msgs/JointTrajectory")(
        header, ["hip", "knee"], [point, point]
    )
    return [
        (imu, "linear_acceleration.z", 6),
        (imu, "orientation_covariance[8]", 0),
        (odometry, "pose.pose.orientation.w", 0.8),
        (odometry, "twist.twist.linear.x", 1),
        (get("geometry_msgs/PoseStamped")(header, pose), "pose.position.y", 2),
        (get("geometry_msgs/TwistStamped")(header, twist), "twist.angular.z", 6),
        (wrench, "torque.x", 4),
        (get("std_msgs/Float64")(2.5), "data", 2.5),
        (get("std_msgs/Float64MultiArray")(layout, np.array([1.0, 3.0])), "data[1]", 3),
        (trajectory, "points[0].positions[knee]", 8),
        (trajectory, "points[0].time_from_start", 2.5),
    ]


def test_fields_of_the_usual_types_are_columns_by_their_paths(tmp_path, store):
    usual = _list_usual(store)
    messages = [(f"/t{k}", message) for k, (message, _, _) in enumerate(usual)]
    found = read_all(open_log(write_bag(tmp_path / "bag", store, messages)))
    for k, (_, column, value) in enumerate(usual):
        assert found[f"/t{k}"][column].tolist() == [value]
        assert not any("points[1]" in name for name in found[f"/t{k}"])


DYNAMIC = "string[] joint_names\nValues[] interface_values\n" + "=" * 80
DYNAMIC += "\nMSG: my_msgs/Values\nstring[] interface_names\nfloat64[] values\n"
CONTROLLER = (
    "string[] joint_names\nfloat64[] reference\nstring[] multi_dof_joint_names\n"
)


@pytest.mark.parametrize(
    ("text", "more", "column"),
    [
        (DYNAMIC, [], "interface_values[knee].values[i]"),  # names of both
        (CONTROLLER, [[]], "reference[knee]"),  # the first names, others may be empty
    ],
)
def test_elements_have_the_names_in_a_message_or_around_it(
    tmp_path, text, more, column
):
    found, kind = get_typestore(Stores.ROS2_HUMBLE), "my_msgs/msg/Named"
    found.register(get_types_from_msg(text, kind))
    values = np.array([1.0, 2.0])
    if text is DYNAMIC:
        values = [found.types["my_msgs/msg/Values"](["q", "i"], values)] * 2
    message = found.types[kind](["hip", "knee"], values, *more)
    log = open_log(write_bag(tmp_path / "bag", found, [("/d", message)] * 3))
    assert read_all(log)["/d"][column].tolist() == [2] * 3


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat])
def test_a_bag_of_ros_1_reads_the_same(tmp_path, compression):
    store = get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / "log.bag"
    writer = Writer1(path)
    if compression:
        writer.set_compression(compression)
    with writer:
        connection = writer.add_connection("/joints", JOINTS, typestore=store)
        for k in range(30):
            header = store.types["std_msgs/msg/Header"](
                k, _stamp(store, START + k * STEP - 5_000_000), "base"
            )
            q = np.array([100.0 + k, 200.0 + k])
            names = ["hip", "knee"]
            message = store.types[JOINTS](header, names, q, -q, np.array([]))
            raw = store.serialize_ros1(message, JOINTS)
            writer.write(connection, START + k * STEP, raw)
    found = read_all(open_log(path))["/joints"]
    assert found.pop("header.seq").tolist() == list(range(30))
    _check_joints(found)
    if compression is None:
        assert read_damaged(path)


def _write_mcap(path, store, definition=None, kind=JOINTS, **settings):
    """An MCAP of thirty joint states, and of a message that nobody can read."""
    text = definition or store.generate_msgdef(JOINTS, ros_version=2)[0]
    channels = [("/joints", "cdr"), ("/joints", "cdr"), ("/other", "protobuf")]
    joints = [_make_joints(store, k) for k in range(30)]
    raw = [bytes(store.serialize_cdr(message, JOINTS)) for message in joints]
    messages = [*((k % 2, content) for k, content in enumerate(raw)), (2, b"\x08\x96")]
    schema = kind, "ros2msg", text.encode()
    return write_mcap(path, channels, schema, messages, **settings)


@pytest.mark.parametrize(
    "settings",
    [
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"use_chunking": False},
        {"use_summary_offsets": False, "use_statistics": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"index_types": IndexType.NONE},
    ],
)
def test_an_mcap_reads_the_same_however_it_is_written(tmp_path, store, settings):
    found = read_all(open_log(_write_mcap(tmp_path / "log.mcap", store, **settings)))
    _check_joints(found["/joints"])
    assert list(found["/other"]) == ["bag time"]


def test_only_what_is_wanted_comes_and_readings_do_not_meet(tmp_path, store):
    log = open_log(write_bag(tmp_path / "bag", store, _list_joints(store)))
    first = log.read({"/joints": ["position[knee]"]})
    second = log.read({"/joints": ["velocity[hip]", "bag time"]})
    (_, rows), (_, others) = next(first), next(second)
    assert list(rows) == ["position[knee]"]
    assert list(others) == ["velocity[hip]", "bag time"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ('a/msg/X"""\nraise SystemExit\n"""', "float64 x\n"),
        ("a/msg/X", "float64 x\n" + "=" * 80 + '\nMSG: a/Y"""\nfloat64 x\n'),
        ("a/msg/X", "Y[99999999] y\n" + "=" * 80 + "\nMSG: a/Y\nfloat64 x\n"),
        ("a/msg/X", "X x\n"),
        ("a/msg/X", "Unknown x\n"),
        ("a/msg/X", "float64[ x\n"),
        ("a/msg/X", "float64 __init__\n"),
    ],
)
def test_of_a_type_that_makes_no_sense_only_the_time_is_read(
    tmp_path, store, name, text
):
    path = _write_mcap(tmp_path / "log.mcap", store, text, name)
    assert list(read_all(open_log(path))["/joints"]) == ["bag time"]


def test_a_chunk_that_would_unpack_to_gigabytes_is_refused(tmp_path, store):
    path = _write_mcap(tmp_path / "log.mcap", store)
    bomb = zstandard.ZstdCompressor().compress(bytes(300_000_000))
    content = path.read_bytes()
    start = content.index(b"zstd") + 4
    path.write_bytes(content[:start] + len(bomb).to_bytes(8, "little") + bomb)
    with pytest.raises(InputError):
        read_all(open_log(path))


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_a_damaged_bag_is_read_or_refused(tmp_path, store, plugin):
    path = write_bag(tmp_path / "bag", store, _list_joints(store), plugin)
    (path,) = (file for file in path.iterdir() if file.suffix != ".yaml")
    assert read_damaged(path)


def test_an_empty_bag_has_no_rows(tmp_path, store):
    path = write_bag(tmp_path / "bag", store, [])
    assert read_all(open_log(path)) == {}
