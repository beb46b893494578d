"""Findings that say nothing of the model at hand are refused."""

import json

import pytest

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.output.schema import check_entries
from selfheal.errors import InputError
from tests.support.diagnosis_folder import write_finding
from tests.support.recorded_robots import bench, places

NAN, INFINITY = float("nan"), float("inf")
HUGE = 10**400


def _state(**values: object) -> dict:
    """Parameters of a finding, by their names."""
    return {"parameters": [{"name": k, "value": v} for k, v in values.items()]}


STOP = {"effect": "hard_stop", "side": 1, **_state(range=1)}
SLOPE = {"effect": "slope", "target": "world", **_state(tilt=0.1, azimuth=0.0)}
PLAY = {"effect": "backlash", "native": True, **_state(gap=0.1)}
DELAY = {"effect": "command_delay", "target": "actuator:elbow_servo"}
COUPLING = {"effect": "joint_coupling", **_state(stiffness=1.0, ratio=1.0)}


@pytest.mark.parametrize(
    "finding, said",
    [
        ({"target": "joint:wrist"}, "no joint 'wrist'"),
        ({"target": "elbow"}, "'elbow'; would fit: joint:"),
        ({"target": "world"}, "'world'; would fit: joint: and a name"),
        ({"target": "body:forearm"}, "target is 'body:forearm'; would"),
        ({"target": 3}, r"json: findings\[0\].target is 3; would fit"),
        ({"effect": 3}, "effect is 3; would fit: a valid string"),
        ({"effect": "gremlins"}, "unknown effect.*gremlins"),
        ({"effect": "gremlins", "native": True}, "unknown effect.*gremlins"),
        (
            {"effect": "ground_friction", "target": "world", **_state(friction=0.5)},
            "no ground",
        ),
        ({"effect": "asymmetric_friction"}, "fit: positive, negative"),
        ({"parameters": None}, "parameters is None; would fit: a valid array"),
        ({"parameters": []}, r"is \[\]; would fit: frictionloss"),
        ({"parameters": [{"value": 1.0}]}, "name is missing"),
        (_state(frictionloss=None), "None; would fit: a valid number"),
        (_state(frictionloss="much"), "'much'; would fit: a valid number"),
        (_state(frictionloss=True), "True; would fit: a valid number"),
        (_state(frictionloss=HUGE), "fit: a finite number"),
        (_state(frictionloss=[]), "fit: a number"),
        (_state(frictionloss=NAN), "NaN is no number"),
        (_state(frictionloss=-INFINITY), "-Infinity is no"),
        (_state(frictionloss=1e13), r"-1e\+12 to 1e\+12"),
        (
            {"effect": "quadratic_damping", **_state(damping2=-1e9)},
            "damping2 is -1000000000.0; would fit: 0 or more",
        ),
        ({**DELAY, **_state(delay=-0.1)}, "delay is -0.1; would fit: 0 or more"),
        (
            {**STOP, "measured": "link"},
            "measured is 'link'; would fit: no measured beside hard_stop",
        ),
        ({**STOP, "other": "joint:wrist"}, "fit: no other beside hard_sto"),
        ({**STOP, "side": True}, "side is True; would fit: -1 or 1"),
        ({**STOP, "side": None}, "side is None; would fit: -1 or 1"),
        ({**STOP, "native": "no"}, "native is 'no'; would fit: a valid boolean"),
        ({**SLOPE, "side": 3}, "side is 3; would fit: 1 or -1"),
        (COUPLING, "other is None; would fit: joint: and a name"),
        ({**PLAY, "measured": "motor"}, "patched.xml has no joint 'elbow_play'"),
    ],
)
def test_a_finding_that_says_nothing_of_this_model_is_refused(
    finding, said, empty_diagnosis
):
    out, recording = empty_diagnosis
    write_finding(out, **finding)
    with pytest.raises(InputError, match=said):
        replay_recording(out, recording)


@pytest.mark.parametrize(
    "entry, said",
    [
        ({"given": "x"}, "given is 'x'; would fit: a valid number"),
        ({"value": None}, "value is None; would fit: a valid number"),
        ({"given": 1e-9, "value": 1e9}, r"1e\+12 times as much as given"),
        ({"parameter": 7}, r"refit\[0\].parameter is 7; would fit: a valid str"),
    ],
)
def test_a_refitted_value_that_is_none_is_refused(entry, said, empty_diagnosis):
    out, recording = empty_diagnosis
    document = json.loads((out / "diagnosis.json").read_text())
    own = {"parameter": "joint:elbow/damping", "given": 1.0, "value": 1.0}
    document["refit"] = [{**own, **entry}]
    (out / "diagnosis.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=said):
        replay_recording(out, recording)


@pytest.mark.parametrize("robot", places())
def test_what_a_diagnosis_writes_is_what_a_replay_takes(robot, tmp_path):
    scene = bench(robot, tmp_path).robot
    for effect in load_catalogue().values():
        for term in effect.propose_terms(scene)[:1]:
            stated = [{"name": p.name, "value": 1.0} for p in term.parameters]
            if effect.name == "payload":
                stated[1:] = [{"name": "position", "value": [0.0, 0.0, 1.0]}]
            entry = {
                "effect": effect.name,
                "target": term.targets[0],
                **term.finding_fields,
            }
            entries = {"findings": [{**entry, "parameters": stated}], "refit": []}
            check_entries("diagnosis.json", entries)


@pytest.mark.parametrize("robot", places())
def test_a_fit_stays_within_what_a_finding_may_state(robot, tmp_path):
    scene = bench(robot, tmp_path).robot
    for effect in load_catalogue().values():
        specs = {spec.name: spec for spec in effect.parameters}
        for parameter in (p for t in effect.propose_terms(scene) for p in t.parameters):
            spec = specs.get(parameter.name)
            if spec and (spec.nonnegative or parameter.low == 0):
                assert spec.nonnegative and parameter.low >= 0, parameter
