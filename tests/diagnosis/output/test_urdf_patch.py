"""A URDF's own text with what a diagnosis found, as far as URDF can hold it."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from selfheal.diagnosis.effects.inertia import spatial_inertia
from selfheal.diagnosis.output.urdf_patch import UrdfPatch, explain_urdf
from selfheal.mjcf.edit import Set
from selfheal.preparation.drives import Gains
from selfheal.preparation.prepare import prepare_model, write_model
from selfheal.recording import load_model
from tests.support.diagnosis_folder import save_diagnosis
from tests.support.mjcf_models import CUBE, write_file

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <!-- it stands -->
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0.01 -0.1" rpy="0.3 0 0.2"/> <mass value = '0.4'/>
      <inertia ixx="0.0015" ixy="1e-5" ixz="0" iyy="0.0017" iyz="0" izz="0.001"/>
    </inertial>
    <collision><geometry><mesh filename="meshes/c.obj"/></geometry></collision>
  </link>
  <link name="tool"><inertial><mass value="0.1"/><inertia ixx="1e-4"
    iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="30" velocity="10"/>
    <dynamics damping="0.01"/></joint>
  <joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/>
    <origin xyz="0 0 -0.2" rpy="0 0 1"/></joint>
</robot>
"""


@pytest.fixture
def given(tmp_path):
    write_file(tmp_path / "meshes" / "c.obj", CUBE.format(0.1))
    return write_file(tmp_path / "arm.urdf", URDF)


def _edit(given, **changes):
    """The folder of a diagnosis that sets attributes of the joint, or the body."""
    return save_diagnosis(given, [Set("joint", "shoulder", changes)])


def _list_changes(out):
    lines = (out / "patched.diff").read_text().splitlines()
    return [line for line in lines if re.match(r"[+-](?![+-])", line)]


def test_a_change_of_friction_is_one_line(given):
    out = _edit(given, damping="0.02", frictionloss="0.14")
    old, new = _list_changes(out)
    assert old == '-    <dynamics damping="0.01"/></joint>'
    assert new == '+    <dynamics damping="0.02" friction="0.14"/></joint>'
    model = load_model(out / "patched.urdf")  # its mesh is found from there
    assert model.joint("shoulder").frictionloss[0] == pytest.approx(0.14)
    assert model.nmesh == 1


def test_the_diff_makes_the_users_file_the_patched_one(given):
    out = _edit(given, damping="0.02", actuatorfrcrange="-25 25", range="-2 2.5")
    assert len(_list_changes(out)) == 4
    if git := shutil.which("git"):
        subprocess.run([git, "apply", "out/patched.diff"], cwd=given.parent, check=True)
        model, patched = load_model(given), load_model(out / "patched.xml")
        for field in ("dof_damping", "jnt_range", "jnt_actfrcrange", "body_inertia"):
            values = [getattr(m, field) for m in (model, patched)]
            np.testing.assert_allclose(*values, rtol=1e-5)


def test_an_inertia_changes_in_the_link_that_states_it(given):
    """A tool at a fixed joint, which is one body with the link, stays as it is."""
    body = {"mass": "0.6", "pos": "0.01 0.01 -0.12", "quat": "1 0 0 0"}
    body["diaginertia"] = "0.004 0.004 0.002"
    out = save_diagnosis(given, [Set("inertial", "upper", body)])
    urdf, patched = load_model(out / "patched.urdf"), load_model(out / "patched.xml")
    assert urdf.body("upper").mass[0] == pytest.approx(0.6)
    np.testing.assert_allclose(urdf.body("upper").ipos, [0.01, 0.01, -0.12], atol=1e-7)
    both = [spatial_inertia(m, m.body("upper").id) for m in (urdf, patched)]
    np.testing.assert_allclose(*both, rtol=1e-5, atol=1e-8)
    text = (out / "patched.urdf").read_text()
    assert 'rpy="0.3 0 0.2"' in text and '<mass value="0.1"/>' in text
    assert "mass value = '0.5'" in text


def test_what_urdf_cannot_hold_is_said(given):
    out = _edit(given, armature="0.01", stiffness="2", damping="0.3")
    models = load_model(given), load_model(out / "patched.xml")
    (said,) = explain_urdf(given, *models)
    assert "armature of shoulder" in said and "stiffness of shoulder" in said
    assert "damping of shoulder" not in said and "inertia" not in said
    assert explain_urdf(given, models[0], models[0]) == []
    assert UrdfPatch(given, models[0], models[0]).diff == ""


def test_an_mjcf_gets_no_urdf(tmp_path):
    path = write_file(tmp_path / "m.xml", "<mujoco><worldbody/></mujoco>")
    assert not (save_diagnosis(path, ()) / "patched.urdf").exists()


def test_a_model_that_was_prepared_of_a_urdf_gives_that_back(given):
    out = given.parent / "models" / "arm.xml"
    out.parent.mkdir()
    plain = {"weld_base": False, "without_contacts": False}
    made = prepare_model(given, out.parent, Gains({"": 20.0}, {}), **plain)
    write_model(made, out)
    servo = {"kp": "22", "forcerange": "-25 25"}
    friction = Set("joint", "shoulder", {"frictionloss": "0.14"})
    folder = save_diagnosis(out, [friction, Set("actuator", "shoulder", servo)])
    text = (folder / "patched.urdf").read_text()
    assert 'friction="0.14"' in text and 'effort="25"' in text
    assert load_model(folder / "patched.urdf").nmesh == 1
    assert not (folder / "patched.diff").read_text()  # the MJCF's, made up
    models = load_model(out), load_model(folder / "patched.xml")
    assert explain_urdf(given, *models) == []
