"""A diagnosis on disk: whole or not there; replays of it, and what they refuse."""

import json
import os
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.base import Parameter
from selfheal.diagnosis.effects.nominal import is_unidentified
from selfheal.diagnosis.output import storage
from selfheal.diagnosis.output.document import (
    build_refit,
    format_document,
    to_json_values,
)
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.output.result import Diagnosis, Localization
from selfheal.diagnosis.output.schema import check_entries
from selfheal.errors import InputError, RecordingError, UnknownNameError
from selfheal.mjcf.edit import apply_edits
from selfheal.recording import Signal, list_model_names, load_model
from tests.diagnosis.simulation.test_score import undiagnosed
from tests.support.recorded_robots import ROBOTS, bench, places, record

NAN = float("nan")
FILES = ["diagnosis.json", "patched.xml", "report.html"]


@pytest.fixture
def given(tmp_path_factory):
    """The file of a model."""
    path = tmp_path_factory.mktemp("robot") / "model.xml"
    path.write_text(ROBOTS["pendulum"].xml)
    return path


def _diagnosis(given, verdict="nothing", page="<html/>") -> Diagnosis:
    document = {
        "format": "selfheal-diagnosis", "version": 1, "verdict": verdict,
        "findings": [], "refit": [], "fit": {"floor": float("nan")},
    }  # fmt: skip
    located = Localization((), (), np.zeros((0, 0)), np.zeros((0, 0)))
    return Diagnosis(
        str(given), document, (), given.read_text(), "", (), located, (), (), (), 1.0,
        2, page,
    )  # fmt: skip


def _names(path) -> list[str]:
    return sorted(p.name for p in path.iterdir())


# on disk


def test_a_diagnosis_is_three_files_and_is_read_back(given, tmp_path):
    out = tmp_path / "out"
    _diagnosis(given).save(out)
    assert _names(out) == FILES and _names(tmp_path) == ["out"]
    assert storage.read_document(out)["verdict"] == "nothing"
    assert storage.read_document(out)["fit"] == {"floor": None}


def test_an_earlier_diagnosis_is_replaced_by_force_only(given, tmp_path):
    out = tmp_path / "out"
    _diagnosis(given).save(out)
    with pytest.raises(InputError, match="--force"):
        _diagnosis(given, "unlisted").save(out)
    assert storage.read_document(out)["verdict"] == "nothing"
    _diagnosis(given, "unlisted").save(out, force=True)
    assert storage.read_document(out)["verdict"] == "unlisted" and _names(tmp_path) == [
        "out"
    ]


def test_an_empty_folder_is_taken(given, tmp_path):
    (tmp_path / "out").mkdir()
    _diagnosis(given).save(tmp_path / "out")
    assert _names(tmp_path / "out") == FILES


@pytest.mark.parametrize("force", [False, True])
def test_other_files_are_never_deleted(force, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("")
    with pytest.raises(InputError):
        storage.check_folder(out, force)
    assert _names(out) == ["thesis.tex"]


def test_a_link_to_a_folder_stays_one(given, tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "out").symlink_to("real")
    _diagnosis(given).save(tmp_path / "out")
    assert (tmp_path / "out").is_symlink() and _names(tmp_path / "real") == FILES
    assert _names(tmp_path) == ["out", "real"]


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="is a file"):
        storage.check_folder(tmp_path / "out", True)


