"""Success of `identify` over seeds, for each method and robot.

    python -m benchmarks.identify SUITE [--seeds N] [--first-seed K] [--jobs 2]

Takes a suite of `suites.py`, gives its part of docs/results. Finished runs are
kept in benchmarks/results/identify-SUITE.jsonl, so that an interrupted suite goes on;
runs of other program code than today's are not counted. "calibration" runs nothing:
it pools what the suites' runs said of how sure they are.
"""

from pathlib import Path

from benchmarks.identify.page import compute_figures, tabulate_calibration
from benchmarks.identify.runs import hash_code, list_runs
from benchmarks.identify.suites import SUITES
from benchmarks.suites import complete_suite, read_records
from benchmarks.writer import INTACT, count_cores, make_parser, publish_page

PAGE = Path(__file__).with_name("page.md")


def publish_suite(options) -> None:
    """Do what is left of a suite and publish its page."""
    rows, jobs = SUITES[options.suite], options.jobs
    jobs = jobs or (1 if options.suite == "mjx" else count_cores())
    runs = {row.name: list_runs(row, options) for row in rows}
    every = {key: play for of_row in runs.values() for key, play in of_row.items()}
    name = f"identify-{options.suite}"
    done = complete_suite(name, every.items(), jobs)
    records = {row: [done[key] for key in of_row] for row, of_row in runs.items()}
    figures = {"suite": options.suite, "jobs": jobs, "code": hash_code()}
    figures |= compute_figures(rows, records)
    publish_page(options.root, name, PAGE, figures)


def pool_calibration(root: Path) -> None:
    """Publish how sure all suites' runs of our method were, against how often right."""
    now, used = hash_code(), dict[str, list]()
    for name in SUITES:
        known = read_records(f"identify-{name}").items()
        if found := [r for key, r in known if key.startswith(now)]:
            used[name] = found
    pooled = [r for records in used.values() for r in records]
    source = ", ".join(f"{name} ({len(found)} runs)" for name, found in used.items())
    figures = {
        "suite": "how sure, stated against true",
        "source": f"Pooled from: {source or 'none'}.",
        "calibration": tabulate_calibration(pooled),
        "rows": [],
    }
    publish_page(root, "identify-calibration", PAGE, {"code": now, **figures})


def main() -> None:
    """Read the command line and run what it says."""
    line = make_parser(__doc__ or "")
    line.add_argument("suite", choices=[*SUITES, "calibration"])
    line.add_argument("--seeds", type=int, help="runs of each row, instead of its own")
    line.add_argument("--first-seed", type=int, default=5000, help="then one by one")
    line.add_argument("--jobs", type=int, help="processes; one a core, mjx suite: one")
    line.add_argument("--engine", help="instead of the suite's (statics; mjx: mjx)")
    line.add_argument("--recordings", type=Path, default=INTACT, help="intact.h5")
    options = line.parse_args()
    if options.suite == "calibration":
        pool_calibration(options.root)
    else:
        publish_suite(options)


if __name__ == "__main__":
    main()
