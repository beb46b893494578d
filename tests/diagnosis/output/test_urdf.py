"""A URDF from end to end: the patch is MJCF, and all that it stated is still there."""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis import diagnose as module
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.errors import ModelError, RecordingError
from selfheal.mjcf.edit import apply_edits
from selfheal.recording import (
    check_against_model,
    load_model,
    read,
    read_names,
    write,
)
from tests.support.commands.run import run_well
from tests.support.patched_models import check_patch, make_case
from tests.support.recorded_robots import NO_COMMAND, Robot, record

URDF = """<?xml version="1.0"?>
<robot name="two_links">
  <!-- they hang from a stand -->
  <link name="stand"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 -0.1"/>
      <mass value="0.4"/>
      <inertia ixx="0.0015" iyy="0.0015" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision>
      <origin xyz="0 0 -0.1"/>
      <geometry><box size="0.02 0.02 0.2"/></geometry>
    </collision>
  </link>
  <link name="lower">
    <inertial>
      <origin xyz="0 0 -0.1"/>
      <mass value="0.2"/>
      <inertia ixx="0.0008" iyy="0.0008" izz="5e-5" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="stand"/>
    <child link="upper"/>
    <origin xyz="0 0 1"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="30" velocity="10"/>
    <dynamics damping="0.01"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0 0 -0.2"/>
    <axis xyz="0 1 0"/>
    <dynamics damping="0.005"/>
  </joint>
</robot>
"""
SWINGING = Robot(
    URDF,
    {
        "shoulder": ("joint_position", "shoulder", "rad"),
        "elbow": ("joint_position", "elbow", "rad"),
    },
    NO_COMMAND,
    lambda rng: (0.6 * rng.normal(size=2), np.zeros(2)),
)
DRY = 0.02  # [N m]


def _dry(model) -> None:
    model.dof_frictionloss[0] = DRY


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A folder with a URDF, a recording, and the diagnosis in `out`."""
    home = tmp_path_factory.mktemp("urdf")
    (home / "robot.urdf").write_text(URDF)
    recording = record(SWINGING, episodes=5, change=_dry, finer=1)
    write(recording, home / "recording.h5")
    names = ("coulomb_friction", "payload", "joint_spring")
    small = {n: load_catalogue()[n] for n in names}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "load_catalogue", lambda: small)
        out = ["--out", home / "out"]
        run_well("diagnose", home / "robot.urdf", home / "recording.h5", *out)
    return home


@pytest.mark.slow
def test_the_patch_is_mjcf_with_the_missing_friction(diagnosed):
    path = diagnosed / "out" / "patched.xml"
    assert ElementTree.parse(path).getroot().tag == "mujoco"
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.joint("shoulder").frictionloss[0] == pytest.approx(DRY, rel=0.2)
    assert model.joint("elbow").frictionloss[0] == 0
    given = load_model(diagnosed / "robot.urdf")
    for field in ("jnt_range", "jnt_limited", "jnt_actfrcrange", "qpos0"):
        np.testing.assert_allclose(getattr(model, field), getattr(given, field))


@pytest.mark.slow
@pytest.mark.parametrize("other", [[], ["--model", "robot.urdf"]])
def test_it_is_replayed_on_the_patch_and_on_the_urdf(
    other, diagnosed, tmp_path, monkeypatch
):
    monkeypatch.chdir(diagnosed)
    out = tmp_path / "predicted.h5"
    run_well("replay", "out", "recording.h5", "--out", out, *other)
    measured, predicted = read("recording.h5"), read(out)
    for name, episode in measured.episodes.items():
        for key, signal in episode.signals.items():
            apart = predicted.episodes[name].signals[key].values - signal.values
            assert np.sqrt(np.mean(apart**2)) < 2 * SWINGING.noise


@pytest.mark.parametrize("name", ["robot.urdf", "robot.URDF", "robot"])
def test_the_mjcf_of_a_urdf_is_the_same_model(name, tmp_path):
    (tmp_path / name).write_text(URDF)
    text = apply_edits(tmp_path / name, (), tmp_path)
    new = mujoco.MjModel.from_xml_string(text)
    given = load_model(tmp_path / name)
    kinds = ("body_", "jnt_", "dof_", "geom_", "qpos")
    for field in [f for f in dir(given) if f.startswith(kinds)]:
        both = [np.asarray(getattr(m, field), float) for m in (new, given)]
        np.testing.assert_allclose(*both, rtol=1e-6, atol=1e-9, err_msg=field)


def test_the_text_says_what_the_diagnosis_means(tmp_path):
    """Every stated value changed, of links that stand on a fixed one, turned."""
    fixed = """<link name="floor"/><joint name="foot" type="fixed">
    <parent link="floor"/><child link="stand"/><origin xyz="1 2 3" rpy="0 0 0.5"/>
    </joint><link name="stand"/>"""
    (tmp_path / "robot.urdf").write_text(URDF.replace('<link name="stand"/>', fixed))
    case = make_case(tmp_path / "robot.urdf", SWINGING)
    terms = build_nominal_terms(case.robot)
    check_patch(case, terms, np.linspace(0.98, 1.02, len(terms)), tmp_path)


def test_commands_to_a_urdf_are_refused_with_what_would_help(recording, tmp_path):
    (tmp_path / "robot.urdf").write_text(URDF)
    with pytest.raises(RecordingError, match=r"'pusher'.*selfheal model prepare"):
        check_against_model(recording, read_names(tmp_path / "robot.urdf"))


def test_a_mesh_of_a_ros_package_is_refused_with_what_would_help(tmp_path):
    mesh = '<mesh filename="package://robot/link.stl"/>'
    text = URDF.replace('<box size="0.02 0.02 0.2"/>', mesh)
    (tmp_path / "robot.urdf").write_text(text)
    with pytest.raises(ModelError, match=r"link\.stl.*would fit.*strippath"):
        load_model(tmp_path / "robot.urdf")
