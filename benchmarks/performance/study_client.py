"""The command `selfheal` with the studies that only the benchmark of studies has."""

import sys

from selfheal.cli import app, study
from selfheal.study.plan import STUDIES

if __name__ == "__main__":
    for name in ("short", "empty"):
        STUDIES[name] = f"benchmarks.performance.study_{name}"
        study._command(name, "Of the benchmark.")
    app(sys.argv[1:])
