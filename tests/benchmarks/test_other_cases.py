"""The other cases: always the same, named as the contract does, read by the scorer."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.other_cases.cases import OTHER_CASES
from benchmarks.other_cases.make import make_case, make_hidden_spec, make_key
from benchmarks.sealed.cases import save_case
from benchmarks.sealed.effects import BY_NAME
from benchmarks.sealed.judge import read_case, read_places
from selfheal.recording import check_against_model, read, read_names, validate

pytestmark = pytest.mark.slow

CASES = {case.name: case for case in OTHER_CASES}


def _short(name):
    """A case that is quickly made."""
    case, robot = CASES[name], CASES[name].robot
    short = replace(robot, seconds=0.6, episodes=1, piece=min(robot.piece, 0.2))
    return replace(case, robot=short)


@pytest.mark.parametrize("name", CASES)
def test_case_is_valid_and_its_key_is_read(name, tmp_path):
    cases, keys = tmp_path / "cases", tmp_path / "keys"
    save_case(make_case(_short(name)), cases, keys)
    folder, model = cases / name, read_names(cases / name / "model.xml")
    for file in (folder / "recording.h5", keys / name / "test.h5"):
        recording = read(file)
        validate(recording)
        check_against_model(recording, model)
    assert read_case(folder, keys)["verdict"] == "failed"  # no diagnosis
    key, places = (
        json.loads((keys / name / "key.json").read_text()),
        read_places(folder),
    )
    for effect in key["effects"]:
        assert effect["target"] in places.same
        assert (effect["effect"] in BY_NAME) == (key["kind"] != "unlisted")


def test_same_case_each_time():
    one, again = (make_case(_short("pen_two_effects")) for _ in range(2))
    for a, b in ((one.train, again.train), (one.test, again.test)):
        pairs = zip(a.episodes["run0"].signals.values(),
                    b.episodes["run0"].signals.values(), strict=True)  # fmt: skip
        assert all(np.array_equal(x.values, y.values) for x, y in pairs)
    assert one.key == again.key


def test_as_many_effects_as_its_kind_says():
    count = {"single": 1, "null": 0, "double": 2, "unlisted": 1}
    assert len(CASES) == len(OTHER_CASES)
    for case in OTHER_CASES:
        assert len(make_key(case)["effects"]) == count[case.kind]


@pytest.mark.parametrize("name", [c.name for c in OTHER_CASES if c.effects])
def test_hidden_robot_is_not_the_given_one(name):
    given = mujoco.MjModel.from_xml_string(CASES[name].robot.xml)
    hidden = make_hidden_spec(CASES[name]).compile()
    assert not np.array_equal(hidden.body_mass, given.body_mass)
