"""Drives that a model lacks: cases by seed, diagnosed and set beside two references.

    python -m benchmarks.drives make OUT --kind everything --seed 3
    python -m benchmarks.drives run --kind everything --cases 40 --seed 1 --jobs 2

`make` writes one case into a folder of its own: model.xml and recording.h5, which
`selfheal diagnose` takes, test.h5 and truth.json. `run` makes cases, diagnoses each in
a process with a time limit, and predicts its test by the given model, by a plain fit of
dry friction, viscous friction and rotor at every driven joint, by the diagnosis and by
the truth. A run that is killed goes on where it stopped; remove a case's folder to have
it made again.
"""

import json
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from benchmarks.diagnosis_runs import ProcessLimits, diagnose_case
from benchmarks.drives.case import make_case, name_case, save_case
from benchmarks.drives.kinds import KINDS
from benchmarks.drives.page import compute_figures, make_sections
from benchmarks.drives.references import measure_references
from benchmarks.drives.score import score_case
from benchmarks.writer import ROOT, make_parser, publish_results, tell_progress
from selfheal.files import atomic_path
from selfheal.mujoco_files import silence_mujoco


def _write_json(file: Path, value: Any) -> None:
    with atomic_path(file) as path:
        path.write_text(json.dumps(value, indent=1, default=float) + "\n")


def _run_case(folder: Path, kind: str, seed: int, seconds: float) -> dict[str, Any]:
    """One case made, diagnosed and scored; each part is kept in its folder.

    Args:
        folder: of all cases.
        kind: of the case.
        seed: of the case.
        seconds: [s] that its diagnosis may take.
    """
    silence_mujoco()
    place = folder / name_case(kind, seed)
    scored = place / "score.json"
    if scored.is_file():
        return json.loads(scored.read_text())
    case = make_case(kind, seed)
    save_case(case, folder)
    known = place / "references.json"
    if not known.is_file():
        _write_json(known, measure_references(case))
    if not (place / "run.json").is_file():
        program = (str(Path(sys.executable).parent / "selfheal"), "diagnose")
        cores = frozenset(os.sched_getaffinity(0))
        diagnose_case(place, ProcessLimits(seconds, program, cores))
    run = json.loads((place / "run.json").read_text())
    found = score_case(place, case, json.loads(known.read_text()), run)
    _write_json(scored, found)
    return found


def _run_cases(options: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Kinds and scores of all cases, as they are done."""
    tasks = [
        (kind, seed)
        for kind in options.kind
        for seed in range(options.seed, options.seed + options.cases)
    ]
    start = time.perf_counter()
    with ProcessPoolExecutor(options.jobs) as pool:
        futures = {
            pool.submit(_run_case, options.folder, *task, options.seconds): task
            for task in tasks
        }
        for done, future in enumerate(as_completed(futures), 1):
            kind, _ = futures[future]
            score = future.result()
            ratio = max(
                score["errors"]["selfheal"][h] / error
                for h, error in score["errors"]["plain"].items()
            )
            tell_progress(
                f"{score['case']}: {score['verdict']}, {score['seconds']:.0f} s, "
                f"named {score['named']}/{score['needed']}, "
                f"false {len(score['false'])}/{score['names']}, at worst "
                f"{ratio:.2f} times the plain fit",
                done, len(tasks), start,
            )  # fmt: skip
            yield kind, score


def run_cases(options: Any) -> int:
    """Make, diagnose and score cases, and write the page."""
    by_kind: dict[str, list[dict[str, Any]]] = {kind: [] for kind in options.kind}
    for kind, score in _run_cases(options):
        by_kind[kind].append(score)
    for cases in by_kind.values():
        cases.sort(key=lambda score: score["case"])
    figures = {kind: compute_figures(cases) for kind, cases in by_kind.items()}
    publish_results(
        options.root,
        "drives",
        "Drives that a model lacks",
        make_sections(by_kind),
        {"figures": figures, "cases": by_kind},
    )
    return 0


def make_one(options: Any) -> int:
    """Write one case."""
    silence_mujoco()
    print(save_case(make_case(options.kind, options.seed), options.out))
    return 0


def main() -> int:
    """Read the command line and do what it says."""
    line = make_parser(__doc__ or "")
    commands = line.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="write one case")
    making.add_argument("out", type=Path)
    making.add_argument("--kind", choices=KINDS, default="everything")
    making.add_argument("--seed", type=int, default=1)
    making.set_defaults(do=make_one)
    running = commands.add_parser("run", help="diagnose and score cases")
    running.add_argument("--cases", type=int, default=40, help="of each kind")
    running.add_argument("--seed", type=int, default=1, help="of the first case")
    running.add_argument("--kind", nargs="+", choices=KINDS, default=["everything"])
    running.add_argument("--jobs", type=int, default=1)
    running.add_argument("--seconds", type=float, default=900.0, help="of a diagnosis")
    running.add_argument(
        "--folder", type=Path, default=ROOT / "runs" / "drives", help="of the cases"
    )
    running.set_defaults(do=run_cases)
    options = line.parse_args()
    return options.do(options)


if __name__ == "__main__":
    sys.exit(main())