@pytest.mark.parametrize("there", [False, True])
def test_a_diagnosis_that_cannot_be_written_leaves_what_was_there(
    there, given, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    if there:
        _diagnosis(given, page="old").save(out)
    with pytest.raises(TypeError):
        _diagnosis(given, page=None).save(out, force=True)
    assert _names(tmp_path) == (["out"] if there else [])
    if there:
        assert (out / "report.html").read_text() == "old"

    def refuse(*_):
        raise OSError("no")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(OSError, match="no"):
        _diagnosis(given, page="new").save(out, force=True)
    assert _names(tmp_path) == (["out"] if there else [])


BAD = [
    (None, "cannot read"),
    ("{", "is not JSON"),
    ("[]", "is not a selfheal-diagnosis"),
    ("[" * 100_000, "is nested too deeply"),
    ('{"format": "selfheal-diagnosis", "version": 2}', "of version 1"),
    ('{"format": "selfheal-run", "version": 1}', "is not a selfheal-diagnosis"),
]


@pytest.mark.parametrize("text, said", BAD, ids=[b[1] for b in BAD])
def test_what_is_no_diagnosis_is_refused(text, said, tmp_path):
    if text is not None:
        (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(InputError, match=said):
        storage.read_document(tmp_path)


def test_json_has_no_nan_and_no_numpy():
    thing = {"a": np.float64("nan"), "b": (np.inf, np.int64(3), np.bool_(True)),
             "c": np.array([1.0, np.nan]), "d": "x", "e": None}  # fmt: skip
    told = json.loads(
        format_document(thing), parse_constant=lambda word: pytest.fail(word)
    )
    assert told == {"a": None, "b": [None, 3, True], "c": [1.0, None], "d": "x",
                    "e": None}  # fmt: skip
    assert to_json_values(thing) == told


def test_the_interval_of_a_negative_value_is_in_order():
    term = SimpleNamespace(
        effect=SimpleNamespace(name="stated"), targets=("joint:a/springref",),
        parameters=(Parameter("x", "1", 1.0, 0.7, 1.3, 0.1),),
        finding_fields={"value": -2.0, "unit": "rad"},
    )  # fmt: skip
    (told,) = build_refit(
        SimpleNamespace(terms=(term,), values=np.array([1.1])), np.array([0.01])
    )
    assert told["low"] < told["value"] < told["high"] < 0 and not is_unidentified(told)


# replay


@pytest.fixture
def arm(tmp_path):
    """The folder of a diagnosis that found nothing, and a recording."""
    path = tmp_path / "model.xml"
    path.write_text(ROBOTS["arm"].xml)
    return undiagnosed(tmp_path / "out", path), record(ROBOTS["arm"], seconds=0.3)


def _with(recording, **more):
    episodes = {k: replace(e, **more) for k, e in recording.episodes.items()}
    return replace(recording, episodes=episodes)


def _emptied(recording):
    """The recording without a single reading."""
    episodes = {}
    for key, episode in recording.episodes.items():
        signals = {
            name: replace(s, values=np.full_like(s.values, np.nan))
            for name, s in episode.signals.items()
        }
        episodes[key] = replace(episode, signals=signals)
    return replace(recording, episodes=episodes)


def test_a_replay_needs_no_reading_and_fills_in_every_row(arm):
    out, recording = arm
    played, again = (
        replay_recording(out, _emptied(recording)),
        replay_recording(out, recording),
    )
    for key, episode in played.episodes.items():
        assert set(episode.signals) == set(recording.episodes[key].signals)
        for name, signal in episode.signals.items():
            given = recording.episodes[key].signals[name]
            assert signal.values.shape == given.values.shape
            assert np.isfinite(signal.values).all(), name
            other = again.episodes[key].signals[name].values
            np.testing.assert_allclose(signal.values, other, atol=1e-12)


def test_a_replay_is_what_plain_mujoco_does(arm):
    out, recording = arm
    played = replay_recording(out, recording)
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    every = round(0.01 / model.opt.timestep)
    for key, episode in recording.episodes.items():
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = episode.qpos0, episode.qvel0
        told = []
        for u in episode.ctrl:
            told.append(data.qpos.copy())
            data.ctrl[:] = u
            mujoco.mj_step(model, data, every)
        signals = played.episodes[key].signals
        both = np.stack([signals[n].values for n in ("shoulder", "elbow")], axis=1)
        np.testing.assert_allclose(both, told, atol=1e-9)


def test_a_motor_torque_is_told_at_the_joint(tmp_path):
    xml = ROBOTS["arm"].xml.replace('kv="0.4"', 'kv="0.4" gear="-3"')
    path = tmp_path / "model.xml"
    path.write_text(xml)
    recording = record(replace(ROBOTS["arm"], xml=xml), seconds=0.2, finer=1, noise=0)
    played = replay_recording(undiagnosed(tmp_path / "out", path), recording)
    for key, episode in recording.episodes.items():
        both = [
            e.signals["elbow_torque"].values for e in (episode, played.episodes[key])
        ]
        np.testing.assert_allclose(*both, atol=1e-6)


@pytest.mark.parametrize("end", [".mjcf", ".XML", ".txt", ""])
def test_a_model_may_have_any_name(end, arm, tmp_path):
    """Files that it speaks of are found from where it lies."""
    out, recording = arm
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "still.xml").write_text(
        '<mujoco><option gravity="0 0 0"/></mujoco>'
    )
    still = ROBOTS["arm"].xml.replace(
        "</mujoco>", '<include file="more/still.xml"/></mujoco>'
    )
    (tmp_path / f"other{end}").write_text(still)
    (tmp_path / "usual.xml").write_text(still)
    told = [
        replay_recording(out, recording, model=tmp_path / n)
        .episodes["000"]
        .signals["elbow"]
        for n in (f"other{end}", "usual.xml")
    ]
    np.testing.assert_array_equal(told[0].values, told[1].values)
    texts = [
        apply_edits(tmp_path / n, (), tmp_path) for n in (f"other{end}", "usual.xml")
    ]
    assert texts[0] == texts[1] and list_model_names(
        load_model(tmp_path / f"other{end}")
    )


def test_supply_voltage_and_temperature_stay_unread(arm):
    out, recording = arm
    (first, *_) = recording.episodes
    episode = recording.episodes[first]
    nan = np.full(episode.time.size, np.nan)
    some = episode.signals["elbow"]
    more = {
        "heat": replace(some, kind="temperature", target="", unit="degC"),
        "supply": replace(some, kind="supply_voltage", target="", unit="V"),
    }
    more = {k: replace(s, values=nan) for k, s in more.items()}
    asked = replace(
        recording,
        episodes={first: replace(episode, signals={**episode.signals, **more})},
    )
    signals = replay_recording(out, asked).episodes[first].signals
    assert np.isnan(signals["heat"].values).all()
    assert np.isnan(signals["supply"].values).all()
    assert np.isfinite(signals["elbow"].values).all()


def test_a_missing_qpos0_is_refused_with_its_episode(arm):
    out, recording = arm
    with pytest.raises(RecordingError, match="'000': it has no qpos0"):
        replay_recording(out, _with(recording, qpos0=None))


@pytest.mark.parametrize("size", [1, 3])
def test_a_qpos0_of_another_model_is_refused(size, arm):
    out, recording = arm
    with pytest.raises(RecordingError, match=f"qpos0 has {size} values"):
        replay_recording(out, _with(recording, qpos0=np.zeros(size)))


def test_a_missing_qvel0_is_rest(arm):
    out, recording = arm
    bare = replay_recording(out, _with(recording, qvel0=None))
    rest = replay_recording(out, _with(recording, qvel0=np.zeros(2)))
    for key, episode in bare.episodes.items():
        other = rest.episodes[key].signals["elbow"].values
        np.testing.assert_array_equal(episode.signals["elbow"].values, other)


def test_a_qvel0_of_another_model_is_refused(arm):
    out, recording = arm
    with pytest.raises(RecordingError, match="qvel0"):
        replay_recording(out, _with(recording, qvel0=np.ones(3)))


def _find(out, **finding) -> None:
    path = out / "diagnosis.json"
    document = json.loads(path.read_text())
    found = {"effect": "coulomb_friction", "target": "joint:elbow",
             "parameters": [{"name": "frictionloss", "value": 0.1}]}  # fmt: skip
    document["findings"] = [{**found, **finding}]
    path.write_text(json.dumps(document))


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
        ({"target": 3}, InputError, r"json, findings\[0\]: target is 3; would fit"),
        ({"effect": 3}, InputError, "effect is 3; would fit: a name"),
        ({"effect": "gremlins", "native": True}, UnknownNameError, "gremlins"),
        ({"parameters": None}, InputError, "parameters is None; would fit: a list"),
        ({"parameters": []}, InputError, r"is \[\]; would fit: frictionloss"),
        ({"parameters": [{"value": 1.0}]}, InputError, "would fit: frictionloss"),
        ({"effect": "asymmetric_friction"}, InputError, "fit: positive, negative"),
        *(({"parameters": [{**LOSS, "value": value}]}, InputError, "fit: a number")
          for value in (None, "much", [], HUGE, NAN, True)),
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
def test_a_finding_that_says_nothing_of_this_model_is_refused(finding, kind, said, arm):
    out, recording = arm
    _find(out, **finding)
    with pytest.raises(kind, match=said):
        replay_recording(out, recording)


@pytest.mark.parametrize(
    "entry, said",
    [
        ({"given": "x"}, "given is 'x'; would fit: a number"),
        ({"value": None}, "value is None; would fit: a number"),
        ({"parameter": 7}, r"refit\[0\]: parameter is 7; would fit: a text"),
    ],
)
def test_a_refitted_value_that_is_none_is_refused(entry, said, arm):
    out, recording = arm
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
            told = [{"name": p.name, "value": 1.0} for p in term.parameters]
            if effect.name == "payload":
                told[1:] = [{"name": "position", "value": [0.0, 0.0, 1.0]}]
            entry = {
                "effect": effect.name,
                "target": term.targets[0],
                **term.finding_fields,
            }
            entries = {"findings": [{**entry, "parameters": told}], "refit": []}
            check_entries("diagnosis.json", entries)


@pytest.mark.parametrize(
    "change, said",
    [
        ({"ctrl_names": ("a", "b")}, "no actuator 'a', 'b'; would fit: 'shoulder_serv"),
        ({"signals": {"x": Signal(np.zeros(30), "joint_position", "knee", "rad")}},
         "no joint 'knee'"),
    ],
)  # fmt: skip
def test_inputs_of_another_robot_are_refused(change, said, arm):
    out, recording = arm
    with pytest.raises(RecordingError, match=said):
        replay_recording(out, _with(recording, **change))


def test_a_diverging_model_is_told_with_episode_and_time(arm):
    out, recording = arm
    _find(out, effect="joint_spring", native=False,
          parameters=[{"name": "stiffness", "value": -1e9},
                      {"name": "springref", "value": 0.0}])  # fmt: skip
    with pytest.raises(RecordingError, match=r"'000': the model diverges at 0\.\d+ s$"):
        replay_recording(out, recording)


def test_another_version_of_the_model_gets_values_as_ratios(arm, tmp_path):
    """A firmware gain four times as high, re-fitted 10 % lower, is still 10 % lower."""
    out, recording = arm
    document = json.loads((out / "diagnosis.json").read_text())
    entry = {"parameter": "actuator:elbow_servo/kp", "given": 10.0, "value": 9.0}
    document["refit"] = [entry]
    (out / "diagnosis.json").write_text(json.dumps(document))
    texts = [ROBOTS["arm"].xml.replace('kp="10"', f'kp="{kp}"') for kp in (40, 36)]
    for name, text in zip(("other.xml", "right.xml"), texts, strict=True):
        (tmp_path / name).write_text(text)
    played = replay_recording(out, recording, model=tmp_path / "other.xml")
    true = replay_recording(
        undiagnosed(tmp_path / "none", tmp_path / "right.xml"), recording
    )
    for key, episode in played.episodes.items():
        other = true.episodes[key].signals["elbow"].values
        np.testing.assert_allclose(episode.signals["elbow"].values, other, atol=1e-9)
