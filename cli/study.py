"""`selfheal study`: a table of the papers, or robots, in; runs, tables, pages out."""

import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from selfheal.errors import InputError
from selfheal.files import lock_file

from ._options import AS_JSON, make_epilog, out_folder, resume_from, start_over
from ._print import (
    print_document,
    print_error,
    print_line,
    print_paragraph,
    print_table,
)
from ._progress import ProgressBar, ShowProgress
from ._runs import RunFolder, refuse_settings

if TYPE_CHECKING:
    from selfheal.study.plan import StudyRequest, Table
    from selfheal.study.run import Progress
    from selfheal.study.store import Results

_NAME, _PAGES = "study.h5", ("report.html", "report.md")
_RUNS = {"table3": 30, "actions": 30, "schema": 30, "eea": 3, "diagnose": 1}
_RECORDINGS = typer.Option(
    metavar="FOLDER",
    help="Readings of the robot of 2006; without it the simulated robot alone.",
)
_ROBOTS = typer.Argument(
    metavar="FOLDER",
    help="Of 'diagnose': folders of model.xml and recording.h5, or a model.xml with "
    "recordings.",
)
_FILE = typer.Argument(metavar="STUDY.h5", help="A study's file.")

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog=make_epilog("selfheal study table3 --runs 30", "how-study-works.md"),
    help="Repeat a table of the papers, or diagnose a fleet, on many cores.",
)

_RUN_COUNT = typer.Option(help="Number of runs in each row.")
_SEED = typer.Option(help="First seed; the others follow one by one.")
_WORKERS = typer.Option(
    help="Number of processes or cluster jobs; by default all cores."
)
_SCHEDULER = typer.Option(metavar="ADDRESS", help="A Dask cluster, tcp://HOST:8786.")
_CLUSTER = typer.Option(metavar="KIND", help="slurm, pbs, sge or lsf.")
_ONLY = typer.Option(metavar="failed", help="With --resume: failed runs again.")


