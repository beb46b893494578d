"""Elements by name and id, and refusals of those that have no text."""

import numpy as np
import pytest

from selfheal.errors import ModelError, UnknownNameError
from selfheal.mjcf.edit import Insert, Set, apply_edits
from tests.support.mjcf_models import compile_edited, load_model, write_file


def test_an_id_is_that_of_the_compiled_model(arm, tmp_path):
    model = load_model(arm)
    for k in range(model.ngeom):
        new = apply_edits(
            arm, [Set("geom", np.int64(k), {"friction": "0.123"})], tmp_path
        )
        path = write_file(tmp_path / "new.xml", new)
        friction = load_model(path).geom_friction[:, 0]
        assert np.flatnonzero(friction == 0.123).tolist() == [k]


def test_ids_are_those_of_the_given_model_whatever_the_edits_add(arm, tmp_path):
    edits = [
        Insert("body", 0, '<geom size="1" pos="9 0 0"/>', first=True),
        Set("geom", 0, {"friction": "0.3"}),
    ]
    new = apply_edits(arm, edits, tmp_path)
    assert '<geom type="plane" size="1 1 1" friction="0.3"/>' in new


def test_an_unknown_name_lists_what_there_is(arm, tmp_path):
    with pytest.raises(ModelError, match=r"no joint 'toe'.*'hip', 'knee', 'free'"):
        apply_edits(arm, [Set("joint", "toe", {})], tmp_path)
    with pytest.raises(ModelError, match=r"no actuator 'x'.*'servo', 1 without a name"):
        apply_edits(arm, [Set("actuator", "x", {})], tmp_path)
    with pytest.raises(ModelError, match="no geom has id 9; there are 5"):
        apply_edits(arm, [Set("geom", 9, {})], tmp_path)
    with pytest.raises(ModelError, match=r"no inertial 'upper'.*none"):
        apply_edits(arm, [Set("inertial", "upper", {})], tmp_path)
    with pytest.raises(ModelError, match="no joint ''"):
        apply_edits(arm, [Set("joint", "", {})], tmp_path)
    with pytest.raises(ModelError, match="option> has no name"):
        apply_edits(arm, [Set("option", "o", {})], tmp_path)
    with pytest.raises(UnknownNameError, match=r"unknown tag 'leg'.*joint"):
        apply_edits(arm, [Set("leg", "x", {})], tmp_path)


@pytest.mark.parametrize("name", ["j", "j1", 1, 2])
def test_what_mujoco_makes_has_no_text(name, tmp_path):
    path = write_file(
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
    after = compile_edited(path, [Set("joint", 3, {"damping": "1"})])
    assert after.dof_damping.ravel()[[0, 3]].tolist() == [0, 1]


def test_frames_are_seen_through(tmp_path):
    path = write_file(
        tmp_path / "m.xml",
        """<mujoco><worldbody><body name="b">
          <body><joint/><geom size="1"/></body>
          <frame><frame><joint axis="1 0 0"/></frame><geom size="1"/></frame>
          <joint name="j"/>
        </body></worldbody></mujoco>""",
    )
    for k in range(3):
        after = compile_edited(path, [Set("joint", k, {"armature": "1"})])
        assert np.flatnonzero(after.dof_armature == 1).tolist() == [k]


def test_inertias_go_by_their_body(tmp_path):
    inertial = '<inertial pos="0 0 0" mass="{}" diaginertia="1 1 1"/>'
    path = write_file(
        tmp_path / "m.xml",
        f"""<mujoco><worldbody><body name="a">{inertial.format(1)}
          <body>{inertial.format(2)}</body></body></worldbody></mujoco>""",
    )
    edits = [Set("inertial", "a", {"mass": "3"}), Set("inertial", 2, {"mass": "4"})]
    assert compile_edited(path, edits).body_mass.tolist() == [0, 3, 4]


def test_the_world_is_a_body(arm):
    for name in ("world", 0):
        after = compile_edited(arm, [Insert("body", name, '<site name="here"/>')])
        assert after.site("here").bodyid == 0
