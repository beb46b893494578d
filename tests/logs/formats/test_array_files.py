"""NumPy's, HDF5's and MATLAB's files of arrays, each written by its own library."""

import zipfile

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from selfheal.recording import Episode, Recording, write
from tests.support.logs.reading import check_rows, read_all, read_damaged, read_one
from tests.support.logs.table_files import write_hdf5

T = np.arange(200) / 100
Q = np.random.default_rng(0).normal(size=(200, 3))


def test_an_npy_has_numbers_or_the_names_of_its_records(tmp_path):
    np.save(tmp_path / "q.npy", Q)
    assert list(read_one(tmp_path / "q.npy")) == ["0", "1", "2"]
    records = np.array([(0.5, [1, 2]), (1.5, [3, 4])], [("t", "f8"), ("v", "i4", 2)])
    np.save(tmp_path / "r.npy", records)
    found = read_one(tmp_path / "r.npy")
    values = {name: column.tolist() for name, column in found.items()}
    assert values == {"t": [0.5, 1.5], "v[0]": [1, 3], "v[1]": [2, 4]}
    read_damaged(tmp_path / "r.npy")


HUGE = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 9), }"
OBJECTS = HUGE.replace(b"<f8", b"|O").replace(b"99999999999, 9", b"1,")


@pytest.mark.parametrize(("header", "said"), [(OBJECTS, "bject"), (HUGE, r"log\.np")])
def test_python_objects_and_huge_sizes_are_refused(tmp_path, header, said):
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("a.npy", content + bytes(80))
    (tmp_path / "log.npy").write_bytes(content + bytes(80))
    for name in ("log.npz", "log.npy"):
        with pytest.raises(InputError, match=said):
            open_log(tmp_path / name)


def _list_demos(count):
    """Arrays of robomimic; each demo has another length."""
    arrays = {"mask/train": np.array([b"demo_0"])}
    for k in range(count):
        n = 20 + k
        arrays |= {
            f"data/demo_{k}/actions": np.full((n, 2), k),
            f"data/demo_{k}/obs/q": Q[:n],
            f"data/demo_{k}/next_obs/q": Q[1 : n + 1],
            f"data/demo_{k}/obs/image": np.zeros((n, 4, 4, 3), np.uint8),
        }
    return arrays


def test_demos_of_robomimic_are_episodes_in_their_order(tmp_path):
    log = open_log(write_hdf5(tmp_path / "demo.hdf5", _list_demos(12)))
    check_rows(log)
    assert log.streams[0].episode == "episode"
    found = read_all(log)[""]
    assert list(dict.fromkeys(found["episode"])) == [f"demo_{k}" for k in range(12)]
    np.testing.assert_array_equal(
        found["actions[1]"], np.repeat(np.arange(12), np.arange(20, 32))
    )
    assert {"obs/q[0]", "next_obs/q[2]"} < set(found)


PARTS = {f"{side}/{name}": Q for side in ("left", "right") for name in ("q", "v")}
ALOHA = {name: Q for name in ("action", "observations/qpos", "observations/qvel")}
ALOHA["observations/images/top"] = np.zeros((200, 2, 2, 3), np.uint8)


@pytest.mark.parametrize(
    ("arrays", "column"), [(PARTS, "left/q[0]"), (ALOHA, "observations/qvel[2]")]
)
def test_groups_that_differ_or_are_parts_are_no_episodes(tmp_path, arrays, column):
    (stream,) = open_log(write_hdf5(tmp_path / "log.h5", arrays)).streams
    assert stream.episode == "" and column in stream.columns
    assert not any("images" in name for name in stream.columns)


def test_units_records_and_texts_of_hdf5_are_read(tmp_path):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["q"] = T
        file["q"].attrs["unit"] = "deg"
        table = np.empty(200, [("time", "f8"), ("q", "f8", 3)])
        table["time"], table["q"] = T, Q
        file["table"] = table
        file["label"] = ["a"] * 200
        file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "/")
        file["self"] = h5py.SoftLink("/")
    log = open_log(tmp_path / "log.h5")
    assert log.streams[0].columns["q"] == "deg"
    found = read_all(log)[""]
    assert set(found) == {
        "q",
        "label",
        *(f"table.q[{k}]" for k in range(3)),
        "table.time",
    }
    np.testing.assert_array_equal(found["table.q[1]"], Q[:, 1])
    assert found["label"][0] == "a"


def test_structures_of_matlab_are_read_and_arrays_of_them_are_runs(tmp_path):
    savemat(tmp_path / "a.mat", {"log": {"t": T[None], "imu": {"gyro": Q.T}}})
    found = read_one(tmp_path / "a.mat")
    assert set(found) == {"log/t", *(f"log/imu/gyro[{k}]" for k in range(3))}
    np.testing.assert_array_equal(found["log/imu/gyro[2]"], Q[:, 2])
    runs = np.array([(T[:9], Q[:9]), (T, Q)], dtype=[("t", "O"), ("q", "O")])
    savemat(tmp_path / "b.mat", {"trial": runs})
    found = read_one(tmp_path / "b.mat")
    assert found["episode"].tolist() == ["1"] * 9 + ["2"] * 200


def test_a_recording_of_selfheal_needs_no_import(tmp_path):
    episode = Episode(np.array([0.0, 1.0]), np.zeros((2, 0)), (), {})
    write(Recording({"0": episode}), tmp_path / "log.h5")
    with pytest.raises(InputError, match="needs no import"):
        open_log(tmp_path / "log.h5")


@pytest.mark.parametrize(
    ("stated", "period"),
    [('{"env_kwargs": {"control_freq": 20}}', 0.05), ("no JSON", None), (7, None)],
)
def test_the_rate_of_robomimic_is_read(tmp_path, stated, period):
    path = write_hdf5(tmp_path / "demo.hdf5", _list_demos(2))
    with h5py.File(path, "r+") as file:
        file["data"].attrs["env_args"] = stated
    assert open_log(path).streams[0].period == period
