"""What was computed is found again, and only where nothing it depends on changed."""

import numpy as np
import pytest

from selfheal.diagnosis import diagnose as module
from selfheal.diagnosis.diagnose import diagnose
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.output.document import format_document
from selfheal.diagnosis.simulation.checkpoint import Checkpoint
from tests.support.recorded_robots import ROBOTS, record

INPUTS = ("fit", np.arange(3.0), (1, None), [b"of", 2.5])


class Computation:
    """Counts how often it is done."""

    def __init__(self) -> None:
        self.arrays, self.count = (np.arange(4.0), np.array(7)), 0

    def __call__(self):
        self.count += 1
        return self.arrays


def test_arrays_are_computed_once_for_the_same_inputs(tmp_path):
    compute = Computation()
    for _ in range(3):
        arrays = Checkpoint(tmp_path).load_or_compute(INPUTS, compute)
        for value, expected in zip(arrays, compute.arrays, strict=True):
            np.testing.assert_array_equal(value, expected)
            assert value.dtype == expected.dtype
    assert compute.count == 1
    Checkpoint(tmp_path).load_or_compute(("try", *INPUTS[1:]), compute)
    assert compute.count == 2


def test_nothing_is_kept_without_a_folder():
    compute = Computation()
    for _ in range(2):
        Checkpoint().load_or_compute(INPUTS, compute)
    assert compute.count == 2


def test_what_other_code_computed_is_not_found(tmp_path):
    compute = Computation()
    for programs in (b"old", b"old", b"new", None, None):
        Checkpoint(tmp_path, programs).load_or_compute(INPUTS, compute)
    assert compute.count == 3


@pytest.mark.parametrize("rest", [0, 1, 40])
def test_arrays_that_cannot_be_read_are_computed_again(tmp_path, rest):
    compute = Computation()
    Checkpoint(tmp_path).load_or_compute(INPUTS, compute)
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(kept.read_bytes()[:rest])
    for _ in range(2):
        Checkpoint(tmp_path).load_or_compute(INPUTS, compute)
    assert compute.count == 2


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
