"""Healing a robot: what is found, the result, and going on after a kill."""

import json
from dataclasses import replace

import numpy as np
import pytest

from selfheal import files
from selfheal.damage.words import parse_damages
from selfheal.errors import InputError, RunFileError
from selfheal.gait.rival_bodies import select_rival_bodies
from selfheal.gait.synthesis import Gait, LikelyPlants
from selfheal.recovery import phases
from selfheal.recovery.heal import check_same_body, heal_robot
from selfheal.recovery.phased_run import (
    ignore_progress,
    load_phased_run,
    save_phased_run,
)
from selfheal.recovery.phases import make_robot_states
from selfheal.recovery.record import HealRun, HealSettings
from selfheal.recovery.recover_run import RecoverRun
from selfheal.report.heal import make_heal_page
from selfheal.robot.base import require_walker
from selfheal.robot.open_robot import open_robot
from tests.support.damaged.members import NEVER_FIT, make_damaged_copies
from tests.support.short_heal import BODY, GENES, PLACEMENT, identified, robot

pytestmark = pytest.mark.usefixtures("short_heal")
NOSE = {"kind": "limb_loss", "target": "body:nose"}


def _heal(said, run=None):
    damage = parse_damages(said, BODY.anatomy)
    settings = HealSettings("run.h5", damage, 12.0, seed=1)
    robots = make_robot_states(robot(), settings)
    return list(heal_robot(robots, BODY, np.ones(1), settings, run=run))


@pytest.fixture(scope="module")
def steps(short_heal):
    """A heal of a short leg, phase by phase."""
    return _heal("right_lower:0.1")


def test_a_short_leg_is_noticed_and_found(steps):
    result = steps[-1].result
    best = result["hypotheses"][0]
    assert 12.0 <= result["alarm"]["time"] <= 16.0
    assert (best["kind"], best["target"]) == ("part_scale", "body:right_lower")
    assert best["value"] == pytest.approx(0.1, abs=0.1)
    assert best["probability"] > 0.9
    assert result["actions"] <= 8
    assert result["distance"]["damaged"] < 0.5 * result["distance"]["intact"]


def test_the_result_is_what_the_contract_says(steps):
    result = json.loads(json.dumps(steps[-1].result, allow_nan=False))
    assert list(result) == [
        *("format", "version", "robot", "seed", "damage", "alarm", "hypotheses"),
        *("actions", "distance", "predicted", "seconds", "run"),
    ]
    assert list(result["alarm"]) == ["time", "sensor", "p_value"]
    assert list(result["damage"][0]) == ["kind", "target", "value"]
    kept = ["kind", "target", "value", "probability"]
    assert all(list(h) == kept for h in result["hypotheses"])
    chances = [h["probability"] for h in result["hypotheses"]]
    assert chances == sorted(chances, reverse=True)
    assert list(result["distance"]) == ["intact", "damaged", "healed", "best_known"]
    assert list(result["predicted"]) == ["intact", "healed"]


@pytest.mark.parametrize("new_is_good", [True, False])
def test_of_a_new_gait_and_the_old_one_the_robot_keeps_what_gets_it_farther(
    monkeypatch, new_is_good
):
    good, idle = (
        Gait("waves", genes, 0.0, 9.0, 9.0, 9.0, 0, 0) for genes in (GENES, 0 * GENES)
    )
    new, old = (good, idle) if new_is_good else (idle, good)
    monkeypatch.setattr(phases, "synthesize_gaits", lambda *a, **k: [new])
    settings = HealSettings("", parse_damages("friction:0.8", BODY.anatomy), 12.0)
    robots = make_robot_states(robot(), settings)
    work = phases.HealPhases(
        robots, BODY, np.ones(1), settings, ignore_progress, phases.Past()
    )
    kept = work.try_gaits("healed", LikelyPlants(work.plants), old)
    assert kept.genes is good.genes


