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


def _no_time(root):
    del root["episodes/alpha/time"]


def _no_signals(root):
    del root["episodes/alpha/signals"]


def _no_names(root):
    del root["episodes/alpha/ctrl"].attrs["names"]


def _no_kind(root):
    del root["episodes/alpha/signals/up"].attrs["kind"]


def _without(name, value=None):
    """A signal without an attribute, or with one that is no text."""

    def damage(root):
        attrs = root["episodes/alpha/signals/up"].attrs
        del attrs[name]
        if value is not None:
            attrs[name] = value

    return damage


def _numbered(root):
    root["episodes/alpha/ctrl"].attrs["names"] = [1, 2]


def _together(root):
    root["episodes/alpha/ctrl"].attrs["names"] = "servo,b"


def _other_version(root):
    root.attrs["version"] = 2


def _other_format(root):
    root.attrs["format"] = "rosbag"


def _typing_error(root):
    root["episodes/alpha"].move("ctrl", "control")


def _text_array(root):
    del root["episodes/alpha/time"]
    root["episodes/alpha/time"] = ["a", "b"]


def _no_space(root):
    del root["episodes/alpha/time"]
    root["episodes/alpha/time"] = h5py.Empty("f8")


def _soft_link(root):
    root["episodes/alpha/signals/copy"] = h5py.SoftLink("/episodes/alpha/time")


def _external_link(root):
    root["episodes/beta"] = h5py.ExternalLink("secret.h5", "/")


def _external_data(root):
    signals = root["episodes/alpha/signals"]
    del signals["voltage"]
    raw = [("/etc/passwd", 0, 40)]
    signals.create_dataset("voltage", (5,), "f8", external=raw)


def _virtual_data(root):
    signals = root["episodes/alpha/signals"]
    del signals["voltage"]
    layout = h5py.VirtualLayout((5,), "f8")
    layout[:] = h5py.VirtualSource("secret.h5", "time", (5,))
    signals.create_virtual_dataset("voltage", layout)


def _huge(root):
    signals = root["episodes/alpha/signals"]
    signals.create_dataset("huge", (10**9,), "f8", chunks=(1000,))


def _slash(root):
    root["episodes/alpha/signals/imu/up"] = np.zeros(5)


def _unstored(root):
    del root["episodes/alpha/time"]
    root["episodes/alpha"].create_dataset("time", (10**7,), "f8", chunks=(1000,))


def _huge_chunk(root):
    options = {"maxshape": (None,), "chunks": (MAX_VALUES,)}
    root["episodes/alpha/signals"].create_dataset("huge", (5,), "f8", **options)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_no_time, "episode 'alpha': time is missing; .* holds 'ctrl'"),
        (_no_signals, "episode 'alpha': signals is missing"),
        (_no_names, "episode 'alpha': ctrl lacks the attribute names"),
        (_no_kind, "signal 'up': it lacks the attribute kind; .* 'joint_position', "),
        (_without("unit"), "'up': it lacks the attribute unit; would fit: that of the"),
        (_without("target"), "lacks the attribute target; would fit: the name of a s"),
        (_without("kind", 5), "attribute kind is 5, no text; would fit: 'joint_posi"),
        (_numbered, r"names of ctrl is \[1, 2\]; it must be texts"),
        (_together, "columns and the names 'servo,b'; would fit"),
        (_other_version, "version is .*2.*; this program reads 1"),
        (_other_format, "format is 'rosbag'; would fit: 'selfheal-recording'"),
        (_typing_error, "unknown member 'control'; would fit: time, ctrl"),
        (_text_array, "time has type object; would fit: float64"),
        (_no_space, "time is empty"),
        (_soft_link, "signal 'copy': copy is a link to elsewhere"),
        (_external_link, "episode 'beta': beta is a link to elsewhere"),
        (_external_data, "signal 'voltage': voltage keeps its data elsewhere"),
        (_virtual_data, "signal 'voltage': voltage keeps its data elsewhere"),
        (_slash, "'imu': imu must be .* a slash .*; would fit: 'imu_up' for 'imu/up'"),
        (_unstored, "time states 10000000 values and stores hardly any"),
        (_huge, "it holds 10.* values; at most 2"),
        (_huge_chunk, "it holds 2.* values; at most 2"),
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
        result = subprocess.run(command, capture_output=True, text=True)
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
