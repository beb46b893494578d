"""Damage in the words of users."""

import pytest

from selfheal.damage.kinds import KINDS
from selfheal.damage.words import WORDS, parse_damages
from selfheal.errors import UnknownNameError
from selfheal.robot.actions import load_published_body
from tests.support.paths import ROOT

BODY = load_published_body()
ANATOMY = BODY.anatomy


def test_every_kind_can_be_said():
    said = (
        "right_lower:0.1, loss:left_upper, jam:left_hip:20, weak:back_knee:0.4, "
        "dead:clearance, lie:vertical:0.7, slope:8:90, friction:0.2"
    )
    kinds = [damage.kind for damage in parse_damages(said, ANATOMY)]
    legged = {"neuron_dead", "wind"}  # struck by `robot.scenarios`
    assert sorted(kinds) == sorted(set(KINDS) - {"none"} - legged)
    command = (ROOT / "cli" / "heal.py").read_text()  # its help, which loads nothing
    assert all(f"{word}:" in command for word in WORDS)


def test_an_actuator_may_be_named_by_its_joint():
    assert parse_damages("weak:left_hip", ANATOMY) == parse_damages(
        "weak:left_hip_servo:0.5", ANATOMY
    )


@pytest.mark.parametrize(
    ("said", "listed"),
    [
        ("loss:tail", "left_upper"),
        ("dead:nose", "clearance"),
        ("jam:left_lower", "left_hip"),
    ],
)
def test_a_name_that_is_not_there_is_refused_with_those_that_are(said, listed):
    with pytest.raises(UnknownNameError, match=listed):
        parse_damages(said, ANATOMY)
