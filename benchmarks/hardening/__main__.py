"""Broken files, full disks and kills: what the program does about them.

    python -m benchmarks.hardening fuzz [--count N] [--kind KIND]
    python -m benchmarks.hardening fuzz --kind KIND --seed SEED [--keep FOLDER]
    python -m benchmarks.hardening disk [--count SIZES]
    python -m benchmarks.hardening kills [--count KILLS]
    python -m benchmarks.hardening short [--count DIAGNOSES]
    python -m benchmarks.hardening page

Every study appends its records to benchmarks/results/hardening-STUDY.jsonl and leaves
out what is there already; `page` makes its part of docs/results of them. `short` has a
part of its own. With a kind alone, N mutants of that kind
are tried. With a kind and a seed, one mutant is tried again and nothing is kept but
what --keep names.
"""

import json
import os
import tempfile
from argparse import Namespace
from pathlib import Path

from benchmarks.suites import complete_suite, read_records
from benchmarks.writer import count_cores, make_parser, publish_page

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # no threads where forks begin


def main() -> None:
    """Do the study that the command line names."""
    from benchmarks.hardening.originals import KINDS

    line = make_parser(__doc__ or "")
    line.add_argument("study", choices=("fuzz", "disk", "kills", "short", "page"))
    line.add_argument("--count", type=int, default=0)
    line.add_argument("--kind", choices=KINDS)
    line.add_argument("--seed", type=int)
    line.add_argument("--keep", type=Path)
    options = line.parse_args()
    if options.seed is not None and options.kind is None:
        line.error("--seed needs --kind")
    with tempfile.TemporaryDirectory(prefix="hardening-") as place:
        _do_study(options, Path(place))


def _do_study(options: Namespace, place: Path) -> None:
    """Do a study in a folder."""
    from benchmarks.hardening import fuzz
    from benchmarks.hardening.disk import list_disk_runs
    from benchmarks.hardening.kills import list_kill_runs
    from benchmarks.hardening.originals import KINDS
    from benchmarks.hardening.page import STUDIES, compute_figures
    from benchmarks.hardening.short_logs import publish_short_logs

    if options.seed is not None:
        keep = options.keep and options.keep.resolve()
        found = fuzz.try_mutant(place, options.kind, options.seed, keep)
        print(found.pop("stderr"))
        print(json.dumps(found, indent=1))
    elif options.study == "page":
        known = {study: read_records(f"hardening-{study}") for study in STUDIES}
        page = Path(__file__).with_name("page.md")
        publish_page(options.root, "hardening", page, compute_figures(known))
    elif options.study == "short":
        publish_short_logs(options.root, options.count or 300)
    elif options.study == "fuzz":
        kinds = (options.kind,) if options.kind else KINDS
        runs = fuzz.list_runs(place, options.count or 10_000, kinds)
        complete_suite("hardening-fuzz", runs, count_cores())
    elif options.study == "disk":
        complete_suite("hardening-disk", list_disk_runs(place, options.count or 40))
    else:
        complete_suite("hardening-kills", list_kill_runs(place, options.count or 100))


if __name__ == "__main__":
    main()
