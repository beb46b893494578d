"""`selfheal study`: a table of the papers, or robots, in; runs, tables, pages out."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._options import AS_JSON, make_epilog, out_folder, resume_from, start_over
from ._print import print_error, print_json, print_line, print_table, print_text
from ._progress import ProgressBar, ShowProgress
from ._runs import RunFolder, refuse_settings

if TYPE_CHECKING:
    from selfheal.study.plan import StudyRequest, Table
    from selfheal.study.run import Progress
    from selfheal.study.store import Results
    from selfheal.study.workers import Workplace

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


def _run_study(
    context: typer.Context,
    folder: Annotated[Path | None, _ROBOTS] = None,
    runs: Annotated[int | None, typer.Option(help="Seeds of each row.")] = None,
    seed: Annotated[int, typer.Option(help="The first; then one by one.")] = 0,
    recordings: Annotated[Path | None, _RECORDINGS] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes, or jobs of a cluster; all cores.")
    ] = None,
    scheduler: Annotated[
        str, typer.Option(metavar="ADDRESS", help="A Dask cluster, tcp://HOST:8786.")
    ] = "",
    cluster: Annotated[
        str, typer.Option(metavar="KIND", help="slurm, pbs, sge or lsf.")
    ] = "",
    out: Annotated[Path | None, out_folder("runs/study-NAME")] = None,
    resume: Annotated[Path | None, resume_from("STUDY.h5", "a study")] = None,
    only: Annotated[
        str, typer.Option(metavar="failed", help="With --resume: failed runs again.")
    ] = "",
    force: Annotated[bool, start_over("a study")] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """One study; which one, the command's name says."""
    from selfheal.errors import InputError
    from selfheal.study.plan import StudyRequest
    from selfheal.study.workers import Workplace

    name = str(context.info_name)
    if workers == 0:
        raise InputError("workers must be positive; not 0")
    place = Workplace(workers or 0, scheduler, cluster)
    if only not in ("", "failed") or (only and resume is None):
        raise InputError("--only failed goes with --resume STUDY.h5, and nothing else")
    if resume is not None:
        refuse_settings(context, heeded=("only", "workers", "scheduler", "cluster"))
        _check_name(resume, name)
        _finish_study(
            resume, place, only_failed=bool(only), as_json=as_json, asked=progress
        )
        return
    count = _RUNS[name] if runs is None else runs
    path = _begin_study(name, StudyRequest(count, seed, recordings, folder), out, force)
    _finish_study(path, place, only_failed=False, as_json=as_json, asked=progress)


def _begin_study(
    name: str, asked: "StudyRequest", out: Path | None, force: bool
) -> Path:
    """A new study's file, once all that can be wrong was checked."""
    from dataclasses import replace

    from selfheal.api.run_files import clear_run
    from selfheal.errors import InputError
    from selfheal.files import lock_file
    from selfheal.study.plan import find_study
    from selfheal.study.run import begin_study
    from selfheal.study.store import find_journal

    given = find_study(name).inputs
    for what, option in ("recordings", "--recordings "), ("cases", ""):
        folder = getattr(asked, what)
        if folder is not None and what not in given:
            raise InputError(f"study {name!r} has no use for {option}{folder}")
        if folder is not None and not folder.is_dir():
            raise InputError(f"{option}{folder}: there is no such folder")
    if "recordings" in given and asked.recordings is None:
        print_error(
            "no --recordings FOLDER with readings of the robot of 2006: the hidden "
            "simulated robot alone"
        )
    folders = {k: f.resolve() for k in ("recordings", "cases")
               if (f := getattr(asked, k)) is not None}  # fmt: skip
    asked = replace(asked, **folders)
    path = RunFolder(out, force)(f"study-{name}") / _NAME
    with lock_file(path):
        clear_run(path, force, (find_journal(path).name, *_PAGES))
        begin_study(path, name, asked)
    return path


