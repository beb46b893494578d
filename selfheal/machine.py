"""What only some systems have: the same call on Linux and macOS, a word elsewhere."""

import os
import sys
from pathlib import Path
from typing import IO

from .errors import InputError

try:
    import fcntl
    import resource
except ImportError as error:  # Windows has neither, and no fork
    raise InputError(
        f"selfheal runs on Linux and on macOS, and not on {sys.platform}; on Windows, "
        "install it inside WSL ('wsl --install' sets that up)"
    ) from error

_PROC = Path("/proc/self")  # Linux's files about a process
# a folder in which no process can leave a file; / is one for all but root
BARE_FOLDER = "/proc" if _PROC.is_dir() else "/"


def list_cores() -> tuple[int, ...]:
    """The cores this process may run on; all where the system cannot restrict it."""
    if hasattr(os, "sched_getaffinity"):
        return tuple(sorted(os.sched_getaffinity(0)))
    return tuple(range(os.cpu_count() or 1))


def count_cores() -> int:
    """The number of cores this process may run on; NPROC can say fewer, as to XLA."""
    free, limit = len(list_cores()), os.environ.get("NPROC", "")
    return min(free, max(int(limit), 1)) if limit.isdecimal() else free


def pin_to_core(core: int) -> None:
    """Keep all threads of this process to one core, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        for thread in os.listdir(_PROC / "task"):
            os.sched_setaffinity(int(thread), {core})


def limit_memory(more: int) -> None:
    """Let this process take so many more bytes, where the system says what it has.

    macOS does not: there a limit of time has to do.
    """
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if (_PROC / "statm").exists():
        pages = int((_PROC / "statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + more
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def measure_peak_memory() -> int:
    """The most memory that this process ever had [B]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak  # bytes there, else KiB


def lock(file: IO, *, wait: bool) -> None:
    """Keep an open file to this process until it is closed.

    Args:
        wait: until another process lets go of it.

    Raises:
        BlockingIOError: another process has it, and `wait` is not set.
        OSError: the file system has no locks.
    """
    fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
