"""The sealed benchmark: same seed same case, nominal effects absent, a fair scorer."""

import ast
import json
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.diagnosis_runs import (
    ProcessLimits,
    diagnose_cases,
    find_undiagnosed,
    score_diagnosis,
)
from benchmarks.sealed.cases import UnfitDraw, make_case, save_case
from benchmarks.sealed.effects import BY_NAME, EFFECTS, make_blank_robot
from benchmarks.sealed.experiment import PlacedEffect, draw_experiment
from benchmarks.sealed.judge import read_case, read_places
from benchmarks.sealed.page import make_sections
from benchmarks.sealed.robots import ROBOTS
from benchmarks.sealed.score import compute_figures, compute_removed_on_test
from benchmarks.sealed.simulator import simulate_plans
from benchmarks.sealed.unlisted import UNLISTED
from selfheal.recording import check_against_model, read, read_names, validate, write
from tests.support.paths import ROOT, SHARED

pytestmark = pytest.mark.slow

FAST = {"robots": ("pendulum",)}
# the values at which each of these is exactly absent
NOMINAL = {
    "load_dependent_friction": {"load_coefficient": 0.0},
    "cogging": {"amplitude": 0.0, "poles": 7.0, "phase": 0.3},
    "joint_spring": {"stiffness": 0.0, "springref": 0.4},
    "quadratic_damping": {"damping2": 0.0},
    "torque_saturation": {"limit": 1e3},
    "command_delay": {"delay": 0.0},
    "rate_limit": {"rate": 1e9},
    "integral_action": {"ki": 0.0, "imax": 1.0},
    "slope": {"tilt": 0.0, "azimuth": 1.0},
    "fluid_drag": {"density": 0.0},
    "com_shift": {"x": 0.0, "y": 0.0, "z": 0.0},
    "sensor_bias": {"bias": 0.0},
    "sensor_gain": {"gain": 1.0},
    "sensor_delay": {"delay": 0.0},
}


@pytest.fixture(scope="module")
def case():
    return make_case("single", 10, effects=("coulomb_friction",), **FAST)


@pytest.fixture
def folders(case, tmp_path):
    cases, keys = tmp_path / "cases", tmp_path / "keys"
    save_case(case, cases, keys)
    return cases, keys


def _arrays(recording):
    return {
        f"{name}/{key}": value.tobytes()
        for name, e in recording.episodes.items()
        for key, value in [
            ("time", e.time),
            ("ctrl", e.ctrl),
            *((k, s.values) for k, s in e.signals.items()),
        ]
    }


def test_same_seed_same_case(case):
    again = make_case("single", 10, effects=("coulomb_friction",), **FAST)
    assert _arrays(again.train) == _arrays(case.train)
    assert _arrays(again.test) == _arrays(case.test)
    assert (again.key, again.robot.xml) == (case.key, case.robot.xml)


@pytest.mark.parametrize("name", NOMINAL)
def test_nominal_effect_changes_nothing(name):
    effect = BY_NAME[name]
    fits = effect.targets(make_blank_robot("arm2_servo"))
    robot = "arm2_servo" if fits else "double_pendulum"
    made = draw_experiment(robot, np.random.default_rng(3))
    plans = [
        replace(p, rows=p.rows[:40], reference=p.reference[:40]) for p in made.train[:2]
    ]
    target = effect.targets(made.robot)[0]
    truth = made.make_hidden_robot([PlacedEffect(effect, target, dict(NOMINAL[name]))])
    pairs = zip(
        simulate_plans(made.make_hidden_robot(), plans),
        simulate_plans(truth, plans),
        strict=True,
    )
    for plain, edited in pairs:
        np.testing.assert_allclose(edited.qpos, plain.qpos, atol=1e-9)
        one = made.make_instruments(made.make_hidden_robot()).read_clean(plain)
        other = made.make_instruments(truth).read_clean(edited)
        for key, signal in one.items():
            np.testing.assert_allclose(other[key].values, signal.values, atol=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_gives_a_valid_recording(name, tmp_path):
    rng = np.random.default_rng(5)
    made = draw_experiment(name, rng)
    file, model = tmp_path / "r.h5", tmp_path / "model.xml"
    truth = made.make_hidden_robot()
    model.write_text(made.robot.xml)
    plans = [
        replace(p, rows=p.rows[:60], reference=p.reference[:60]) for p in made.train[:2]
    ]
    runs = simulate_plans(truth, plans)
    write(
        made.make_instruments(truth).record_episodes(plans, runs, rng, state=True), file
    )
    recording = read(file)
    validate(recording)
    check_against_model(recording, read_names(model))
    assert len(recording.episodes) == 2


def test_test_is_valid_and_states_where_it_starts(case, folders):
    cases, keys = folders
    recording = read(keys / case.name / "test.h5")
    check_against_model(recording, read_names(cases / case.name / "model.xml"))
    assert all(e.qpos0 is not None for e in recording.episodes.values())


def test_key_is_not_with_the_case(folders, case):
    cases, keys = folders
    assert {p.name for p in cases.rglob("*") if p.is_file()} == {
        "model.xml",
        "recording.h5",
    }
    text = (cases / case.name / "model.xml").read_text()
    assert "coulomb" not in text and "single" not in case.name


def test_effect_matters(case):
    effect = case.key["effects"][0]
    assert 3 <= effect["after_refit"] <= 30
    assert case.key["test"]["stated"] > case.key["test"]["floor"]


def test_catalogue_is_the_contracts():
    contract = SHARED / "contract.md"
    if not contract.is_file():
        pytest.skip("no contract here")
    text = contract.read_text()
    assert len(BY_NAME) == len(EFFECTS)
    assert all(f"`{e.name}`" in text for e in EFFECTS)
    assert not any(f"`{e.name}`" in text for e in UNLISTED)


def test_the_hidden_truth_knows_nothing_of_the_product_s_effects():
    """An error in the product's physics cannot hide in the truth."""
    folders = [ROOT / "benchmarks" / name for name in ("sealed", "other_cases")]
    files = [path for folder in folders for path in folder.rglob("*.py")]
    assert files
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            else:
                continue
            assert not any(n.startswith("selfheal.diagnosis") for n in names), path
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in files
        if path.stem != "__main__"
    ]
    code = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert "selfheal.diagnosis.effects" not in loaded.stdout.split()


