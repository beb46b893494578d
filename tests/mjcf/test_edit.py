"""Edits of a model's text: what changes is what was asked for, and nothing else."""

import os
import re
import struct
import zlib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from selfheal.errors import ModelError, UnknownNameError
from selfheal.mjcf.edit import (
    Insert,
    Rename,
    Set,
    apply_edits,
    format_number,
    unified_diff,
)

ARM = """<?xml version="1.0"?>
<!-- an arm; not <joint name="knee"/> -->
<mujoco model="arm">
  <compiler angle="radian"/>
  <default>
    <joint damping="0.5"/>
    <default class="soft">
      <joint stiffness='3'/>
    </default>
  </default>

  <worldbody>
    <geom type="plane" size="1 1 1"/>  <!-- the floor -->
    <body name="upper" pos="0 0 1">
      <!-- it swings -->
      <joint   name = "hip"  axis="0 1 0"
               armature="0.01"/>  <!-- hip -->
      <geom name='bone' size="0.10" mass="1"/>
      <body name="lower" pos="0 0 -0.5"><joint name="knee" axis='0 1 0'/>
        <geom size=".1"/>
      </body>
      <geom name="cap" size="0.05"/>
    </body>
    <body name="ball"><freejoint name="free"/><geom size="0.2"/>
      <site name="top"/></body>
  </worldbody>
  <![CDATA[ <joint name="hip"/> ]]>
  <actuator>
    <position name="servo" joint="hip" kp="10"/>
    <motor joint="knee"/>
  </actuator>
  <sensor>
    <jointpos name="angle" joint="hip"/>
  </sensor>
</mujoco>
"""
CUBE = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def arm(tmp_path) -> Path:
    return _write(tmp_path / "arm.xml", ARM)


def _write(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def _compiled(path: Path, edits=(), folder: str = "") -> mujoco.MjModel:
    """The model after the edits, written into a folder beside it, in MuJoCo."""
    place = path.parent / folder
    new = place / "patched.xml"
    _write(new, apply_edits(path, edits, place))
    return mujoco.MjModel.from_xml_path(str(new))


def _changed(one: mujoco.MjModel, other: mujoco.MjModel) -> set[str]:
    """The fields, options included, in which two models differ."""
    names = set()
    for prefix, a, b in (("", one, other), ("opt.", one.opt, other.opt)):
        for field in dir(a):
            value = getattr(a, field) if field[0] != "_" else None
            if isinstance(value, np.ndarray | int | float | bytes):
                same = np.array_equal(value, getattr(b, field))
                names |= set() if same else {prefix + field}
    return names - {"paths", "signature"}


def _lines(given: str, new: str) -> list[str]:
    """The lines that a diff removes and adds."""
    diff = unified_diff(given, new).splitlines()
    return [line for line in diff if re.match(r"[-+](?![-+]{2} )", line)]


def _given(path: Path) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(path))


# laws


def test_no_edits_give_the_same_text(arm, tmp_path):
    assert apply_edits(arm, [], tmp_path) == ARM
    assert apply_edits(arm, [], tmp_path / "elsewhere") == ARM
    assert unified_diff(ARM, ARM) == ""


def test_values_that_are_there_keep_their_spelling(arm, tmp_path):
    edits = [
        Set("joint", "hip", {"armature": "0.01", "axis": "0 1.0 0", "damping": None}),
        Set("geom", "bone", {"size": "0.1"}),
        Set("compiler", "", {"angle": "radian"}),
        Rename("actuator", "servo", "position", {"kp": "1e1"}),
    ]
    assert apply_edits(arm, edits, tmp_path) == ARM


SETS = [
    (Set("joint", "hip", {"armature": "0.02"}), {"dof_armature"}),
    (Set("joint", "hip", {"frictionloss": "1"}), {"dof_frictionloss"}),
    (Set("joint", "knee", {"damping": "0.7"}), {"dof_damping"}),
    (Set("joint", 0, {"frictionloss": "1"}), {"dof_frictionloss"}),
    (Set("geom", 0, {"friction": "0.3"}), {"geom_friction"}),
    (Set("geom", "cap", {"friction": "0.3"}), {"geom_friction"}),
    (Set("body", "ball", {"pos": "0 0 3"}), {"body_pos", "qpos0", "qpos_spring"}),
    (Set("site", "top", {"pos": "0 0 1"}), {"site_pos", "site_sameframe"}),
    (Set("actuator", "servo", {"forcerange": "-1 1"}),
     {"actuator_forcerange", "actuator_forcelimited"}),
    (Set("actuator", 1, {"gear": "2"}), {"actuator_gear"}),
    (Set("sensor", "angle", {"noise": "0.1"}), {"sensor_noise"}),
    (Set("option", "", {"density": "1.2"}), {"opt.density"}),
    (Insert("actuator", "", '<motor joint="hip"/>'), {"nu"}),
    (Insert("worldbody", "", "<site/>"), None),
]  # fmt: skip


