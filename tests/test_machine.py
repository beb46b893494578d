"""What only Linux has is missed by nobody: elsewhere another way, or a plain word."""

import importlib
import os
import re
import subprocess
import sys

import pytest

from selfheal import machine
from selfheal.engine.statics import count_cores
from selfheal.errors import InputError, RunLockError
from selfheal.files import lock_file, write_text
from tests.support import harmful_readers
from tests.support.paths import ROOT


@pytest.fixture
def elsewhere(monkeypatch, tmp_path):
    """A system without /proc, affinities and Linux's unit of memory, as macOS is."""
    monkeypatch.setattr(machine, "_PROC", tmp_path / "no proc")
    for name in ("sched_getaffinity", "sched_setaffinity"):
        monkeypatch.delattr(os, name)
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.delenv("NPROC", raising=False)


def test_elsewhere_every_core_counts(elsewhere, monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    assert machine.list_cores() == (0, 1, 2)
    assert count_cores() == 3
    machine.pin_to_core(0)  # asks for nothing that is not there


def test_a_core_that_is_taken_away_does_not_count(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {5, 2})
    assert machine.list_cores() == (2, 5)


@pytest.mark.parametrize("told, counted", [("1", 1), ("0", 1), ("9", 2), ("all", 2)])
def test_nproc_can_only_lower_the_count(monkeypatch, told, counted):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    monkeypatch.setenv("NPROC", told)
    assert machine.count_cores() == counted


def test_memory_is_in_bytes_on_either_system(monkeypatch):
    linux = machine.measure_peak_memory()
    monkeypatch.setattr(sys, "platform", "darwin")
    assert 1e7 < linux < 1e12
    assert linux == pytest.approx(1024 * machine.measure_peak_memory(), rel=0.5)


def test_elsewhere_files_are_written_and_locked(elsewhere, tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "whole")
    assert path.read_text() == "whole"
    refused = pytest.raises(RunLockError, match="another process")
    with lock_file(path), refused, lock_file(path):
        pass


# a process of its own: the server forks it, and what it limits stays limited
_READ = """
import pathlib, sys
from selfheal import limited_reading, machine
machine._PROC = pathlib.Path("no proc")
request = limited_reading._Request(
    sys.argv[1], "json", sys.argv[2], seconds=0.3, memory=1_000_000_000
)
print(limited_reading._read_in_child(request))
"""


@pytest.mark.parametrize(
    "reader, end", [("read", "0"), ("hang", "SIGALRM"), ("crash", "SIGABRT")]
)
def test_elsewhere_a_harmful_file_still_harms_a_child_alone(tmp_path, reader, end):
    (tmp_path / "file").touch()
    name = f"{harmful_readers.__name__}:{reader}"
    command = [sys.executable, "-c", _READ, name, str(tmp_path / "file")]
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    assert done.stdout.split() == [end], done.stderr


def test_no_other_module_asks_for_what_only_some_systems_have():
    only_some = re.compile(r"sched_[gs]etaffinity|\b(fcntl|resource)\.|[\"']/proc\b")
    modules = [p for top in ("selfheal", "cli") for p in (ROOT / top).rglob("*.py")]
    asking = {path.stem for path in modules if only_some.search(path.read_text())}
    assert asking == {"machine"}


@pytest.mark.parametrize("missing", ["fcntl", "resource"])
def test_a_system_without_the_calls_is_named(monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.delitem(sys.modules, machine.__name__)
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(InputError, match=r"not on win32; on Windows, .* WSL"):
        importlib.import_module(machine.__name__)
