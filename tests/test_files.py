"""Files are whole or absent, and a folder that cannot be written is refused first."""

import resource
import signal
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from selfheal.errors import InputError, SelfhealError
from selfheal.files import atomic_hdf5, atomic_path, check_writable_folder


def _leftovers(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_gets_its_name_only_when_it_is_whole(tmp_path):
    path = tmp_path / "run.h5"
    with atomic_path(path) as temporary:
        temporary.write_text("new")
        assert not path.exists()
        assert temporary.parent == path.parent
    assert path.read_text() == "new"
    assert _leftovers(tmp_path) == ["run.h5"]


def test_after_an_exception_the_old_file_stands(tmp_path):
    path = tmp_path / "run.h5"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert _leftovers(tmp_path) == ["run.h5"]


def test_a_full_disk_is_a_failure_with_the_name_of_the_file(tmp_path):
    path = tmp_path / "run.h5"
    with pytest.raises(SelfhealError, match=r"run\.h5.*No space"), atomic_path(path):
        raise OSError(28, "No space left on device")
    assert _leftovers(tmp_path) == []


def test_a_link_keeps_pointing_where_it_did(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with atomic_path(tmp_path / "link") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


@pytest.mark.parametrize("place", ["missing/run.h5", "file/run.h5", "folder"])
def test_where_nothing_can_be_written_the_body_never_runs(tmp_path, place):
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="cannot write"), atomic_path(tmp_path / place):
        pytest.fail("the body ran")


def test_a_missing_folder_is_made_and_left_empty(tmp_path):
    folder = check_writable_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert _leftovers(folder) == []


# root may write anywhere but into a file and into /proc
@pytest.mark.parametrize("folder", ["{tmp}/file", "{tmp}/file/b", "/proc/selfheal"])
def test_a_folder_that_cannot_be_written_is_refused(tmp_path, folder):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot write into"):
        check_writable_folder(folder.format(tmp=tmp_path))


def test_what_a_killed_process_left_is_removed(tmp_path):
    left, other = tmp_path / ".run.h5.0123abcd.tmp", tmp_path / ".b.h5.0123abcd.tmp"
    for path in (left, other):
        path.touch()
    with atomic_path(tmp_path / "run.h5") as temporary:
        temporary.write_text("new")
    assert _leftovers(tmp_path) == [other.name, "run.h5"]


def test_what_another_process_writes_stays(tmp_path):
    with atomic_path(tmp_path / "run.h5") as first:
        with atomic_path(tmp_path / "run.h5") as second:
            second.write_text("second")
        first.write_text("first")
    assert (tmp_path / "run.h5").read_text() == "first"
    assert _leftovers(tmp_path) == ["run.h5"]


@contextmanager
def _limit_file_size(size):
    """No file can grow beyond some bytes, not even that which pytest prints to."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, old)


@pytest.mark.parametrize("size", [0, 100, 3000])
def test_on_a_full_disk_the_old_hdf5_file_stands(tmp_path, size):
    path = tmp_path / "run.h5"
    path.touch()
    with (
        _limit_file_size(size),
        pytest.raises(SelfhealError) as raised,
        atomic_hdf5(path) as file,
    ):
        file["readings"] = np.arange(1000.0)
    assert "cannot write" in str(raised.value)
    assert not isinstance(raised.value, InputError)
    assert path.read_bytes() == b"" and _leftovers(tmp_path) == ["run.h5"]


def test_an_hdf5_file_is_whole(tmp_path):
    import h5py

    with atomic_hdf5(tmp_path / "run.h5") as file:
        file["readings"] = np.arange(1000.0)
    with h5py.File(tmp_path / "run.h5") as file:
        assert (file["readings"][()] == np.arange(1000.0)).all()