@pytest.mark.parametrize("edit, fields", SETS[:-1], ids=lambda e: str(e)[:40])
def test_only_what_was_asked_for_changes(arm, edit, fields):
    before, after = _given(arm), _compiled(arm, [edit], "out")
    changed = _changed(before, after)
    # what follows from the change: weights at rest, size, names
    changed = {f for f in changed if not re.search("weight0|M0|nbuffer|narena|acc0", f)}
    if fields == {"nu"}:
        assert before.nu + 1 == after.nu
        assert not {f for f in changed if f.startswith(("jnt_", "body_", "geom_"))}
    else:
        assert changed == fields
    diff = _lines(ARM, apply_edits(arm, [edit], arm.parent))
    assert len(diff) <= 2


def test_a_changed_attribute_is_the_only_changed_text(arm, tmp_path):
    edits = [Set("joint", "hip", {"armature": "0.2"}), Set("geom", 3, {"mass": "2"})]
    new = apply_edits(arm, edits, tmp_path)
    expected = ARM.replace('armature="0.01"', 'armature="0.2"')
    expected = expected.replace('<geom name="cap" size="0.05"/>', "CAP")
    found = re.findall(r' mass="2"', new)
    assert len(found) == 1
    assert new.replace(' mass="2"', "") == expected.replace(
        "CAP", '<geom name="cap" size="0.05"/>'
    )


def test_an_id_is_that_of_the_compiled_model(arm, tmp_path):
    model = _given(arm)
    for k in range(model.ngeom):
        new = apply_edits(
            arm, [Set("geom", np.int64(k), {"friction": "0.123"})], tmp_path
        )
        path = _write(tmp_path / "new.xml", new)
        friction = _given(path).geom_friction[:, 0]
        assert np.flatnonzero(friction == 0.123).tolist() == [k]


def test_ids_are_those_of_the_given_model_whatever_the_edits_add(arm, tmp_path):
    edits = [
        Insert("body", 0, '<geom size="1" pos="9 0 0"/>', first=True),
        Set("geom", 0, {"friction": "0.3"}),
    ]
    new = apply_edits(arm, edits, tmp_path)
    assert '<geom type="plane" size="1 1 1" friction="0.3"/>' in new


def test_edits_of_one_element_add_up(arm, tmp_path):
    edits = [
        Set("joint", "hip", {"damping": "1", "frictionloss": "2"}),
        Set("joint", "hip", {"damping": "3", "armature": None}),
        Set("joint", 0, {"frictionloss": None}),
    ]
    new = apply_edits(arm, edits, tmp_path)
    assert '<joint   name = "hip"  axis="0 1 0" damping="3"/>  <!-- hip -->' in new


def test_an_inserted_element_can_be_edited(arm, tmp_path):
    edits = [
        Insert("body", "upper", '<joint name="hip_play"/>'),
        Set("joint", "hip_play", {"range": "-0.1 0.1"}),
        Insert("option", "", '<flag contact="disable"/>'),
        Set("option", "", {"timestep": "0.001"}),
    ]
    new = apply_edits(arm, edits, tmp_path)
    assert (
        """armature="0.01"/>  <!-- hip -->
      <joint name="hip_play" range="-0.1 0.1"/>
      <geom"""
        in new
    )
    assert (
        """  <compiler angle="radian"/>
  <option timestep="0.001">
    <flag contact="disable"/>
  </option>
  <default>"""
        in new
    )


