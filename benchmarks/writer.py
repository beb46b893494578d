"""The one writer of all benchmarks: figures in, dated JSON and a Markdown page out."""

import argparse
import json
import os
import platform
import shlex
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from selfheal.files import atomic_path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
INTACT = ROOT.parent / "shared" / "recordings" / "starfish_2006" / "intact.h5"
_LIBRARIES = ("mujoco", "mujoco-mjx", "jax", "numba", "numpy", "scipy")


@dataclass(frozen=True)
class Section:
    """A part of a page: a heading, a text, and a table where it has rows.

    Attributes:
        title: the heading.
        text: what the table shows, or the whole content.
        header: names of the table's columns.
        rows: cells of the table, a row as long as `header`.
    """

    title: str
    text: str
    header: Sequence[str] = ()
    rows: Sequence[Sequence[Any]] = ()


def make_parser(text: str) -> argparse.ArgumentParser:
    """A command-line parser with --root, the option that every benchmark has.

    Args:
        text: what `--help` says.
    """
    line = argparse.ArgumentParser(prog=_name_command(), description=text)
    line.add_argument(
        "--root",
        type=Path,
        default=ROOT,
        help="results go to ROOT/benchmarks/results and ROOT/docs/results",
    )
    return line


def tell_progress(said: str, done: int, total: int, begun: float) -> None:
    """Say on standard error what was done, how much of all, and the time left.

    Args:
        total: how many there are to do.
        begun: `time.perf_counter()` when the first one began [s].
    """
    left = (time.perf_counter() - begun) / done * (total - done)
    print(
        f"{done}/{total} {said}; about {left / 60:.1f} min left",
        file=sys.stderr,
        flush=True,
    )


def count_cores() -> int:
    """The number of cores this process may run on."""
    return len(os.sched_getaffinity(0))


def describe_machine() -> str:
    """A sentence about this machine: processor, cores, versions of the libraries."""
    model = platform.machine()
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    libraries = ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
    python = platform.python_version()
    return f"{model}, {count_cores()} cores in use; Python {python}, {libraries}"


def describe_command() -> str:
    """The command line of this process, without --root, as a reader would repeat it."""
    words = sys.argv[1:]
    if "--root" in words:
        place = words.index("--root")
        del words[place : place + 2]
    return f"{_name_command()} {shlex.join(words)}".strip()


def _name_command() -> str:
    """How this process was started, without its arguments."""
    spec = sys.modules["__main__"].__spec__  # None where no module was run by -m
    name = spec.name if spec else Path(sys.argv[0]).name
    return f"python -m {name.removesuffix('.__main__')}"


def format_table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table.

    Args:
        rows: cells, each written by `str`.
    """
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(x) for x in row) + " |" for row in lines)


def format_page(title: str, sections: Sequence[Section], hardware: str) -> str:
    """The Markdown page of one benchmark: title, command, date, machine, sections.

    Args:
        hardware: what is said of the machine.
    """
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
        root: folder of the repository; missing folders are made.
        name: name of the benchmark, in both file names.
        sections: content of the page, in order.
        hardware: what is added to the description of the machine.
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
