"""Files of a diagnosis for other simulators say what the patched model says."""

import sys
from types import ModuleType

import mujoco
import pytest
import yaml

from selfheal.mjcf.edit import Set
from selfheal.recording import load_model
from tests.support.diagnosis_folder import save_diagnosis

ARM = """<mujoco><compiler angle="radian"/><option timestep="0.004"/><worldbody>
  <body><joint name="hip" damping="0.5" armature="0.01"/><geom size="0.1"/>
    <body><joint name="knee" frictionloss="0.2"/><geom size="0.1"/>
      <body><joint name="toe" type="slide"/><geom size="0.1"/>
        <body><joint name="tail" damping="0.1"/><geom size="0.1"/></body>
  </body></body></body></worldbody>
  <actuator>
    <position name="hip_servo" joint="hip" kp="40" kv="2" forcerange="-20 20"/>
    <position name="knee_servo" joint="knee" gear="10" kp="3" kv="0.5"/>
    <motor name="toe_motor" joint="toe" gear="50" ctrlrange="-1 1"/>
  </actuator></mujoco>"""
VALUES = {"coulomb": 0.3, "static": 0.5, "stribeck_velocity": 0.1}
STRIBECK = {
    "effect": "stribeck_friction",
    "target": "joint:knee",
    "parameters": [{"name": name, "value": value} for name, value in VALUES.items()],
}
PLAY = {
    "effect": "backlash",
    "target": "joint:hip",
    "parameters": [{"name": "gap", "value": 0.01, "unit": "rad"}],
}
EDITS = (
    Set("joint", "hip", {"damping": "0.43", "frictionloss": "0.14"}),
    Set("actuator", "hip_servo", {"kp": "44", "delay": "0.012", "nsample": "5"}),
)
FIELDS = {  # of Isaac Lab 2.3 and of mjlab 1.6, beside the names of the joints
    "isaaclab": "stiffness damping armature friction dynamic_friction viscous_friction "
    "effort_limit effort_limit_sim min_delay max_delay joint_names_expr",
    "mjlab": "stiffness damping armature frictionloss viscous_damping effort_limit "
    "delay_min_lag delay_max_lag target_names_expr",
}


@pytest.fixture
def out(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return save_diagnosis(tmp_path / "arm.xml", EDITS, [STRIBECK, PLAY])


def _read_yaml(out):
    return yaml.safe_load((out / "actuators.yaml").read_text())


def _read_python(out, library):
    """The configurations that the file of a library makes: class and fields of each."""
    made = []

    def make(kind):
        return lambda **fields: made.append((kind, fields)) or fields

    package, module = ModuleType(library), ModuleType("actuators")
    module.__getattr__ = make
    name = {"isaaclab": "isaaclab.actuators", "mjlab": "mjlab.actuator"}[library]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, library, package)
        patch.setitem(sys.modules, name, module)
        exec((out / f"actuators_{library}.py").read_text(), {})
    for _, fields in made:
        assert set(fields) <= set(FIELDS[library].split())
    return made


def test_the_values_are_those_of_the_patched_model(out):
    stated, model = _read_yaml(out), load_model(out / "patched.xml")
    hip, servo = stated["joints"]["hip"], model.actuator("hip_servo")
    assert stated["timestep"] == model.opt.timestep
    for key, value in (
        ("armature", model.joint("hip").armature[0]),
        ("viscous_damping", model.joint("hip").damping[0]),
        ("frictionloss", model.joint("hip").frictionloss[0]),
        ("stiffness", servo.gainprm[0]),
        ("damping", -servo.biasprm[2]),
        ("effort_limit", servo.forcerange[1]),
        ("delay", model.actuator_delay[servo.id]),
    ):
        assert hip[key] == pytest.approx(value, rel=1e-8), key
    identified = "frictionloss viscous_damping stiffness delay"
    assert hip["identified"] == identified.split()


def test_a_gear_is_counted_in(out):
    """A servo on its model acts at the joint as stiffness and damping say."""
    stated, model = _read_yaml(out)["joints"], load_model(out / "patched.xml")
    model.opt.timestep = 1e-5
    data = mujoco.MjData(model)
    data.qpos[1], data.qvel[1] = 0.2, 0.3
    data.ctrl[1], data.ctrl[2] = stated["knee"]["gear"] * 0.1, 0.7
    mujoco.mj_forward(model, data)
    servo = stated["knee"]["stiffness"] * (0.1 - 0.2) - stated["knee"]["damping"] * 0.3
    assert data.qfrc_actuator[1] == pytest.approx(servo)
    assert data.qfrc_actuator[2] == pytest.approx(stated["toe"]["gear"] * 0.7)
    toe = {"actuator": "toe_motor", "control": "effort", "gear": 50.0}
    assert stated["toe"] == {**toe, "effort_limit": 50.0}


def test_what_no_field_holds_is_left_out_by_name(out):
    stated = _read_yaml(out)
    assert stated["left_out"] == ["backlash at joint:hip: gap 0.01 rad"]
    for library in FIELDS:
        assert "# left out: backlash" in (out / f"actuators_{library}.py").read_text()


def test_isaac_lab_gets_its_own_fields(out):
    made = {f["joint_names_expr"][0]: (k, f) for k, f in _read_python(out, "isaaclab")}
    kind, hip = made["hip"]
    assert kind == "DelayedPDActuatorCfg"
    assert (hip["min_delay"], hip["max_delay"], hip["effort_limit"]) == (3, 3, 20.0)
    assert (hip["friction"], hip["dynamic_friction"]) == (0.14, 0.14)
    assert hip["viscous_friction"] == 0.43 and hip["stiffness"] == 44.0
    kind, knee = made["knee"]
    assert kind == "ImplicitActuatorCfg" and "effort_limit_sim" not in knee
    assert (knee["friction"], knee["dynamic_friction"]) == (0.5, 0.3)
    assert made["toe"][1]["effort_limit_sim"] == 50.0
    assert made["tail"][1]["stiffness"] == made["tail"][1]["damping"] == 0.0


def test_mjlab_gets_its_own_fields(out):
    made = {f["target_names_expr"][0]: (k, f) for k, f in _read_python(out, "mjlab")}
    assert set(made) == {"hip", "knee", "toe"}  # what has no drive is in the MJCF
    kind, hip = made["hip"]
    assert kind == "BuiltinPositionActuatorCfg" and hip["delay_max_lag"] == 3
    assert made["knee"][1]["frictionloss"] == 0.3
    toe = {"target_names_expr": ("toe",), "effort_limit": 50.0}
    assert made["toe"] == ("BuiltinMotorActuatorCfg", toe)


def test_joints_whose_drives_are_alike_are_one_group(tmp_path):
    text = ARM.replace("knee", "hip+2")
    text = text.replace('frictionloss="0.2"', 'damping="0.1" armature="0.02"')
    text = text.replace('gear="10"', 'forcerange="-9 9"')
    (tmp_path / "arm.xml").write_text(text)
    out = save_diagnosis(tmp_path / "arm.xml", ())
    stated = _read_yaml(out)["joints"]
    assert not [joint for joint in stated.values() if "identified" in joint]
    (group,) = [f for _, f in _read_python(out, "isaaclab") if "armature" in f]
    assert group["joint_names_expr"] == ["hip", r"hip\+2"]
    assert group["effort_limit_sim"] == {"hip": 20.0, r"hip\+2": 9.0}