@pytest.mark.parametrize(
    "compilers, range_",
    [
        ("", "-90 180"),
        ('<compiler angle="radian"/>', "-1.5707963 3.1415927"),
        ('<compiler angle="radian"/><compiler angle="degree"/>', "-90 180"),
        ('<include file="c.xml"/>', "-1.5707963 3.1415927"),
    ],
)
def test_an_inserted_angle_is_in_the_models_unit(compilers, range_, tmp_path):
    (tmp_path / "c.xml").write_text('<mujoco><compiler angle="radian"/></mujoco>')
    path = tmp_path / "m.xml"
    path.write_text(
        f'<mujoco>{compilers}<worldbody><body name="b"/></worldbody></mujoco>'
    )
    xml = '<joint range="-1.5707963 3.1415927"/>'
    text = apply_edits(path, [Insert("body", "b", xml, angles=("range",))], tmp_path)
    assert f'<joint range="{range_}"/>' in text


def test_renaming_changes_the_tag_and_the_attributes(arm, tmp_path):
    told = {"kp": None, "gainprm": "10", "biastype": "affine", "biasprm": "0 -10 0"}
    rename = Rename("actuator", "servo", "general", told)
    assert _lines(ARM, apply_edits(arm, [rename], tmp_path)) == [
        '-    <position name="servo" joint="hip" kp="10"/>',
        '+    <general name="servo" joint="hip" gainprm="10" biastype="affine" '
        'biasprm="0 -10 0"/>',
    ]
    changed = _changed(_given(arm), _compiled(arm, [rename]))
    assert {f for f in changed if "actuator_" in f} <= {"actuator_ctrlspec"}


def test_renaming_an_open_element_renames_its_end(tmp_path):
    path = _write(
        tmp_path / "a.xml",
        "<mujoco><worldbody><body><freejoint></freejoint ><geom size='1'/></body>"
        "</worldbody></mujoco>",
    )
    new = apply_edits(path, [Rename("joint", 0, "joint", {"type": "free"})], tmp_path)
    assert '<joint type="free"></joint>' in new


# where inserted text goes


def _inserted(tmp_path, text: str, edit: Insert) -> str:
    path = _write(tmp_path / "m.xml", f"<mujoco>{text}</mujoco>")
    new = apply_edits(path, [edit], tmp_path)
    assert new.startswith("<mujoco>") and new.endswith("</mujoco>")
    return new[8:-9]


WORLD = "\n  <worldbody>\n{}\n  </worldbody>\n"
PLACES = {
    "into an empty one": (
        '    <body name="b"/>',
        '    <body name="b">\n      <X/>\n    </body>',
    ),
    "into one with a space": (
        '    <body name="b" />',
        '    <body name="b">\n      <X/>\n    </body>',
    ),
    "into one without children": (
        '    <body name="b"></body>',
        '    <body name="b">\n      <X/>\n    </body>',
    ),
    "into one of blanks": (
        '    <body name="b">\n    </body>',
        '    <body name="b">\n      <X/>\n    </body>',
    ),
    "into a comment": (
        '    <body name="b"><!-- b --></body>',
        '    <body name="b"><!-- b -->\n      <X/>\n    </body>',
    ),
    "in line": (
        '    <body name="b"><site/></body>',
        '    <body name="b"><site/><X/></body>',
    ),
    "after its kind": (
        '    <body name="b">\n     <X a="1"/> <!-- x -->\n     <site/>\n    </body>',
        '    <body name="b">\n     <X a="1"/> <!-- x -->\n     <X/>\n     <site/>\n'
        "    </body>",
    ),
    "before bodies": (
        '    <body name="b">\n\t<site/>\n\t<!-- c -->\n\t<body/>\n    </body>',
        '    <body name="b">\n\t<site/>\n\t<X/>\n\t<!-- c -->\n\t<body/>\n    </body>',
    ),
    "after a frame with its kind": (
        '    <body name="b">\n     <frame><X a="1"/></frame>\n     <body/>\n'
        "    </body>",
        '    <body name="b">\n     <frame><X a="1"/></frame>\n     <X/>\n'
        "     <body/>\n    </body>",
    ),
}


@pytest.mark.parametrize("case", PLACES)
def test_what_is_inserted_is_indented_like_its_siblings(case, tmp_path):
    before, after = (WORLD.format(text) for text in PLACES[case])
    assert _inserted(tmp_path, before, Insert("body", "b", "<X/>")) == after


def test_the_first_place_is_before_comments_but_not_those_of_the_line(tmp_path):
    before = WORLD.format('    <body name="b">  <!-- b -->\n      <!-- j -->\n'
                          "      <joint/>\n    </body>")  # fmt: skip
    insert = Insert("body", "b", "<X>\n  <Y/>\n</X>", first=True)
    after = before.replace(
        "<!-- b -->\n", "<!-- b -->\n      <X>\n        <Y/>\n      </X>\n"
    )
    assert _inserted(tmp_path, before, insert) == after


