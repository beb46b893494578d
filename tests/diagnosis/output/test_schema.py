"""Findings that say nothing of the model at hand are refused."""

import json

import pytest

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.output.schema import check_entries
from selfheal.errors import InputError, UnknownNameError
from tests.support.diagnosis_folder import write_finding
from tests.support.recorded_robots import bench, places

NAN, INFINITY = float("nan"), float("inf")
STOP = {"effect": "hard_stop", "side": 1, "parameters": [{"name": "range", "value": 1}]}

LOSS = {"name": "frictionloss", "value": 0.1}
HUGE = 10**400


@pytest.mark.parametrize(
    "finding, kind, said",
    [
        ({"target": "joint:wrist"}, InputError, "no joint 'wrist'"),
        ({"target": "elbow"}, InputError, "'elbow'; would fit: joint:"),
        ({"effect": "gremlins"}, UnknownNameError, "gremlins"),
        ({"effect": "ground_friction", "target": "world", "parameters": [
            {"name": "friction", "value": 0.5}]}, InputError, "no ground"),
        ({"target": "world"}, InputError, "'world'; would fit: joint: and a name"),
        ({"target": "body:forearm"}, InputError, "target is 'body:forearm'; would"),
        ({"target": 3}, InputError, r"json: findings\[0\].target is 3; would fit"),
        ({"effect": 3}, InputError, "effect is 3; would fit: a valid string"),
        ({"effect": "gremlins", "native": True}, UnknownNameError, "gremlins"),
        ({"parameters": None}, InputError, "parameters is None; would fit: a valid"),
        ({"parameters": []}, InputError, r"is \[\]; would fit: frictionloss"),
        ({"parameters": [{"value": 1.0}]}, InputError, "name is missing"),
        ({"effect": "asymmetric_friction"}, InputError, "fit: positive, negative"),
        *(({"parameters": [{**LOSS, "value": value}]}, InputError, "fit: a valid num")
          for value in (None, "much", True)),
        ({"parameters": [{**LOSS, "value": HUGE}]}, InputError, "fit: a finite numb"),
        ({"parameters": [{**LOSS, "value": []}]}, InputError, "fit: a number"),
        ({"parameters": [{**LOSS, "value": NAN}]}, InputError, "NaN is no number"),
        ({"parameters": [{**LOSS, "low": -INFINITY}]}, InputError, "-Infinity is no"),
        ({"parameters": [{**LOSS, "value": 1e13}]}, InputError, "-1e.12 to 1e.12"),
        ({"effect": "quadratic_damping", "parameters": [
            {"name": "damping2", "value": -1e9}]}, InputError,
         "damping2 is -1000000000.0; would fit: 0 or more"),
        ({**STOP, "measured": "link"}, InputError,
         "measured is 'link'; would fit: no measured beside hard_stop"),
        ({**STOP, "other": "joint:wrist"}, InputError, "fit: no other beside hard_sto"),
        ({**STOP, "side": True}, InputError, "side is True; would fit: -1 or 1"),
        ({**STOP, "native": "no"}, InputError, "native is 'no'; would fit: a valid b"),
        ({"effect": "slope", "target": "world", "side": 3, "parameters": [
            {"name": "tilt", "value": 0.1}, {"name": "azimuth", "value": 0.0}]},
         InputError, "side is 3; would fit: 1 or -1"),
        ({"effect": "joint_coupling", "parameters": [
            {"name": "stiffness", "value": 1.0}, {"name": "ratio", "value": 1.0}]},
         InputError, "other is None; would fit: joint: and a name"),
        ({"effect": "hard_stop", "parameters": [{"name": "range", "value": 1.0}]},
         InputError, "side is None; would fit: -1 or 1"),
        ({"effect": "backlash", "native": True, "measured": "motor",
          "parameters": [{"name": "gap", "value": 0.1}]}, InputError,
         "patched.xml has no joint 'elbow_play'"),
        ({"effect": "command_delay", "target": "actuator:elbow_servo",
          "parameters": [{"name": "delay", "value": -0.1}]}, InputError,
         "value of delay is -0.1; would fit: 0 or more"),
    ],
)  # fmt: skip
def test_a_finding_that_says_nothing_of_this_model_is_refused(
    finding, kind, said, empty_diagnosis
):
    out, recording = empty_diagnosis
    write_finding(out, **finding)
    with pytest.raises(kind, match=said):
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
