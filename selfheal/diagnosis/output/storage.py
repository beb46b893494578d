"""A diagnosis on disk (contract section 2): takes its parts, writes all or nothing."""

import glob
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from uuid import uuid4

import h5py
import numpy as np

from ...documents import load_json
from ...errors import InputError
from ...files import check_writable, lock_file, make_write_error
from ...mjcf.xml_text import encode_text
from ..estimation.information import Information
from .schema import Document, check_entries

PATCHED = ("patched.xml", "patched.diff")
ACTUATORS = ("actuators.yaml", "actuators_isaaclab.py", "actuators_mjlab.py")
FILES = ("diagnosis.json", *PATCHED, "report.html", *ACTUATORS)
URDF, INFORMATION = "patched.urdf", "information.h5"  # that a diagnosis may lack
ALL_FILES = (*FILES, URDF, INFORMATION)


def check_folder(folder: str | os.PathLike[str], force: bool) -> Path:
    """The folder, if a diagnosis can be written there and nothing else is lost.

    Args:
        force: whether an earlier diagnosis there may be replaced.

    Raises:
        InputError: it cannot be written, or holds something and `force` is not set.
    """
    folder = Path(folder)
    check_writable(folder)
    if folder.is_file():
        raise InputError(f"{folder} is a file; would fit: a folder to be made")
    try:
        held = sorted(os.listdir(folder)) if folder.is_dir() else []
    except OSError as error:
        raise InputError(f"cannot look into {folder}: {error.strerror}") from error
    if others := [name for name in held if name not in ALL_FILES]:
        raise InputError(
            f"{folder} holds {', '.join(others[:3])}, which is no part of a diagnosis "
            "and would be lost; would fit: a new folder, or an empty one"
        )
    if held and not force:
        raise InputError(
            f"{folder} holds an earlier diagnosis; --force replaces it, or give "
            "another folder"
        )
    return folder


@contextmanager
def claim_folder(
    folder: str | os.PathLike[str], *, force: bool, resume: bool
) -> Iterator[Path]:
    """Keep a folder to one diagnosis, until that is written.

    Args:
        force: whether an earlier diagnosis there may be replaced.
        resume: whether a diagnosis that was killed goes on; else its arrays are lost.

    Yields:
        The hidden folder beside it for arrays that a killed diagnosis goes on with. It
        is removed if nothing is raised.

    Raises:
        InputError: it cannot be written, or holds something and `force` is not set.
        RunLockError: another process works on it.
    """
    check_writable(folder)
    real = Path(folder).resolve()  # "." has no name
    memory = real.with_name(f".{real.name}.unfinished")
    made = [parent for parent in real.parents if not parent.exists()]
    real.parent.mkdir(parents=True, exist_ok=True)
    try:
        with lock_file(real):
            _remove_abandoned(real)
            check_folder(folder, force)
            if not resume:
                shutil.rmtree(memory, ignore_errors=True)
            yield memory
            shutil.rmtree(memory, ignore_errors=True)
    finally:
        with suppress(OSError):  # what is not empty stays
            for parent in made:
                parent.rmdir()


def _remove_abandoned(folder: Path) -> None:
    """Remove what a diagnosis that was killed while it was written left beside it.

    An earlier diagnosis that it had just moved away gets its place back.
    """
    pattern = f".{glob.escape(folder.name)}.????????"
    for old in folder.parent.glob(f"{pattern}.old"):
        if not folder.exists():
            os.replace(old, folder)
        shutil.rmtree(old, ignore_errors=True)
    for new in folder.parent.glob(f"{pattern}.tmp"):
        shutil.rmtree(new, ignore_errors=True)


def write_diagnosis(
    folder: Path, texts: Mapping[str, str], information: Information | None
) -> None:
    """Write the files of a diagnosis, all or nothing.

    Args:
        folder: that `check_folder` let pass, where a link to it leads.
        texts: of the files, by their names; those that are no text aside.
        information: information.h5; None: there is none.

    Raises:
        SelfhealError: the disk is full.
    """
    new = folder.parent / f".{folder.name}.{uuid4().hex[:8]}.tmp"
    try:
        new.mkdir(parents=True)
        for name, text in texts.items():
            (new / name).write_bytes(encode_text(text))
        if information:
            _write_information(new / INFORMATION, information)
        _replace_folder(new, folder)
    except OSError as error:
        raise make_write_error(folder, error) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _write_information(path: Path, information: Information) -> None:
    """Write Gram matrices by block, and what they are of, as HDF5."""
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["version"] = "selfheal-information", 1
        for name, value in asdict(information).items():
            is_names = name == "parameters"
            file[name] = np.array(value, h5py.string_dtype()) if is_names else value


def _replace_folder(new: Path, folder: Path) -> None:
    """Put a new folder in the place of one that may be there."""
    if folder == Path.cwd():  # a shell in it would be left in a deleted folder
        for name in ALL_FILES:
            if (new / name).exists():
                os.replace(new / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
        return
    old = new.with_suffix(".old")
    if folder.exists():
        os.replace(folder, old)
    try:
        os.replace(new, folder)
    except OSError:
        if old.exists():
            os.replace(old, folder)
        raise
    shutil.rmtree(old, ignore_errors=True)


def read_document(folder: str | os.PathLike[str]) -> Document:
    """The checked diagnosis.json of a folder.

    Raises:
        InputError: the folder has none, or one that no replay could use.
    """
    path = Path(folder) / "diagnosis.json"
    try:
        document = load_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path} is not JSON: {error}") from error
    except RecursionError as error:
        raise InputError(
            f"{path} is nested too deeply; would fit: a diagnosis"
        ) from error
    kind = document.get("format") if isinstance(document, dict) else None
    if kind != "selfheal-diagnosis" or document.get("version") != 1:
        raise InputError(f"{path} is not a selfheal-diagnosis of version 1")
    check_entries(path, document)
    return document
