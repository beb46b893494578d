"""Time and memory of reading large logs, beside the libraries of their formats alone.

    python -m benchmarks.logs [--size 2.0]

Writes a CSV and an MCAP of so many gigabytes, each by its own library, reads all their
columns in a process for each reader, and gives docs/results/logs.md.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.logs.readers import READERS
from benchmarks.logs.writers import WRITERS
from benchmarks.writer import make_parser, publish_page

Row = dict[str, Any]


def measure(reader: str, path: Path) -> Row:
    """Times [s] and peak memory [B] of a process that reads a log."""
    command = [sys.executable, "-m", "benchmarks.logs.readers", reader, str(path)]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(found.stdout)


def measure_all(folder: Path, size: float) -> list[Row]:
    """A row for each log and reader.

    Args:
        size: of each [B].
    """
    rows = list[Row]()
    for name, write in WRITERS.items():
        path = folder / f"log.{name}"
        write(path, size)
        for reader in READERS:
            kind, _, by = reader.partition(" ")
            if kind == name:
                row = {"log": name, "by": by, "size": path.stat().st_size}
                rows.append(row | measure(reader, path))
                print(json.dumps(rows[-1]), flush=True)
        path.unlink()
    return rows


def main() -> None:
    """Write, read, publish."""
    line = make_parser(__doc__)
    line.add_argument("--size", type=float, default=2.0, help="of each log [GB]")
    line.add_argument("--folder", type=Path, help="where the logs are written")
    given = line.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        rows = measure_all(Path(folder), given.size * 1e9)
    page = Path(__file__).with_name("page.md")
    publish_page(given.root, "logs", page, {"rows": rows})


if __name__ == "__main__":
    main()
