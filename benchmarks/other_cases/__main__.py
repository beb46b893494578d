"""Cases of another style than the sealed benchmark's, for `selfheal diagnose`.

    python -m benchmarks.other_cases --out DIR --keys KEYS [--only NAME ...]
    python -m benchmarks.sealed run --cases DIR --jobs 2
    python -m benchmarks.sealed --root ROOT score --cases DIR --keys KEYS --name others

A crane, a geared arm, a rover, a drone, a ball and more: robots, sensors and motions
that the catalogue and its constants were not made with. Every case is always the same;
those that are there are not made again.
"""

import argparse
import sys
import time
from pathlib import Path

from benchmarks.other_cases.cases import OTHER_CASES
from benchmarks.other_cases.make import make_case
from benchmarks.sealed.cases import save_case
from selfheal.mujoco_files import silence_mujoco


def main() -> int:
    """Read the command line and make the cases that are not there yet."""
    names = [case.name for case in OTHER_CASES]
    line = argparse.ArgumentParser(description=__doc__)
    line.add_argument("--out", type=Path, required=True)
    line.add_argument("--keys", type=Path, required=True)
    line.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME")
    options = line.parse_args()
    silence_mujoco()
    for case in OTHER_CASES:
        known = (options.keys / case.name / "key.json").is_file()
        if known or case.name not in options.only:
            continue
        start = time.perf_counter()
        save_case(make_case(case), options.out, options.keys)
        print(f"{case.name}: {time.perf_counter() - start:.1f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