def test_a_finished_heal_is_not_done_again(steps, tmp_path):
    save_phased_run(steps[-1], tmp_path / "heal.h5")
    kept = load_phased_run(tmp_path / "heal.h5", HealRun)
    again = _heal("right_lower:0.1", kept)
    assert len(again) == 1 and again[0].result == steps[-1].result


@pytest.mark.slow
def test_a_heal_with_a_member_replaced_is_refused_or_fits_its_run(
    steps, tmp_path, monkeypatch
):
    monkeypatch.setattr(files, "explain_dangerous", lambda *what: "")
    save_phased_run(steps[-1], tmp_path / "heal.h5")
    passed = set()
    for member, what, damaged in make_damaged_copies(tmp_path / "heal.h5"):
        try:
            check_same_body(load_phased_run(damaged, HealRun), BODY)
            passed.add((member, what))
        except RunFileError:
            pass
    assert passed and not {each for each in passed if each[1] in NEVER_FIT}


@pytest.mark.parametrize(
    "name, changes, said",
    [
        ("ask-01", {"probe": 99}, "probe of action 1 is 99; would fit: 0 to 72"),
        ("ask-01", {"values": np.zeros(3)}, "action 1 has 3 values; would fit: "),
        ("whole", {"angles": np.zeros((5, 3))}, "whole has 3 columns; would fit: 8"),
        ("verdict", {"believed": [NOSE]}, "target 'body:nose'; would fit: left_upper"),
    ],
)
def test_a_heal_of_another_body_is_not_gone_on_with(steps, name, changes, said):
    run = steps[-1]
    phases = {**run.phases, name: {**run.phases[name], **changes}}
    with pytest.raises(RunFileError, match=said):
        check_same_body(replace(run, phases=phases), BODY)


def test_a_result_needs_all_phases(steps, tmp_path):
    kept = {k: p for k, p in steps[-1].phases.items() if k != "known"}
    save_phased_run(replace(steps[-1], phases=kept), tmp_path / "heal.h5")
    with pytest.raises(RunFileError, match="there is a result, but no phase known"):
        load_phased_run(tmp_path / "heal.h5", HealRun)


def test_the_page_reports_it_and_loads_nothing(steps):
    page = make_heal_page(steps[-1], BODY)
    assert "right lower x" in page
    assert "<script" not in page and "http" not in page.replace(
        "http-equiv", ""
    ).replace("http://www.w3.org", "")


def test_the_page_of_a_heal_that_nothing_called_for(steps):
    run = steps[-1]
    kept = {k: v for k, v in run.phases.items() if not k.startswith("ask")}
    kept["alarm"] = {**kept["alarm"], "alarm": None}
    nothing = {"kind": "none", "target": "world", "value": 0.0, "azimuth": 0.0}
    kept["verdict"] = {"believed": [{**nothing, "probability": 1.0}]}
    quiet = replace(run, phases=kept, result={**run.result, "alarm": None})
    assert "no alarm" in make_heal_page(quiet, BODY)


@pytest.mark.parametrize("kind", [HealRun, RecoverRun])
def test_a_file_of_something_else_is_refused(tmp_path, kind):
    (tmp_path / "x.h5").write_text("nothing")
    for name in ("x.h5", "y.h5"):
        with pytest.raises(RunFileError, match=name):
            load_phased_run(tmp_path / name, kind)


def test_a_part_a_little_askew_is_believed_to_be_straight(tmp_path):
    askew = PLACEMENT + 0.02
    bodies, weights = select_rival_bodies(identified(tmp_path, askew)[1])
    assert bodies.anchor[0] == pytest.approx(BODY.anchor[0], abs=1e-6)
    assert weights.sum() == pytest.approx(1)


def test_a_robot_that_only_answers_cannot_walk(shared_recordings):
    replayed = open_robot(
        "starfish-2006", recordings=shared_recordings / "starfish_2006" / "intact.h5"
    )
    with pytest.raises(InputError, match="cannot walk"):
        require_walker(replayed)
