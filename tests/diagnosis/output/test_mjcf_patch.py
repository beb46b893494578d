"""A diagnosed change as text: whichever way a user writes the same robot."""

import re
import shutil
import subprocess
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.output import build_result
from selfheal.diagnosis.output.build_result import build_patch, patch_or_nominal
from selfheal.mjcf.edit import Set
from tests.support.patched_models import (
    check_patch,
    check_same_robot,
    compile_patch,
    make_case,
)
from tests.support.recorded_robots import ARM, ROBOTS, bench

RADIAN = '<compiler angle="radian"/>'
ELBOW = '<position name="elbow_servo" joint="elbow" kp="10" kv="0.4"/>'
(ACTUATORS,) = re.findall(r"<actuator>.*</actuator>", ARM, flags=re.S)
(BODIES,) = re.findall(r"<worldbody>.*</worldbody>", ARM, flags=re.S)


JOINT = '<joint name="elbow"'
LOWER = '<body name="lower" pos="0.2 0 0">'
CAPSULE = '<geom name="lower" type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"'
MASSES = 'angle="radian" inertiafromgeom="true"'
INERTIA = '<inertial pos="0.1 0 0.01" mass="0.2" {}/>'
DIAGONAL = 'diaginertia="1e-4 3e-4 2.5e-4"'
STATED = INERTIA.format(f'{DIAGONAL} quat="1 1 0 0"')
FULL = 'fullinertia="1e-4 3e-4 2.5e-4 1e-5 2e-5 0"'


def _put(*pairs: str) -> str:
    """The arm with texts, each of which is there once, replaced by others."""
    text = ARM
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text


def _driven(kind: str, more: str = "") -> str:
    return _put(ELBOW, f'<{kind} name="elbow_servo" joint="elbow" {more}/>')


