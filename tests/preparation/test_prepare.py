"""A URDF becomes a model that can be driven, checked and diagnosed."""

import json
import re

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.preparation.contacts import POSES, draw_pose, find_touching_pairs
from selfheal.preparation.inertias import find_possible_inertia
from selfheal.recording import load_model, write
from tests.support.commands.run import refuse, run_well
from tests.support.mjcf_models import CUBE, write_file
from tests.support.recorded_robots import Robot, record

INERTIAL = """<inertial><origin xyz="0 0 0.1"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""
ARM = f"""<robot name="arm">
  <link name="base"><collision><origin xyz="0 0 0.1"/><geometry>
    <cylinder radius="0.1" length="0.2"/></geometry></collision></link>
  <link name="upper">{INERTIAL}
    <visual><geometry><mesh filename="package://arm/meshes/upper.dae"/></geometry>
    </visual><collision><origin xyz="0 0 0.1"/><geometry>
    <cylinder radius="0.04" length="0.25"/></geometry></collision></link>
  <link name="lower">{INERTIAL}</link>
  <link name="finger">{INERTIAL}</link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="30" velocity="3.5"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="lower"/><child link="finger"/>
    <origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="5" velocity="0.2"/>
    <mimic joint="elbow" multiplier="0.01" offset="0.02"/></joint>
</robot>
"""
SEEN = """<mujoco><asset><mesh name="skin" file="skin.stl"/><mesh file="cube.obj"/>
  </asset><worldbody><body name="link"><joint name="hinge"/><geom size="0.1"/>
  <geom type="mesh" mesh="{}" contype="0" conaffinity="0" mass="0"/></body></worldbody>
</mujoco>"""


def _prepare(text, tmp_path, *options, name="robot.urdf"):
    """The compiled model that the command makes of a text, and what it says."""
    path, out = write_file(tmp_path / name, text), tmp_path / "out" / "m.xml"
    said = run_well("model", "prepare", path, "--out", out, *options)
    return mujoco.MjModel.from_xml_path(str(out)), said


def test_a_urdf_gets_servos_where_joints_are_free_to_be_driven(tmp_path):
    model, said = _prepare(ARM, tmp_path, "--kp", 60, "--kv", 2, "--kp", "elbow=20")
    assert [model.actuator(a).name for a in range(model.nu)] == ["shoulder", "elbow"]
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], [60, 20])
    np.testing.assert_allclose(model.actuator_biasprm[:, 1:3], [[-60, -2], [-20, -2]])
    np.testing.assert_allclose(model.actuator_forcerange, [[-30, 30], [0, 0]])
    assert list(model.jnt_actfrclimited[:2]) == [0, 0]  # stated once
    np.testing.assert_allclose(model.eq_data[0, :2], [0.02, 0.01])
    assert "'grip': no drive, it follows 'elbow'" in said
    for words in ("'shoulder' 3.5 rad/s", "'world' and 'upper'", "upper.dae", "30 N m"):
        assert words in said


def test_a_servo_without_a_known_damping_is_damped_critically(tmp_path):
    model, said = _prepare(ARM, tmp_path, "--kp", 60)
    for a, (kp, kv) in enumerate(-model.actuator_biasprm[:, 1:3]):
        inertia = model.dof_M0[model.jnt_dofadr[model.actuator_trnid[a, 0]]]
        assert kv == pytest.approx(2 * np.sqrt(kp * inertia), rel=1e-3)
    assert said.count("critical") == model.nu


def test_motors_are_driven_by_torques(tmp_path):
    model, _ = _prepare(ARM, tmp_path, "--motors", "--passive", "elbow")
    assert [model.actuator(a).name for a in range(model.nu)] == ["shoulder"]
    assert model.actuator_gainprm[0, 0] == 1 and not model.actuator_biasprm.any()


def test_check_and_diagnose_read_what_was_prepared(tmp_path):
    _prepare(ARM, tmp_path, "--kp", 60)
    out = tmp_path / "out" / "m.xml"
    signals = {j: ("joint_position", j, "rad") for j in ("shoulder", "elbow")}
    robot = Robot(
        out.read_text(),
        signals,
        lambda t, rng: 0.2 * np.sin(3 * t)[:, None] * np.ones(2),
        lambda rng: (np.array([0, 0, 0.02]), np.zeros(3)),
    )
    recording = record(robot, episodes=1, seconds=0.5)
    write(recording, tmp_path / "r.h5")
    told = run_well("recording", "check", tmp_path / "r.h5", "--model", out)
    assert "keeps the contract and fits" in told
    simulator = build_simulator(ModelCompiler(str(out)), [recording])
    assert {c.name for c in simulator.channels} == {"shoulder", "elbow"}


def test_bodies_that_touch_in_every_pose_no_longer_do(tmp_path):
    model, _ = _prepare(ARM, tmp_path, "--kp", 60)
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(POSES):
        data.qpos[:] = draw_pose(model, rng)
        mujoco.mj_fwdPosition(model, data)
        assert data.ncon == 0
        low, high = model.jnt_range[0]
        assert low <= data.qpos[0] <= high
        assert data.qpos[2] == pytest.approx(0.02 + 0.01 * data.qpos[1])


def test_what_touches_at_times_or_where_a_free_body_lies_stays():
    ball = '<geom name="{}" size="0.1" pos="{} 0 0"/>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/>
        <body name="car"><freejoint/>{ball.format("belly", 0)}</body>
        <body name="arm" pos="5 0 5"><joint axis="0 1 0"/>{ball.format("a", 1)}</body>
        <body name="leg" pos="5 0 5"><joint axis="0 1 0"/>{ball.format("b", 1)}</body>
        </worldbody></mujoco>"""
    )
    assert find_touching_pairs(model) == []


