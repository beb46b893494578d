"""Names and paths with any characters, in any locale: read, written, printed."""

import io
import os
import subprocess
import sys
from dataclasses import replace

import pytest

from selfheal.cli._streams import guard_streams
from selfheal.recording import write
from tests.support.mjcf_models import CUBE, write_file

TEXT = "é – 漢 \udce9 \ud800"  # a byte of a path, half of a character
# what a locale without a language leaves, where Python is forced to heed it
PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
USE_ALL = r"""
import os, sys
from pathlib import Path
from selfheal.cli import app
from selfheal.mjcf.edit import Set, apply_edits
from selfheal.mjcf.xml_text import encode_text
from selfheal.mujoco_files import compile_file
assert sys.getfilesystemencoding() == "ascii"
model, recording, out = map(Path, sys.argv[1:])
out.mkdir()
for edit in (Set("geom", "b\xe9", {"size": "3"}), Set("geom", 0, {"size": "3"})):
    (out / "new.xml").write_bytes(encode_text(apply_edits(model, [edit], out)))
    assert compile_file(out / "new.xml").ngeom == 3
app(["recording", "check", os.fspath(recording), "--model", os.fspath(model)])
"""


@pytest.mark.parametrize(
    ("encoding", "written"),
    [
        ("ascii", "é – 漢 \\udce9 \\ud800".encode()),
        ("utf-8", "é – 漢 \\udce9 \\ud800".encode()),
        ("latin-1", b"\xe9 \\u2013 \\u6f22 \\udce9 \\ud800"),
    ],
)
def test_any_text_is_printed(encoding, written, monkeypatch):
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding))
    monkeypatch.setattr(sys, "stderr", sys.stderr)
    guard_streams()
    print(TEXT, end="", flush=True)
    assert raw.getvalue() == written


def test_paths_work_where_the_locale_has_no_language(recording, model, tmp_path):
    folder = tmp_path / "é"
    text = model.read_text().replace(
        "<worldbody>",
        '<compiler meshdir="nét"/><asset><mesh name="ü" file="é.obj"/></asset>'
        '<include file="é.xml"/><worldbody>',
    )
    text = text.replace('<geom size="0.1" mass="1"/>', '<geom type="mesh" mesh="ü"/>')
    write_file(folder / "m.xml", text)
    included = '<worldbody><geom name="bé" size="1"/></worldbody>'
    write_file(folder / "é.xml", f"<mujoco>{included}</mujoco>")
    write_file(folder / "nét/é.obj", CUBE.format(1))
    write(replace(recording, robot="é – 漢"), folder / "é.h5")
    paths = [folder / "m.xml", folder / "é.h5", tmp_path / "ö"]
    done = subprocess.run(
        [sys.executable, "-c", USE_ALL, *paths],
        env=os.environ | PLAIN,
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    last = done.stdout.decode().splitlines()[-1]
    assert f"{paths[1]} (é – 漢)" in last and f"fits {paths[0]}." in last