def _run_study(
    context: typer.Context,
    folder: Annotated[Path | None, _ROBOTS] = None,
    runs: Annotated[int | None, _RUN_COUNT] = None,
    seed: Annotated[int, _SEED] = 0,
    recordings: Annotated[Path | None, _RECORDINGS] = None,
    workers: Annotated[int | None, _WORKERS] = None,
    scheduler: Annotated[str, _SCHEDULER] = "",
    cluster: Annotated[str, _CLUSTER] = "",
    out: Annotated[Path | None, out_folder("runs/study-NAME")] = None,
    resume: Annotated[Path | None, resume_from("STUDY.h5", "a study")] = None,
    only: Annotated[str, _ONLY] = "",
    force: Annotated[bool, start_over("a study")] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """One study; which one, the command's name says."""
    from selfheal.study.plan import StudyRequest
    from selfheal.study.run import continue_study
    from selfheal.study.store import load_study
    from selfheal.study.workers import Workplace, check_workplace

    name = str(context.info_name)
    if workers == 0:
        raise InputError("workers must be positive; not 0")
    place = Workplace(workers or 0, scheduler, cluster)
    check_workplace(place)
    if only not in ("", "failed") or (only and resume is None):
        raise InputError("--only failed goes with --resume STUDY.h5, and nothing else")
    if resume is not None:
        refuse_settings(context, heeded=("only", "workers", "scheduler", "cluster"))
        path, found = resume, load_study(resume).study
        if found != name:
            raise InputError(
                f"{path} is of study {found!r}; selfheal study {found} --resume {path}"
            )
    else:
        count = _RUNS[name] if runs is None else runs
        request = StudyRequest(count, seed, recordings, folder)
        path = _begin_study(name, request, out, force)
    try:
        with ProgressBar("starting", as_json=as_json, progress=progress) as live:
            for p in continue_study(path, place, only_failed=bool(only)):
                here = p.session + p.total - p.done  # runs of this session
                live.show(_describe_progress(p), p.session / max(here, 1))
    except KeyboardInterrupt:
        print_error(_describe_left(load_study(path), path))
        raise typer.Exit(130) from None  # as shells say of a program that was stopped
    _show_study(path, as_json)


def _begin_study(
    name: str, request: "StudyRequest", out: Path | None, force: bool
) -> Path:
    """A new study's file, once all that can be wrong was checked."""
    from selfheal.api.run_files import clear_run
    from selfheal.study.plan import find_study
    from selfheal.study.run import begin_study
    from selfheal.study.store import find_journal

    given = find_study(name).inputs
    named = {"recordings": request.recordings, "cases": request.cases}
    folders = {what: folder for what, folder in named.items() if folder is not None}
    for what, folder in folders.items():
        said = f"--recordings {folder}" if what == "recordings" else f"{folder}"
        if what not in given:
            raise InputError(f"study {name!r} has no use for {said}")
        if not folder.is_dir():
            raise InputError(f"{said}: there is no such folder")
    if "recordings" in given and request.recordings is None:
        print_error(
            "no --recordings FOLDER with readings of the robot of 2006: the hidden "
            "simulated robot alone"
        )
    whole = {what: folder.resolve() for what, folder in folders.items()}
    request = replace(
        request, recordings=whole.get("recordings"), cases=whole.get("cases")
    )
    path = RunFolder(out, force)(f"study-{name}") / _NAME
    with lock_file(path):
        clear_run(path, force, (find_journal(path).name, *_PAGES))
        begin_study(path, name, request)
    return path


def _describe_left(results: "Results", path: Path) -> str:
    """What is to be done yet, and how."""
    return (
        f"{len(results.left):,} of {len(results.tasks):,} runs are left; go on with: "
        f"selfheal study {results.study} --resume {path}"
    )


def _describe_progress(progress: "Progress") -> str:
    """How far a study is, in words."""
    failed = f", {progress.failed:,} failed" if progress.failed else ""
    at = f"{progress.workers:,} workers" if progress.workers else "waiting for workers"
    return f"{progress.done:,} of {progress.total:,} runs{failed}, {at}"


def show(
    file: Annotated[Path, _FILE], as_json: Annotated[bool, AS_JSON] = False
) -> None:
    """Show a finished or interrupted study."""
    _show_study(file, as_json)


def _show_study(path: Path, as_json: bool) -> None:
    """Tables, and the pages beside the file."""
    from selfheal.report.page import write_page
    from selfheal.study.page import format_markdown, make_study_page
    from selfheal.study.plan import find_study
    from selfheal.study.store import load_study

    results = load_study(path, has_tables=True)
    tables = find_study(results.study).make_tables(results.finished)
    pages = [path.with_name(name) for name in _PAGES]
    for page, make in zip(pages, (make_study_page, format_markdown), strict=True):
        write_page(make(results, tables), page)
    if as_json:
        failed = [
            {"key": task.key, "error": results.records[task.key]["error"]}
            for task in results.failed
        ]
        print_document(
            "study",
            study=results.study,
            asked=results.request,
            runs=len(results.tasks),
            done=len(results.records),
            failed=failed,
            tables=[asdict(table) for table in tables],
            file=str(path),
        )
        return
    _print_study(results, tables)
    if results.left:
        print_line(_describe_left(results, path))
    for file in (path, *pages):
        print_line(os.fspath(file))


def _print_study(results: "Results", tables: "Sequence[Table]") -> None:
    """Tables for a reader."""
    from selfheal.study.page import describe_progress

    for table in tables:
        print_line("")
        print_line(table.title, "bold")
        print_paragraph(table.text)
        if table.rows:
            print_table(table.head, table.rows)
    print_paragraph(describe_progress(results))
    for task in results.failed:
        last = results.records[task.key]["error"].splitlines()[-1]
        print_paragraph(f"{task.key}: {last}")


def _add_command(name: str, about: str) -> None:
    """One study as a command."""
    folder = "FLEET " if name == "diagnose" else ""
    example = f"selfheal study {name} {folder}--workers 2"
    end = make_epilog(example, "how-study-works.md")
    app.command(name, help=about, epilog=end)(_run_study)


for _name, _about in {
    "table3": "Actions, successes, errors of six methods, before, after damage.",
    "actions": "Chosen against random actions, by which score; 8 actions.",
    "schema": "Lengths from seven sets of sensors; then the 8 x 4 matrix.",
    "eea": "Two legged robots, ten scenarios: recoveries.",
    "diagnose": "Diagnoses of many robots or logs, side by side.",
}.items():
    _add_command(_name, _about)
_example = "selfheal study show runs/study-table3/study.h5"
app.command("show", epilog=make_epilog(_example, "how-study-works.md"))(show)
