"""What a diagnosis found, in sentences."""

import re

import pytest

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.declaration import PLACEHOLDERS
from selfheal.report import phrases
from selfheal.report.phrases import state_verdict
from tests.support.made_up_diagnosis import (
    DELAY,
    FINDING,
    make_diagnosis,
    make_document,
    read_page_words,
)


def test_one_finding_is_reported_in_plain_words():
    assert state_verdict(make_document()) == (
        "The joint knee has dry friction of 0.14 N m (0.12 to 0.16) that the model "
        "lacks; it explains 95\N{NO-BREAK SPACE}% of the error that can be explained."
    )


def test_several_findings_are_one_sentence():
    said = state_verdict(make_document(findings=(FINDING, DELAY)))
    assert said.startswith("2 things differ from the model: the joint knee has dry ")
    assert "the actuator hip_motor acts on its commands 0.0123 s (0.0118 to" in said
    assert "late, since 3.40 s of episode 002; together they explain 95" in said
    assert len(re.findall(r"\.(?!\d)", said)) == 1


def test_the_same_in_several_places_is_one_thing():
    legs = [{**DELAY, "target": f"actuator:{k}"} for k in "abcdefgh"]
    said = state_verdict(make_document(findings=legs[:3]))
    assert said.startswith("Each of the actuators a, b and c acts on its commands ")
    assert "; it explains" in said
    assert state_verdict(make_document(findings=legs)).startswith(
        "Each of 8 actuators acts "
    )


def test_many_findings_are_counted():
    many = [{**FINDING, "target": "joint:a"}, DELAY]
    many += [{**FINDING, "effect": f"effect_{k}"} for k in range(5)]
    said = state_verdict(make_document(findings=many))
    assert said.startswith("7 things differ from the model, the 3 that explain most: ")
    assert "effect 0 (frictionloss 0.14 N m" in said and "effect 1" not in said
    assert read_page_words(make_diagnosis(findings=many)).count("joint:knee") >= 5


@pytest.mark.parametrize(
    "removed, says",
    [
        (None, "it brings the held-out error from 0.12 to 0.03."),
        (0.999, "it explains all of the error that can be explained."),
        (1.04, "it explains all of the error"),
        (-0.2, "it explains none of the held-out error (0.12 before)."),
    ],
)
def test_what_a_finding_is_worth_is_said(removed, says):
    document = make_document()
    document["fit"]["explainable_removed"] = removed
    assert says in state_verdict(document)


def test_where_short_pieces_are_noise_longer_ones_tell_the_worth():
    document = make_document()
    document["fit"] |= {"explainable_removed": None, "refit": 0.0141}
    document["fit"]["horizons"] = [
        {"seconds": 0.5, "explainable_removed": None},
        {"seconds": 2.0, "explainable_removed": 0.93},
    ]
    said = state_verdict(document)
    assert "explains 93\N{NO-BREAK SPACE}% of the error over 2 s that can" in said


def test_every_effect_has_its_own_words():
    assert set(PLACEHOLDERS) == {"at", "all", *phrases.COMMON}
    for effect in load_catalogue().values():
        names = set(re.findall(r"{(\w+)}", effect.phrase)) - set(PLACEHOLDERS)
        stated = [{"name": n, "value": 1.5, "unit": "1"} for n in names]
        found = {"effect": effect.name, "target": "joint:a", "parameters": stated}
        said = state_verdict(make_document(findings=(found,)))
        assert "{" not in said and "shows" not in said and said[0].isupper()
        assert all("1.5" in said for _ in names)


def test_a_plugins_effect_is_reported_by_its_name():
    found = {"effect": "magnetic_drag", "target": "world", "parameters": []}
    said = state_verdict(make_document(findings=(found,)))
    assert said.startswith("The robot shows magnetic drag that the model lacks; ")
    # an effect of the catalogue with other parameters than its sentence speaks of
    found = {**FINDING, "effect": "cogging"}
    assert "shows cogging (frictionloss 0.14" in state_verdict(
        make_document(findings=(found,))
    )
