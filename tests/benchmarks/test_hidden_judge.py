"""Diagnoses judged: a perfect one scores so, a miss is one, and the key is apart."""

import json
import sys

import numpy as np
import pytest

from benchmarks.diagnosis_runs import (
    ProcessLimits,
    diagnose_cases,
    find_undiagnosed,
    score_diagnosis,
)
from benchmarks.hidden.case import save_case
from benchmarks.hidden.drives import make_case as make_drives
from benchmarks.hidden.judge import drives
from benchmarks.hidden.judge.drives import judge_verdict
from benchmarks.hidden.judge.names import judge_names, read_places
from benchmarks.hidden.judge.page import tabulate_drives, tabulate_sealed
from benchmarks.hidden.judge.sealed import (
    compute_figures,
    compute_removed_on_test,
    read_case,
)
from benchmarks.hidden.sealed import make_case
from benchmarks.replay_error import average_commands
from benchmarks.writer import render_page
from selfheal.recording import check_against_model, read, read_names
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def case():
    return make_case("single", 10, effects=["coulomb_friction"], robots=["pendulum"])


@pytest.fixture
def folders(case, tmp_path):
    cases, keys = tmp_path / "cases", tmp_path / "keys"
    save_case(case, cases, keys)
    return cases, keys


def test_key_is_not_with_the_case(folders, case):
    cases, keys = folders
    given = {p.name for p in cases.rglob("*") if p.is_file()}
    assert given == {"model.xml", "recording.h5"}
    test = read(keys / case.name / "test.h5")
    check_against_model(test, read_names(cases / case.name / "model.xml"))
    assert all(e.qpos0 is not None for e in test.episodes.values())
    text = (cases / case.name / "model.xml").read_text()
    assert "coulomb" not in text and "single" not in case.name


def test_effect_matters_and_the_given_model_is_not_the_truth(case):
    effect = case.key["effects"][0]
    assert 3 <= effect["after_refit"] <= 30
    assert case.key["test"]["stated"] > case.key["test"]["floor"]
    assert case.robot.model.opt.timestep > case.key["fine_step"]
    errors = case.key["parameter_errors"]
    assert errors and all(abs(e) <= 0.6 * 0.3 for e in errors.values())


def _perfect(key):
    def state(parameter):
        value, near = parameter["value"], 0.1 * abs(parameter["value"])
        return {**parameter, "low": value - near, "high": value + near}

    findings = [
        {**e, "equivalent": [], "parameters": [state(p) for p in e["parameters"]]}
        for e in key["effects"]
    ]
    fit = {"explainable_removed": 1.0}
    return {"verdict": "explained", "findings": findings, "fit": fit}


def _diagnosed(folders, name, diagnosis):
    cases, keys = folders
    folder = cases / name / "diagnosis"
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps(diagnosis))
    return read_case(cases / name, keys)


def _render(suite, cases):
    """The page of judged cases."""
    tabulate = {"sealed": tabulate_sealed, "drives": tabulate_drives}[suite]
    template = ROOT / "benchmarks" / "hidden" / "judge" / f"{suite}.md"
    return render_page(template, {"title": "A page", **tabulate(cases)}, "a machine")


def test_perfect_diagnosis_is_scored_perfect(folders, case):
    judged = _diagnosed(folders, case.name, _perfect(case.key))
    found = compute_figures([judged])
    names = ("exact name first", "name or class first", "joint or body right")
    for figure in (*names, "intervals that hold the truth"):
        assert found[figure]["rate"] == 1.0, figure
    assert found["explainable removed, median over explained"] == 1.0
    assert not found["singles with a further, wrong name"]["hits"]
    assert tabulate_sealed([judged])["wrong"] == []
    assert "| 1/1 | 1/1 | 1/1 | - | - | - |" in _render("sealed", [judged])


def test_empty_diagnosis_is_a_miss(folders, case):
    judged = _diagnosed(folders, case.name, {"verdict": "nothing", "findings": []})
    found = compute_figures([judged])
    assert found["exact name first"]["rate"] == 0.0
    assert found["joint or body right"]["rate"] == 0.0
    assert judged["first"] == "nothing"


def test_no_diagnosis_is_a_failure(folders, case):
    judged = read_case(folders[0] / case.name, folders[1])
    assert judged["verdict"] == "failed" and not judged["exact"]


def test_class_and_equivalent_count_as_class_only(folders, case):
    wrong = _perfect(case.key)
    wrong["findings"][0] |= {"effect": "stribeck_friction", "parameters": []}
    judged = _diagnosed(folders, case.name, wrong)
    assert (judged["exact"], judged["class"], judged["place"]) == (False, True, True)


