"""What happens in a worker process: a run's settings in, its record out."""

import os
import signal
import time
import traceback
import warnings
from collections.abc import Callable

from distributed import Worker, WorkerPlugin, get_worker

from ..machine import measure_peak_memory, pin_to_core
from .plan import Outcome, Record, RunSettings

_LINES = 6  # last ones of a traceback that are kept; chosen


class PinnedWorker(WorkerPlugin):
    """Keeps what a worker computes to one thread.

    Libraries read the variable when they first start threads, after this; those that
    read theirs when they are loaded get them from Dask's nanny. On this machine each
    worker is put on a core of its own, too; a batch system does that for its jobs. A
    terminal's Ctrl-C there is left to the process that submitted the work.
    """

    name, idempotent = "selfheal-pinned", True

    def __init__(self, own: tuple[int, ...] = ()) -> None:
        """`own`: cores to share out among workers named 0, 1, 2, ...; empty: none."""
        self.own = own

    def setup(self, worker: Worker) -> None:
        """Called by Dask in a worker that has just started."""
        os.environ["NPROC"] = "1"
        warnings.simplefilter("ignore")  # a thousand runs would each say the same
        if self.own:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            pin_to_core(self.own[int(worker.name) % len(self.own)])


def perform_task(
    play: Callable[[RunSettings], Outcome], key: str, settings: RunSettings
) -> Record:
    """The record of one run; its error is part of it."""
    start, outcome, error = time.perf_counter(), None, ""
    try:
        outcome = play(settings)
    except Exception as raised:  # whatever it is, it is this run's alone
        lines = traceback.format_exception(raised)
        error = "".join(lines[-_LINES:]).strip()
    return {
        "key": key,
        "settings": dict(settings),
        "outcome": outcome,
        "error": error,
        "seconds": round(time.perf_counter() - start, 3),
        "megabytes": measure_peak_memory() >> 20,
        "worker": str(get_worker().name),
    }
