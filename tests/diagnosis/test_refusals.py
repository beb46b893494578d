"""What a diagnosis refuses, and what it tells, before it searches."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from selfheal.diagnosis.diagnose import diagnose
from selfheal.diagnosis.output import build_result
from selfheal.errors import ModelError, RecordingError, UnknownNameError
from tests.support.recorded_robots import ROBOTS, record

PENDULUM = ROBOTS["pendulum"]
short = partial(record, PENDULUM, episodes=4, seconds=1.5, noise=4e-3, seed=3)


@pytest.fixture
def model(tmp_path):
    (tmp_path / "model.xml").write_text(PENDULUM.xml)
    return tmp_path / "model.xml"


def test_a_model_that_mujoco_cannot_load_is_refused_with_its_words(tmp_path):
    (tmp_path / "bad.xml").write_text("<mujoco>\n <bodywork/>\n</mujoco>")
    with pytest.raises(ModelError, match=r"bad.xml: .*bodywork.*line 2"):
        diagnose(tmp_path / "bad.xml", [short(episodes=2)])


def test_too_little_is_refused(model):
    with pytest.raises(RecordingError, match="too few to decide"):
        diagnose(model, [short(episodes=2, seconds=0.3)])


def test_a_robot_at_rest_is_refused(model):
    still = replace(
        PENDULUM, command=lambda t, rng: np.zeros((t.size, 1)),
        begin=lambda rng: (np.zeros(1), np.zeros(1)),
    )  # fmt: skip
    with pytest.raises(RecordingError, match="no position-like signal moves"):
        diagnose(model, [record(still, episodes=4, seconds=1.5, noise=4e-3)])


def test_an_unknown_held_out_name_is_refused(model):
    with pytest.raises(UnknownNameError, match="nine"):
        diagnose(model, [short()], held_out=["nine"])


def test_a_recording_of_another_robot_is_refused(model):
    with pytest.raises(RecordingError, match="shoulder"):
        diagnose(model, [record(ROBOTS["arm"], episodes=3, seconds=0.5)])


class _SearchBegan(Exception):
    """Ends a diagnosis whose beginning is all that a test asks for."""


def _listen_until_search(said: list[str]):
    """A progress function that notes what is said, up to the search."""

    def listen(what, share):
        if what.startswith("refitting"):
            raise _SearchBegan
        said.append(what)

    return listen


def _refuse(*arguments):
    raise ModelError("it has no text")


def test_a_text_that_cannot_be_copied_is_refused_before_the_search(model, monkeypatch):
    monkeypatch.setattr(build_result, "apply_edits", _refuse)
    with pytest.raises(ModelError, match="it has no text"):
        diagnose(model, [short()], progress=_listen_until_search([]))


def test_a_text_that_cannot_be_patched_is_told_before_the_search(model, monkeypatch):
    monkeypatch.setattr(build_result, "compile_patched", _refuse)
    said: list[str] = []
    with pytest.raises(_SearchBegan):
        diagnose(model, [short()], progress=_listen_until_search(said))
    assert said[-1] == "patched.xml will be the model as given: it has no text"