def test_a_base_is_welded_and_keyframes_that_no_longer_fit_go(tmp_path):
    text = """<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint/>
      <geom size="0.1"/><body name="leg" pos="0 0 -0.3"><joint name="hip"/>
      <geom size="0.05"/></body></body></worldbody>
      <keyframe><key name="home" qpos="0 0 1 1 0 0 0 0.5"/><key name="rest" qpos="0.5"/>
      </keyframe></mujoco>"""
    model, said = _prepare(text, tmp_path, "--kp", 5, "--weld-base", name="m.xml")
    assert (model.nq, model.nkey, model.key(0).name) == (1, 1, "rest")
    np.testing.assert_allclose(model.body("trunk").pos, [0, 0, 1])
    assert "'trunk' is fixed" in said and "'home': its qpos has 8 numbers" in said


def test_a_base_is_welded_without_gains_where_each_joint_has_a_drive(tmp_path):
    text = """<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint/>
      <geom size="0.1"/><body name="leg" pos="0 0 -0.3"><joint name="hip"/>
      <geom size="0.05"/></body></body></worldbody>
      <actuator>DRIVES</actuator></mujoco>"""
    driven = text.replace("DRIVES", '<motor name="m" joint="hip" gear="3"/>')
    model, _ = _prepare(driven, tmp_path, "--weld-base", name="m.xml")
    assert (model.nq, model.nu, model.actuator("m").gear[0]) == (1, 1, 3)
    bare = write_file(tmp_path / "bare.xml", text.replace("DRIVES", ""))
    out = tmp_path / "none.xml"
    said = refuse("model", "prepare", bare, "--weld-base", "--out", out)
    assert "'hip' has no drive" in said and not out.exists()


@pytest.mark.parametrize("moments", ["1e-6 1e-6 1e-6", "0.05 0 0", "0.1 0.1 -0.01"])
def test_an_inertia_of_no_body_becomes_a_possible_one(moments, tmp_path):
    """It is diagonal, or with products as large as its moments."""
    ixx, iyy, izz = moments.split()
    product = "1e-6" if ixx == iyy == izz else "0"
    stated = f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="{product}"'
    text = ARM.replace('<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0"', stated, 1)
    model, said = _prepare(text, tmp_path, "--kp", 60)
    a, b, c = np.sort(model.body("upper").inertia)
    assert a > 0 and a + b >= c * (1 - 1e-9)
    assert (
        "link 'upper': its inertia is of no body" in said and "'lower': its" not in said
    )


def test_an_inertia_that_a_body_can_have_stays():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(5, 3))
    inertia = sum(p @ p * np.eye(3) - np.outer(p, p) for p in points)
    np.testing.assert_allclose(find_possible_inertia(inertia), inertia)


def test_without_contacts_meshes_that_cannot_be_read_are_left_out(tmp_path):
    mesh = '<mesh filename="package://arm/c.dae"/>'
    text = ARM.replace('<cylinder radius="0.04" length="0.25"/>', mesh)
    path, out = write_file(tmp_path / "a.urdf", text), tmp_path / "out" / "m.xml"
    said = refuse("model", "prepare", path, "--out", out, "--motors")
    assert "c.dae" in said and "--no-contacts" in said
    model, said = _prepare(text, tmp_path, "--motors", "--no-contacts")
    assert (model.ngeom, model.nu) == (0, 2) and "left out shapes" in said


def test_driven_joints_keep_their_actuators(tmp_path):
    text = """<mujoco><worldbody><body><joint name="a"/><geom size="0.1"/>
      <body><joint name="b"/><geom size="0.1"/></body></body></worldbody>
      <actuator><motor name="m" joint="a"/></actuator></mujoco>"""
    servo = text.replace("<motor", '<position kp="3"')
    cases = [(servo, ("--kp", 5)), (text, ("--kp", "b=5"))]
    for given, options in (*cases, (text, ("--kp", 5, "--passive", "a"))):
        model, said = _prepare(given, tmp_path, *options, name="m.xml")
        assert [model.actuator(a).name for a in range(model.nu)] == ["m", "b"]
        assert ("joint 'a': it keeps its motor" in said) == ("--passive" in options)
        assert model.actuator_gainprm[0, 0] == (3 if given is servo else 1)
        (tmp_path / "out" / "m.xml").unlink()


