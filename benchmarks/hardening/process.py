"""Commands of `selfheal` in forked processes: words in; how each ended out.

The process that forks has all modules loaded and no threads, so a command costs what it
does itself.
"""

import faulthandler
import importlib
import multiprocessing
import os
import pkgutil
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, Any

from benchmarks.hardening.short_searches import shorten_searches
from selfheal.machine import measure_peak_memory

MOST_SECONDS = 20.0  # of a command; chosen
_MOST_DATA = 3 * 2**30  # bytes that a command may ask for, so that the machine lives
_UNLOADED = ("jax", "mjx", "_gl", "worker")  # in names of modules that start threads


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        code: its exit code; None where a signal ended it.
        signal: name of that signal, "" if none.
        hung: whether it was stopped because it took too long.
        megabytes: peak of its memory [MB]; 0 where a signal ended it.
        stdout: standard output.
        stderr: standard error.
    """

    code: int | None
    signal: str
    hung: bool
    seconds: float
    megabytes: float
    stdout: str
    stderr: str


@cache
def load_program() -> None:
    """Import all modules of the program and make its searches short."""
    import selfheal
    import selfheal.cli

    for package in (selfheal, selfheal.cli):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not any(word in found.name for word in _UNLOADED):
                importlib.import_module(found.name)
    shorten_searches()


def run_selfheal(
    words: Sequence[object],
    folder: Path,
    *,
    prepare: Callable[[], None] = lambda: None,
    seconds: float = MOST_SECONDS,
) -> Ended:
    """Run one command of `selfheal` in a process of its own.

    Args:
        seconds: after which it is stopped [s].
    """

    def play() -> None:
        from selfheal.cli import app

        prepare()
        app(list(map(str, words)))

    return run_forked(play, folder, seconds=seconds)


def run_forked(
    play: Callable[[], None], folder: Path, *, seconds: float = MOST_SECONDS
) -> Ended:
    """Call a function in a process of its own.

    Args:
        seconds: after which it is stopped [s].
    """
    fork = multiprocessing.get_context("fork")
    with tempfile.TemporaryFile() as stdout, tempfile.TemporaryFile() as stderr:
        peak, start = fork.Value("d", 0.0), time.perf_counter()
        child = fork.Process(target=_play, args=(play, folder, stdout, stderr, peak))
        child.start()
        child.join(seconds)
        hung = child.is_alive()
        if hung:  # abort shows the stack, where a process still listens to signals
            os.kill(child.pid or 0, signal.SIGABRT)
            child.join(2.0)
            child.kill()
            child.join()
        code = child.exitcode or 0
        return Ended(
            code=None if code < 0 else code,
            signal=signal.Signals(-code).name if code < 0 else "",
            hung=hung,
            seconds=time.perf_counter() - start,
            megabytes=peak.value,
            stdout=_read_text(stdout),
            stderr=_read_text(stderr),
        )


def _play(
    play: Callable[[], None],
    folder: Path,
    stdout: IO[bytes],
    stderr: IO[bytes],
    peak: Any,
) -> None:
    """Call the function in this process, which is the forked one.

    Args:
        peak: gets the most memory that it had [MB].
    """
    os.chdir(folder)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_DATA, _MOST_DATA))
    os.dup2(stdout.fileno(), 1)
    os.dup2(stderr.fileno(), 2)
    sys.stdout, sys.stderr = (os.fdopen(f, "w", closefd=False) for f in (1, 2))
    faulthandler.enable(sys.stderr)
    try:
        play()
    finally:
        peak.value = measure_peak_memory() / 1e6


def _read_text(file: IO[bytes]) -> str:
    """What a file holds, where it is long its two ends."""
    file.seek(0)
    text = file.read(2**26).decode(errors="replace")
    return text if len(text) < 200_000 else f"{text[:100_000]} ... {text[-100_000:]}"


def stop_at_progress(seconds: float) -> None:
    """End a command with code 0 where it shows progress after some time [s]."""
    from selfheal.cli._progress import ProgressBar

    begun, show = time.perf_counter(), ProgressBar.show

    def show_or_stop(self: ProgressBar, what: str, share: float) -> None:
        if time.perf_counter() - begun >= seconds:
            raise SystemExit(0)
        show(self, what, share)

    # by name: mypy refuses a function in a method's place
    setattr(ProgressBar, "show", show_or_stop)  # noqa: B010
