"""The one writer of all benchmarks: figures in, dated JSON and Markdown out."""

import argparse
import json
import os
import platform
import re
import shlex
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from importlib.metadata import version
from pathlib import Path

import jinja2
import numpy as np

from selfheal.files import atomic_path
from selfheal.study.statistics import format_share

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
INTACT = ROOT.parent / "shared" / "recordings" / "starfish_2006" / "intact.h5"
_LIBRARIES = ("mujoco", "mujoco-mjx", "jax", "numba", "numpy", "scipy")


def make_parser(text: str) -> argparse.ArgumentParser:
    """A command-line parser with --root, the option that every benchmark has."""
    line = argparse.ArgumentParser(prog=_name_command(), description=text)
    line.add_argument(
        "--root",
        type=Path,
        default=ROOT,
        help="results go to ROOT/benchmarks/results and ROOT/docs/results",
    )
    return line


def report_progress(said: str, done: int, total: int, begun: float) -> None:
    """Report on standard error what was done, of how many, and the time left.

    Args:
        begun: `time.perf_counter()` when the first one began [s].
    """
    left = (time.perf_counter() - begun) / done * (total - done)
    text = f"{done}/{total} {said}; about {left / 60:.1f} min left"
    print(text, file=sys.stderr, flush=True)


def count_cores() -> int:
    """The number of cores this process may run on."""
    return len(os.sched_getaffinity(0))


def describe_machine() -> str:
    """A sentence about this machine: processor, cores, versions of the libraries."""
    cpu = Path("/proc/cpuinfo").read_text().splitlines()
    names = [s.partition(":")[2].strip() for s in cpu if s.startswith("model name")]
    libraries = ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
    return (
        f"{(names or [platform.machine()])[0]}, {count_cores()} cores in use; "
        f"Python {platform.python_version()}, {libraries}"
    )


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


def format_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table of cells, each written by `str`."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(x) for x in row) + " |" for row in lines)


def format_fixed(value: float | None, digits: int = 2) -> str:
    """A number with so many digits behind the point, "" of None."""
    return "" if value is None else f"{value:,.{digits}f}"


def format_quantiles(values: Sequence[float], *at: float) -> str:
    """Quantiles of values as text, "none" where there are no values."""
    return ", ".join(f"{q:.2f}" for q in np.quantile(values, at)) if values else "none"


def format_hits(flags: Iterable[object]) -> str:
    """How many of some flags are set, with the interval of their share."""
    known = [bool(flag) for flag in flags]
    return format_share(sum(known), len(known))


def render_page(template: Path, figures: Mapping[str, object], machine: str) -> str:
    """The page of a Jinja template, whose first line is the title."""
    environment = jinja2.Environment(
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {
        "fixed": format_fixed,
        "hits": format_hits,
        "quantiles": format_quantiles,
        "median": np.median,
    }
    environment.globals |= {"table": format_table, "share": format_share}
    page = environment.from_string(template.read_text()).render(figures)
    title, _, rest = page.partition("\n")
    return f"{title}\n\n    {describe_command()}\n\nOn {machine}.\n{rest}"


def place_part(folder: Path, name: str, part: str) -> tuple[Path, str]:
    """The page that has a place for a part, with that part; else a page of its own.

    A place is between `<!-- begin NAME -->` and `<!-- end NAME -->`; headings of a part
    are a level lower.
    """
    begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->\n"
    for page in sorted(folder.glob("*.md")):
        before, found, rest = page.read_text().partition(begin)
        if found:
            lower = re.sub(r"^#", "##", part, flags=re.M)
            after = rest.partition(end)[2]
            return page, f"{before}{begin}\n{lower}\n{end}{after}"
    return folder / f"{name}.md", part


def publish_page(
    root: Path, name: str, template: Path, figures: Mapping[str, object]
) -> None:
    """Write ROOT/benchmarks/results/NAME-DATE.json and a part of ROOT/docs/results.

    Args:
        figures: by their names in the template; what JSON does not know is left out of
            the JSON file as its text.
    """
    machine, today = describe_machine(), date.today().isoformat()
    text = render_page(template, figures, machine)
    head = {"date": today, "command": describe_command(), "machine": machine}
    data = json.dumps({**head, **figures}, indent=1, default=str) + "\n"
    docs = root / "docs" / "results"
    for file, content in (
        (root / "benchmarks" / "results" / f"{name}-{today}.json", data),
        place_part(docs, name, text),
    ):
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(file) as path:
            path.write_text(content)
    print(text)