def test_places_join_joint_actuator_signal_and_body(folders, case):
    places = read_places(folders[0] / case.name)
    truth = {"effect": "coulomb_friction", "target": "joint:j1"}
    for target in ("actuator:m1", "sensor:j1_position", "body:link1"):
        place = places.find_place({"effect": "x", "target": target})
        assert place & places.find_place(truth)
    world = places.find_place({"effect": "slope", "target": "world"})
    assert not world & places.find_place(truth)


def test_run_sees_model_and_recording_alone_and_goes_on(folders, case, tmp_path):
    program = tmp_path / "fake.py"
    program.write_text(
        "import json, os\n"
        "assert sorted(os.listdir()) == ['model.xml', 'recording.h5']\n"
        "os.mkdir('diagnosis')\n"
        "found = {'verdict': 'nothing', 'findings': []}\n"
        "json.dump(found, open('diagnosis/diagnosis.json', 'w'))\n"
    )
    cases = folders[0]
    limits = ProcessLimits(60.0, (sys.executable, "-I", str(program)))
    assert diagnose_cases(cases, 1, limits) == 0
    record = json.loads((cases / case.name / "run.json").read_text())
    assert record["exit_code"] == 0 and record["seconds"] > 0
    assert find_undiagnosed(cases) == []


def test_replay_of_the_truth_scores_the_floor(folders, case, tmp_path):
    cases, keys = folders
    sealed = keys / case.name
    _diagnosed(folders, case.name, _perfect(case.key))
    program = tmp_path / "replay.py"
    program.write_text(
        f"import shutil, sys\nshutil.copy({str(sealed / 'test.h5')!r}, sys.argv[4])\n"
    )
    words = (sys.executable, str(program))
    assert score_diagnosis(cases / case.name, sealed, words) == 0.0
    judged = {
        **read_case(cases / case.name, keys),
        "patched": case.key["test"]["floor"],
    }
    assert compute_removed_on_test(judged) == 1.0


def test_crash_is_recorded(folders, case):
    limits = ProcessLimits(60.0, (sys.executable, "-c", "raise SystemExit('broken')"))
    assert diagnose_cases(folders[0], 1, limits) == 1
    record = json.loads((folders[0] / case.name / "run.json").read_text())
    assert record["exit_code"] == 1 and "broken" in record["stderr"]
    assert len(find_undiagnosed(folders[0])) == 1


def test_names_are_right_at_their_place_only(folders, case):
    places = read_places(folders[0] / case.name)
    names = ["coulomb_friction", "stribeck_friction"]
    truth = [{"names": names, "target": "joint:j1", "needed": True}]
    right = {"effect": "stribeck_friction", "target": "actuator:m1"}
    wrong = {"effect": "armature", "target": "joint:j1"}
    judged = judge_names([right, wrong], truth, places)
    assert (judged["needed"], judged["named"], judged["missed"]) == (1, 1, [])
    assert (judged["names"], judged["false"]) == (2, ["armature joint:j1"])


def test_a_verdict_agrees_with_the_errors_at_every_horizon():
    errors = {"given": {"a": 1.0, "b": 2.0}, "true": {"a": 0.1, "b": 0.1}}
    assert judge_verdict("explained", {"a": 0.15, "b": 0.2}, errors)
    assert not judge_verdict("explained", {"a": 0.15, "b": 0.5}, errors)
    assert judge_verdict("nothing", {"a": 0.12, "b": 0.12}, errors)
    assert not judge_verdict("nothing", {"a": 0.12, "b": 0.2}, errors)
    assert judge_verdict("partly", {"a": 1.0, "b": 1.0}, errors)


def test_the_plain_fit_helps_and_the_truth_helps_more(tmp_path, shorten_drives):
    shorten_drives("everything", 4.0)
    case = make_drives("everything", 7)
    save_case(case, tmp_path / "cases", tmp_path / "keys")
    judged = drives.read_case(tmp_path / "cases" / case.name, tmp_path / "keys")
    errors = judged["errors"]
    for name, given in errors["given"].items():
        assert errors["true"][name] <= errors["plain"][name] * 1.05
        assert errors["plain"][name] < 0.7 * given
    assert judged["verdict"] == "failed" and judged["named"] == 0 < judged["needed"]
    assert drives.compute_figures([judged])["everything"]["error / plain, whole"] > 1
    assert f"| {judged['case']} |" in _render("drives", [judged])


def test_late_commands_are_those_of_before():
    time, ctrl = np.arange(60) / 100, np.random.default_rng(0).normal(size=(60, 2))
    now, late = (average_commands(time, ctrl, 0.002, d) for d in (0.0, 0.01))
    np.testing.assert_allclose(late[5:], now[:-5], atol=1e-9)
    np.testing.assert_allclose(late[:5], np.repeat(ctrl[:1], 5, 0), atol=1e-9)