# the same robot, or nearly
WAYS = {
    "plain": ARM,
    "two dashes in a comment": _put("<actuator>", "<!-- a -- b --><actuator>"),
    "a bare ampersand": _put('model="arm"', 'model="arm & hand"'),
    "an included compiler": _put(RADIAN, '<include file="c.xml"/>'),
    "included actuators": _put(ACTUATORS, '<include file="a.xml"/>'),
    "included bodies": _put(BODIES, '<include file="b.xml"/>'),
    "two compilers": _put(RADIAN, f'<compiler autolimits="true"/>{RADIAN}'),
    "two sections of actuators": _put(ELBOW, f"</actuator><actuator>{ELBOW}"),
    "a muscle": _driven("muscle", 'ctrlrange="0 1" force="5" lengthrange="-1 1"'),
    "a DC motor": _driven("dcmotor", 'resistance="2" motorconst="0.05"'),
    "a law of the user's": _driven(
        "general", 'gaintype="user" biastype="user" gainprm="3"'
    ),
    "a sticky body": _put(
        ELBOW, '<adhesion name="elbow_servo" body="lower" ctrlrange="0 1" gain="3"/>'
    ),
    "a propeller": _put(
        ELBOW,
        '<general name="elbow_servo" site="tip" gear="0 0 2 0 0 0" gainprm="3"/>',
    ),
    "degrees": _put(RADIAN, ""),
    "masses of the geoms": _put(
        *(JOINT, f'<inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>{JOINT}'),
        *('angle="radian"', MASSES),
    ),
    "a total mass": _put('angle="radian"', 'angle="radian" settotalmass="1"'),
    "frames": _put(
        *("      </body>\n", "      </body></frame></frame>\n"),
        LOWER,
        '<frame pos="0.1 0 0" euler="0 0.3 0.2"><frame pos="0 0.1 0"><body '
        'name="lower" pos="0.1 -0.1 0">',
    ),
    "geoms in a frame": _put(
        f'{CAPSULE}\n          mass="0.2"/>',
        f'<frame pos="0 0 0.01" euler="0 0 0.2">{CAPSULE} mass="0.2"/><geom '
        'type="box" size="0.1 0.01 0.01" pos="0.1 0 0" euler="0 0 -0.2" mass="0.1"/>'
        "</frame>",
    ),
    "a stated inertia": _put(JOINT, STATED + JOINT),
    "a turned inertia": _put(
        JOINT, INERTIA.format(f'{DIAGONAL} euler="0.1 0.2 0.3"') + JOINT
    ),
    "a full inertia": _put(JOINT, INERTIA.format(FULL) + JOINT),
    "a body without a name": _put(
        LOWER,
        f'<body pos="0.2 0 0">{STATED}',
    ),
    "a box between two points": _put(
        CAPSULE,
        '<site type="cylinder" fromto="0 0 0.01 0.1 0 0.01" size="0.01"/><geom '
        'name="lower" type="box" fromto="0.2 0 0 0 0 0" size="0.02 0.01"',
    ),
    "fused bodies": _put(
        *('angle="radian"', 'angle="radian" fusestatic="true"'),
        *("  </worldbody>", "</body></worldbody>"),
        '<body name="upper" pos="0 0 1">',
        '<body name="stand" pos="0 0 0.4"><body name="upper" pos="0 0 0.6">',
    ),
    "a geared motor": _driven("motor", 'gear="20"'),
    "a velocity servo": _driven("velocity", 'kv="0.4"'),
    "an integrated velocity": _driven(
        "intvelocity", 'kp="10" kv="0.4" actrange="-3 3"'
    ),
    "a damper": _driven("damper", 'kv="0.4" ctrlrange="0 1"'),
    "a lagging servo": _driven("position", 'kp="10" timeconst="0.03"'),
    "a damping ratio": _driven("position", 'kp="10" dampratio="1"'),
    "a general actuator": _driven(
        "general", 'gainprm="10" biastype="affine" biasprm="0 -10 -0.4"'
    ),
    "an inherited range": _put(
        *('armature="0.005"', 'armature="0.005" range="-2 2"'),
        *(ELBOW, ELBOW.replace("/>", ' inheritrange="1"/>')),
    ),
}
PART = '<include file="parts/lower.xml"/>'
(LOWER_BODY,) = re.findall(r'      <body name="lower".*?</body>\n', ARM, flags=re.S)
# texts of which one number is changed
SPELLINGS = {
    name: WAYS[name]
    for name in ("plain", "included bodies", "frames", "degrees", "a bare ampersand")
} | {
    "an included file that includes one": WAYS["included bodies"],
    "lines that end as on Windows": _put(LOWER_BODY, PART),
    "comments, many spaces and other quotes": _put(
        '<joint name="elbow" type="hinge" axis="0 1 0" damping="0.03" '
        'armature="0.005"/>',
        "<!-- the elbow -->\t<joint  name = 'elbow'\n\n axis='0  1 0'  damping = "
        "'3e-2'   armature='0.0050'\n   /><!-- damping 0.03 -->",
    ),
    "a default class": _put(
        *('damping="0.03" ', ""),
        *(RADIAN, f'{RADIAN}<default><joint damping="0.03"/></default>'),
    ),
}
# files that they include
INCLUDED = {
    "an included compiler": {"c.xml": f"<mujoco>{RADIAN}</mujoco>"},
    "included actuators": {"a.xml": f"<mujoco>{ACTUATORS}</mujoco>"},
    "included bodies": {"b.xml": f"<mujoco>{BODIES}</mujoco>"},
    "an included file that includes one": {
        "b.xml": f"<mujoco>{BODIES.replace(LOWER_BODY, PART)}</mujoco>",
        "parts/lower.xml": f"<mujocoinclude>{LOWER_BODY}</mujocoinclude>",
    },
    "lines that end as on Windows": {
        "parts/lower.xml": f"<mujocoinclude>\n{LOWER_BODY}</mujocoinclude>".replace(
            "\n", "\r\n"
        )
    },
}
EFFECTS = (
    *("coulomb_friction", "joint_spring", "hard_stop", "servo_gain", "payload"),
    *("link_length", "torque_saturation"),
)


@pytest.fixture
def written(tmp_path):
    """Writes a robot in one of the ways; gives what a diagnosis has of it."""

    def write(way, text=""):
        files = {"model.xml": text or (WAYS | SPELLINGS)[way], **INCLUDED.get(way, {})}
        for name, content in files.items():
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_bytes(content.encode())
        return make_case(tmp_path / "model.xml", ROBOTS["arm"])

    return write


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass':UserWarning")
@pytest.mark.parametrize("way", WAYS)
def test_the_text_says_what_the_diagnosis_means(way, written, tmp_path):
    """All nominal values are changed; each effect is at each of its places."""
    case, rng = written(way), np.random.default_rng(0)
    stated = build_nominal_terms(case.robot)
    for name in EFFECTS:
        for term in find_effect(name).propose_terms(case.robot):
            start = np.array(term.initial_values[0]) + 0.3 * term.scale
            factors = 1 + 0.02 * rng.uniform(-1, 1, len(stated))
            terms, values = (*stated, term), np.concatenate([factors, start])
            check_patch(case, terms, values, tmp_path)


