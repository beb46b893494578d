"""A table reads the same whatever format it is written in."""

import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from tests.support.logs.reading import check_rows, read_all, read_damaged
from tests.support.logs.table_files import TABLES, write_table

T = np.arange(200) / 100
Q = np.random.default_rng(0).normal(size=(200, 3))
ARRAYS = ("log.json", "log.npz", "log.h5", "log.mat", "new.mat", "log.pt")


@pytest.mark.parametrize("name", TABLES)
def test_arrays_of_one_length_are_a_stream(tmp_path, name):
    log = open_log(write_table(tmp_path / name, {"t": T, "q": Q, "on": T > 1}))
    check_rows(log)
    assert [s.name for s in log.streams] == [""]
    found = read_all(log)[""]
    expected = {"t": T, **{f"q[{k}]": q for k, q in enumerate(Q.T)}, "on": T > 1}
    assert found.keys() == expected.keys()
    for column, values in expected.items():
        np.testing.assert_array_equal(found[column], values)


@pytest.mark.parametrize("name", TABLES)
def test_a_damaged_log_is_read_or_refused(tmp_path, name):
    path = write_table(tmp_path / name, {"t": T[:60], "q": Q[:60], "on": T[:60] > 1})
    refused = read_damaged(path, tries=20)
    assert refused or name == "log.csv"


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_of_several_lengths_are_streams(tmp_path, name):
    arrays = {"t": T, "q": Q, "slow_t": T[:50], "slow_q": Q[:50], "gain": np.ones(2)}
    found = read_all(open_log(write_table(tmp_path / name, arrays)))
    assert {n: set(rows) for n, rows in found.items()} == {
        "200 rows": {"t", "q[0]", "q[1]", "q[2]"},
        "50 rows": {"slow_t", "slow_q[0]", "slow_q[1]", "slow_q[2]"},
    }


@pytest.mark.parametrize("name", ARRAYS)
def test_a_file_without_arrays_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="no columns"):
        open_log(write_table(tmp_path / name, {"n": np.array(3)}))