def _check_name(path: Path, name: str) -> None:
    """Refuse to go on with a study by another one's name."""
    from selfheal.errors import InputError
    from selfheal.study.store import load_study

    found = load_study(path).study
    if found != name:
        raise InputError(
            f"{path} is of study {found!r}; selfheal study {found} --resume {path}"
        )


def _finish_study(
    path: Path, place: "Workplace", *, only_failed: bool, as_json: bool, asked: bool
) -> None:
    """Do what is left, then show it."""
    from selfheal.study.run import continue_study
    from selfheal.study.store import load_study

    try:
        with ProgressBar("starting", as_json=as_json, asked=asked) as live:
            for p in continue_study(path, place, only_failed=only_failed):
                here = p.session + p.total - p.done  # runs of this session
                live.show(_describe_progress(p), p.session / max(here, 1))
    except KeyboardInterrupt:
        print_error(_describe_left(load_study(path), path))
        raise typer.Exit(130) from None  # as shells say of a program that was stopped
    _show_study(path, as_json)


def _describe_left(results: "Results", path: Path) -> str:
    """What is to be done yet, and how."""
    return (
        f"{len(results.left):,} of {len(results.tasks):,} runs are left; go on with: "
        f"selfheal study {results.study} --resume {path}"
    )


def _describe_progress(progress: "Progress") -> str:
    """How far a study is, in words."""
    p = progress
    words = [f"{p.done:,} of {p.total:,} runs"]
    if p.failed:
        words.append(f"{p.failed:,} failed")
    if not p.workers:
        return ", ".join([*words, "waiting for workers"])
    words.append(f"{p.workers:,} workers")
    return ", ".join(words)


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
    from selfheal.study.store import load_checked

    results = load_checked(path)
    tables = find_study(results.study).make_tables(results.finished)
    pages = [path.with_name(name) for name in _PAGES]
    for page, make in zip(pages, (make_study_page, format_markdown), strict=True):
        write_page(make(results, tables), page)
    if as_json:
        print_json(_serialize_study(results, tables, path))
        return
    _print_study(results, tables)
    if results.left:
        print_line(_describe_left(results, path))
    for file in (path, *pages):
        print_line(os.fspath(file))


def _serialize_study(results: "Results", tables: "Sequence[Table]", path: Path) -> dict:
    """A study for scripts."""
    from dataclasses import asdict

    failed = [
        {"key": t.key, "error": results.records[t.key]["error"]} for t in results.failed
    ]
    return {
        "format": "selfheal-study",
        "version": 1,
        "study": results.study,
        "asked": results.request,
        "runs": len(results.tasks),
        "done": len(results.records),
        "failed": failed,
        "tables": [asdict(table) for table in tables],
        "file": str(path),
    }


def _print_study(results: "Results", tables: "Sequence[Table]") -> None:
    """Tables for a reader."""
    from selfheal.study.page import describe_progress

    for table in tables:
        print_line("")
        print_text(table.title, "bold")
        print_text(table.text)
        if table.rows:
            print_table(table.head, table.rows)
    print_text(describe_progress(results))
    for task in results.failed:
        last = results.records[task.key]["error"].splitlines()[-1]
        print_text(f"{task.key}: {last}")


def _add_command(name: str, about: str) -> Callable:
    """One study as a command."""
    folder = "FLEET " if name == "diagnose" else ""
    example = f"selfheal study {name} {folder}--workers 2"
    end = make_epilog(example, "how-study-works.md")
    return app.command(name, help=about, epilog=end)(_run_study)


_add_command(
    "table3", "Actions, successes, errors of six methods, before, after damage."
)
_add_command("actions", "Chosen against random actions, by which score; 8 actions.")
_add_command("schema", "Lengths from seven sets of sensors; then the 8 x 4 matrix.")
_add_command("eea", "Two legged robots, ten scenarios: recoveries.")
_add_command("diagnose", "Diagnoses of many robots or logs, side by side.")
app.command(
    "show",
    epilog=make_epilog(
        "selfheal study show runs/study-table3/study.h5", "how-study-works.md"
    ),
)(show)
