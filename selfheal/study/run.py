"""A study from its file: what is left of it is done, and each record kept."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from ..errors import InputError, check_seed
from ..files import lock_file
from .execute import execute_tasks
from .plan import StudyRequest, find_study
from .store import create_study, digest_code, load_study, open_journal
from .workers import Workplace, check_workplace, connect_workers


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
    check_workplace(place)
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
