"""A study from its file: what is left of it is done, and each record kept."""

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, cast
from uuid import uuid4

from ..errors import InputError, SelfhealError, check_seed
from ..files import lock_file
from .plan import Record, Study, StudyRequest, Task, find_study
from .store import create_study, digest_code, load_study, open_journal
from .workers import Workplace, connect_workers

if TYPE_CHECKING:
    from distributed import Client

# Chosen: tasks that the scheduler knows of, for each worker and at least. A worker
# always has its next one; the scheduler's memory does not grow with the study.
_TASKS_PER_WORKER, _LEAST_TASKS = 4, 64
_POLL_PERIOD = 1.0  # [s] from one count of the workers to the next; chosen


@dataclass(frozen=True)
class Progress:
    """How far a study is.

    Attributes:
        done: runs that have ended, those of earlier sessions included.
        total: all runs.
        failed: of those done.
        session: runs that ended in this session.
        workers: that are there now.
    """

    done: int
    total: int
    failed: int
    session: int
    workers: int


def begin_study(path: Path, name: str, request: StudyRequest) -> None:
    """Make a study's file, with all its runs left.

    Raises:
        InputError: the study is unknown, or the request makes no sense.
    """
    if request.runs < 1:
        raise InputError(f"the runs must be positive; not {request.runs}")
    check_seed(request.seed)
    tasks = find_study(name).list_tasks(request)
    stated = {
        k: str(v) if isinstance(v, Path) else v for k, v in asdict(request).items()
    }
    create_study(path, name, stated, tasks)


def continue_study(
    path: Path, place: Workplace, *, only_failed: bool
) -> Iterator[Progress]:
    """Do what is left of a study, a yield whenever there is news.

    Args:
        path: of its file; no other process may work on it.
        place: where runs are done.
        only_failed: do those again that ended with an error, and no others.

    Raises:
        InputError: the place makes no sense or does not answer, or the study was begun
            with other program code, so that old and new runs would not belong together.
    """
    with ExitStack() as stack:
        stack.enter_context(lock_file(path))
        results = load_study(path)
        if results.records and results.code != digest_code():
            raise InputError(
                f"{path} was begun with other program code ({results.code}, now "
                f"{digest_code()}); start over by --force"
            )
        tasks = results.failed if only_failed else results.left
        study, total, session = find_study(results.study), len(results.tasks), 0
        done, failed = set(results.records), {task.key for task in results.failed}
        del results  # of a long study it is most of the memory
        yield Progress(len(done), total, len(failed), 0, 0)
        if not tasks:
            return
        client = stack.enter_context(connect_workers(place, path.with_name("jobs")))
        client.wait_for_workers(1)
        journal = stack.enter_context(open_journal(path))
        for records, workers in execute_tasks(client, study, tasks):
            journal.add(records)
            keys = {record["key"] for record in records}
            done |= keys
            failed -= keys
            failed |= {record["key"] for record in records if record["error"]}
            session += len(records)
            yield Progress(len(done), total, len(failed), session, workers)


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
