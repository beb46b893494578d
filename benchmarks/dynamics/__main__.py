"""What short moves tell of the servos of hidden robots, on fresh seeds.

    python -m benchmarks.dynamics starfish [--count N]
    python -m benchmarks.dynamics page

A suite appends its records to benchmarks/results/dynamics-SUITE.jsonl and leaves out
what is there already; `page` makes docs/results/dynamics.md of them. Seeds are 6000 and
up; development used seeds below 6000.
"""

from benchmarks.dynamics.page import write_page
from benchmarks.dynamics.suites import list_starfish, list_trees
from benchmarks.suites import run_suites

SUITES = {"starfish": (list_starfish, 5), "trees": (list_trees, 1)}

if __name__ == "__main__":
    run_suites("dynamics", __doc__ or "", SUITES, write_page, option="count")
