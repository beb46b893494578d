"""What all benchmarks share: figures in, dated JSON and a Markdown page out."""

import argparse
import json
import os
import platform
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from selfheal.files import atomic_path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
INTACT = ROOT.parent / "shared" / "recordings" / "starfish_2006" / "intact.h5"
KeyedRuns = Iterable[tuple[str, Callable[[], dict[str, Any]]]]
_LIBRARIES = ("mujoco", "mujoco-mjx", "jax", "numba", "numpy", "scipy")


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        title: its heading.
        text: what it shows.
        header: of its table's columns.
        rows: of its table.
    """

    title: str
    text: str
    header: Sequence[str] = ()
    rows: Sequence[Sequence[Any]] = ()


def make_parser(text: str) -> argparse.ArgumentParser:
    """A command line with the option that every benchmark has."""
    made = argparse.ArgumentParser(description=text)
    made.add_argument(
        "--root",
        type=Path,
        default=ROOT,
        help="results go to ROOT/benchmarks/results and ROOT/docs/results",
    )
    return made


def read_records(benchmark: str, suite: str) -> dict[str, dict[str, Any]]:
    """What is known of a suite of a benchmark: key -> what came of it."""
    file = RESULTS / f"{benchmark}-{suite}.jsonl"
    if not file.is_file():
        return {}
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    return {line.pop("key"): line for line in lines}


def complete_suite(benchmark: str, suite: str, plays: KeyedRuns) -> None:
    """Play what is not known yet of a suite, writing each down as it ends."""
    done = read_records(benchmark, suite)
    RESULTS.mkdir(parents=True, exist_ok=True)
    for key, play in plays:
        if key in done:
            continue
        start, cpu = time.perf_counter(), time.process_time()
        record = {"key": key, **play(), "cpu_seconds": time.process_time() - cpu}
        with (RESULTS / f"{benchmark}-{suite}.jsonl").open("a") as out:
            out.write(json.dumps(record) + "\n")
        spent = time.perf_counter() - start
        print(f"{suite} {key}: {spent:.1f} s", file=sys.stderr)


def run_suites(
    benchmark: str,
    text: str,
    suites: Mapping[str, tuple[Callable[[int], KeyedRuns], int]],
    write: Callable[[Path, Mapping[str, dict[str, dict[str, Any]]], str], None],
    *,
    counted: str,
) -> None:
    """Play the suites that the command line names, or make the page of all.

    Args:
        benchmark: its name.
        text: what `--help` says.
        suites: name -> what gives its plays for a count, and the usual count.
        write: makes the page, of where, all records, and remarks.
        counted: the option that gives another count.
    """
    line = make_parser(text)
    line.add_argument("suites", nargs="+", choices=[*suites, "page"])
    line.add_argument(f"--{counted}", type=int, default=0, dest="count")
    chosen = line.parse_args()
    for name in chosen.suites:
        if name == "page":
            known = {suite: read_records(benchmark, suite) for suite in suites}
            remarks = Path(__file__).with_name(f"_{benchmark}_remarks.md")
            write(chosen.root, known, remarks.read_text())
        else:
            suite, usual = suites[name]
            complete_suite(benchmark, name, suite(chosen.count or usual))


def count_cores() -> int:
    """The number of cores this process may run on."""
    return len(os.sched_getaffinity(0))


def describe_machine() -> str:
    """This machine in words: processor, cores, versions of what computes."""
    model = platform.machine()
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    libraries = ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
    python = platform.python_version()
    return f"{model}, {count_cores()} cores in use; Python {python}, {libraries}"


def describe_command() -> str:
    """The command that runs this script as it runs now, without --root."""
    words = [Path(sys.argv[0]).name, *sys.argv[1:]]
    if "--root" in words:
        place = words.index("--root")
        del words[place : place + 2]
    return "python benchmarks/" + shlex.join(words)


def format_table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(x) for x in row) + " |" for row in lines)


def format_page(title: str, sections: Sequence[Section], hardware: str) -> str:
    """The Markdown page of one benchmark."""
    today = date.today().isoformat()
    parts = [f"# {title}", f"    {describe_command()}", f"{today}, on {hardware}."]
    for s in sections:
        parts += [f"## {s.title}", *filter(None, [s.text])]
        if s.rows:
            parts.append(format_table(s.header, s.rows))
    return "\n\n".join(parts) + "\n"


def publish_results(
    root: Path,
    name: str,
    title: str,
    sections: Sequence[Section],
    data: dict[str, Any],
    *,
    hardware: str = "",
) -> None:
    """Write ROOT/benchmarks/results/NAME-DATE.json and ROOT/docs/results/NAME.md.

    Args:
        root: where; the folders are made.
        name: of the benchmark.
        title: of the page.
        sections: of the page.
        data: everything measured, for the JSON.
        hardware: what to say of the machine besides its processor.
    """
    hardware = f"{describe_machine()}{hardware}"
    text = format_page(title, sections, hardware)
    head = {
        "date": date.today().isoformat(),
        "command": describe_command(),
        "machine": hardware,
    }
    results, docs = root / "benchmarks" / "results", root / "docs" / "results"
    results.mkdir(parents=True, exist_ok=True)
    docs.mkdir(parents=True, exist_ok=True)
    with atomic_path(results / f"{name}-{head['date']}.json") as path:
        path.write_text(json.dumps({**head, **data}, indent=1) + "\n")
    with atomic_path(docs / f"{name}.md") as path:
        path.write_text(text)
    print(text)
