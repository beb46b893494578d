"""Diagnoses of hidden robots: their missing physics is known to the scorer alone.

    python -m benchmarks.hidden make sealed --cases 60 --out DIR --keys KEYS
    python -m benchmarks.hidden run --cases DIR --jobs 2
    python -m benchmarks.hidden score sealed --cases DIR --keys KEYS

Suites: `sealed` draws one or two effects, none, or one that the catalogue lacks;
`drives` draws robots whose models lack drives, and more kinds of what real robots lack;
`others` are robots that were written down. `make` simulates robots that differ from the
model as given; `run` diagnoses each case in a folder that holds its model and its
recording alone, and goes on where it was interrupted; `score` opens the keys and gives
its part of docs/results. Sealed seeds below 5000 are for development, those from 5000
on for the reported run.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

from benchmarks.diagnosis_runs import ProcessLimits, diagnose_cases
from benchmarks.hidden import drafts, drives, others, sealed
from benchmarks.hidden.case import Case, save_case
from benchmarks.hidden.judge import drives as judge_drives
from benchmarks.hidden.judge import page
from benchmarks.hidden.judge import sealed as judge_sealed
from benchmarks.hidden.judge.names import Judged
from benchmarks.hidden.judge.sealed import read_json
from benchmarks.hidden.truth import UnfitDraw
from benchmarks.writer import make_parser, publish_page
from selfheal.errors import InputError
from selfheal.mujoco_files import silence_mujoco

Task = tuple[str, str, Callable[[], Case]]  # name, kind and maker of a case


@dataclass(frozen=True)
class Suite:
    """A suite of cases.

    Attributes:
        kinds: of its cases, the usual one first; empty: it is not drawn.
        list_tasks: the cases that the command line asks for.
        page: its template in judge/.
        tabulate: gives what the page shows of judged cases.
    """

    title: str
    kinds: Sequence[str]
    list_tasks: Callable[[argparse.Namespace], Iterator[Task]]
    read_case: Callable[..., Judged]
    page: str
    tabulate: Callable[[Sequence[Judged]], dict[str, object]]


def _list_drawn(options: argparse.Namespace) -> Iterator[tuple[str, int]]:
    """Kinds and seeds that are wanted."""
    seeds = range(options.first_seed, options.first_seed + options.cases)
    return product(options.kind or SUITES[options.suite].kinds[:1], seeds)


def _list_sealed(options: argparse.Namespace) -> Iterator[Task]:
    chosen = {"effects": options.effects, "robots": options.robots}
    for kind, seed in _list_drawn(options):
        make = partial(sealed.make_case, kind, seed, **chosen)
        yield sealed.name_case(seed), sealed.find_kind(kind, seed), make


def _list_drives(options: argparse.Namespace) -> Iterator[Task]:
    for kind, seed in _list_drawn(options):
        yield drives.name_case(kind, seed), kind, partial(drives.make_case, kind, seed)


def _list_others(options: argparse.Namespace) -> Iterator[Task]:
    for name in options.only or others.OTHER_CASES:
        if name not in others.OTHER_CASES:
            sys.exit(f"unknown: {name}; known: {', '.join(others.OTHER_CASES)}")
        yield name, others.OTHER_CASES[name].kind, partial(others.make_case, name)


_SEALED = (judge_sealed.read_case, "sealed.md", page.tabulate_sealed)
SUITES = {
    "sealed": Suite(
        "The sealed benchmark of diagnose",
        ("mixed", *sealed.KINDS),
        _list_sealed,
        *_SEALED,
    ),
    "others": Suite("Diagnoses of other robots", (), _list_others, *_SEALED),
    "drives": Suite(
        "Drives that a model lacks",
        tuple(drafts.KINDS),
        _list_drives,
        judge_drives.read_case,
        "drives.md",
        page.tabulate_drives,
    ),
}


def make_cases(options: argparse.Namespace) -> int:
    """Make the cases that are not there yet."""
    silence_mujoco()
    failed, kinds = 0, SUITES[options.suite].kinds
    if unknown := set(options.kind) - set(kinds):
        sys.exit(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(kinds)}")
    for name, kind, make in SUITES[options.suite].list_tasks(options):
        start, file = time.perf_counter(), options.keys / name / "key.json"
        if known := read_json(file):
            if known["kind"] != kind:  # a seed is of one kind only
                sys.exit(f"{file} is of another kind than {kind}: take other seeds")
            continue
        try:
            save_case(make(), options.out, options.keys)
        except UnfitDraw as reason:
            failed += 1
            print(f"no case {name}: {reason}", file=sys.stderr)
            continue
        print(f"{name}: {time.perf_counter() - start:.1f} s", file=sys.stderr)
    return 1 if failed else 0


def run_diagnoses(options: argparse.Namespace) -> int:
    """Diagnose the cases that have no diagnosis yet."""
    program = tuple(options.program.split())
    limits = ProcessLimits(options.seconds, program)
    try:
        return 1 if diagnose_cases(options.cases, options.jobs, limits) else 0
    except InputError as reason:
        sys.exit(str(reason))


def score_diagnoses(options: argparse.Namespace) -> int:
    """Open the keys and write the page."""
    silence_mujoco()
    suite, replay = SUITES[options.suite], tuple(options.replay.split())
    names = sorted(p.parent.name for p in options.keys.glob("*/key.json"))
    folders = [options.cases / n for n in names if (options.cases / n).is_dir()]
    read = partial(suite.read_case, keys=options.keys, replay=replay)
    with ProcessPoolExecutor(options.jobs) as pool:
        cases = list(pool.map(read, folders))
    figures = {"title": suite.title, **suite.tabulate(cases)}
    template = Path(__file__).parent / "judge" / suite.page
    publish_page(options.root, options.name or options.suite, template, figures)
    return 0


def main() -> int:
    """Read the command line and do what it says."""
    line = make_parser(__doc__ or "")
    commands = line.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="simulate cases")
    making.add_argument("suite", choices=SUITES)
    making.add_argument("--cases", type=int, default=60, help="seeds of each kind")
    making.add_argument("--kind", nargs="+", default=(), help="of drawn cases")
    making.add_argument("--first-seed", type=int, default=5000)
    making.add_argument("--out", type=Path, required=True)
    making.add_argument("--keys", type=Path, required=True)
    making.add_argument("--effects", nargs="*", default=(), help="sealed: only these")
    making.add_argument("--robots", nargs="*", default=(), help="sealed: only these")
    making.add_argument("--only", nargs="+", default=(), help="others: these names")
    making.set_defaults(do=make_cases)
    running = commands.add_parser("run", help="diagnose them")
    running.add_argument("--cases", type=Path, required=True)
    running.add_argument("--jobs", type=int, default=2)
    running.add_argument("--seconds", type=float, default=900.0, help="of each at most")
    running.add_argument("--program", default="selfheal diagnose")
    running.set_defaults(do=run_diagnoses)
    scoring = commands.add_parser("score", help="open the keys")
    scoring.add_argument("suite", choices=SUITES)
    scoring.add_argument("--cases", type=Path, required=True)
    scoring.add_argument("--keys", type=Path, required=True)
    scoring.add_argument("--jobs", type=int, default=1)
    scoring.add_argument("--name", help="of the page; the suite's by default")
    scoring.add_argument(
        "--replay",
        default="selfheal replay",
        help="scores each diagnosis on its test; empty: not",
    )
    scoring.set_defaults(do=score_diagnoses)
    options = line.parse_args()
    return options.do(options)


if __name__ == "__main__":
    sys.exit(main())
