"""Default classes say once what all of their joints are to have."""

import pytest

from selfheal.diagnosis.output.model_source import compile_patched, is_same_model
from selfheal.mjcf.defaults import fold_into_defaults
from selfheal.mjcf.edit import Insert, Set, SetDefault
from tests.support.mjcf_models import write_file

LEG = """<mujoco>
  <default>
    <default class="leg">
      <joint damping="0.1"/>
      <default class="hip"><joint axis="0 1 0" range="-1 1"/></default>
      <default class="calf"><joint axis="0 1 0" damping="0.3"/></default>
    </default>
  </default>
  <worldbody>
    <body childclass="leg"><geom size=".1"/>{}<joint name="a" class="hip"/>
      <body><geom size=".1"/><joint name="b" class="hip" armature="0.1"/>
        <body><geom size=".1"/><joint class="calf"/>
          <body><geom size=".1"/><joint name="d" class="calf"/></body></body></body>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = ("a", "b", 2, "d")  # the third has no name


def _set(names, **attributes) -> list[Set]:
    return [Set("joint", name, attributes) for name in names]


CASES = {
    "all joints": (_set(JOINTS, frictionloss="0.2"), {"main"}),
    "those of a class": (_set(JOINTS[2:], armature="0.01"), {"calf"}),
    "those that inherit it from an outer class": (_set("ab", damping="0.2"), {"leg"}),
    "one is missing": (_set("ab", frictionloss="0.2"), {"hip"}),
    "one of a class is missing": (_set("a", frictionloss="0.2"), set()),
    "one has another value": (
        [*_set("a", stiffness="1"), *_set("b", stiffness="2")],
        set(),
    ),
    "one states its own": (_set("ab", armature="0.2"), set()),
    "two attributes, one of them alike": (
        [*_set("ab", stiffness="1"), *_set("a", damping="2")],
        {"hip"},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_class_says_what_all_of_its_joints_agree_in(case, tmp_path):
    edits, classes = CASES[case]
    path = write_file(tmp_path / "leg.xml", LEG.format(""))
    folded = fold_into_defaults(path, edits)
    assert {e.name for e in folded if isinstance(e, SetDefault)} == classes
    assert len(folded) <= len(edits)
    one, other = (compile_patched(path, e) for e in (edits, folded))
    assert is_same_model(one, other)
    assert not is_same_model(one, compile_patched(path, ()))


def test_a_joint_that_an_edit_inserts_is_left_alone(tmp_path):
    path = write_file(tmp_path / "leg.xml", LEG.format(""))
    body = LEG[LEG.index("<body childclass") :].replace("<body ", '<body name="top" ')
    path = write_file(path, LEG[: LEG.index("<body childclass")] + body.format(""))
    edits = [
        Insert("body", "top", '<joint name="a_play"/>'),
        *_set(("a_play",), range="-0.1 0.1"),
        *_set(JOINTS, stiffness="0.2"),
    ]
    folded = fold_into_defaults(path, edits)
    assert isinstance(folded[0], SetDefault) and edits[1] in folded
    one, other = (compile_patched(path, e) for e in (edits, folded))
    assert not is_same_model(one, other)  # the new joint would inherit it


def test_what_mujoco_multiplies_is_left_alone(tmp_path):
    more = '<replicate count="2" offset="1 0 0"><geom size=".1"/></replicate>'
    path = write_file(tmp_path / "leg.xml", LEG.format(more))
    edits = _set(JOINTS, frictionloss="0.2")
    assert fold_into_defaults(path, edits) == edits
