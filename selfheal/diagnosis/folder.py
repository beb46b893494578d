"""A diagnosis on disk (contract section 2): whole, or not there."""

import json
import os
import shutil
from pathlib import Path
from typing import Any
from uuid import uuid4

from ..errors import InputError
from ..files import check_writable_folder
from .document import text_of
from .result import Diagnosis

FILES = ("diagnosis.json", "patched.xml", "report.html")


def check_folder(folder: str | os.PathLike[str], force: bool) -> Path:
    """Refuse a folder that cannot be written or would be lost.

    Raises:
        InputError: it cannot be written, or holds something and `force` is not set.
    """
    folder = Path(folder)
    if folder.is_file():
        raise InputError(f"{folder} is a file; would fit: a folder to be made")
    held = sorted(p.name for p in folder.iterdir()) if folder.is_dir() else []
    if held and not force:
        raise InputError(
            f"{folder} exists and is not empty; give another --out, or --force"
        )
    if others := [name for name in held if name not in FILES]:
        raise InputError(
            f"{folder} holds {', '.join(others[:3])}, which --force would delete; "
            f"would fit: a folder of {', '.join(FILES)} alone, or a new one"
        )
    check_writable_folder(folder.resolve().parent)
    return folder


def write(diagnosis: Diagnosis, folder, page: str, force: bool) -> None:
    """Write diagnosis.json, patched.xml and report.html, all or nothing."""
    folder = check_folder(folder, force)
    home = folder.resolve().parent
    new = home / f".{folder.name}.{uuid4().hex[:8]}.tmp"
    new.mkdir()
    try:
        (new / "diagnosis.json").write_text(text_of(diagnosis.document))
        (new / "patched.xml").write_bytes(diagnosis.patched.encode())
        (new / "report.html").write_text(page, encoding="utf-8")
        old = new.with_suffix(".old")
        if folder.exists():
            os.replace(folder, old)
        os.replace(new, folder)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def read(folder: str | os.PathLike[str]) -> dict[str, Any]:
    """diagnosis.json of a folder.

    Raises:
        InputError: there is none, or it is none.
    """
    path = Path(folder) / "diagnosis.json"
    try:
        document = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path} is not JSON: {error}") from error
    kind = document.get("format") if isinstance(document, dict) else None
    if kind != "selfheal-diagnosis" or document.get("version") != 1:
        raise InputError(f"{path} is not a selfheal-diagnosis of version 1")
    return document
