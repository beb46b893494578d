"""Logs read whole, and what becomes of damaged ones."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.logs.base import Log
from selfheal.logs.open_log import open_log
from tests.support.paths import RECORDINGS

FIELD = RECORDINGS / "field"
needs_field = pytest.mark.skipif(
    not FIELD.is_dir(), reason="the public logs are not beside this repository"
)


def read_all(log: Log) -> dict[str, dict[str, np.ndarray]]:
    """Every column of every stream, whole; checks what holds for all logs."""
    wanted = {stream.name: list(stream.columns) for stream in log.streams}
    pieces: dict[str, list] = {name: [] for name in wanted}
    shares = [0.0]
    for name, rows in log.read(wanted, shares.append):
        assert list(rows) == wanted[name]
        assert len({len(values) for values in rows.values()}) == 1
        assert all(v.dtype in (np.float64, np.object_) for v in rows.values())
        pieces[name].append(rows)
    assert shares == sorted(shares) and shares[-1] <= 1
    found = {
        name: {c: np.concatenate([p[c] for p in parts]) for c in wanted[name]}
        for name, parts in pieces.items()
        if parts
    }
    for stream in log.streams:
        assert {stream.time, stream.episode} - {""} <= set(stream.columns)
    return found


def check_rows(log: Log) -> None:
    """Check that streams have as many rows as they state."""
    found = read_all(log)
    for stream in log.streams:
        if stream.rows is not None:
            read = found.get(stream.name, {})
            assert all(len(values) == stream.rows for values in read.values())


def read_one(path: Path) -> dict[str, np.ndarray]:
    """Every column of a log of one stream."""
    log = open_log(path)
    assert len(log.streams) == 1
    return read_all(log).get(log.streams[0].name, {})


def read_damaged(path: Path, tries: int = 40) -> list[str]:
    """Damage a file in many ways and read it: the messages of those refused."""
    content = path.read_bytes()
    messages = []
    for changed in _damage(content, tries):
        path.write_bytes(changed)
        try:
            read_all(open_log(path))
        except InputError as error:
            assert str(error).isprintable() and len(str(error)) < 1500
            messages.append(str(error))
    path.write_bytes(content)
    return messages


def _damage(content: bytes, tries: int) -> Iterator[bytes]:
    random = np.random.default_rng(0)
    for cut in {0, 1, len(content) - 1, *random.integers(0, len(content), tries)}:
        yield content[:cut]
    for _ in range(tries):
        changed = bytearray(content)
        for place in random.integers(0, len(content), random.integers(1, 4)):
            changed[place] = random.integers(256)
        yield bytes(changed)
    for _ in range(tries // 4):  # a piece that is of no use, at once
        changed = bytearray(content)
        place = random.integers(0, len(content))
        changed[place : place + 8] = b"\xff" * 8
        yield bytes(changed)
