"""Files of models: MuJoCo's own messages stay away, and any path is read."""

import ast
import os
import shutil
from pathlib import Path

import mujoco
import pytest

from selfheal.body.mjcf import load
from selfheal.errors import ModelError
from selfheal.mjcf.edit import Set, apply_edits
from selfheal.recording import load_model, read_spec
from tests.support.paths import ROOT

HINGE = """<mujoco><worldbody>
  <body name="in" pos="0 0 1"><joint name="hinge"/><geom size="1"/></body>
</worldbody></mujoco>"""
STRANGE = b"caf\xe9 \xc3\xa9"  # latin-1, then UTF-8


@pytest.fixture
def loud(monkeypatch, tmp_path):
    """MuJoCo as it is after its import, in an empty folder."""
    mujoco.set_mju_user_warning(None)
    monkeypatch.chdir(tmp_path)


def _compile_by_id(path: Path) -> str:
    return apply_edits(path, [Set("joint", 0, {"damping": "1"})], path.parent)


@pytest.mark.parametrize("read", [load_model, read_spec, load, _compile_by_id])
@pytest.mark.parametrize("name", ["m.xml", "m.mjcf"])
@pytest.mark.parametrize("value", ["nan 0 1", "0 0 NaN"])
def test_a_nan_is_one_message_and_leaves_nothing(
    read, name, value, loud, tmp_path, capfd
):
    path = tmp_path / name
    path.write_text(HINGE.replace("0 0 1", value))
    said = "a value in it is NaN; would fit: a number"
    with pytest.raises((ModelError, ValueError), match=said):
        read(path)
    assert capfd.readouterr() == ("", "")
    assert os.listdir(tmp_path) == [name]


def test_a_nan_that_mujoco_refuses_is_named_in_its_words(loud, tmp_path, capfd):
    path = tmp_path / "m.xml"
    path.write_text(HINGE.replace('size="1"', 'name="ball" size="nan"'))
    with pytest.raises(ModelError, match=r"nan size in geom .*'ball'.* line 2"):
        load_model(path)
    assert capfd.readouterr() == ("", "") and os.listdir(tmp_path) == ["m.xml"]


def test_a_path_may_have_any_bytes(tmp_path):
    folder = tmp_path / os.fsdecode(STRANGE)
    folder.mkdir()
    (folder / "m.xml").write_text(HINGE)
    shutil.copy(folder / "m.xml", folder / "m.mjcf")
    assert load_model(folder / "m.xml").njnt == load_model(folder / "m.mjcf").njnt == 1
    with pytest.raises(ModelError, match=r"cannot load it: .*none.xml"):
        load_model(folder / "none.xml")


def test_a_mesh_that_is_missed_is_told_with_what_would_fit(tmp_path):
    mesh = '<asset><mesh name="a" file="a.stl"/></asset><worldbody>'
    text = HINGE.replace("<worldbody>", mesh, 1).replace("<geom", '<geom mesh="a"', 1)
    (tmp_path / "m.xml").write_text(text.replace('mesh="a"', 'type="mesh" mesh="a"', 1))
    with pytest.raises(ModelError, match=r"a.stl.*would fit: that mesh as .stl"):
        load_model(tmp_path / "m.xml")


def test_one_module_has_mujoco_read_files():
    readers = {"from_xml_path", "from_file", "from_binary_path", "from_zip"}
    found = {
        path.name
        for top in ("selfheal", "cli")
        for path in (ROOT / top).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and node.attr in readers
    }
    # a process without this package reads what `render.py` has just written
    assert found == {"mujoco_files.py", "_gl.py"}
