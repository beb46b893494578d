"""XML as users write it: escapes, comments, line ends, encodings, damage."""

import pytest

from selfheal.errors import ModelError
from selfheal.mjcf.edit import Insert, Set, apply_edits
from tests.support.mjcf_models import ARM, compile_edited, load_model, write_file


def test_names_may_hold_what_xml_escapes(tmp_path):
    names = "a &amp; &quot;b&quot;", "it's &#228; &lt;", "R & D"
    text = "".join(f'<body name="{n}"/>' for n in names) + "<body name='\"'/>"
    path = write_file(
        tmp_path / "m.xml", f"<mujoco><worldbody>{text}</worldbody></mujoco>"
    )
    model = load_model(path)
    edits = [Set("body", model.body(i).name, {"pos": f"{i} 0 0"}) for i in range(1, 5)]
    after = compile_edited(path, edits)
    assert after.body_pos[:, 0].tolist() == [0, 1, 2, 3, 4]
    assert after.names == model.names
    renamed = [Set("body", '"', {"name": "<'\"&"}), Set("body", "R & D", {"name": '"'})]
    after = compile_edited(path, renamed)
    assert [after.body(i).name for i in (3, 4)] == ['"', "<'\"&"]


def test_comments_that_xml_forbids_but_mujoco_reads(tmp_path):
    text = ARM.replace("<!-- it swings -->", "<!------ it -- swings ------>")
    path = write_file(tmp_path / "m.xml", text)
    edit = Set("joint", "hip", {"armature": "0.2"})
    assert apply_edits(path, [edit], tmp_path) == text.replace('"0.01"', '"0.2"')
    assert compile_edited(path, [edit]).dof_armature[0] == 0.2


def test_line_ends_and_a_byte_order_mark_stay(tmp_path):
    text = "\ufeff" + ARM.replace("\n", "\r\n").replace("swings", "schwingt: ä°漢")
    path = write_file(tmp_path / "m.xml", text)
    edits = [
        Set("joint", "hip", {"armature": "0.2"}),
        Insert("body", "ball", "<site/>"),
        Insert("actuator", "", '<motor joint="hip"/>\n<motor joint="knee"/>'),
        Set("option", "", {"timestep": "0.1"}),
    ]
    new = apply_edits(path, edits, tmp_path)
    assert new[0] == "\ufeff" and "\n" not in new.replace("\r\n", "")
    assert len(new.splitlines()) == len(text.splitlines()) + 4
    assert compile_edited(path, edits).nu == 4


@pytest.mark.parametrize("declared", ["<?xml version='1.0' encoding='latin-1'?>", ""])
def test_another_encoding_becomes_utf_8(declared, tmp_path):
    text = declared + "<mujoco><!-- 90° --><worldbody/></mujoco>"
    path = write_file(tmp_path / "m.xml", text.encode("latin-1"))
    assert apply_edits(path, [], tmp_path) == text.replace("latin-1", "UTF-8")


DAMAGED = [
    *("", "text", "<mujoco>", "<mujoco><a></mujoco>", "<mujoco></a></mujoco>"),
    *("<mujoco/></mujoco>", "<mujoco><body name=1/></mujoco>", "<mujoco><!-- "),
]


@pytest.mark.parametrize("text", DAMAGED)
def test_what_is_no_xml_is_refused(text, tmp_path):
    path = write_file(tmp_path / "m.xml", text)
    with pytest.raises(ModelError, match=r"m\.xml: no "):
        apply_edits(path, [], tmp_path)


def test_damage_has_a_line(tmp_path):
    path = write_file(tmp_path / "m.xml", ARM.replace("</body>\n    <body", "<body"))
    with pytest.raises(ModelError, match=r"in <(worldbody|body)>.*line 2[0-9]"):
        apply_edits(path, [], tmp_path)


DEEP = 480  # elements inside each other; MuJoCo's reader takes 500 of a file


@pytest.mark.parametrize("tag", ["body", "frame"])
def test_a_model_may_be_nested_as_deeply_as_mujoco_reads(tag, tmp_path):
    begin, end = f"<{tag}>" * DEEP, f"</{tag}>" * DEEP
    inside = '<body name="in"><joint name="hinge"/><geom size="1"/></body>'
    text = f"<mujoco><worldbody>{begin}{inside}{end}</worldbody></mujoco>"
    path = write_file(tmp_path / "m.xml", text)
    edits = [
        Set("joint", "hinge", {"damping": "3"}),
        Insert("body", "in", '<site name="new"/>'),
        Insert("body", "world", "<geom size='2'/>"),
    ]
    after = compile_edited(path, edits)
    assert after.dof_damping.tolist() == [3] and after.nsite == 1 and after.ngeom == 2
    assert apply_edits(path, [], tmp_path) == text
    by_id = compile_edited(path, [Set("joint", 0, {"damping": "3"})])
    assert by_id.dof_damping.tolist() == [3]


def test_files_may_include_each_other_as_deeply_as_mujoco_reads(tmp_path):
    parts = ["<mujoco>{}</mujoco>", *["<mujocoinclude>{}</mujocoinclude>"] * DEEP]
    for k, part in enumerate(parts):
        inside = f'<include file="{k + 1}.xml"/>'
        write_file(tmp_path / f"{k}.xml", part.format(inside))
    inside = '<worldbody><body name="in"><joint name="hinge"/><geom size="1"/></body>'
    last = f"<mujocoinclude>{inside}</worldbody></mujocoinclude>"
    write_file(tmp_path / f"{len(parts)}.xml", last)
    path = tmp_path / "0.xml"
    after = compile_edited(path, [Set("joint", "hinge", {"damping": "3"})])
    assert after.dof_damping.tolist() == [3]
