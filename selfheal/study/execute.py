"""The work itself: tasks and workers in; records out, as they come, in chunks."""

import time
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, cast
from uuid import uuid4

from ..errors import SelfhealError
from .plan import Record, Study, Task

if TYPE_CHECKING:
    from distributed import Client

# Chosen: tasks that the scheduler knows of, for each worker and at least. A worker
# always has its next one; the scheduler's memory does not grow with the study.
_TASKS_PER_WORKER, _LEAST_TASKS = 4, 64
_POLL_PERIOD = 1.0  # [s] from one count of the workers to the next; chosen


def execute_tasks(
    client: "Client", study: Study, tasks: Sequence[Task]
) -> Iterator[tuple[list[Record], int]]:
    """Do runs on a client's workers.

    A run whose worker dies is done again elsewhere, `workers.DEATHS` times at most.

    Args:
        client: of the workers; they may come and go meanwhile.

    Yields:
        Records of all runs that have ended since the last yield, each once, and how
        many workers there are.

    Raises:
        SelfhealError: the scheduler was lost.
    """
    from distributed import as_completed

    from .worker import perform_task

    # several studies may share a scheduler. Names of one family: the scheduler keeps
    # such tasks back until a worker is free, instead of sharing them out at once
    family = f"selfheal-{uuid4().hex[:8]}"
    left, running = enumerate(tasks), dict[tuple[str, int], Task]()
    done = as_completed(with_results=True, raise_errors=False)

    def more(count: int) -> None:
        for number, task in islice(left, count):
            name = (family, number)
            running[name] = task
            work = perform_task, study.run_task, task.key, dict(task.settings)
            done.add(client.submit(*work, key=name))

    workers, polled = len(client.nthreads()), time.monotonic()
    more(max(_LEAST_TASKS, _TASKS_PER_WORKER * workers))
    for batch in done.batches():
        if time.monotonic() > polled + _POLL_PERIOD:
            workers, polled = len(client.nthreads()), time.monotonic()
        records = [_make_record(running.pop(f.key), result) for f, result in batch]
        more(max(_LEAST_TASKS, _TASKS_PER_WORKER * workers) - len(running))
        yield records, workers


def _make_record(task: Task, result: object) -> Record:
    """The record of a run that has ended, well or not.

    Args:
        result: what Dask's `as_completed` gives for its future: what `perform_task`
            returned, the type, value and traceback of an exception, or an exception
            that tells why there is neither. The future's own status may have changed
            since: it is lost when the worker dies that had sent the result.
    """
    if isinstance(result, dict):
        return cast(Record, result)
    if not isinstance(result, tuple):
        raise SelfhealError("the scheduler was lost; go on with the study by --resume")
    return {
        "key": task.key,
        "settings": dict(task.settings),
        "outcome": None,
        "error": f"{type(result[1]).__name__}: {result[1]}",
        "seconds": 0.0,
        "megabytes": 0,
        "worker": "",
    }
