"""Tables as text: written in many ways, read as one."""

import gzip

import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from tests.support.logs.reading import read_all, read_one
from tests.support.logs.table_files import write_text

PLAIN = "time [s],q1 (deg),q[0],name\n0.1,2.5,1,a\n0.2,,2,b\n"


@pytest.fixture
def write(tmp_path):
    return lambda text, name="log.csv": write_text(tmp_path / name, text)


@pytest.mark.parametrize(
    ("text", "units"),
    [
        (PLAIN, {"time [s]": "s", "q1 (deg)": "deg", "q[0]": "", "name": ""}),
        ("t,q,mode\nms,[deg],-\n1,2,a\n3,4,b\n", {"t": "ms", "q": "deg", "mode": "-"}),
    ],
)
def test_units_are_those_of_the_header(write, text, units):
    assert open_log(write(text)).streams[0].columns == units


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        (PLAIN, {"q1 (deg)": [2.5, np.nan], "q[0]": [1, 2], "name": ["a", "b"]}),
        ("1 2 3\n4 5 6\n", {"0": [1, 4], "1": [2, 5], "2": [3, 6]}),
        ("time,1,2\n0.5,7,8\n0.6,7,8\n", {"time": [0.5, 0.6], "1": [7, 7]}),
        ("t,q\n1,[1 2]\n2,[3]\n", {"q[0]": [1, 3], "q[1]": [2, np.nan]}),
        ("a,b\n1,True\n2,false\n", {"b": [1, 0]}),
        ("q,q,,q_2\n1,2,3,4\n", {"q": [1], "q_2": [2], "2": [3], "q_2_2": [4]}),
        ("t,q\n", {"t": [], "q": []}),
    ],
)
def test_columns_have_the_names_of_the_header_or_numbers(write, text, columns):
    found = read_one(write(text)) or {"t": [], "q": []}
    for name, values in columns.items():
        np.testing.assert_array_equal(list(found[name]), values)


@pytest.mark.parametrize(
    "text",
    [
        "t\tq\n1\t2\n3\t4\n",
        "t,q\r\n1,2\r\n3,4\r\n",
        "t,q\r1,2\r3,4\r",
        "t, q\n1, 2\n3, 4\n",
        '"t","q"\n"1","2"\n"3","4"\n',
        "t;q\n1,0;2,0\n3,0;4,0\n",
        "sep=;\nt;q\n1;2\n3;4\n",
        "t   q\n 1  2 \n 3  4",
        "# made by\n% a logger\n\nt,q\n1,2\n# a remark, or\n# two\n3,4\n",
        "# t q\n1 2\n3 4\n",
        "t,q\ns,deg\n1,2\n3,4\n",
        "\ufefft,q\n1,2\n3,4\n",
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_one_table_written_in_many_ways_reads_the_same(write, text, packed):
    found = read_one(write(text, "log.csv.gz" if packed else "log.csv"))
    assert {name: v.tolist() for name, v in found.items()} == {"t": [1, 3], "q": [2, 4]}


@pytest.mark.parametrize(
    "cells", [('"[0.5, 1.5]"', '"[2, 3]"'), ("0.5 1.5", "2 3"), ("[0.5;1.5]", "(2 3)")]
)
def test_a_list_in_a_cell_is_a_column_for_each_element(write, cells):
    found = read_one(write(f"t,q\n1,{cells[0]}\n2,{cells[1]}\n"))
    assert list(found) == ["t", "q[0]", "q[1]"]
    assert found["q[1]"].tolist() == [1.5, 3]


@pytest.mark.parametrize(
    "word",
    [
        *("1970-01-01T00:01:00.5Z", "1970-01-01 00:01:00.5"),
        *("1970-01-01T01:01:00,5+01:00", "1970-01-01T00:01:00.500000000 +0000"),
    ],
)
def test_iso_8601_times_are_seconds_since_1970(write, word):
    log = open_log(write(f"when;q\n{word};1\n\n;3\n"))
    assert log.streams[0].time == "when"
    np.testing.assert_equal(read_all(log)[""]["when"], [60.5, np.nan])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("delimiter", [",", " "])
def test_blocks_end_between_rows(write, encoding, end, delimiter):
    lines = ["k,q[°]", "# a remark, or two", *(f"{k},{-k}" for k in range(90_000))]
    lines.insert(80_000, " % another")
    text = end.join(lines) + end
    path = write(text.replace(",", delimiter).encode(encoding))
    log = open_log(path)
    assert len(list(log.read({"": ["k"]}))) > 1
    found = read_all(log)[""]
    np.testing.assert_array_equal(found["k"], np.arange(90_000))
    np.testing.assert_array_equal(found["q[°]"], -np.arange(90_000))


@pytest.mark.parametrize("bad", ["7", "7,x", "7,8,9"])
def test_a_row_that_is_refused_is_counted_from_the_start(write, bad):
    rows = 300_000 * ["1,2"]
    rows[250_000] = bad
    with pytest.raises(InputError, match=r"row 25000[12]:"):
        read_one(write("\n".join(["t,q", *rows, ""])))


def test_a_line_longer_than_a_block_is_refused(write):
    with pytest.raises(InputError, match="too long"):
        read_one(write("t,q\n" + "1,2\n" * 70_000 + "1," + 3_000_000 * "2"))


@pytest.mark.parametrize("size", [2, 300_000])
def test_only_the_last_row_may_be_cut_off(write, size):
    log = open_log(write("t,q\n" + "1,2\n" * size + "7"))
    assert len(read_all(log)[""]["t"]) == size
    assert log.losses == ["the last line is cut off"]
    with pytest.raises(InputError, match="Expected 2 columns"):
        read_one(write("t,q\n" + "1,2\n" * 70_000 + "7\n" + "1,2\n" * size + "7"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,q\n" + "1,2\n" * 2000 + "1,two\n", "conversion error"),
        ("t,q\n" + "1,2\n" * 2000 + "1\n1,2\n", "Expected 2 columns"),
        ("some words\nof no table at all\n", "no table"),
        ("", "it is empty"),
        (gzip.compress(PLAIN.encode(), mtime=0)[:-9], "damaged table"),
    ],
)
def test_what_is_no_table_is_refused(write, text, said):
    with pytest.raises(InputError, match=said):
        read_one(write(text))
