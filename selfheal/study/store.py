"""STUDY.h5: the runs of a study in; what came of each, exactly once, on disk.

STUDY.h5: attributes format="selfheal-study", version=1, study, code and asked (JSON);
datasets `tasks` and `records`, a JSON text each run. While a study works, records go to
STUDY.h5.journal, a line each, a chunk at a time. A process killed at any moment leaves
whole lines and perhaps a torn last one, which is not counted. At the end all of it
becomes one file, in one step; reading takes in both.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator

from ..files import atomic_hdf5
from ..schema import Members, open_members
from .plan import JsonObject, Record, Task, find_study

FORMAT, VERSION = "selfheal-study", 1
# rooms and data that an outcome depends on
_ROOMS = (
    "recording",
    "body",
    "engine",
    "robot",
    "selfmodel",
    "gait",
    "recovery",
    "diagnosis",
    "study",
    "models",
)


def _check_end(record: Record) -> Record:
    """Refuse a run that neither ended well nor failed, or both."""
    if not isinstance(record["outcome"], dict | None):
        raise ValueError("with an outcome that is no object")
    if (record["outcome"] is None) != bool(record["error"]):
        raise ValueError("with both or neither of outcome and error")
    return record


@dataclass(frozen=True)
class Results:
    """A study, finished or not.

    Attributes:
        study: its name.
        request: its settings, as JSON can hold them.
        code: digest of the program that it was begun with.
        tasks: all its runs.
        records: of the runs done so far, by their keys.
    """

    study: str
    request: JsonObject
    code: str
    tasks: tuple[Task, ...]
    records: dict[str, Record]

    @property
    def left(self) -> list[Task]:
        """Runs that were not done yet."""
        return [task for task in self.tasks if task.key not in self.records]

    @property
    def failed(self) -> list[Task]:
        """Runs that ended with an error."""
        found = self.records
        return [t for t in self.tasks if t.key in found and found[t.key]["error"]]

    @property
    def finished(self) -> list[Record]:
        """Records of runs without an error, in the order of the tasks."""
        found = (self.records.get(task.key) for task in self.tasks)
        return [record for record in found if record and not record["error"]]


def digest_code() -> str:
    """A name of the program code that outcomes depend on."""
    digest = hashlib.sha256()
    for room in _ROOMS:
        root = Path(str(files("selfheal").joinpath(room)))
        if room == "models":
            root = Path(str(files("selfheal.models")))
        for file in sorted([*root.rglob("*.py"), *root.rglob("*.xml")]):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def find_journal(path: Path) -> Path:
    """Where records stand until they are in the file itself."""
    return path.with_name(f"{path.name}.journal")


def create_study(
    path: Path, study: str, request: JsonObject, tasks: Sequence[Task]
) -> None:
    """Begin a study's file.

    Args:
        request: the settings of the study, as JSON can hold it.

    Raises:
        InputError: nothing can be written there.
    """
    _save_results(path, Results(study, request, digest_code(), tuple(tasks), {}))


def load_study(path: str | os.PathLike[str]) -> Results:
    """Read a study, the records of its journal included.

    Raises:
        RunFileError: missing, held by another process, truncated, of another format or
            version, or damaged.
    """
    path = Path(path)
    with open_members(path, "study", form=FORMAT, version=VERSION) as file:
        name, code = file.read_attribute("study"), file.read_attribute("code")
        request = file.read_json("asked", dict[str, int | str | None])
        tasks = _read_tasks(file)
        known = {task.key for task in tasks}
        records = _parse_records(file, "records", file.read_texts("records"))
        if unknown := records.keys() - known:
            found = f"of runs that tasks lacks, as {min(unknown)!r}"
            raise file.make_error("records", found)
        journal = find_journal(path)
        if journal.is_file():
            lines = journal.read_bytes().split(b"\n")[:-1]  # what has no end is torn
            place = Members(None, f"{journal}: a damaged journal")
            added = _parse_records(place, "line", lines)
            records |= {key: record for key, record in added.items() if key in known}
    return Results(name, request, code, tasks, records)


def load_checked(path: str | os.PathLike[str]) -> Results:
    """Read a study whose settings and outcomes fit its tables, as `load_study` does."""
    results = load_study(path)
    study = find_study(results.study)
    members = Members(None, f"{os.fspath(path)}: a damaged study")
    for key, record in results.records.items():
        settings, outcome = record["settings"], record["outcome"]
        if outcome is not None:
            place, kind = f"run {key!r}", study.find_outcome
            members.parse(f"{place}, settings", json.dumps(settings), study.settings)
            members.parse(f"{place}, outcome", json.dumps(outcome), kind(settings))
    return results


def _read_tasks(file: Members) -> tuple[Task, ...]:
    """All runs of an open file."""
    tasks = [
        file.parse(f"tasks[{k}]", text, Task)
        for k, text in enumerate(file.read_texts("tasks"))
    ]
    if len({task.key for task in tasks}) != len(tasks):
        raise file.make_error(
            "tasks", "of several runs with one key", "keys that differ"
        )
    return tuple(tasks)


def _parse_records(
    members: Members, what: str, texts: Sequence[str | bytes]
) -> dict[str, Record]:
    """The records of JSON texts by their keys; of two with one key the last."""
    kind = Annotated[Record, AfterValidator(_check_end)]
    records = [
        members.parse(f"{what} {k}", text, kind) for k, text in enumerate(texts, 1)
    ]
    return {record["key"]: record for record in records}


def _save_results(path: Path, results: Results) -> None:
    """Write all of a study, whole or not at all."""
    import h5py

    order = {task.key: k for k, task in enumerate(results.tasks)}
    records = sorted(results.records.values(), key=lambda r: order[r["key"]])
    text = h5py.string_dtype()
    with atomic_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION, study=results.study)
        file.attrs["asked"] = json.dumps(results.request)
        file.attrs["code"] = results.code
        tasks = [{"key": t.key, "settings": dict(t.settings)} for t in results.tasks]
        for name, rows in (("tasks", tasks), ("records", records)):
            lines = [json.dumps(row) for row in rows]
            file.create_dataset(name, (len(lines),), text, lines or None)


class Journal:
    """Where the one writer of a study puts records, a chunk at a time."""

    def __init__(self, file: int) -> None:
        """`file`: descriptor, open for appending."""
        self._file = file

    def add(self, records: Sequence[Record]) -> None:
        """Keep some records; when this returns they are on disk."""
        text = "".join(json.dumps(record) + "\n" for record in records)
        rest = memoryview(text.encode())
        while rest:
            rest = rest[os.write(self._file, rest) :]
        os.fsync(self._file)


@contextmanager
def open_journal(path: Path) -> Iterator[Journal]:
    """A journal beside a study's file; in the end its records are in the file.

    Also after an exception; of a killed process they are when it is resumed.
    """
    journal = find_journal(path)
    merge_journal(path)
    file = os.open(journal, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        yield Journal(file)
    finally:
        os.close(file)
        merge_journal(path)


def merge_journal(path: Path) -> None:
    """Take a journal into its study's file; killed at any point, it can be repeated."""
    journal = find_journal(path)
    if journal.exists():
        _save_results(path, load_study(path))
        journal.unlink()
