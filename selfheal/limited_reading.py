"""Files read on trial by a process with limits; what they do to it, as an error.

HDF5 and MuJoCo read some damaged files for ever, ask for all memory, or crash the
process. So one process, which does nothing else, forks a child for each file. The child
reads it and ends, and only what it survived is read again here.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from threading import Lock
from typing import NamedTuple

from .machine import BARE_FOLDER, limit_memory

# [s] that a small file may take; chosen: 100 times what the largest models take
MAX_SECONDS = 12.0
MIN_SPEED = 5e6  # [B/s] at which larger ones are read; chosen: a tenth of gzip's
# [B] that reading a small file may add; chosen: far above what a robot's meshes take
MAX_MEMORY = 1_000_000_000
# bytes added per byte of a larger file; chosen: float32 read as float64, and room
MAX_EXPANSION = 4
_OUT_OF_MEMORY, _UNKNOWN_ERROR = 3, 4  # exit codes of a child
_LATE = signal.SIGALRM.name
_lock = Lock()


class _Request(NamedTuple):
    """What a child is to read, in so much time [s] and more memory [B]."""

    reader: str
    library: str
    path: str
    seconds: float
    memory: int


def explain_dangerous(path: str | os.PathLike[str], reader: str, library: str) -> str:
    """Why a file cannot be read without harm; empty where it can, or where it is not.

    What the reader raises itself is not reported: who reads it next says it better.

    Args:
        reader: "module:function" that is given the path.
        library: module that does the reading; it is loaded once.
    """
    real = os.path.realpath(path)
    if not os.path.isfile(real):
        return ""
    stat = os.stat(real)
    return _explain_version(reader, library, real, stat.st_mtime_ns, stat.st_size)


@cache
def _explain_version(reader: str, library: str, path: str, _: int, size: int) -> str:
    """What becomes of reading a file that was last modified at a time; read once."""
    seconds, memory = MAX_SECONDS + size / MIN_SPEED, MAX_MEMORY + MAX_EXPANSION * size
    with _lock:
        outcome = _ask_server(_Request(reader, library, path, seconds, memory))
    if not outcome:
        return ""
    if outcome == _OUT_OF_MEMORY:
        what = f"needs more than {memory / 1e9:.1f} GB of memory"
    elif outcome == _UNKNOWN_ERROR:
        what = "ends in an error that the library cannot name"
    elif outcome == _LATE:
        what = f"did not end within {seconds:.0f} s"
    else:
        what = f"crashes the process ({outcome})"
    return (
        f"reading it {what}: it is damaged, states sizes that are too large, or "
        "includes what is no file"
    )


def _ask_server(request: _Request) -> int | str:
    """Have a file read by the server; 0 where that ended by itself."""
    process = _start_server(os.getpid())
    sent, got = process.stdin, process.stdout
    assert sent and got
    try:
        sent.write(json.dumps(request) + "\n")
        sent.flush()
        outcome: int | str = json.loads(got.readline())
        return outcome
    except BaseException as error:  # its next answer would be to this request
        process.kill()
        _start_server.cache_clear()
        if isinstance(error, OSError | ValueError):
            return 0  # it was killed; that says nothing about the file
        raise


@cache
def _start_server(_: int) -> subprocess.Popen[str]:
    """Start the server of a process; a fork of that does not share it."""
    code = f"import sys; sys.path[:] = {sys.path!r}; import {__name__} as m; m.serve()"
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", code],
        stdin=pipe,
        stdout=pipe,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        cwd=BARE_FOLDER,
        # the second one is macOS's: forks of what has loaded its libraries may run on
        env=os.environ
        | {"OPENBLAS_NUM_THREADS": "1", "OBJC_DISABLE_INITIALIZE_FORK_SAFETY": "YES"},
    )
    atexit.register(_stop_server, process, os.getpid())
    return process


def _stop_server(process: subprocess.Popen[str], owner: int) -> None:
    """End a server, unless this is a fork of the process that owns it."""
    if os.getpid() == owner:
        process.communicate()


def serve() -> None:
    """Answer requests, a line of JSON each, until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no answer
    for line in sys.stdin:
        outcome = _read_in_child(_Request(*json.loads(line)))
        print(json.dumps(outcome), file=answers, flush=True)


def _read_in_child(request: _Request) -> int | str:
    """The end of a child that reads: an exit code, or a signal's name."""
    module, _, function = request.reader.partition(":")
    import_module(request.library)
    read = getattr(import_module(module), function)
    child = os.fork()
    if child == 0:
        _read_and_exit(read, request)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return status if status >= 0 else signal.Signals(-status).name


def _read_and_exit(read: Callable[[str], object], request: _Request) -> None:
    """What a child does: read within the limits, and end."""
    code = 1  # of a library that ends the process by itself
    try:
        # its signal ends the process
        signal.setitimer(signal.ITIMER_REAL, request.seconds)
        limit_memory(request.memory)
        read(request.path)
        code = 0
    except MemoryError:
        code = _OUT_OF_MEMORY
    except Exception as error:
        text = str(error)
        if "alloc" in text:  # MuJoCo: "Could not allocate memory for texture"
            code = _OUT_OF_MEMORY
        else:  # of C++, not a std::exception: MuJoCo's of a flexcomp that is too large
            code = _UNKNOWN_ERROR if "unknown exception" in text else 0
    finally:
        os._exit(code)
