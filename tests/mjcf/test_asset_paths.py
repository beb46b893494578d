"""Included files, meshes and textures are found from wherever a model is written."""

import os
import struct
import zlib
from pathlib import Path

import pytest

from selfheal.errors import ModelError
from selfheal.mjcf.edit import Set, apply_edits
from tests.support.mjcf_models import (
    CUBE,
    list_changed_lines,
    list_edited_fields,
    write_file,
)


@pytest.fixture
def scene(tmp_path) -> Path:
    """A model of four files and a mesh in three folders."""
    write_file(tmp_path / "robot/meshes/cube.obj", CUBE.format(1))
    write_file(
        tmp_path / "robot/robot.xml",
        """<!-- (c) the robot's makers -->
<mujoco model="robot">
  <compiler meshdir="robot/meshes/"/>
  <asset>
    <mesh name="cube" file="cube.obj"/>
  </asset>
  <include file="motors.xml"/>
  <worldbody>
    <include file="robot/leg.xml"/>
  </worldbody>
</mujoco>
""",
    )
    write_file(
        tmp_path / "robot/leg.xml",
        """<mujocoinclude>
    <body name="leg"> <!-- left -->
      <joint name="hip"/><geom type="mesh" mesh="cube"/>
    </body>
</mujocoinclude>
""",
    )
    write_file(
        tmp_path / "robot/motors.xml",
        '<mujoco><actuator><motor name="m" joint="hip"/></actuator></mujoco>',
    )
    return write_file(
        tmp_path / "scene.xml",
        """<mujoco model="scene">
  <!-- who -->
  <include file="robot/robot.xml"/>
  <!-- where -->
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
  </worldbody>
</mujoco>
""",
    )


FILES = [
    [],
    [Set("geom", "floor", {"friction": "0.5"})],
    [Set("joint", "hip", {"frictionloss": "0.5"})],
    [Set("actuator", "m", {"gear": "2"})],
    [Set("joint", 0, {"frictionloss": "0.5"}), Set("option", "", {"density": "1"})],
]


@pytest.mark.parametrize("edits", FILES)
@pytest.mark.parametrize("folder", ["", "out", "out/deep", "../beside"])
def test_included_files_and_meshes_are_found_from_everywhere(scene, edits, folder):
    fields = {"geom_friction", "dof_frictionloss", "actuator_gear", "opt.density"}
    changed = list_edited_fields(scene, edits, folder)
    assert changed <= {*fields, "actuator_acc0"}
    assert len(changed & fields) == len(edits)


def test_an_include_stays_where_no_edit_falls_into_it(scene, tmp_path):
    given = scene.read_text()
    assert apply_edits(scene, [], tmp_path) == given
    floor = [Set("geom", "floor", {"friction": "1"}), Set("joint", "hip", {})]
    assert list_changed_lines(given, apply_edits(scene, floor, tmp_path)) == [
        '-    <geom name="floor" type="plane" size="1 1 1"/>',
        '+    <geom name="floor" type="plane" size="1 1 1" friction="1"/>',
    ]


def test_an_edited_include_is_written_out_and_the_others_stay(scene, tmp_path):
    new = apply_edits(scene, [Set("joint", "hip", {"damping": "1"})], tmp_path)
    assert '<include file="robot/motors.xml"/>' in new
    for kept in ("makers", "left", "who", "where", 'meshdir="robot/meshes/"'):
        assert kept in new
    for gone in ("robot.xml", "leg.xml", "mujocoinclude"):
        assert gone not in new
    assert '<joint name="hip" damping="1"/>' in new


def test_a_mesh_beside_the_including_file_is_found_when_that_is_written_out(tmp_path):
    body = "<worldbody><body name='b'><joint name='j'/><geom type='mesh' mesh='c'/>"
    asset = "<asset><mesh name='c' file='m/c.obj'/></asset>"
    text = f"<mujoco>{asset}{body}</body></worldbody></mujoco>"
    write_file(tmp_path / "sub/robot.xml", text)
    write_file(tmp_path / "sub/m/c.obj", CUBE.format(1))
    path = write_file(
        tmp_path / "m.xml", "<mujoco><include file='sub/robot.xml'/></mujoco>"
    )
    edit = Set("joint", "j", {"armature": "1"})
    assert list_edited_fields(path, [], "out") == set()
    for folder in ("", "out"):
        changed = list_edited_fields(path, [edit], folder)
        assert "dof_armature" in changed and "mesh_vert" not in changed


TWO = '<compiler assetdir="x"/><compiler assetdir="t"/>'
STRIP = '<compiler strippath="true" assetdir="a"/>'
DIRS = {  # compiler, mesh, texture, height field
    "none": ("", "m/c.obj", "t/t.png", "t/t.png"),
    "mesh": ('<compiler meshdir="m"/>', "c.obj", "t/t.png", "../t/t.png"),
    "both": ('<compiler meshdir="m" texturedir="t"/>', "c.obj", "t.png", "../t/t.png"),
    "asset": ('<compiler assetdir="m"/>', "c.obj", "../t/t.png", "../t/t.png"),
    "over": ('<compiler assetdir="t" meshdir="m"/>', "c.obj", "t.png", "../t/t.png"),
    "two": (TWO, "../m/c.obj", "t.png", "t.png"),
    "strip": (STRIP, "x/c.obj", "/y/t.png", "t.png"),
}


