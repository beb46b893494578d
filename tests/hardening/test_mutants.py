"""Damaged files are refused with one message, or read; nothing is left of either."""

import shutil
import traceback
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.hardening.fuzz import Mutant, copy_with_mutant, make_mutant
from benchmarks.hardening.judge import Fault, list_faults
from benchmarks.hardening.log_files import write_logs
from benchmarks.hardening.mutate_bytes import mutate_bytes
from benchmarks.hardening.originals import (
    KINDS,
    write_identified_run,
    write_small_files,
    write_study,
)
from benchmarks.hardening.process import Ended
from selfheal.api import heal, identify
from selfheal.api.recovery import begin_recovery, make_recover_settings
from selfheal.cli import app
from selfheal.cli._progress import ProgressBar
from tests.support import short_heal, short_recover

COUNT = 50  # mutants of a kind


class _Begun(Exception):
    """A run has begun, and its file is there."""


def _stop(*args: object) -> None:
    raise _Begun


def _write_begun_runs(folder: Path) -> None:
    """Runs that were killed right after they began."""
    damage = "dead:left_hip_position"
    with suppress(_Begun):
        identify(
            "starfish",
            engine="statics",
            budget=500,
            cycles=2,
            out=folder / "identify",
            on_step=_stop,
        )
    with suppress(_Begun):
        heal(folder / "run.h5", damage, out=folder / "heal", on_step=_stop)
    begin_recovery(folder, make_recover_settings("quadruped", 1), force=False)
    for made, names in (
        ("run.h5", ["ended.h5"]),
        ("identify/run.h5", ["begun.h5"]),
        ("heal/heal.h5", ["heal.h5", "begun-heal.h5"]),
        ("recover.h5", ["begun-recover.h5"]),
    ):
        for name in names:
            shutil.copy(folder / made, folder / name)


@pytest.fixture(scope="module")
def originals(tmp_path_factory) -> Path:
    """A folder of whole files of all kinds."""
    folder = tmp_path_factory.mktemp("originals")
    write_small_files(folder)
    write_identified_run(folder)
    write_study(folder)
    write_logs(folder)
    _write_begun_runs(folder)
    return folder


@pytest.fixture(scope="module", autouse=True)
def short_searches() -> Iterator[None]:
    """Searches that come to their first progress at once, and end there."""
    with pytest.MonkeyPatch.context() as patch:
        short_heal.shorten(patch.setattr)
        short_recover.shorten(patch.setattr)
        patch.setattr(ProgressBar, "show", _leave)
        yield


def _leave(*args: object) -> None:
    raise SystemExit(0)


def _try(mutant: Mutant, originals: Path, place: Path) -> list[Fault]:
    """What is wrong with how a mutant's command ends in this process."""
    copy_with_mutant(originals, mutant, place)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        result = CliRunner().invoke(app, mutant.command.split())
    said = result.stderr
    if result.exception and not isinstance(result.exception, SystemExit):
        said += "".join(traceback.format_exception(result.exception))
    ended = Ended(result.exit_code, "", False, 0.0, 0.0, result.stdout, said)
    return list_faults(ended, place)


def _list_mutants(kind: str, originals: Path) -> Iterator[tuple[int, Mutant]]:
    """Seeds and mutants that this process can be trusted with."""
    for seed in range(COUNT):
        mutant = make_mutant(originals, kind, seed)
        # HDF5's library was seen to loop and to crash on bytes that are wrong
        wrong = mutant.mutate is mutate_bytes and mutant.original.file.endswith(
            (".h5", ".hdf5")
        )
        if not wrong:
            yield seed, mutant


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_refused_with_one_message_or_read(kind, originals, tmp_path):
    faults = {}
    for seed, mutant in _list_mutants(kind, originals):
        if found := _try(mutant, originals, tmp_path / str(seed)):
            faults[seed] = mutant.original.file, mutant.command, found
    assert not faults


def test_the_same_seed_makes_the_same_mutant(originals):
    for kind in KINDS:
        made = [make_mutant(originals, kind, s) for s in (3, 3, 4)]
        assert made[0] == made[1] != made[2]


def test_a_message_that_is_two_or_a_file_that_is_left_is_a_fault(tmp_path):
    (tmp_path / ".run.h5.0123abcd.tmp").touch()
    said = "selfheal: one\nselfheal: two\n"
    ended = Ended(2, "", False, 0.0, 0.0, "", said)
    assert [f.what for f in list_faults(ended, tmp_path)] == ["message", "leftover"]


def test_a_recording_of_a_log_that_was_refused_is_a_fault(tmp_path):
    (tmp_path / "imported.h5").touch()
    refused = Ended(2, "", False, 0.0, 0.0, "", "selfheal: no log\n")
    assert [f.what for f in list_faults(refused, tmp_path)] == ["leftover"]
    assert not list_faults(replace(refused, code=0), tmp_path)
