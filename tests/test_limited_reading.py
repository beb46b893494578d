"""A file that harms the process that reads it harms another one first."""

import os

import pytest

from selfheal import limited_reading
from selfheal.errors import ModelError, RecordingError, RunFileError
from selfheal.files import open_run
from selfheal.recording import read
from selfheal.recording.names import load_model
from tests.support import harmful_readers
from tests.support.paths import RECORDINGS


def _explain(file, reader):
    name = f"{harmful_readers.__name__}:{reader}"
    return limited_reading.explain_dangerous(file, name, "numpy")


@pytest.fixture
def file(tmp_path, monkeypatch):
    """A file, and little time to read it."""
    monkeypatch.setattr(limited_reading, "MAX_SECONDS", 0.3)
    (tmp_path / "file").touch()
    return tmp_path / "file"


@pytest.mark.parametrize("reader", ["read", "refuse"])
def test_what_ends_by_itself_is_let_pass(file, reader):
    assert _explain(file, reader) == ""


@pytest.mark.parametrize(
    "reader, said",
    [
        ("hang", "did not end within 0 s"),
        ("crash", "crashes the process (SIGABRT)"),
        ("leave", "crashes the process (7)"),
        ("fill", "needs more than 1.0 GB"),
        ("fail_to_allocate", "needs more than 1.0 GB"),
    ],
)
def test_what_does_not_is_said(file, reader, said):
    assert said in _explain(file, reader)
    assert _explain(file, "read") == ""


def test_a_file_is_read_again_when_it_has_changed(file):
    assert _explain(file, "crash_on_content") == ""
    file.write_text("content")
    assert "SIGABRT" in _explain(file, "crash_on_content")


def test_a_server_that_was_killed_is_started_again(file):
    limited_reading._start_server(os.getpid()).kill()
    assert _explain(file, "refuse") == ""
    file.write_text("content")
    assert "SIGABRT" in _explain(file, "crash_on_content")


def test_what_is_no_file_is_left_to_its_reader(tmp_path):
    assert _explain(tmp_path, "crash") == ""


MODELS = {
    "hfield": '<asset><hfield name="h" nrow="65536" ncol="65536" size="1 1 1 1"/>'
    '</asset><worldbody><geom type="hfield" hfield="h"/></worldbody>',
    "texture": '<asset><texture name="t" type="2d" builtin="flat" width="40000" '
    'height="40000"/></asset>',
    "replicate": '<worldbody><replicate count="1000000000" offset="1 0 0">'
    '<geom size="1"/></replicate></worldbody>',
    "flexcomp": '<worldbody><flexcomp name="f" type="grid" dim="3" spacing="1 1 1" '
    'count="1000 1000 1000"/></worldbody>',
    "pipe": '<include file="pipe.xml"/>',
}


@pytest.mark.parametrize("kind", MODELS)
def test_a_model_that_harms_the_process_is_refused(file, tmp_path, kind):
    os.mkfifo(tmp_path / "pipe.xml")
    path = tmp_path / "model.xml"
    path.write_text(f"<mujoco>{MODELS[kind]}</mujoco>")
    with pytest.raises(ModelError, match="reading it"):
        load_model(path)


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings of real robots")
def test_hdf5_that_never_ends_is_refused(file):
    whole = bytearray((RECORDINGS / "starfish_2006" / "damaged.h5").read_bytes())
    whole[2608:3112] = bytes(3112 - 2608)  # the heap of an attribute
    file.write_bytes(whole)
    with pytest.raises(RecordingError, match="did not end"):
        read(file)
    opened = open_run(file, "run file", form="selfheal-run", version=2)
    with pytest.raises(RunFileError, match="did not end"), opened:
        pass