@pytest.mark.parametrize("case", DIRS)
@pytest.mark.parametrize("folder", ["out", "../x/y"])
def test_every_way_to_name_assets_leads_to_them(case, folder, tmp_path):
    compiler, mesh, texture, field = DIRS[case]
    for place in ("m", "a"):
        write_file(tmp_path / place / "c.obj", CUBE.format(1))
    for place in ("t", "a"):
        write_file(tmp_path / place / "t.png", _png())
    path = write_file(
        tmp_path / "m.xml",
        f"""<mujoco>
  {compiler}
  <asset><mesh name="c" file="{mesh}"/>
    <texture name="t" type="2d" file="{texture}"/>
    <texture name="u" type="cube" fileright="{texture}"/>
    <hfield name="h" file="{field}" size="1 1 1 1"/></asset>
  <worldbody><geom type="mesh" mesh="c"/></worldbody>
</mujoco>""",
    )
    assert list_edited_fields(path, [], folder) == set()
    new = apply_edits(path, [], tmp_path / folder)
    assert len(list_changed_lines(path.read_text(), new)) <= 2
    assert apply_edits(path, [], tmp_path) == path.read_text()


def _png() -> bytes:
    """A picture of 2 x 2 points."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        crc = struct.pack(">I", zlib.crc32(kind + body))
        return struct.pack(">I", len(body)) + kind + body + crc

    rows = zlib.compress(b"\0" + bytes(range(6)) + b"\0" + bytes(range(6, 12)))
    head = struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", head), chunk(b"IDAT", rows), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def test_absolute_paths_stay(tmp_path):
    mesh = write_file(tmp_path / "c.obj", CUBE.format(1))
    text = f"""<mujoco><asset><mesh name="c" file="{mesh}"/></asset></mujoco>"""
    path = write_file(tmp_path / "m.xml", text)
    assert apply_edits(path, [], tmp_path / "out") == text


def test_an_attached_model_is_found_and_its_insides_have_no_text(tmp_path):
    child = "<mujoco><asset><mesh name='c' file='c.obj'/></asset>" + (
        "<worldbody><body name='b'><joint name='j'/><geom type='mesh' mesh='c'/>"
        "</body></worldbody></mujoco>"
    )
    write_file(tmp_path / "sub/child.xml", child)
    write_file(tmp_path / "sub/c.obj", CUBE.format(1))
    path = write_file(
        tmp_path / "m.xml",
        "<mujoco><asset><model name='k' file='sub/child.xml'/></asset><worldbody>"
        "<frame><attach model='k' body='b' prefix='p_'/></frame></worldbody></mujoco>",
    )
    assert list_edited_fields(path, [], "out") == set()
    with pytest.raises(ModelError, match=r"no joint 'p_j'.*<attach> makes"):
        apply_edits(path, [Set("joint", "p_j", {"damping": "1"})], tmp_path)


def test_what_an_included_file_attaches_is_found_from_another_folder(tmp_path):
    child = "<mujoco><worldbody><body name='b'><geom size='1'/></body></worldbody>"
    write_file(tmp_path / "model.xml", f"{child}</mujoco>")
    write_file(
        tmp_path / "part.xml",
        "<mujoco><asset><model name='k' file='model.xml'/></asset></mujoco>",
    )
    path = write_file(
        tmp_path / "m.xml",
        "<mujoco><include file='part.xml'/><worldbody><attach model='k' body='b' "
        "prefix='p_'/></worldbody></mujoco>",
    )
    assert list_edited_fields(path, [], "out") == set()


def test_missing_and_repeated_files_are_named(scene, tmp_path):
    with pytest.raises(ModelError, match=r"cannot read .*nowhere\.xml"):
        apply_edits(tmp_path / "nowhere.xml", [], tmp_path)
    path = write_file(tmp_path / "m.xml", "<mujoco><include file='gone.xml'/></mujoco>")
    with pytest.raises(ModelError, match=r"cannot read .*gone\.xml"):
        apply_edits(path, [], tmp_path)
    path = write_file(tmp_path / "m.xml", "<mujoco><include file='m.xml'/></mujoco>")
    with pytest.raises(ModelError, match=r"m\.xml is included twice"):
        apply_edits(path, [], tmp_path)


def test_the_text_does_not_depend_on_the_working_folder(scene, tmp_path, monkeypatch):
    whole = apply_edits(
        scene, [Set("joint", "hip", {"damping": "1"})], tmp_path / "out"
    )
    monkeypatch.chdir(tmp_path)
    edit = Set("joint", "hip", {"damping": "1"})
    assert apply_edits(os.path.basename(scene), [edit], "out") == whole
