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
from typing import Any

from ..errors import RunFileError
from ..files import atomic_hdf5, open_run
from .plan import Record, Task

FORMAT, VERSION = "selfheal-study", 1
# rooms and data that an outcome depends on
_ROOMS = ("recording", "body", "engine", "robot", "selfmodel", "gait", "recovery",
          "diagnosis", "study", "models")  # fmt: skip


@dataclass(frozen=True)
class Results:
    """A study, finished or not.

    Attributes:
        study: its name.
        request: what was asked for, as JSON can hold it.
        code: digest of the program that it was begun with.
        tasks: all its runs.
        records: of the runs done so far, key -> "settings", "outcome" (None where it
            failed), "error" ("" where it did not), "seconds", "megabytes" (peak of the
            process until then) and "worker".
    """

    study: str
    request: dict[str, Any]
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
    path: Path, study: str, asked: dict[str, Any], tasks: Sequence[Task]
) -> None:
    """Begin a study's file.

    Args:
        path: of the file.
        study: its name.
        asked: what was asked for, as JSON can hold it.
        tasks: all its runs.

    Raises:
        InputError: nothing can be written there.
    """
    _save_results(path, Results(study, asked, digest_code(), tuple(tasks), {}))


def load_study(path: str | os.PathLike[str]) -> Results:
    """Read a study, the records of its journal included.

    Raises:
        RunFileError: missing, held by another process, truncated, of another format or
            version, or damaged.
    """
    path = Path(path)
    with open_run(path, "study", form=FORMAT, version=VERSION) as file:
        tasks = tuple(Task(**json.loads(t)) for t in file["tasks"].asstr()[()])
        kept = [json.loads(text) for text in file["records"].asstr()[()]]
        results = Results(
            study=str(file.attrs["study"]),
            request=json.loads(file.attrs["asked"]),
            code=str(file.attrs["code"]),
            tasks=tasks,
            records={record["key"]: record for record in kept},
        )
    journal = find_journal(path)
    if journal.is_file():
        lines = journal.read_bytes().split(b"\n")[:-1]  # what has no end is torn
        known = {task.key for task in tasks}
        for line in lines:
            record = _parse_line(line, journal)
            if record["key"] in known:
                results.records[record["key"]] = record
    return results


def _parse_line(line: bytes, journal: Path) -> Record:
    """The record of a line."""
    try:
        record = json.loads(line)
        record["key"], record["error"]
    except (ValueError, KeyError, TypeError) as error:
        raise RunFileError(f"{journal}: a damaged journal: {error}") from error
    return record


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