def test_sections_are_made_where_they_are_missing(tmp_path):
    path = _write(tmp_path / "m.xml", ARM.replace("actuator>", "custom>"))
    path.write_text(
        re.sub("<custom>.*</custom>", "<!-- none -->", path.read_text(), flags=16)
    )
    edits = [
        Insert("actuator", "", '<motor name="m" joint="hip"/>'),
        Insert("contact", "", '<exclude body1="upper" body2="ball"/>'),
        Insert("equality", "", '<joint joint1="hip" joint2="knee"/>'),
        Set("option", "", {"timestep": "0.001"}),
        Set("actuator", "m", {"gear": "3"}),
    ]
    model = _compiled(path, edits)
    assert (model.nu, model.nexclude, model.neq) == (1, 1, 1)
    assert (model.opt.timestep, model.actuator_gear[0, 0]) == (0.001, 3)
    new = apply_edits(path, edits, tmp_path)
    assert (
        '  <actuator>\n    <motor name="m" joint="hip" gear="3"/>\n  </actuator>' in new
    )
    assert [c for c in _lines(path.read_text(), new) if c[0] == "-"] == []


def test_settings_are_changed_where_they_are_made(tmp_path):
    text = (
        '<mujoco><option timestep="0.1"/><worldbody/>'
        '<option timestep="0.2" density="1"/></mujoco>'
    )
    path = _write(tmp_path / "m.xml", text)
    new = apply_edits(path, [Set("option", "", {"timestep": "0.3"})], tmp_path)
    assert new == text.replace("0.2", "0.3")
    new = apply_edits(path, [Set("option", "", {"timestep": None})], tmp_path)
    assert "timestep" not in new


def test_a_model_without_line_breaks_stays_one_line(tmp_path):
    path = _write(tmp_path / "m.xml", "<mujoco><worldbody/></mujoco>")
    new = apply_edits(path, [Set("option", "", {"timestep": "1"})], tmp_path)
    assert new == '<mujoco><option timestep="1"/><worldbody/></mujoco>'


# hard texts


