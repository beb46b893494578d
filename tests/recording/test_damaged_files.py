"""Files that are damaged, or no recording at all, are refused with what is wrong."""

import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

from selfheal.errors import RecordingError
from selfheal.files import MAX_VALUES
from selfheal.recording import read

ALPHA = "episodes/alpha"
UP, VOLTAGE = f"{ALPHA}/signals/up", f"{ALPHA}/signals/voltage"
ROWS = {"shape": (5,), "dtype": "f8"}
ELSEWHERE = h5py.VirtualLayout((5,), "f8")
ELSEWHERE[:] = h5py.VirtualSource("secret.h5", "time", (5,))


def _set(name, value=None):
    """A member that is something else, or, of None, that is missing."""

    def damage(root):
        if name in root:
            del root[name]
        if value is not None:
            root[name] = value

    return damage


def _tell(name, attribute, value=None):
    """A member without an attribute, or with another one."""

    def damage(root):
        del root[name].attrs[attribute]
        if value is not None:
            root[name].attrs[attribute] = value

    return damage


def _create(name, **how):
    """A dataset that is stored in an odd way."""

    def damage(root):
        if name in root:
            del root[name]
        root.create_dataset(name, **how)

    return damage


def _virtual_data(root):
    del root[VOLTAGE]
    root.create_virtual_dataset(VOLTAGE, ELSEWHERE)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_set(f"{ALPHA}/time"), "episode 'alpha': time is missing; .* holds 'ctrl'"),
        (_set(f"{ALPHA}/signals"), "episode 'alpha': signals is missing"),
        (_tell(f"{ALPHA}/ctrl", "names"), "'alpha': ctrl lacks the attribute names"),
        (_tell(UP, "kind"), "signal 'up': it lacks the attribute kind; .* 'joint_po"),
        (
            _tell(UP, "unit"),
            "'up': it lacks the attribute unit; would fit: that of the",
        ),
        (_tell(UP, "target"), "lacks the attribute target; would fit: the name of a s"),
        (_tell(UP, "kind", 5), "attribute kind is 5, no text; would fit: 'joint_posi"),
        (
            _tell(f"{ALPHA}/ctrl", "names", [1, 2]),
            r"names of ctrl is \[1, 2\]; it must be texts",
        ),
        (
            _tell(f"{ALPHA}/ctrl", "names", "servo,b"),
            "columns and the names 'servo,b'; would fit",
        ),
        (_tell("/", "version", 2), "version is .*2.*; this program reads 1"),
        (
            _tell("/", "format", "rosbag"),
            "format is 'rosbag'; would fit: 'selfheal-recording'",
        ),
        (
            lambda root: root[ALPHA].move("ctrl", "control"),
            "unknown member 'control'; would fit: time, ctrl",
        ),
        (_set(f"{ALPHA}/time", ["a", "b"]), "time has type object; would fit: float64"),
        (_set(f"{ALPHA}/time", h5py.Empty("f8")), "time is empty"),
        (
            _set(f"{ALPHA}/signals/copy", h5py.SoftLink(f"/{ALPHA}/time")),
            "signal 'copy': copy is a link to elsewhere",
        ),
        (
            _set("episodes/beta", h5py.ExternalLink("secret.h5", "/")),
            "episode 'beta': beta is a link to elsewhere",
        ),
        (
            _create(VOLTAGE, **ROWS, external=[("/etc/passwd", 0, 40)]),
            "signal 'voltage': voltage keeps its data elsewhere",
        ),
        (_virtual_data, "signal 'voltage': voltage keeps its data elsewhere"),
        (
            _set(f"{ALPHA}/signals/imu/up", np.zeros(5)),
            "'imu': imu must be .* a slash .*; would fit: 'imu_up' for 'imu/up'",
        ),
        (
            _create(f"{ALPHA}/time", shape=(10**7,), dtype="f8", chunks=(1000,)),
            "time states 10000000 values and stores hardly any",
        ),
        (
            _create(f"{ALPHA}/signals/huge", shape=10**9, dtype="f8", chunks=(1000,)),
            "it holds 10.* values; at most 2",
        ),
        (
            _create(
                f"{ALPHA}/signals/huge", **ROWS, maxshape=(None,), chunks=MAX_VALUES
            ),
            "it holds 2.* values; at most 2",
        ),
    ],
)
def test_a_bad_file_is_refused(file, damage, said):
    with h5py.File(file, "r+") as root:
        damage(root)
    with pytest.raises(RecordingError, match=f"arm.h5.*{said}"):
        read(file)


def test_every_truncation_is_refused(file):
    whole = file.read_bytes()
    for size in np.linspace(0, len(whole) - 1, 40, dtype=int):
        file.write_bytes(whole[:size])
        with pytest.raises(RecordingError, match="HDF5"):
            read(file)


def test_overwritten_samples_are_refused(file):
    with h5py.File(file) as root:
        chunk = root["episodes/alpha/signals/up"].id.get_chunk_info(0)
    broken = bytearray(file.read_bytes())
    broken[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    file.write_bytes(broken)
    with pytest.raises(RecordingError, match="damaged"):
        read(file)


def test_a_file_that_is_being_written_is_refused(file):
    with h5py.File(file, "r+"):
        code = "import sys; from selfheal.recording import read; read(sys.argv[1])"
        command = [sys.executable, "-c", code, file]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "another process holds it open" in result.stderr


@pytest.mark.parametrize("text", [b"", b"time,ctrl\n0,1\n"])
def test_what_is_no_hdf5_is_refused(tmp_path, text):
    (tmp_path / "a.h5").write_bytes(text)
    with pytest.raises(RecordingError, match=r"a\.h5: it is no HDF5.*recording import"):
        read(tmp_path / "a.h5")


def test_a_missing_file_or_a_folder_is_refused(tmp_path):
    for name, said in (("", "it is a folder"), ("nothing.h5", "no such file")):
        with pytest.raises(RecordingError, match=said):
            read(tmp_path / name)


def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.h5")
    with pytest.raises(RecordingError, match="it is no regular file"):
        read(tmp_path / "pipe.h5")
