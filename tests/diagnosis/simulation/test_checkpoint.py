"""What was worked out is found again, and only where nothing it depends on changed."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis import diagnose as module
from selfheal.diagnosis.diagnose import diagnose
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.output.document import format_document
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.checkpoint import Checkpoint
from selfheal.diagnosis.simulation.digest import Digester
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from tests.support.recorded_robots import ROBOTS, bench, record

ANSWER = (np.arange(4.0), np.array(7))
QUESTION = ("fit", np.arange(3.0), (1, None), [b"of", 2.5])


class Work:
    """Counts how often it is done."""

    def __init__(self, answer=ANSWER) -> None:
        self.answer, self.done = answer, 0

    def __call__(self):
        self.done += 1
        return self.answer


def test_an_answer_is_worked_out_once(tmp_path):
    work = Work()
    answers = [Checkpoint(tmp_path).load_or_compute(QUESTION, work) for _ in range(3)]
    assert work.done == 1
    for answer in answers:
        for value, expected in zip(answer, work.answer, strict=True):
            np.testing.assert_array_equal(value, expected)
            assert value.dtype == expected.dtype


@pytest.mark.parametrize(
    "other",
    [
        ("try", *QUESTION[1:]),
        ("fit", np.arange(3), *QUESTION[2:]),
        ("fit", np.arange(3.0) + 1e-12, *QUESTION[2:]),
        ("fit", np.arange(3.0)[None], *QUESTION[2:]),
        QUESTION[:-1],
        (*QUESTION[:2], (1, 0), QUESTION[3]),
    ],
)
def test_another_question_has_another_answer(tmp_path, other):
    memory = Checkpoint(tmp_path)
    memory.load_or_compute(QUESTION, Work())
    work = Work((np.zeros(1),))
    (answer,) = memory.load_or_compute(other, work)
    assert work.done == 1
    assert answer == 0


def test_nothing_is_kept_without_a_folder():
    work = Work()
    Checkpoint().load_or_compute(QUESTION, work)
    Checkpoint().load_or_compute(QUESTION, work)
    assert work.done == 2


def test_what_other_code_computed_is_not_found(tmp_path):
    work = Work()
    for programs in (b"old", b"old", b"new", None, None):
        Checkpoint(tmp_path, programs).load_or_compute(QUESTION, work)
    assert work.done == 3


@pytest.mark.parametrize("rest", [0, 1, 40])
def test_an_answer_that_cannot_be_read_is_worked_out_again(tmp_path, rest):
    work = Work()
    Checkpoint(tmp_path).load_or_compute(QUESTION, work)
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(kept.read_bytes()[:rest])
    Checkpoint(tmp_path).load_or_compute(QUESTION, work)
    Checkpoint(tmp_path).load_or_compute(QUESTION, work)
    assert work.done == 2


def test_what_answers_are_about_is_the_model_and_every_reading(tmp_path):
    pendulum = bench("pendulum", tmp_path, episodes=2, seconds=0.3)
    compiler, recording = pendulum.simulator.compiler, pendulum.recording
    name, episode = next(iter(recording.episodes.items()))
    key, signal = next(iter(episode.signals.items()))
    values = signal.values.copy()
    values[5] += 1e-9
    signals = {**episode.signals, key: replace(signal, values=values)}
    episodes = {**recording.episodes, name: replace(episode, signals=signals)}
    (tmp_path / "arm").mkdir()
    arm = bench("arm", tmp_path / "arm", episodes=1, seconds=0.3)

    def digest(compiler, recording) -> bytes:
        return Digester().digest(build_simulator(compiler, [recording]))

    original = digest(compiler, recording)
    again = ModelCompiler(str(pendulum.path))
    assert digest(again, replace(recording)) == original
    assert digest(compiler, replace(recording, episodes=episodes)) != original
    other = Digester().digest(arm.simulator.compiler)
    assert other != Digester().digest(compiler)


class Killed(BaseException):
    """An exception that, like Ctrl-C, is no Exception."""


@pytest.fixture(scope="module")
def dry_pendulum(tmp_path_factory):
    """The model of a pendulum, and a recording of one with dry friction."""
    model = tmp_path_factory.mktemp("pendulum") / "model.xml"
    model.write_text(ROBOTS["pendulum"].xml)

    def change(model) -> None:
        model.dof_frictionloss[:] = 0.1

    recording = record(
        ROBOTS["pendulum"], episodes=4, seconds=1.5, noise=4e-3, seed=3, change=change
    )
    return model, recording


@pytest.fixture(scope="module")
def few():
    """A catalogue of three."""
    names = ("coulomb_friction", "command_delay", "sensor_bias")
    small = {name: load_catalogue()[name] for name in names}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "load_catalogue", lambda: small)
        yield


@pytest.fixture(scope="module")
def whole(few, dry_pendulum):
    """The diagnosis that nobody killed."""
    model, recording = dry_pendulum
    return diagnose(model, [recording])


@pytest.mark.parametrize("last", [4, pytest.param(7, marks=pytest.mark.slow)])
def test_a_killed_diagnosis_goes_on_to_the_same_end(
    last, whole, dry_pendulum, tmp_path
):
    (model, recording), memory = dry_pendulum, tmp_path / "memory"
    calls = 0

    def kill(what, share):
        nonlocal calls
        calls += 1
        if calls > last:
            raise Killed

    with pytest.raises(Killed):
        diagnose(model, [recording], memory=memory, progress=kill)
    kept = set(memory.iterdir())
    assert kept
    again = diagnose(model, [recording], memory=memory)
    assert set(memory.iterdir()) > kept
    assert format_document(again.document) == format_document(whole.document)
    assert again.patched == whole.patched
    assert again.simulations == whole.simulations
