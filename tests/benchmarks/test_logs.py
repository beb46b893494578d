"""The benchmark of logs, with small ones."""

import numpy as np
import pytest

from benchmarks.logs.readers import READERS, measure_peak
from benchmarks.logs.writers import WRITERS
from selfheal.logs.open_log import open_log
from tests.support.logs.reading import read_all

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kind", WRITERS)
def test_logs_of_the_benchmark_are_whole_and_every_reader_reads_them(tmp_path, kind):
    path = tmp_path / f"log.{kind}"
    WRITERS[kind](path, 3e5)
    found = read_all(open_log(path))
    for rows in found.values():
        assert all(len(v) and np.isfinite(v).all() for v in rows.values())
    assert len(found) == (2 if kind == "mcap" else 1)
    for name, read in READERS.items():
        if name.startswith(kind) and "pandas" not in name:  # an extra of benchmarks
            read(str(path))


def test_the_peak_of_memory_is_not_below_what_is_held():
    held = np.ones(5_000_000)
    assert measure_peak() > held.nbytes
