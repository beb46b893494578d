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

T = np.arange(200) / 100
Q = np.random.default_rng(0).normal(size=(200, 3))


def _write_hdf5(path, arrays, **attributes):
    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)
        for name, array in arrays.items():
            packed = "gzip" if np.shape(array) else None
            file.create_dataset(name, data=array, compression=packed)
    return path


def _write_mat73(path, arrays):
    """As MATLAB writes version 7.3: HDF5 behind a block of text, axes turned."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            file[name] = np.atleast_2d(np.transpose(array))
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
    return path


def _write_npz(path, arrays):
    np.savez(path, **arrays)
    return path


def _write_mat(path, arrays):
    savemat(path, arrays, do_compression=True)
    return path


WRITERS = {
    "log.npz": _write_npz,
    "log.h5": _write_hdf5,
    "log.mat": _write_mat,
    "new.mat": _write_mat73,
}


@pytest.mark.parametrize("name", WRITERS)
def test_arrays_of_one_length_are_a_stream(tmp_path, name):
    arrays = {"t": T, "q": Q, "on": T > 1, "gain": np.ones(2), "n": np.array(3)}
    log = open_log(WRITERS[name](tmp_path / name, arrays))
    check_rows(log)
    assert [s.name for s in log.streams] == [""]
    found = read_all(log)[""]
    assert set(found) == {"t", "q[0]", "q[1]", "q[2]", "on"}
    np.testing.assert_array_equal(found["q[2]"], Q[:, 2])
    np.testing.assert_array_equal(found["on"], T > 1)


@pytest.mark.parametrize("name", WRITERS)
def test_arrays_of_several_lengths_are_streams(tmp_path, name):
    arrays = {"t": T, "q": Q, "slow_t": T[:50], "slow_q": Q[:50]}
    log = open_log(WRITERS[name](tmp_path / name, arrays))
    found = read_all(log)
    assert {n: set(rows) for n, rows in found.items()} == {
        "200 rows": {"t", "q[0]", "q[1]", "q[2]"},
        "50 rows": {"slow_t", "slow_q[0]", "slow_q[1]", "slow_q[2]"},
    }


@pytest.mark.parametrize("name", WRITERS)
def test_damaged_arrays_are_read_or_refused(tmp_path, name):
    path = WRITERS[name](tmp_path / name, {"t": T, "q": Q})
    assert read_damaged(path, tries=15)


def test_an_npy_has_numbers_or_the_names_of_its_records(tmp_path):
    np.save(tmp_path / "q.npy", Q)
    assert list(read_one(tmp_path / "q.npy")) == ["0", "1", "2"]
    records = np.array([(0.5, [1, 2]), (1.5, [3, 4])], [("t", "f8"), ("v", "i4", 2)])
    np.save(tmp_path / "r.npy", records)
    found = read_one(tmp_path / "r.npy")
    assert {n: v.tolist() for n, v in found.items()} == {
        "t": [0.5, 1.5], "v[0]": [1, 3], "v[1]": [2, 4]}  # fmt: skip
    read_damaged(tmp_path / "r.npy")


def test_python_objects_are_refused(tmp_path):
    objects = np.array([{"a": 1}], dtype=object)
    np.savez(tmp_path / "log.npz", a=objects)
    np.save(tmp_path / "log.npy", objects, allow_pickle=True)
    for name in ("log.npz", "log.npy"):
        with pytest.raises(InputError, match="bject"):
            open_log(tmp_path / name)


def test_an_array_that_states_a_huge_size_is_refused(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 9), }"
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("a.npy", content + bytes(80))
    (tmp_path / "log.npy").write_bytes(content + bytes(80))
    for name in ("log.npz", "log.npy"):
        with pytest.raises(InputError):
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
    log = open_log(_write_hdf5(tmp_path / "demo.hdf5", _list_demos(12)))
    check_rows(log)
    assert log.streams[0].episode == "episode"
    found = read_all(log)[""]
    assert list(dict.fromkeys(found["episode"])) == [f"demo_{k}" for k in range(12)]
    np.testing.assert_array_equal(
        found["actions[1]"], np.repeat(np.arange(12), np.arange(20, 32))
    )
    assert {"obs/q[0]", "next_obs/q[2]"} < set(found)


def test_parts_of_a_robot_are_no_episodes(tmp_path):
    arrays = {f"{side}/{x}": Q for side in ("left", "right") for x in ("q", "v")}
    found = read_one(_write_hdf5(tmp_path / "log.h5", arrays))
    assert len(found) == 12 and "left/q[0]" in found


def test_a_file_of_aloha_is_one_episode(tmp_path):
    arrays = {
        "action": Q, "observations/qpos": Q, "observations/qvel": Q,
        "observations/images/top": np.zeros((200, 2, 2, 3), np.uint8),
    }  # fmt: skip
    log = open_log(_write_hdf5(tmp_path / "episode_0.hdf5", arrays, sim=True))
    assert log.streams[0].episode == ""
    assert "observations/qvel[2]" in log.streams[0].columns


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
        "table.time",
        *(f"table.q[{k}]" for k in range(3)),
        "label",
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


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_without_arrays_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="no columns"):
        open_log(WRITERS[name](tmp_path / name, {"n": np.array(3)}))


@pytest.mark.parametrize(
    ("stated", "period"),
    [('{"env_kwargs": {"control_freq": 20}}', 0.05), ("no JSON", None), (7, None)],
)
def test_the_rate_of_robomimic_is_read(tmp_path, stated, period):
    path = _write_hdf5(tmp_path / "demo.hdf5", _list_demos(2))
    with h5py.File(path, "r+") as file:
        file["data"].attrs["env_args"] = stated
    assert open_log(path).streams[0].period == period
