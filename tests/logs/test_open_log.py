"""Which format reads a log, and what is said where none does."""

import re
import sys
from importlib.metadata import EntryPoint, entry_points, requires

import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.export.export import export_recording
from selfheal.extras import DISTRIBUTION
from selfheal.logs import open_log as module
from selfheal.logs.base import Log, LogFormat, Stream
from selfheal.logs.open_log import open_log
from selfheal.recording import Recording
from tests.support.logs.reading import read_all

GROUP = "selfheal.importers"


class Tape(Log):
    def __init__(self, path):
        self.path, self.streams = path, [Stream("", {"q": ""})]

    def read(self, wanted, report=None):
        yield from ()


class TapeFormat(LogFormat):
    name = "magnetic tape"

    def recognizes(self, path):
        return path.suffix == ".tape"

    def open(self, path):
        return Tape(path)


@pytest.fixture
def add_points(monkeypatch):
    def add(*points):
        found = [*entry_points(group=GROUP), *points]
        monkeypatch.setattr(module, "entry_points", lambda group: found)

    return add


def test_a_third_party_adds_a_format(tmp_path, add_points):
    add_points(EntryPoint("aaa", f"{__name__}:TapeFormat", GROUP))
    path = tmp_path / "log.tape"
    path.write_text("whatever")
    assert isinstance(open_log(path), Tape)


@pytest.mark.parametrize("value", ["no.such.module:X", f"{__name__}:Missing"])
def test_a_format_that_does_not_load_matters_only_if_nothing_else_fits(
    tmp_path, add_points, value
):
    add_points(EntryPoint("aaa", value, GROUP))
    good, bad = tmp_path / "log.csv", tmp_path / "log.bin"
    good.write_text("t,q\n1,2\n")
    bad.write_bytes(b"\0\1\2\3" * 10)
    assert open_log(good).streams
    with pytest.raises(InputError, match=f"{value} does not load"):
        open_log(bad)


@pytest.mark.parametrize("content", [b"\0" * 100, b"plain words\nno table\n"])
def test_what_nobody_recognizes_is_refused_with_the_list(tmp_path, content):
    path = tmp_path / "log"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_log(path)
    known = "CSV HDF5 JSON LeRobot MATLAB NumPy Parquet ROS .pt"
    assert all(name in str(caught.value) for name in known.split())


@pytest.mark.parametrize("name", ["missing", "x" * 5000, "nul\0", "."])
def test_what_is_no_log_is_refused(tmp_path, name):
    with pytest.raises(InputError):
        open_log(tmp_path / name)


@pytest.mark.parametrize(
    ("library", "name", "content"),
    [
        ("rosbags.typesys", "log.bag", b"#ROSBAG V2.0\n"),
        ("mcap.reader", "log.mcap", b"\x89MCAP0\r\n"),
    ],
)
def test_a_missing_library_is_named_with_the_way_to_install_it(
    tmp_path, monkeypatch, library, name, content
):
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"pip install 'mcap.*'rosbags"):
        list(open_log(path).read({"": ["t"]}))


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_table_is_read_by_what_every_installation_has(tmp_path, monkeypatch, form):
    stated = requires(DISTRIBUTION)
    plain = {re.split(r"[^\w-]", line)[0] for line in stated if "extra ==" not in line}
    extra = {re.split(r"[^\w-]", line)[0] for line in stated if "extra ==" in line}
    assert "pyarrow" in plain - extra
    for library in ("mcap", "mcap_protobuf", "rerun", "rosbags"):
        monkeypatch.setitem(sys.modules, library, None)
    recording = Recording.from_arrays(np.arange(3.0), {"motor": np.zeros(3)}, {})
    export_recording(recording, tmp_path / f"log.{form}", to=form)
    (rows,) = read_all(open_log(tmp_path / f"log.{form}")).values()
    assert len(rows) == 3


def test_a_name_with_half_a_character_is_refused(tmp_path):
    path = tmp_path / "log.json"
    path.write_text('{"t": [0, 1, 2], "goal\\udc80": [1, 2, 3]}')
    with pytest.raises(InputError, match=r"log.json: the name .* half a character"):
        open_log(path)