def test_what_a_ball_joint_states_is_in_the_text(tmp_path):
    b = bench("wrist", tmp_path, episodes=1, seconds=0.3)
    case = SimpleNamespace(compiler=b.simulator.compiler)
    terms = [
        t
        for t in build_nominal_terms(b.robot)
        if t.targets[0].startswith("joint:wrist")
    ]
    fields = [t.targets[0].partition("/")[2] for t in terms]
    assert fields == ["damping", "stiffness"]
    values = np.array([1.2, 0.8])
    new = check_patch(case, terms, values, tmp_path)
    np.testing.assert_allclose(new.dof_damping, 1.2 * b.robot.model.dof_damping)


@pytest.mark.parametrize("way", ["plain", "degrees"])
def test_play_is_as_wide_in_the_text(way, written, tmp_path):
    case = written(way)
    for term in find_effect("backlash").propose_terms(case.robot):
        values = np.array(term.initial_values[0])
        new = compile_patch(case, (term,), values, tmp_path)
        joint = new.joint(term.targets[0].partition(":")[2] + "_play")
        assert np.ptp(joint.range) == pytest.approx(values[0], rel=1e-5)


def _find_length(case):
    """The length of the lower link as a term."""
    terms = find_effect("link_length").propose_terms(case.robot)
    return next(t for t in terms if "lower" in t.label)


def _find_nominal(case, target):
    (term,) = [t for t in build_nominal_terms(case.robot) if t.targets == (target,)]
    return term


def test_an_inertia_keeps_the_axes_of_the_model(written, tmp_path):
    case = written("a stated inertia")
    mass = _find_nominal(case, "body:lower/mass")
    for term, value in ((mass, [1.1]), (_find_length(case), [0.21])):
        text, *_ = build_patch(case, (term,), np.array(value))
        (inertial,) = re.findall("<inertial[^>]*>", text)
        assert 'quat="1 1 0 0"' in inertial and "1e-4 3e-4" not in inertial


def _list_changes(diff: str) -> list[str]:
    return [d for d in diff.splitlines() if re.match(r"[+-](?![+-])", d)]


@pytest.mark.parametrize("way", SPELLINGS)
def test_a_change_of_one_number_changes_one_line(way, written, tmp_path):
    """Of the file that states it; the files then say what the patch does."""
    case = written(way)
    term = _find_nominal(case, "joint:elbow/damping")
    text, diff, _ = build_patch(case, (term,), np.array([1.2]))
    old, new = _list_changes(diff)
    assert "0.036" in new and "damping" in new
    same = (
        new[1:].replace("0.036", "{}"),
        re.sub(r"0\.03\b|3e-2", "{}", old[1:], count=1),
    )
    assert same[0].split() == same[1].split() or way == "a default class"
    if git := shutil.which("git"):
        (tmp_path / "patched.diff").write_bytes(diff.encode())
        apply = [git, "apply", "--whitespace=nowarn", "patched.diff"]
        subprocess.run(apply, cwd=tmp_path, check=True)
        (tmp_path / "patched.xml").write_text(text)
        files = (str(tmp_path / name) for name in ("model.xml", "patched.xml"))
        check_same_robot(*map(mujoco.MjModel.from_xml_path, files))


def test_a_longer_link_stays_between_its_points(written):
    case = written("a box between two points")
    _, diff, _ = build_patch(case, (_find_length(case),), np.array([0.125]))
    added = [c for c in _list_changes(diff) if c.startswith("+")]
    assert any('fromto="0.25 0 0 0 0 0" size="0.02 0.01"' in line for line in added)
    assert not any("e-1" in line for line in added)  # rounding


def test_masses_that_did_not_count_stay_where_they_count_neither(written):
    """Of two bodies without an <inertial>, one gets one."""
    case = written("plain", _put('angle="radian"', MASSES))
    term = _find_nominal(case, "body:upper/mass")
    text, diff, _ = build_patch(case, (term,), np.array([1.1]))
    assert len(_list_changes(diff)) == 3 and text.count("<inertial") == 1


def test_a_patch_that_mujoco_refuses_is_never_written(written, monkeypatch):
    wrong = [Set("joint", "elbow", {"stickiness": "much"})]
    monkeypatch.setattr(build_result, "build_edits", lambda *_: wrong)
    text, diff, edits, unpatched = patch_or_nominal(written("plain"), (), np.zeros(0))
    assert (text, diff, edits) == (ARM, "", [])
    assert "MuJoCo refuses the patch" in unpatched and "stickiness" in unpatched