def test_every_effect_fits_a_robot():
    for effect in (*EFFECTS, *UNLISTED):
        assert any(effect.targets(make_blank_robot(name)) for name in ROBOTS), (
            effect.name
        )


def test_impossible_case_is_refused():
    with pytest.raises(UnfitDraw, match="no robot"):
        make_case("single", 1, effects=("limb_loss",), robots=("pendulum",))


def _perfect(key):
    return {
        "verdict": "explained",
        "findings": [
            {
                "effect": e["effect"],
                "target": e["target"],
                "equivalent": [],
                "parameters": [
                    {
                        "name": p["name"],
                        "value": p["value"],
                        "low": p["value"] - 0.1 * abs(p["value"]),
                        "high": p["value"] + 0.1 * abs(p["value"]),
                    }
                    for p in e["parameters"]
                ],
            }
            for e in key["effects"]
        ],
        "fit": {"explainable_removed": 1.0},
    }


def _diagnosed(folders, name, diagnosis):
    cases, keys = folders
    folder = cases / name / "diagnosis"
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps(diagnosis))
    return read_case(cases / name, keys)


def test_perfect_diagnosis_is_scored_perfect(folders, case):
    judged = _diagnosed(folders, case.name, _perfect(case.key))
    found = compute_figures([judged])
    names = ("exact name first", "name or class first", "joint or body right")
    for figure in (*names, "intervals that hold the truth"):
        assert found[figure]["rate"] == 1.0, figure
    assert found["explainable removed, median over explained"] == 1.0
    assert not found["singles with a further, wrong name"]["hits"]
    assert make_sections([judged])[-1].rows == []


def test_empty_diagnosis_is_a_miss(folders, case):
    judged = _diagnosed(folders, case.name, {"verdict": "nothing", "findings": []})
    found = compute_figures([judged])
    assert found["exact name first"]["rate"] == 0.0
    assert found["joint or body right"]["rate"] == 0.0
    assert judged["first"] == "nothing"


def test_no_diagnosis_is_a_failure(folders, case):
    judged = read_case(folders[0] / case.name, folders[1])
    assert judged["verdict"] == "failed" and not judged["exact"]


def test_class_and_equivalent_count_as_class_only(folders, case):
    wrong = _perfect(case.key)
    wrong["findings"][0] |= {"effect": "stribeck_friction", "parameters": []}
    judged = _diagnosed(folders, case.name, wrong)
    assert (judged["exact"], judged["class"], judged["place"]) == (False, True, True)


def test_places_join_joint_actuator_signal_and_body(folders, case):
    places = read_places(folders[0] / case.name)
    truth = {"effect": "coulomb_friction", "target": "joint:j1"}
    for target in ("actuator:m1", "sensor:j1_position", "body:link1"):
        place = places.find_place({"effect": "x", "target": target})
        assert place & places.find_place(truth)
    world = places.find_place({"effect": "slope", "target": "world"})
    assert not world & places.find_place(truth)


def test_run_sees_model_and_recording_alone_and_goes_on(folders, case, tmp_path):
    program = tmp_path / "fake.py"
    program.write_text(
        "import json, os\n"
        "assert sorted(os.listdir()) == ['model.xml', 'recording.h5']\n"
        "os.mkdir('diagnosis')\n"
        "found = {'verdict': 'nothing', 'findings': []}\n"
        "json.dump(found, open('diagnosis/diagnosis.json', 'w'))\n"
    )
    cases = folders[0]
    limits = ProcessLimits(60.0, (sys.executable, "-I", str(program)))
    assert diagnose_cases(cases, 1, limits) == 0
    record = json.loads((cases / case.name / "run.json").read_text())
    assert record["exit_code"] == 0 and record["seconds"] > 0
    assert find_undiagnosed(cases) == []


def test_replay_of_the_truth_scores_the_floor(folders, case, tmp_path):
    cases, keys = folders
    sealed = keys / case.name
    _diagnosed(folders, case.name, _perfect(case.key))
    program = tmp_path / "replay.py"
    program.write_text(
        f"import shutil, sys\nshutil.copy({str(sealed / 'test.h5')!r}, sys.argv[4])\n"
    )
    words = (sys.executable, str(program))
    assert score_diagnosis(cases / case.name, sealed, words) == 0.0
    judged = {
        **read_case(cases / case.name, keys),
        "patched": case.key["test"]["floor"],
    }
    assert compute_removed_on_test(judged) == 1.0


def test_crash_is_recorded(folders, case):
    limits = ProcessLimits(60.0, (sys.executable, "-c", "raise SystemExit('broken')"))
    assert diagnose_cases(folders[0], 1, limits) == 1
    record = json.loads((folders[0] / case.name / "run.json").read_text())
    assert record["exit_code"] == 1 and "broken" in record["stderr"]
    assert len(find_undiagnosed(folders[0])) == 1


def test_given_models_load_and_are_not_the_truth(case):
    model = mujoco.MjModel.from_xml_string(case.robot.xml)
    assert model.opt.timestep > case.key["fine_step"]
    errors = case.key["parameter_errors"]
    assert errors and all(abs(e) <= 0.6 * 0.3 for e in errors.values())
