"""A column of ctrl is a control: how those of one actuator are told apart."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.errors import RecordingError
from selfheal.recording import (
    Episode,
    Recording,
    check_against_model,
    list_controls,
    list_model_names,
    split,
    validate,
)
from selfheal.recording.controls import order_columns

MODEL = """<mujoco><worldbody>
  <body><joint name="knee"/><geom size="0.1"/>
    <body><joint name="hip" type="ball"/><geom size="0.1"/></body></body></worldbody>
  <actuator>
    <dcmotor name="idle" joint="knee" motorconst="1" resistance="1" input="none"/>
    <pid {name}joint="knee" kp="2" kv="1"/>
    <orientation name="turn" joint="hip" kp="3" kv="1" input="quat"/>
    <position name="last" joint="knee" kp="1"/>
  </actuator></mujoco>"""
BY_ACTUATOR = ("servo", "servo", "turn", "turn", "turn", "turn", "last")
BY_INPUT = ("servo_pos", "servo_vel", *(f"turn_q{x}" for x in "wxyz"), "last")


def _compile(name='name="servo" '):
    return mujoco.MjModel.from_xml_string(MODEL.format(name=name))


def _record(names):
    ctrl = np.arange(3.0 * len(names)).reshape(3, len(names))
    episode = Episode(np.arange(3.0), ctrl, tuple(names), {})
    return Recording({"a": episode}, file="legs.h5")


def _check(names, model=None):
    validate(recording := _record(names))
    check_against_model(recording, list_model_names(model or _compile()))


@pytest.mark.parametrize("names", [BY_ACTUATOR, BY_INPUT])
def test_either_name_fits_in_any_order_of_the_actuators(names):
    for turned in (names, names[-1:] + names[:-1]):
        _check(turned)
        order = order_columns(turned, list_controls(_compile()))
        assert [turned[i] for i in order] == list(names)


def test_columns_with_one_name_are_in_mujocos_order():
    """Others between them do not matter; of full names each says which it is."""
    controls = list_controls(_compile())
    mixed = ("servo", "turn", "last", "turn", "servo", "turn", "turn")
    assert order_columns(mixed, controls) == [0, 4, 1, 3, 5, 6, 2]
    assert order_columns(BY_INPUT[::-1], controls) == [6, 5, 4, 3, 2, 1, 0]


def test_an_actuator_with_the_name_of_anothers_input_has_its_own_column():
    xml = MODEL.format(name='name="servo" ').replace('"last"', '"servo_vel"')
    controls = list_controls(mujoco.MjModel.from_xml_string(xml))
    names = ("servo_vel", "turn", "turn", "turn", "turn", "servo", "servo")
    assert order_columns(names, controls) == [5, 6, 1, 2, 3, 4, 0]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (BY_ACTUATOR[1:], "for 'servo', 'turn'.*; would fit: 'servo', 'servo', 'turn'"),
        (BY_ACTUATOR[:-1], "no column for actuator 'last' of the model"),
        (
            (*BY_ACTUATOR, "last"),
            "'last', 'last'; would .* or 'servo_pos', 'servo_vel'",
        ),
        ((*BY_ACTUATOR, "idle"), "'last', 'idle'; would fit: 'servo', 'servo', 'turn'"),
        (("servo_vel", *BY_INPUT[1:]), "for 'servo_vel', 'servo_vel', .*; would fit"),
        (("servo_ff", *BY_INPUT[1:]), "no actuator 'servo_ff'; would fit: 'servo', 's"),
        (("last_pos", *BY_INPUT), "no actuator 'last_pos'"),
    ],
)
def test_columns_that_are_not_the_models_controls_are_refused(names, said):
    with pytest.raises(RecordingError, match=f"legs.h5, episode 'a': .*{said}"):
        _check(names)


def test_an_actuator_without_a_name_counts_once():
    with pytest.raises(RecordingError, match="1 of the model's actuators have no name"):
        _check(BY_ACTUATOR[2:], _compile(name=""))


@pytest.mark.parametrize("names", [BY_ACTUATOR, BY_INPUT])
def test_a_split_spans_the_ranges_of_all_columns_with_one_name(names):
    """What is held out lies within the rest, in the second column of an actuator."""
    episode = _record(names).episodes["a"]
    episodes = {}
    for size in (1.0, 9.0, 3.0, 4.0):
        ctrl = np.zeros_like(episode.ctrl)
        ctrl[:, 1] = size * np.arange(len(ctrl))
        episodes[str(size)] = replace(episode, ctrl=ctrl)
    _, held = split(Recording(episodes))
    assert list(held.episodes) == ["4.0"]


def test_arrays_by_the_names_of_controls_are_a_recording(tmp_path):
    (tmp_path / "legs.xml").write_text(MODEL.format(name='name="servo" '))
    columns = {name: np.full(3, float(k)) for k, name in enumerate(BY_INPUT)}
    made = Recording.from_arrays(
        np.arange(3.0), columns, {}, model=tmp_path / "legs.xml"
    )
    assert made.episodes["000"].ctrl_names == BY_INPUT
