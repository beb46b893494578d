"""Figures of `recover` on fresh seeds: both robots, all ten scenarios, three methods.

    python -m benchmarks.recover SUITE... [--count SEEDS] [--jobs J]
    python -m benchmarks.recover page

Every suite appends its records to benchmarks/results/recover-SUITE.jsonl and leaves out
what is there already; `page` makes its part of docs/results of them. Seeds are 5000 and
up; development used seeds below 5000.
"""

from benchmarks.recover.page import compute_figures
from benchmarks.recover.suites import SUITES
from benchmarks.suites import run_suites

if __name__ == "__main__":
    run_suites("recover", __doc__ or "", SUITES, compute_figures)
