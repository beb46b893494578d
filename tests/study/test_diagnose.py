"""Many diagnoses side by side: which robots there are, and what differs among them."""

from types import SimpleNamespace

import pytest

from selfheal.errors import InputError
from selfheal.study import diagnose
from selfheal.study.diagnose import STUDY
from selfheal.study.plan import StudyRequest

FIT = {"given": 0.2, "refit": 0.1, "patched": 0.05, "explainable_removed": None}


def _finding(effect, value, target="joint:knee"):
    parameter = {"name": "x", "value": value, "unit": "N m"}
    ends = {"low": value - 0.01, "high": value + 0.01}
    return {"effect": effect, "target": target, "parameters": [parameter | ends]}


def _run(robot, *findings, monkeypatch, folder):
    """The record of a robot in which this is found."""
    saved = []
    document = {"verdict": "explained", "findings": findings, "fit": FIT}
    answer = SimpleNamespace(
        document=document, save=lambda where, force: saved.append(where)
    )
    monkeypatch.setattr(diagnose, "diagnose", lambda *files, seed: answer)
    tasks = STUDY.list_tasks(StudyRequest(1, cases=folder))
    (task,) = (t for t in tasks if t.settings["robot"] == robot)
    outcome = STUDY.run_task(task.settings)
    assert saved == [task.settings["out"]]
    return {"settings": task.settings, "outcome": outcome, "seconds": 1.0}


@pytest.fixture
def fleet(tmp_path):
    """A folder of one model and three recordings."""
    for name in ("model.xml", "a.h5", "b.h5", "c.h5"):
        (tmp_path / name).touch()
    return tmp_path


def test_what_differs_among_robots_is_said(fleet, monkeypatch):
    def run(robot, *findings):
        return _run(robot, *findings, monkeypatch=monkeypatch, folder=fleet)

    records = [
        run("a", _finding("friction", 0.10), _finding("delay", 0.02)),
        run("b", _finding("friction", 0.11), _finding("delay", 0.9)),
        run("c", _finding("friction", 0.10), _finding("payload", 0.3)),
    ]
    robots, effects, verdicts = STUDY.make_tables(records)
    assert [row[0] for row in robots.rows] == ["a", "b", "c"]
    assert "friction joint:knee 0.1 N m; delay" in robots.rows[0][-1]
    found = {row[0]: row for row in effects.rows}
    assert [row[0] for row in effects.rows] == ["friction", "delay", "payload"]
    assert found["friction"][2:4] == ("3/3", "all")
    assert found["delay"][2:4] == ("2/3", "all but c")
    assert found["payload"][2:4] == ("1/3", "only c")
    same, other = (float(found[name][5]) for name in ("friction", "delay"))
    assert same > 0.1 and other < 1e-6 and found["payload"][5] == ""
    assert verdicts.rows[0][0] == "explained"


def test_a_robot_is_a_folder_or_a_recording_of_a_fleet(fleet, tmp_path):
    tasks = STUDY.list_tasks(StudyRequest(1, cases=fleet))
    outs = [task.settings["out"] for task in tasks]
    assert outs == [str(fleet / "diagnosis" / name) for name in "abc"]
    many = tmp_path / "many"
    for robot in ("one", "two"):
        (many / robot).mkdir(parents=True)
        for name in diagnose.GIVEN:
            (many / robot / name).touch()
    tasks = STUDY.list_tasks(StudyRequest(2, cases=many))
    assert [t.key for t in tasks] == ["one 0", "two 0", "one 1", "two 1"]
    assert tasks[0].settings["out"] == str(many / "one" / "diagnosis")


def test_a_model_without_a_recording_is_refused(tmp_path):
    (tmp_path / "model.xml").touch()
    with pytest.raises(InputError, match="no recording"):
        STUDY.list_tasks(StudyRequest(1, cases=tmp_path))
