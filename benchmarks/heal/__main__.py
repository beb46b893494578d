"""Figures of `gait`, `watch` and `heal` on fresh seeds, and on the readings of 2006.

    python -m benchmarks.heal SUITE... [--count N] [--jobs J]
    python -m benchmarks.heal page

Every suite appends its records to benchmarks/results/heal-SUITE.jsonl and leaves out
what is there already; `page` makes its part of docs/results of them. Seeds are 5000 and
up; development used seeds below 5000.
"""

from benchmarks.heal.page import compute_figures
from benchmarks.heal.suites import SUITES
from benchmarks.suites import run_suites

if __name__ == "__main__":
    run_suites("heal", __doc__ or "", SUITES, compute_figures)