def test_gains_that_no_joint_takes_are_told(tmp_path):
    servo = "<actuator><position kp='3' joint='hinge'/></actuator></mujoco>"
    text = SEEN.format("skin").replace("</mujoco>", servo)
    write_file(tmp_path / "cube.obj", CUBE.format(1))
    _, said = _prepare(text, tmp_path, "--kp", 5, name="m.xml")
    assert "no joint needed a drive, so the gains that were given change" in said


def test_gains_put_servos_as_strong_in_the_places_of_motors(tmp_path):
    """Of motors with gears, limits and classes, in the order in which they were."""
    text = """<mujoco><default><motor ctrlrange="-2 2" gear="6"/></default><worldbody>
      <body><joint name="a"/><geom size="0.1"/><body><joint name="b"/>
      <geom size="0.1"/></body></body></worldbody><actuator><motor name="second"
      joint="b"/><motor name="first" joint="a" ctrllimited="false"/></actuator>
      <keyframe><key name="home" ctrl="1 1"/></keyframe></mujoco>"""
    gains = ("--kp", 5, "--kp", "b=4", "--kv", 1)
    model, said = _prepare(text, tmp_path, *gains, name="m.xml")
    assert [model.actuator(a).name for a in range(model.nu)] == ["second", "first"]
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], [4, 5])
    np.testing.assert_allclose(model.actuator_biasprm[:, 1:3], [[-4, -1], [-5, -1]])
    assert list(model.actuator_gear[:, 0]) == [1, 1]
    assert list(model.actuator_forcelimited) == [1, 0]
    assert not model.actuator_ctrllimited.any() and not model.key_ctrl.any()
    np.testing.assert_allclose(model.actuator_forcerange[0], [-12, 12])
    assert said.count("in the place of a torque motor") == 2


def test_a_mesh_that_is_only_seen_may_be_missing_or_unreadable(tmp_path):
    write_file(tmp_path / "cube.obj", CUBE.format(1))
    path = write_file(tmp_path / "seen.xml", SEEN.format("skin"))
    given = load_model(path)
    assert (given.ngeom, given.nmesh) == (1, 0)
    assert ModelCompiler(str(path)).compile_variant(()).model.ngeom == 1
    model, said = _prepare(SEEN.format("skin"), tmp_path, "--motors", name="m.xml")
    assert model.nu == 1 and "skin.stl" in said


def test_meshes_are_found_from_where_the_model_goes(tmp_path):
    """Of a package that the URDF lies in, too."""
    write_file(tmp_path / "arm" / "meshes" / "c.obj", CUBE.format(0.1))
    mesh = '<mesh filename="package://arm/meshes/c.obj"/>'
    text = ARM.replace('<cylinder radius="0.04" length="0.25"/>', mesh)
    model, _ = _prepare(text, tmp_path, "--kp", 1, name="arm/urdf/arm.urdf")
    assert model.nmesh == 1


XACRO = ARM.replace("</robot>", "<xacro:arm/></robot>")
CYLINDER = '<cylinder radius="0.04" length="0.25"/>'
MISSING = ARM.replace(CYLINDER, '<mesh filename="package://arm/c.stl"/>')


@pytest.mark.parametrize(
    ("name", "text", "options", "words"),
    [
        ("a.urdf.xacro", ARM, ["--kp", "1"], "run xacro first: xacro .*> a.urdf"),
        ("a.urdf", XACRO, ["--motors"], "run xacro first: xacro .*> a_plain.urdf"),
        ("a.urdf", ARM, [], "--kp VALUE"),
        ("a.urdf", ARM, ["--kp", "elbow=3"], "'shoulder' has no --kp"),
        ("a.urdf", ARM, ["--kp", "3", "--kp", "knee=3"], "'knee'; valid: elbow, sho"),
        ("a.urdf", ARM, ["--kp", "stiff"], "--kp stiff: would fit: a number"),
        ("a.urdf", MISSING, ["--kp", "1"], "c.stl"),
    ],
)
def test_what_cannot_be_prepared_is_refused_and_nothing_written(
    name, text, options, words, tmp_path
):
    path, out = write_file(tmp_path / name, text), tmp_path / "m.xml"
    said = refuse("model", "prepare", path, "--out", out, *options)
    assert re.search(words, said) and not out.exists()


def test_xacro_is_told_apart_wherever_a_model_is_read(tmp_path, monkeypatch):
    write_file(tmp_path / "a.xacro", ARM)
    write_file(tmp_path / "log.csv", "time,shoulder\n0,0\n")
    log, model, out = (tmp_path / name for name in ("log.csv", "a.xacro", "map.toml"))
    words = (log, "--guess", "--model", model, "--out", out)
    said = refuse("recording", "import", *words)
    assert "run xacro first" in said


def test_the_steps_are_there_for_scripts(tmp_path):
    path = write_file(tmp_path / "a.urdf", ARM)
    out = tmp_path / "m.xml"
    told = json.loads(
        run_well("model", "prepare", path, "--motors", "--out", out, "--json")
    )
    assert told["format"] == "selfheal-prepare" and told["out"] == str(out)
    assert any("grip" in step for step in told["steps"])
    refuse("model", "prepare", path, "--motors", "--out", out)
    run_well("model", "prepare", path, "--motors", "--out", out, "--force")
