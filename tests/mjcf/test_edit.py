"""Edits of a model's text: what changes is what was asked for, and nothing else."""

import re
import shutil
import subprocess
from pathlib import Path

import mujoco
import numpy as np
import pytest

from selfheal.errors import ModelError
from selfheal.mjcf.edit import (
    Insert,
    Rename,
    Set,
    apply_edits,
    format_number,
    unified_diff,
)
from tests.support.mjcf_models import (
    ARM,
    compile_edited,
    list_changed_fields,
    list_changed_lines,
    load_model,
    write_file,
)


def test_no_edits_give_the_same_text(arm, tmp_path):
    assert apply_edits(arm, [], tmp_path) == ARM
    assert apply_edits(arm, [], tmp_path / "elsewhere") == ARM
    assert unified_diff(ARM, ARM, "arm.xml") == ""


@pytest.mark.skipif(shutil.which("git") is None, reason="no git to apply a diff")
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("last", ["", "\n"], ids=["no last line end", "last line end"])
def test_a_diff_is_what_git_applies(ends, last, tmp_path):
    given = ARM.strip().replace("\n", ends) + last.replace("\n", ends)
    arm = write_file(tmp_path / "arm.xml", given)
    new = apply_edits(arm, [Set("joint", "hip", {"armature": "0.02"})], tmp_path)
    diff = unified_diff(given, new, "arm.xml")
    (tmp_path / "patched.diff").write_bytes(diff.encode())
    command = ["git", "apply", "--whitespace=nowarn", "patched.diff"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert arm.read_bytes().decode() == new != given


def test_values_that_are_there_keep_their_spelling(arm, tmp_path):
    edits = [
        Set("joint", "hip", {"armature": "0.01", "axis": "0 1.0 0", "damping": None}),
        Set("geom", "bone", {"size": "0.1"}),
        Set("compiler", "", {"angle": "radian"}),
        Rename("actuator", "servo", "position", {"kp": "1e1"}),
    ]
    assert apply_edits(arm, edits, tmp_path) == ARM


FORCES = {"actuator_forcerange", "actuator_forcelimited"}
SETS = [
    (Set("joint", "hip", {"armature": "0.02"}), {"dof_armature"}),
    (Set("joint", "hip", {"frictionloss": "1"}), {"dof_frictionloss"}),
    (Set("joint", "knee", {"damping": "0.7"}), {"dof_damping"}),
    (Set("joint", 0, {"frictionloss": "1"}), {"dof_frictionloss"}),
    (Set("geom", 0, {"friction": "0.3"}), {"geom_friction"}),
    (Set("geom", "cap", {"friction": "0.3"}), {"geom_friction"}),
    (Set("body", "ball", {"pos": "0 0 3"}), {"body_pos", "qpos0", "qpos_spring"}),
    (Set("site", "top", {"pos": "0 0 1"}), {"site_pos", "site_sameframe"}),
    (Set("actuator", "servo", {"forcerange": "-1 1"}), FORCES),
    (Set("actuator", 1, {"gear": "2"}), {"actuator_gear"}),
    (Set("sensor", "angle", {"noise": "0.1"}), {"sensor_noise"}),
    (Set("option", "", {"density": "1.2"}), {"opt.density"}),
    (Insert("actuator", "", '<motor joint="hip"/>'), {"nu"}),
    (Insert("worldbody", "", "<site/>"), None),
]


def _name_case(value) -> str:
    return " ".join(sorted(value)) if isinstance(value, set) else str(value)[:40]


@pytest.mark.parametrize("edit, fields", SETS[:-1], ids=_name_case)
def test_only_what_was_asked_for_changes(arm, edit, fields):
    before, after = load_model(arm), compile_edited(arm, [edit], "out")
    changed = list_changed_fields(before, after)
    # what follows from the change: weights at rest, size, names
    changed = {f for f in changed if not re.search("weight0|M0|nbuffer|narena|acc0", f)}
    if fields == {"nu"}:
        assert before.nu + 1 == after.nu
        assert not {f for f in changed if f.startswith(("jnt_", "body_", "geom_"))}
    else:
        assert changed == fields
    diff = list_changed_lines(ARM, apply_edits(arm, [edit], arm.parent))
    assert len(diff) <= 2


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
    assert list_changed_lines(ARM, apply_edits(arm, [rename], tmp_path)) == [
        '-    <position name="servo" joint="hip" kp="10"/>',
        '+    <general name="servo" joint="hip" gainprm="10" biastype="affine" '
        'biasprm="0 -10 0"/>',
    ]
    changed = list_changed_fields(load_model(arm), compile_edited(arm, [rename]))
    assert {f for f in changed if "actuator_" in f} <= {"actuator_ctrlspec"}


def _edit_text(tmp_path, text: str, edit: Set | Insert | Rename) -> str:
    path = write_file(tmp_path / "m.xml", f"<mujoco>{text}</mujoco>")
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
    assert _edit_text(tmp_path, before, Insert("body", "b", "<X/>")) == after


def test_the_first_place_is_before_comments_but_not_those_of_the_line(tmp_path):
    body = '    <body name="b">  <!-- b -->\n      <!-- j -->\n      <joint/>\n'
    before = WORLD.format(f"{body}    </body>")
    insert = Insert("body", "b", "<X>\n  <Y/>\n</X>", first=True)
    after = before.replace(
        "<!-- b -->\n", "<!-- b -->\n      <X>\n        <Y/>\n      </X>\n"
    )
    assert _edit_text(tmp_path, before, insert) == after


def test_sections_are_made_where_they_are_missing(tmp_path):
    path = write_file(tmp_path / "m.xml", ARM.replace("actuator>", "custom>"))
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
    model = compile_edited(path, edits)
    assert (model.nu, model.nexclude, model.neq) == (1, 1, 1)
    assert (model.opt.timestep, model.actuator_gear[0, 0]) == (0.001, 3)
    new = apply_edits(path, edits, tmp_path)
    assert (
        '  <actuator>\n    <motor name="m" joint="hip" gear="3"/>\n  </actuator>' in new
    )
    assert [c for c in list_changed_lines(path.read_text(), new) if c[0] == "-"] == []


BODY = "<worldbody><body>{}<geom size='1'/></body></worldbody>"
TWICE = '<option{}/><worldbody/><option{} density="1"/>'
TEXTS = {  # before, edit, after
    "one line": (
        "<worldbody/>",
        Set("option", "", {"timestep": "1"}),
        '<option timestep="1"/><worldbody/>',
    ),
    "the last setting counts": (
        TWICE.format(' timestep="0.1"', ' timestep="0.2"'),
        Set("option", "", {"timestep": "0.3"}),
        TWICE.format(' timestep="0.1"', ' timestep="0.3"'),
    ),
    "a setting is removed wherever it is": (
        TWICE.format(' timestep="0.1"', ' timestep="0.2"'),
        Set("option", "", {"timestep": None}),
        TWICE.format("", ""),
    ),
    "an open element has its end renamed": (
        BODY.format("<freejoint></freejoint >"),
        Rename("joint", 0, "joint", {"type": "free"}),
        BODY.format('<joint type="free"></joint>'),
    ),
}


@pytest.mark.parametrize("case", TEXTS)
def test_an_edit_changes_the_text_where_it_says_so(case, tmp_path):
    before, edit, after = TEXTS[case]
    assert _edit_text(tmp_path, before, edit) == after


def test_every_model_of_mujoco_comes_back_and_loads_from_elsewhere(tmp_path):
    folder = Path(mujoco.__file__).parent / "mjx" / "test_data"
    paths = [p for p in folder.rglob("*.xml") if p.stat().st_size < 30_000]
    for path in paths:
        try:
            before = load_model(path)
        except ValueError:
            continue  # a part of another model
        assert apply_edits(path, [], path.parent) == path.read_text()
        new = write_file(tmp_path / "out.xml", apply_edits(path, [], tmp_path))
        assert list_changed_fields(before, load_model(new)) == set(), path


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
