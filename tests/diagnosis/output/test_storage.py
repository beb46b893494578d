"""A diagnosis on disk: whole or not there."""

import errno
import os
from contextlib import suppress

import h5py
import numpy as np
import pytest

from selfheal.diagnosis.estimation.information import Information
from selfheal.diagnosis.output import storage
from selfheal.diagnosis.output.result import Diagnosis
from selfheal.errors import InputError, RunLockError, SelfhealError
from tests.support.diagnosis_folder import make_document, make_small_diagnosis
from tests.support.recorded_robots import ROBOTS

FILES = sorted([*storage.FILES, storage.INFORMATION])


@pytest.fixture
def given(tmp_path_factory):
    """The file of a model."""
    path = tmp_path_factory.mktemp("robot") / "model.xml"
    path.write_text(ROBOTS["pendulum"].xml)
    return path


KNOWN = Information(
    parameters=("joint:hip/damping",),
    values=np.ones(1),
    prior=np.full(1, 44.0),
    gram=np.full((2, 1, 1), 9.0),
    gradient=np.zeros((2, 1)),
    variance=1.0,
)


def _diagnosis(given, verdict="nothing", page="<html/>") -> Diagnosis:
    document = make_document(verdict=verdict, fit={"floor": float("nan")})
    fields = {"patched": given.read_text(), "page": page, "information": KNOWN}
    return make_small_diagnosis(str(given), document, **fields)


def _names(path) -> list[str]:
    return sorted(p.name for p in path.iterdir())


@pytest.mark.parametrize("is_there", [False, True])
def test_a_diagnosis_is_whole_and_is_read_back(is_there, given, tmp_path):
    out = tmp_path / "out"
    if is_there:
        out.mkdir()
    _diagnosis(given).save(out)
    assert _names(out) == FILES and _names(tmp_path) == ["out"]
    assert storage.read_document(out)["verdict"] == "nothing"
    assert storage.read_document(out)["fit"] == {"floor": None}
    with h5py.File(out / "information.h5") as file:
        assert file["parameters"].asstr()[:].tolist() == list(KNOWN.parameters)
        assert (file["gram"][:] == KNOWN.gram).all()


def test_an_earlier_diagnosis_is_replaced_by_force_only(given, tmp_path):
    out = tmp_path / "out"
    _diagnosis(given).save(out)
    with pytest.raises(InputError, match="--force"):
        _diagnosis(given, "unlisted").save(out)
    assert storage.read_document(out)["verdict"] == "nothing"
    _diagnosis(given, "unlisted").save(out, force=True)
    assert storage.read_document(out)["verdict"] == "unlisted"
    assert _names(tmp_path) == ["out"]


@pytest.mark.parametrize("force", [False, True])
def test_other_files_are_never_deleted(force, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("")
    with pytest.raises(InputError):
        storage.check_folder(out, force)
    assert _names(out) == ["thesis.tex"]


def test_a_link_to_a_folder_stays_one(given, tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "out").symlink_to("real")
    _diagnosis(given).save(tmp_path / "out")
    assert (tmp_path / "out").is_symlink() and _names(tmp_path / "real") == FILES
    assert _names(tmp_path) == ["out", "real"]


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="is a file"):
        storage.check_folder(tmp_path / "out", True)


@pytest.mark.parametrize("page", ["old", None])
def test_a_diagnosis_that_cannot_be_written_leaves_what_was_there(
    page, given, tmp_path, monkeypatch
):
    out, replace = tmp_path / "out", os.replace
    if page:
        _diagnosis(given, page=page).save(out)

    def refuse(old, new):
        if str(old).endswith(".tmp"):
            raise OSError(errno.ENOSPC, "the disk is full")
        replace(old, new)

    def check():
        assert _names(tmp_path) == (["out"] if page else [])
        assert not page or (out / "report.html").read_text() == page

    with pytest.raises(AttributeError):
        _diagnosis(given, page=None).save(out, force=True)
    check()
    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(SelfhealError, match="the disk is full"):
        _diagnosis(given, page="new").save(out, force=True)
    check()


def _claim(out, **options):
    return storage.claim_folder(out, **{"force": False, "resume": False, **options})


def test_a_folder_is_kept_to_one_diagnosis(given, tmp_path):
    out = tmp_path / "new" / "out"
    with _claim(out) as memory:
        memory.mkdir()
        for force in (False, True):
            again = _claim(out, force=force, resume=force)
            with pytest.raises(RunLockError, match="another process"), again:
                pytest.fail("two work on one folder")
        assert memory.is_dir()
        _diagnosis(given).save(out)
    assert _names(out.parent) == ["out"] and _names(out) == FILES
    with pytest.raises(InputError, match="--force"), _claim(out):
        pytest.fail("it would be lost")


def test_only_a_resumed_diagnosis_finds_the_arrays_of_a_killed_one(tmp_path):
    with pytest.raises(KeyboardInterrupt), _claim(tmp_path / "out") as memory:
        memory.mkdir()
        raise KeyboardInterrupt
    for resume in (True, False):
        with suppress(KeyboardInterrupt), _claim(tmp_path / "out", resume=resume):
            assert memory.is_dir() == resume
            raise KeyboardInterrupt


@pytest.mark.parametrize("moved", [False, True])
def test_what_was_being_written_when_killed_is_cleared(moved, given, tmp_path):
    out, new = tmp_path / "out", tmp_path / ".out.0123abcd.tmp"
    _diagnosis(given, page="old").save(out)
    new.mkdir()
    if moved:
        out.rename(tmp_path / ".out.0123abcd.old")
    with _claim(out, force=True):
        assert _names(tmp_path) == ["out", "out.lock"]
        assert (out / "report.html").read_text() == "old"


BAD = [
    (None, "cannot read"),
    ("{", "is not JSON"),
    ("[]", "is not a selfheal-diagnosis"),
    ("[" * 100_000, "is nested too deeply"),
    ('{"format": "selfheal-diagnosis", "version": 2}', "of version 1"),
    ('{"format": "selfheal-run", "version": 1}', "is not a selfheal-diagnosis"),
]


@pytest.mark.parametrize("text, said", BAD, ids=[b[1] for b in BAD])
def test_what_is_no_diagnosis_is_refused(text, said, tmp_path):
    if text is not None:
        (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(InputError, match=said):
        storage.read_document(tmp_path)
