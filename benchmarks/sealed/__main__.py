"""The sealed benchmark of `selfheal diagnose`: effects that only the scorer knows.

    python -m benchmarks.sealed make --cases 60 --kind mixed --out DIR --keys KEYS
    python -m benchmarks.sealed run --cases DIR --jobs 2
    python -m benchmarks.sealed score --cases DIR --keys KEYS

`make` simulates robots that differ from the model as given; `run` diagnoses each case
in a folder that holds its model and its recording alone, and goes on where it was
interrupted; `score` opens the keys and gives docs/results/NAME.md. Seeds below 5000
are for development, those from 5000 on for the reported run.
"""

import json
import sys
import time
from pathlib import Path

from benchmarks.diagnosis_runs import ProcessLimits, diagnose_cases
from benchmarks.sealed.cases import KINDS, MIXED, make_case, name_case, save_case
from benchmarks.sealed.hidden_robot import UnfitDraw
from benchmarks.sealed.page import make_sections
from benchmarks.sealed.score import compute_figures, count_confusions, read_cases
from benchmarks.writer import make_parser, publish_results
from selfheal.errors import InputError
from selfheal.mujoco_files import silence_mujoco


def _is_made(options, seed: int) -> bool:
    """True where the case is there; a seed is of one kind only."""
    file = options.keys / name_case(seed) / "key.json"
    if not file.is_file():
        return False
    kind = MIXED[seed % len(MIXED)] if options.kind == "mixed" else options.kind
    if json.loads(file.read_text())["kind"] != kind:
        sys.exit(f"{file} is of another kind than {kind}: take other seeds")
    return True


def make_cases(options) -> int:
    """Make the cases that are not there yet."""
    silence_mujoco()
    failed = 0
    for seed in range(options.first_seed, options.first_seed + options.cases):
        start = time.perf_counter()
        if _is_made(options, seed):
            continue
        try:
            case = make_case(
                options.kind, seed, effects=options.effects, robots=options.robots
            )
        except UnfitDraw as reason:
            failed += 1
            print(f"no case {seed}: {reason}", file=sys.stderr)
            continue
        save_case(case, options.out, options.keys)
        spent = time.perf_counter() - start
        print(f"{case.name}: {spent:.1f} s", file=sys.stderr)
    return 1 if failed else 0


def run_diagnoses(options) -> int:
    """Diagnose the cases that have no diagnosis yet."""
    program = tuple(options.program.split())
    limits = ProcessLimits(options.seconds, program)
    try:
        return 1 if diagnose_cases(options.cases, options.jobs, limits) else 0
    except InputError as reason:
        sys.exit(str(reason))


def score_diagnoses(options) -> int:
    """Open the keys and write the page."""
    cases = read_cases(options.cases, options.keys, tuple(options.replay.split()))
    data = {
        "figures": compute_figures(cases),
        "confusion": count_confusions(cases),
        "cases": cases,
    }
    title = f"The {options.name} benchmark of diagnose"
    publish_results(options.root, options.name, title, make_sections(cases), data)
    return 0


def main() -> int:
    """Read the command line and do what it says."""
    line = make_parser(__doc__ or "")
    commands = line.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="simulate cases")
    making.add_argument("--cases", type=int, default=60)
    making.add_argument("--kind", choices=[*KINDS, "mixed"], default="mixed")
    making.add_argument("--first-seed", type=int, default=5000)
    making.add_argument("--out", type=Path, required=True)
    making.add_argument("--keys", type=Path, required=True)
    making.add_argument("--effects", nargs="*", default=(), help="only these")
    making.add_argument("--robots", nargs="*", default=(), help="only these")
    making.set_defaults(do=make_cases)
    running = commands.add_parser("run", help="diagnose them")
    running.add_argument("--cases", type=Path, required=True)
    running.add_argument("--jobs", type=int, default=2)
    running.add_argument("--seconds", type=float, default=900.0, help="of each at most")
    running.add_argument("--program", default="selfheal diagnose")
    running.set_defaults(do=run_diagnoses)
    scoring = commands.add_parser("score", help="open the keys")
    scoring.add_argument("--cases", type=Path, required=True)
    scoring.add_argument("--keys", type=Path, required=True)
    scoring.add_argument("--name", default="sealed", help="of the page")
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
