"""Recovering legged robots: the loop, its result, and going on after a kill."""

import json
from dataclasses import replace

import numpy as np
import pytest

from selfheal.damage.apply import build_damaged_plants
from selfheal.damage.kinds import Damage
from selfheal.engine.reflex import simulate_controllers
from selfheal.recovery.explain import HypothesisPosterior
from selfheal.recovery.phased_run import load_phased_run, save_phased_run
from selfheal.recovery.recover import recover_robot
from selfheal.recovery.recover_run import (
    METHODS,
    RecoverRun,
    RecoverSettings,
    is_damage_named,
    serialize_hypotheses,
    summarize_beliefs,
)
from selfheal.report.recover import make_recover_page
from selfheal.robot.scenarios import draw_scenario
from selfheal.robot.simulated_legs import SimulatedLegs
from tests.support.killed_process import format_run
from tests.support.short_recover import DEAF, FLAT, JAM, LOWER, QUADRUPED, shorten


def test_hypotheses_that_predict_the_same_are_counted_once():
    weak = Damage("weak_sensor", DEAF.target, 0.02)
    several = [(weak,), (DEAF,), (replace(weak, value=0.0201),)]
    phase = {
        "believed": serialize_hypotheses(several),
        "probability": [0.4, 0.35, 0.25],
    }
    shares = summarize_beliefs(phase)
    assert list(shares.values()) == [pytest.approx(0.65), pytest.approx(0.35)]


@pytest.fixture(scope="module", autouse=True)
def short():
    """Searches of a second."""
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch.setattr)
        yield


def _settings(method="ours", number=1, **more):
    damage = (LOWER,) if number == 1 else draw_scenario(number, QUADRUPED, 0)
    few = {"generations": 2, **more}
    return RecoverSettings("quadruped", number, damage, method, seed=2, **few)


def _steps(settings, run=None):
    robot = SimulatedLegs(settings.legged_robot, settings.seed, settings.gap)
    return list(recover_robot(robot, settings, run=run))


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(m, marks=pytest.mark.slow) if m == "as-described" else m
        for m in METHODS
    ],
)
def test_a_recovery_that_was_killed_goes_on_to_the_same_end(method, tmp_path):
    settings = _settings(method, trials=2)
    steps = _steps(settings)
    save_phased_run(steps[1], tmp_path / "recover.h5")
    kept = load_phased_run(tmp_path / "recover.h5", RecoverRun)
    assert format_run(_steps(settings, kept)[-1]) == format_run(steps[-1])
    assert len(_steps(settings, steps[-1])) == 1
    page = make_recover_page(steps[-1])
    assert "Footfalls" in page and "left front lower lost" in page
    assert "<script" not in page


@pytest.fixture(scope="module")
def run(short):
    """A recovery of one trial."""
    return _steps(_settings(trials=1))[-1]


def test_the_result_has_what_scripts_need(run):
    result = json.loads(json.dumps(run.result, allow_nan=False))
    assert list(result) == [
        *("format", "version", "robot", "seed", "scenario", "method", "damage"),
        *("alarm", "verdict", "hypotheses", "actions", "trials", "distance"),
        *("predicted", "seconds"),
    ]
    assert is_damage_named(run) is True and result["verdict"] == "listed"
    assert list(result["hypotheses"][0]) == ["kind", "target", "value", "probability"]
    assert len(result["trials"]) == result["actions"] == 1
    assert list(result["distance"]) == ["intact", "damaged", "healed", "best_known"]


def test_the_belief_never_depends_on_what_is_said_to_be_true(run):
    """The hidden truth stands in the settings, for the report; nobody decides by it."""
    settings = _settings(trials=1)
    robot = SimulatedLegs(settings.legged_robot, 2)
    lied = replace(settings, damage=(DEAF,))

    class Other:
        legged = robot.legged

        def run_trials(self, weights):
            return robot.run_trials(weights)

        def struck(self, damage):
            return robot.struck((LOWER,))

    *_, other = recover_robot(Other(), lied)
    believed = [r.phases["estimate-1"]["believed"] for r in (run, other)]
    assert believed[0] == believed[1]
    np.testing.assert_array_equal(
        run.phases["explore-1"]["weights"], other.phases["explore-1"]["weights"]
    )


def test_where_no_listed_damage_explains_the_trials_gaits_of_other_searches_are_tried():
    settings = _settings(number=10, trials=1, more_trials=2)  # neurons are not listed
    *_, run = _steps(settings)
    names = list(run.phases)
    assert names[4:6] == ["trial-1", "estimate-2"] and run.unlisted
    assert run.result["verdict"] == "unlisted" and run.result["hypotheses"] == []
    assert is_damage_named(run) is False
    ways = [trial.displacement for trial in run.trials[1:]]
    assert len(ways) == 3 or ways[-1] >= run.phases["original"]["way"]
    assert run.result["distance"]["healed"] >= round(max(ways), 4)
    tried = [trial.weights for trial in run.trials]
    assert len(np.unique(tried, axis=0)) == len(tried)
    assert "nearest is" in make_recover_page(run)
    kept = replace(run, phases={k: run.phases[k] for k in names[:6]}, result={})
    assert format_run(_steps(settings, kept)[-1]) == format_run(run)


def test_in_doubt_the_trial_is_one_that_separates(monkeypatch):
    doubt = [(DEAF,), (JAM,)]

    def torn(robot, trims, trials, before, known, progress):
        return HypothesisPosterior(tuple(doubt), np.array([0.5, 0.5]), FLAT)

    monkeypatch.setattr("selfheal.recovery.recover.estimate_damage", torn)
    run = _steps(_settings(trials=1))[-1]
    assert run.phases["explore-1"]["why"] == "separates 2 hypotheses"
    weights = np.tile(run.phases["explore-1"]["weights"], (2, 1))
    drives = simulate_controllers(build_damaged_plants(QUADRUPED, doubt), weights)
    assert np.abs(drives.sensors[0] - drives.sensors[1]).max() > 0.1