def test_names_may_hold_what_xml_escapes(tmp_path):
    names = "a &amp; &quot;b&quot;", "it's &#228; &lt;", "R & D"
    text = "".join(f'<body name="{n}"/>' for n in names) + "<body name='\"'/>"
    path = _write(tmp_path / "m.xml", f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    model = _given(path)
    edits = [Set("body", model.body(i).name, {"pos": f"{i} 0 0"}) for i in range(1, 5)]
    after = _compiled(path, edits)
    assert after.body_pos[:, 0].tolist() == [0, 1, 2, 3, 4]
    assert after.names == model.names
    renamed = [Set("body", '"', {"name": "<'\"&"}), Set("body", "R & D", {"name": '"'})]
    after = _compiled(path, renamed)
    assert [after.body(i).name for i in (3, 4)] == ['"', "<'\"&"]


def test_comments_that_xml_forbids_but_mujoco_reads(tmp_path):
    text = ARM.replace("<!-- it swings -->", "<!------ it -- swings ------>")
    path = _write(tmp_path / "m.xml", text)
    edit = Set("joint", "hip", {"armature": "0.2"})
    assert apply_edits(path, [edit], tmp_path) == text.replace('"0.01"', '"0.2"')
    assert _compiled(path, [edit]).dof_armature[0] == 0.2


def test_line_ends_and_a_byte_order_mark_stay(tmp_path):
    text = "\ufeff" + ARM.replace("\n", "\r\n").replace("swings", "schwingt: ä°漢")
    path = _write(tmp_path / "m.xml", text)
    edits = [
        Set("joint", "hip", {"armature": "0.2"}),
        Insert("body", "ball", "<site/>"),
        Insert("actuator", "", '<motor joint="hip"/>\n<motor joint="knee"/>'),
        Set("option", "", {"timestep": "0.1"}),
    ]
    new = apply_edits(path, edits, tmp_path)
    assert new[0] == "\ufeff" and "\n" not in new.replace("\r\n", "")
    assert len(new.splitlines()) == len(text.splitlines()) + 4
    assert _compiled(path, edits).nu == 4


@pytest.mark.parametrize("declared", ["<?xml version='1.0' encoding='latin-1'?>", ""])
def test_another_encoding_becomes_utf_8(declared, tmp_path):
    text = declared + "<mujoco><!-- 90° --><worldbody/></mujoco>"
    path = _write(tmp_path / "m.xml", text.encode("latin-1"))
    assert apply_edits(path, [], tmp_path) == text.replace("latin-1", "UTF-8")


DAMAGED = [
    *("", "text", "<mujoco>", "<mujoco><a></mujoco>", "<mujoco></a></mujoco>"),
    *("<mujoco/></mujoco>", "<mujoco><body name=1/></mujoco>", "<mujoco><!-- "),
]


@pytest.mark.parametrize("text", DAMAGED)
def test_what_is_no_xml_is_refused(text, tmp_path):
    path = _write(tmp_path / "m.xml", text)
    with pytest.raises(ModelError, match=r"m\.xml: no "):
        apply_edits(path, [], tmp_path)


def test_damage_has_a_line(tmp_path):
    path = _write(tmp_path / "m.xml", ARM.replace("</body>\n    <body", "<body"))
    with pytest.raises(ModelError, match="in <worldbody>|in <body>.*line 2[0-9]"):
        apply_edits(path, [], tmp_path)


# elements that are not there


def test_an_unknown_name_lists_what_there_is(arm, tmp_path):
    with pytest.raises(ModelError, match=r"no joint 'toe'.*'hip', 'knee', 'free'"):
        apply_edits(arm, [Set("joint", "toe", {})], tmp_path)
    with pytest.raises(ModelError, match=r"no actuator 'x'.*'servo', 1 without a name"):
        apply_edits(arm, [Set("actuator", "x", {})], tmp_path)
    with pytest.raises(ModelError, match="no geom has id 9; there are 5"):
        apply_edits(arm, [Set("geom", 9, {})], tmp_path)
    with pytest.raises(ModelError, match="no inertial 'upper'.*none"):
        apply_edits(arm, [Set("inertial", "upper", {})], tmp_path)
    with pytest.raises(ModelError, match="no joint ''"):
        apply_edits(arm, [Set("joint", "", {})], tmp_path)
    with pytest.raises(ModelError, match="option> has no name"):
        apply_edits(arm, [Set("option", "o", {})], tmp_path)
    with pytest.raises(UnknownNameError, match="unknown tag 'leg'.*joint"):
        apply_edits(arm, [Set("leg", "x", {})], tmp_path)


@pytest.mark.parametrize("name", ["j", "j1", 1, 2])
def test_what_mujoco_makes_has_no_text(name, tmp_path):
    path = _write(
        tmp_path / "m.xml",
        """<mujoco><worldbody>
          <body name="b"><joint name="own"/><geom size="1"/></body>
          <replicate count="2" offset="1 0 0">
            <body name="r"><joint name="j"/><geom size="1"/></body>
          </replicate>
          <body><joint/><geom name="last" size="1"/></body>
        </worldbody></mujoco>""",
    )
    edit = Set("joint", name, {"damping": "1"})
    with pytest.raises(ModelError, match=r"no joint '.*j?.*'own'.*<replicate> makes"):
        apply_edits(path, [edit], tmp_path)
    after = _compiled(path, [Set("joint", 3, {"damping": "1"})])
    assert after.dof_damping.ravel()[[0, 3]].tolist() == [0, 1] or (
        after.dof_damping[3, 0] == 1
    )


def test_frames_are_seen_through(tmp_path):
    path = _write(
        tmp_path / "m.xml",
        """<mujoco><worldbody><body name="b">
          <body><joint/><geom size="1"/></body>
          <frame><frame><joint axis="1 0 0"/></frame><geom size="1"/></frame>
          <joint name="j"/>
        </body></worldbody></mujoco>""",
    )
    for k in range(3):
        after = _compiled(path, [Set("joint", k, {"armature": "1"})])
        assert np.flatnonzero(after.dof_armature == 1).tolist() == [k]


def test_inertias_go_by_their_body(tmp_path):
    inertial = '<inertial pos="0 0 0" mass="{}" diaginertia="1 1 1"/>'
    path = _write(
        tmp_path / "m.xml",
        f"""<mujoco><worldbody><body name="a">{inertial.format(1)}
          <body>{inertial.format(2)}</body></body></worldbody></mujoco>""",
    )
    edits = [Set("inertial", "a", {"mass": "3"}), Set("inertial", 2, {"mass": "4"})]
    assert _compiled(path, edits).body_mass.tolist() == [0, 3, 4]


def test_the_world_is_a_body(arm):
    for name in ("world", 0):
        after = _compiled(arm, [Insert("body", name, '<site name="here"/>')])
        assert after.site("here").bodyid == 0


# files


@pytest.fixture
def scene(tmp_path) -> Path:
    """A model of four files and a mesh in three folders."""
    _write(tmp_path / "robot/meshes/cube.obj", CUBE.format(1))
    _write(
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
    _write(
        tmp_path / "robot/leg.xml",
        """<mujocoinclude>
    <body name="leg"> <!-- left -->
      <joint name="hip"/><geom type="mesh" mesh="cube"/>
    </body>
</mujocoinclude>
""",
    )
    _write(
        tmp_path / "robot/motors.xml",
        '<mujoco><actuator><motor name="m" joint="hip"/></actuator></mujoco>',
    )
    return _write(
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
    changed = _changed(_given(scene), _compiled(scene, edits, folder))
    assert changed <= {*fields, "actuator_acc0"}
    assert len(changed & fields) == len(edits)


def test_an_include_stays_where_no_edit_falls_into_it(scene, tmp_path):
    given = scene.read_text()
    assert apply_edits(scene, [], tmp_path) == given
    floor = [Set("geom", "floor", {"friction": "1"}), Set("joint", "hip", {})]
    assert _lines(given, apply_edits(scene, floor, tmp_path)) == [
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
    _write(tmp_path / "sub/robot.xml", text)
    _write(tmp_path / "sub/m/c.obj", CUBE.format(1))
    path = _write(
        tmp_path / "m.xml", "<mujoco><include file='sub/robot.xml'/></mujoco>"
    )
    edit = Set("joint", "j", {"armature": "1"})
    assert _changed(_given(path), _compiled(path, [], "out")) == set()
    for folder in ("", "out"):
        changed = _changed(_given(path), _compiled(path, [edit], folder))
        assert "dof_armature" in changed and "mesh_vert" not in changed


DIRS = {  # compiler, mesh, texture, height field
    "none": ("", "m/c.obj", "t/t.png", "t/t.png"),
    "mesh": ('<compiler meshdir="m"/>', "c.obj", "t/t.png", "../t/t.png"),
    "both": ('<compiler meshdir="m" texturedir="t"/>', "c.obj", "t.png", "../t/t.png"),
    "asset": ('<compiler assetdir="m"/>', "c.obj", "../t/t.png", "../t/t.png"),
    "override": (
        '<compiler assetdir="t" meshdir="m"/>', "c.obj", "t.png", "../t/t.png"),
    "two": (
        '<compiler assetdir="x"/><compiler assetdir="t"/>', "../m/c.obj", "t.png",
        "t.png"),
    "strip": (
        '<compiler strippath="true" assetdir="a"/>', "x/c.obj", "/y/t.png", "t.png"),
}  # fmt: skip


@pytest.mark.parametrize("case", DIRS)
@pytest.mark.parametrize("folder", ["out", "../x/y"])
def test_every_way_to_name_assets_leads_to_them(case, folder, tmp_path):
    compiler, mesh, texture, field = DIRS[case]
    for place in ("m", "a"):
        _write(tmp_path / place / "c.obj", CUBE.format(1))
    for place in ("t", "a"):
        _write(tmp_path / place / "t.png", _png())
    path = _write(
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
    assert _changed(_given(path), _compiled(path, [], folder)) == set()
    new = apply_edits(path, [], tmp_path / folder)
    assert len(_lines(path.read_text(), new)) <= 2
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
    mesh = _write(tmp_path / "c.obj", CUBE.format(1))
    text = f"""<mujoco><asset><mesh name="c" file="{mesh}"/></asset></mujoco>"""
    path = _write(tmp_path / "m.xml", text)
    assert apply_edits(path, [], tmp_path / "out") == text


def test_an_attached_model_is_found_and_its_insides_have_no_text(tmp_path):
    child = "<mujoco><asset><mesh name='c' file='c.obj'/></asset>" + (
        "<worldbody><body name='b'><joint name='j'/><geom type='mesh' mesh='c'/>"
        "</body></worldbody></mujoco>"
    )
    _write(tmp_path / "sub/child.xml", child)
    _write(tmp_path / "sub/c.obj", CUBE.format(1))
    path = _write(
        tmp_path / "m.xml",
        "<mujoco><asset><model name='k' file='sub/child.xml'/></asset><worldbody>"
        "<frame><attach model='k' body='b' prefix='p_'/></frame></worldbody></mujoco>",
    )
    assert _changed(_given(path), _compiled(path, [], "out")) == set()
    with pytest.raises(ModelError, match="no joint 'p_j'.*<attach> makes"):
        apply_edits(path, [Set("joint", "p_j", {"damping": "1"})], tmp_path)


def test_missing_and_repeated_files_are_named(scene, tmp_path):
    with pytest.raises(ModelError, match=r"cannot read .*nowhere\.xml"):
        apply_edits(tmp_path / "nowhere.xml", [], tmp_path)
    path = _write(tmp_path / "m.xml", "<mujoco><include file='gone.xml'/></mujoco>")
    with pytest.raises(ModelError, match=r"cannot read .*gone\.xml"):
        apply_edits(path, [], tmp_path)
    path = _write(tmp_path / "m.xml", "<mujoco><include file='m.xml'/></mujoco>")
    with pytest.raises(ModelError, match=r"m\.xml is included twice"):
        apply_edits(path, [], tmp_path)


URDF = """<robot name="r">
  <mujoco><compiler meshdir="meshes" discardvisual="false"/></mujoco>
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><mesh filename="c.obj"/></geometry></collision></link>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
</robot>
"""


def test_a_urdf_becomes_an_mjcf(tmp_path):
    _write(tmp_path / "meshes/c.obj", CUBE.format(1))
    path = _write(tmp_path / "r.urdf", URDF)
    edits = [
        Set("joint", "elbow", {"frictionloss": "0.1"}),
        Insert("actuator", "", '<motor name="m" joint="elbow"/>'),
    ]
    after = _compiled(path, edits, "out")
    assert (after.dof_frictionloss[0], after.nu, after.nmesh) == (0.1, 1, 1)
    before = _given(path)
    for field in ("body_mass", "body_inertia", "jnt_range", "mesh_vert"):
        np.testing.assert_allclose(
            getattr(before, field), getattr(after, field), atol=1e-6
        )


@pytest.mark.parametrize("text", ["<robot><link/></robot>", "<sdf/>"])
def test_what_mujoco_cannot_turn_into_an_mjcf_is_refused(text, tmp_path):
    path = _write(tmp_path / "r.urdf", text)
    with pytest.raises(ModelError, match=r"r\.urdf: (MuJoCo cannot read|<sdf>)"):
        apply_edits(path, [], tmp_path)


def test_every_model_of_mujoco_comes_back_and_loads_from_elsewhere(tmp_path):
    folder = Path(mujoco.__file__).parent / "mjx" / "test_data"
    paths = [p for p in folder.rglob("*.xml") if p.stat().st_size < 30_000]
    for path in paths:
        try:
            before = _given(path)
        except ValueError:
            continue  # a part of another model
        assert apply_edits(path, [], path.parent) == path.read_text()
        new = _write(tmp_path / "out.xml", apply_edits(path, [], tmp_path))
        assert _changed(before, _given(new)) == set(), path


# numbers


def test_numbers_are_short_and_read_back_in_single_precision():
    rng = np.random.default_rng(0)
    values = rng.normal(size=500) * 10.0 ** rng.integers(-12, 12, 500)
    texts = format_number(values).split()
    np.testing.assert_allclose(np.float64(texts), values, rtol=2.0**-25)
    assert max(len(re.sub(r"e.*|^-?0\.0*|[-.]", "", t)) for t in texts) <= 9
    assert format_number([0.1 + 0.2, 1, -0.0, 1e-7, -2.5]) == "0.3 1 0 1e-07 -2.5"
    assert format_number(np.float64(0.25)) == "0.25"
    assert format_number(1e300) == "1e+300"
    for value in (np.nan, np.inf):
        with pytest.raises(ModelError, match="cannot be written"):
            format_number(value)


def test_the_text_does_not_depend_on_the_working_folder(scene, tmp_path, monkeypatch):
    whole = apply_edits(
        scene, [Set("joint", "hip", {"damping": "1"})], tmp_path / "out"
    )
    monkeypatch.chdir(tmp_path)
    edit = Set("joint", "hip", {"damping": "1"})
    assert apply_edits(os.path.basename(scene), [edit], "out") == whole
