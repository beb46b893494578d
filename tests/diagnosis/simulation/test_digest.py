"""A digest changes with all that a computation depends on, and with nothing else."""

import functools
import operator
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.base import Effect, Onset
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.simulation.cache import SimulationCache, SimulationCounter
from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from selfheal.diagnosis.simulation.digest import Digester, digest_source
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from tests.support.problems import list_nominal_terms
from tests.support.recorded_robots import Bench, bench

SHARED = {"checkpoint", "counter", "cache", "_compiled"}  # objects, not what is asked


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory) -> Bench:
    folder = tmp_path_factory.mktemp("pendulum")
    return bench("pendulum", folder, episodes=2, seconds=0.6)


@pytest.fixture(scope="module")
def problem(pendulum) -> Problem:
    simulator = pendulum.simulator
    segments = cut_readable_segments(simulator, 0.2)
    width = segments.readings.shape[1]
    bases = tuple((np.ones((3, 2)), np.ones(2)) for _ in range(len(segments)))
    shift = np.zeros((len(segments), 2))
    response = np.zeros(segments.readings.size)
    slopes = tuple(np.ones((3, 2)) for _ in range(len(segments)))
    sigma = np.ones(width)
    return Problem(simulator, segments, sigma, bases, shift, response, slopes)


def _terms(pendulum) -> list[Any]:
    (friction,) = load_catalogue()["coulomb_friction"].propose_terms(pendulum.robot)
    late = replace(friction, onset=Onset(0, "a", 1.0, 0.5, 1.5))
    return [late, list_nominal_terms(pendulum)[0]]


def _change_last(array: np.ndarray) -> np.ndarray:
    """Another array: its last value is another."""
    changed = array.copy()
    last = changed.flat[-1]
    changed.flat[-1] = not last if last in (0, 1) else np.nan_to_num(last) + 1
    return changed


CHANGES: dict[type, Callable[[Any], Any]] = {
    bool: operator.not_,
    int: lambda x: x + 1,
    float: lambda x: x + 1,
    str: lambda x: x + "x",
    np.ndarray: _change_last,
    mujoco.MjModel: lambda x: mujoco.MjModel.from_xml_string("<mujoco/>"),
    dict: lambda x: {**x, "more": 1},
    tuple: lambda x: x[:-1],
}


def _with(value: Any, name: str, new: Any) -> Any:
    """A copy of a dataclass with one field changed, whether init takes it or not."""
    changed = object.__new__(type(value))
    for f in fields(value):
        object.__setattr__(changed, f.name, getattr(value, f.name))
    object.__setattr__(changed, name, new)
    return changed


def _variants(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Copies of a value in each of which one field, at any depth, is another."""
    if is_dataclass(value):
        for f in fields(value):
            old, name = getattr(value, f.name), f"{path}.{f.name}"
            if f.name in SHARED or old is None:
                continue
            if not is_dataclass(old) and not isinstance(old, Effect):
                yield name, _with(value, f.name, CHANGES[type(old)](old))
            for below, new in _variants(old, name):
                yield below, _with(value, f.name, new)
    elif isinstance(value, tuple) and value and is_dataclass(value[0]):
        for below, new in _variants(value[0], f"{path}[0]"):
            yield below, (new, *value[1:])


def test_every_field_of_a_problem_and_its_terms_changes_the_digest(pendulum, problem):
    question = problem, tuple(_terms(pendulum))
    original = Digester().digest(question)
    names = []
    for part, value in enumerate(question):
        for name, changed in _variants(value):
            other = tuple(changed if i == part else q for i, q in enumerate(question))
            assert Digester().digest(other) != original, name
            names.append(name)
    kinds = """.segments.readings .simulator.channels[0].ar1 .simulator.timestep
        .simulator.compiler.nominal .simulator.episodes[0].sent_ctrl .centered
        .simulator.episodes[0].polynomials.scatter .marginal_bases [0].places
        [0].onset.time [0].parameters[0].high .simulator.has_contact"""
    assert set(kinds.split()) <= set(names) and len(names) > 50


def test_an_equal_problem_has_the_same_digest(pendulum, problem):
    """Also where its model was compiled anew."""
    simulator = replace(
        pendulum.simulator,
        compiler=ModelCompiler(str(pendulum.path)),
        cache=SimulationCache(),
        counter=SimulationCounter(),
    )
    copied = replace(problem, simulator=simulator, sigma=problem.sigma.copy())
    assert Digester().digest(copied) == Digester().digest(problem)


def test_effects_of_one_name_differ_by_their_attributes_and_closures(pendulum):
    digester, terms = Digester(), list_nominal_terms(pendulum)
    digests = [digester.digest(t.effect) for t in terms]
    assert len(set(digests)) > 1
    again = list_nominal_terms(pendulum)
    assert [digester.digest(t.effect) for t in again] == digests


def _add(x, y=1):
    return x + y


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        (1, True),
        ("1", b"1"),
        (None, "None"),
        ((1, 2), ((1,), 2)),
        (("a", "b"), ("ab",)),
        ({"a": 1}, {"b": 1}),
        (np.zeros(2), np.zeros(2, np.float32)),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (slice(1, 2), slice(1, 3)),
        (functools.partial(_add, 1), functools.partial(_add, 2)),
        (functools.partial(_add, 1), functools.partial(_add, y=1)),
        (len, sorted),
        (int, float),
        (frozenset({1}), frozenset({2})),
    ],
)
def test_values_that_look_alike_are_distinguished(one, other):
    digester = Digester()
    assert digester.digest(one) != digester.digest(other)
    assert digester.digest(one) == Digester().digest(one)


def test_a_scalar_counts_the_same_before_and_after_a_file():
    assert Digester().digest(np.float64(2)) == Digester().digest(np.array(2.0))


def test_what_has_no_digest_is_refused():
    with pytest.raises(TypeError, match="no digest of a generator"):
        Digester().digest([1, (i for i in range(3))])


def test_every_change_of_a_source_file_changes_the_digest_of_the_source(tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "a.py").write_text("x = 1\n")
    (tmp_path / "notes.txt").write_text("nothing\n")
    seen = [digest_source(tmp_path)]
    (tmp_path / "notes.txt").write_text("that counts\n")
    assert digest_source(tmp_path) == seen[0]
    (tmp_path / "room" / "a.py").write_text("x = 2\n")
    seen.append(digest_source(tmp_path))
    (tmp_path / "b.py").write_text("")
    seen.append(digest_source(tmp_path))
    (tmp_path / "b.py").rename(tmp_path / "c.py")
    seen.append(digest_source(tmp_path))
    assert len(set(seen)) == len(seen)


def test_the_code_of_another_package_counts(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    path = tmp_path / "other_package_effects.py"
    path.write_text("class Sticky:\n    pass\n")
    import other_package_effects

    effect = other_package_effects.Sticky()
    before = Digester().digest(effect)
    path.write_text("class Sticky:\n    much = 2\n")
    assert Digester().digest(effect) != before
