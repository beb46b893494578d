"""Effects that set in while a robot is recorded."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.diagnose import diagnose
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.base import Onset
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.marginalization import marginalize_initial_states
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.selection.change_point import (
    _list_cuts,
    choose_held_out_after,
    detect_change_point,
    set_onset,
)
from tests.support.recorded_robots import ROBOTS, bench, record

PENDULUM, STEP = ROBOTS["pendulum"], 0.002
WORN = 0.04  # [N m s/rad]


def _worn(model) -> None:
    model.dof_damping[0] += WORN


def _changing(*, at: int, episodes: int = 6, seed: int = 0, change=_worn):
    """A recording of a pendulum that is another one from an episode on."""
    before, after = (
        record(PENDULUM, episodes=episodes, seed=seed, change=c)
        for c in (lambda model: None, change)
    )
    named = enumerate(before.episodes.items())
    chosen = {k: e if i < at else after.episodes[k] for i, (k, e) in named}
    return replace(before, episodes=chosen)


def _stated_fit(folder, recording):
    """The fit of the nominal values to all segments."""
    from selfheal.diagnosis.simulation.build import build_simulator, summarize_robot
    from selfheal.diagnosis.simulation.model_variants import ModelCompiler

    path = folder / "model.xml"
    path.write_text(PENDULUM.xml)
    simulator = build_simulator(ModelCompiler(str(path)), [recording])
    terms = build_nominal_terms(summarize_robot(simulator))
    sigma = np.full(1, PENDULUM.noise)
    problem = Problem(
        simulator, cut_segments(simulator.episodes, round(0.5 / STEP)), sigma
    )
    problem = marginalize_initial_states(problem, terms, np.ones(len(terms)))
    return fit_parameters(problem, terms, np.ones(len(terms)))


def test_a_dated_effect_is_there_from_its_onset_on(tmp_path):
    b = bench("pendulum", tmp_path, episodes=3)
    (term,) = find_effect("coulomb_friction").propose_terms(b.robot)
    segments, value = cut_segments(b.simulator.episodes, 250), np.array([[0.1]])
    onset = Onset(1, "001", 1.0, 1.0, 1.0)
    predicted, always = (
        b.simulator.simulate([t], value, segments)[0]
        for t in (*set_onset([term], onset), term)
    )
    never = b.simulator.simulate([], np.zeros((1, 0)), segments)[0]
    number, begin = (
        segments.episode[segments.segment_of_sample],
        segments.first_step[segments.segment_of_sample] * STEP,
    )
    late = (number > 1) | ((number == 1) & (begin > 0.9))
    assert 0 < late.sum() < len(late)
    np.testing.assert_allclose(predicted[late], always[late])
    np.testing.assert_allclose(predicted[~late], never[~late])
    assert np.abs(always - never)[late].max() > 1e-3


@pytest.mark.parametrize("at", [1, 3])
def test_the_time_since_which_the_robot_differs_is_reported(tmp_path, at):
    onset = detect_change_point(_stated_fit(tmp_path, _changing(at=at)))
    assert onset is not None and (onset.number, onset.episode) == (at, f"{at:03d}")
    assert onset.time == 0


@pytest.mark.parametrize("at", [0, 6], ids=["always", "never"])
def test_what_was_always_or_never_there_did_not_set_in(tmp_path, at):
    assert detect_change_point(_stated_fit(tmp_path, _changing(at=at))) is None


@pytest.mark.parametrize(
    ("held", "expected"),
    [(("000", "004"), ("004",)), (("003", "005"), ()), (("001",), ("004",))],
    ids=["some before", "all later", "all before"],
)
def test_what_is_held_out_is_later(tmp_path, held, expected):
    from selfheal.diagnosis.simulation.dataset import prepare_dataset

    path = tmp_path / "model.xml"
    path.write_text(PENDULUM.xml)
    recording = _changing(at=2)
    case = prepare_dataset(path, [recording], held)
    onset = Onset(2, "002", 0.0, 0.0, 0.1)
    later = choose_held_out_after(onset, [recording], case.held_out)
    assert len(later) == len(expected)
    assert all(name in ("003", "004", "005") for name in later)


@pytest.mark.slow
def test_friction_that_sets_in_is_named_and_dated(tmp_path):
    """In the midst of the only episode."""
    begin = 9.2

    def torque(data):
        data.qfrc_applied[0] = -WORN * data.qvel[0] * (data.time > begin)

    path = tmp_path / "model.xml"
    path.write_text(PENDULUM.xml)
    recording = record(PENDULUM, episodes=1, seconds=24.0, seed=3, torque=torque)
    said = diagnose(path, [recording]).document
    assert said["verdict"] == "explained"
    (finding,) = said["findings"]
    assert finding["effect"] == "viscous_friction"
    (damping,) = finding["parameters"]
    assert damping["low"] < 0.03 + WORN < damping["high"]
    onset = finding["where"]["onset"]
    assert onset["episode"] == "000"
    assert onset["time"] == pytest.approx(begin, abs=0.5)
    assert onset["low"] <= onset["time"] <= onset["high"]


@pytest.mark.parametrize("count", [2, 3, 4, 50])
def test_a_change_is_looked_for_after_some_segment(count):
    cuts = _list_cuts(np.zeros(count, int))
    assert cuts and min(cuts) >= 1 and max(cuts) < count
