"""Plans of studies: distinct runs, what they lack, studies cut short."""

import json

import pytest

from selfheal.errors import InputError, UnknownNameError
from selfheal.study.plan import STUDIES, StudyRequest, find_study


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_plans_distinct_runs_and_shows_none_of_them_yet(name, tmp_path):
    case = tmp_path / "case"
    case.mkdir()
    for file in (case / "model.xml", case / "recording.h5"):
        file.touch()
    (tmp_path / "poses_schema.csv").touch()
    study = find_study(name)
    tasks = study.list_tasks(StudyRequest(2, 5, recordings=tmp_path, cases=tmp_path))
    assert len({task.key for task in tasks}) == len(tasks) > 0
    assert {task.settings["seed"] for task in tasks} == {5, 6}
    assert [json.loads(json.dumps(t.settings)) for t in tasks] == [
        t.settings for t in tasks
    ]
    study.make_tables([])
    study.make_pictures([])


def test_what_a_study_lacks_is_said(tmp_path):
    with pytest.raises(
        UnknownNameError, match="actions, diagnose, eea, schema, table3"
    ):
        find_study("table4")
    for name, message in (("diagnose", "FOLDER"), ("actions", "--recordings")):
        with pytest.raises(InputError, match=message):
            find_study(name).list_tasks(StudyRequest(1))
    with pytest.raises(InputError, match="no case there"):
        find_study("diagnose").list_tasks(StudyRequest(1, cases=tmp_path))
    with pytest.raises(InputError, match=r"no poses_schema\.csv there"):
        find_study("schema").list_tasks(StudyRequest(1, recordings=tmp_path))


@pytest.mark.parametrize("name", ["actions", "schema", "table3"])
def test_a_study_cut_short_has_every_row_with_the_same_seeds(name, tmp_path):
    (tmp_path / "poses_schema.csv").touch()
    tasks = find_study(name).list_tasks(StudyRequest(3, recordings=tmp_path))
    real = [t.settings for t in tasks if t.settings["robot"] == "starfish-2006"]
    seeds = [settings["seed"] for settings in real]
    assert seeds == sorted(seeds) and set(seeds) == {0, 1, 2}
    each = [[{**s, "seed": 0} for s in real if s["seed"] == k] for k in range(3)]
    assert each[0] == each[1] == each[2]
