"""Hidden robots: same seed same case, absent effects absent, the truth predicts."""

import re
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.hidden import drafts, drives, others
from benchmarks.hidden.case import save_case
from benchmarks.hidden.effects import DRAWN, PLACED, UNLISTED
from benchmarks.hidden.effects.base import PlacedEffect
from benchmarks.hidden.judge.names import read_places
from benchmarks.hidden.robots.shapes import ROBOTS, make_blank_robot
from benchmarks.hidden.robots.written import WRITTEN
from benchmarks.hidden.sealed import draw_experiment, make_case
from benchmarks.hidden.sensors import record_plans
from benchmarks.hidden.simulator import simulate_plans
from benchmarks.hidden.truth import UnfitDraw
from selfheal.recording import check_against_model, read, read_names, validate
from tests.support.paths import ROOT, SHARED

pytestmark = pytest.mark.slow

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
    "clock_shift": {"shift": 0.0},
    "command_range": {"low": -9.0, "high": 9.0},
    "torque_constant": {"gain": 1.0},
    "velocity_feedforward": {"lead": 0.0},
    "dead_band": {"width": 0.0},
}


def _shorten(plans, rows):
    return [replace(plan, rows=plan.rows[:rows]) for plan in plans]


def _arrays(recording):
    return {
        f"{name}/{key}": values.tobytes()
        for name, e in recording.episodes.items()
        for key, values in {
            "time": e.time,
            "ctrl": e.ctrl,
            **{n: s.values for n, s in e.signals.items()},
        }.items()
    }


@pytest.fixture
def make_short(shorten_drives):
    """Makes a case of drives of two short episodes, and its draft and experiment."""

    def make(kind, seed):
        shorten_drives(kind, 1.2)
        case = drives.make_case(kind, seed)
        return case, *drives.draft_case(kind, seed, case.key["attempt"])[:2]

    return make


def _make_written(name):
    """A case of a written robot that is quickly made."""
    whole = WRITTEN[others.OTHER_CASES[name].robot]
    piece = min(whole.piece, 0.2)
    return others.make_case(name, replace(whole, seconds=0.6, episodes=1, piece=piece))


@pytest.mark.parametrize(
    "make",
    [
        lambda: make_case(
            "single", 10, effects=["coulomb_friction"], robots=["pendulum"]
        ),
        lambda: _make_written("pen_two_effects"),
    ],
)
def test_same_seed_same_case(make):
    one, again = make(), make()
    assert _arrays(again.train) == _arrays(one.train)
    assert _arrays(again.test) == _arrays(one.test)
    assert (again.key, again.robot.xml) == (one.key, one.robot.xml)


@pytest.mark.parametrize("name", NOMINAL)
def test_nominal_effect_changes_nothing(name):
    effect = {**DRAWN, **PLACED}[name]
    fits = effect.list_targets(make_blank_robot("arm2_servo"))
    robot = "arm2_servo" if fits else "double_pendulum"
    draw = draw_experiment(robot, np.random.default_rng(3))
    experiment, plans = draw.experiment, _shorten(draw.train[:2], 40)
    target = effect.list_targets(experiment.robot)[0]
    placed = PlacedEffect(effect, target, dict(NOMINAL[name]))
    truth, plain = (
        experiment.make_hidden_robot([placed]),
        experiment.make_hidden_robot(),
    )
    instruments = replace(experiment.instruments, readings=truth.readings)
    pairs = zip(simulate_plans(plain, plans), simulate_plans(truth, plans), strict=True)
    for one, other in pairs:
        np.testing.assert_allclose(other.qpos, one.qpos, atol=1e-9)
        model = experiment.robot.model
        edited = instruments.read_clean(other, model)
        for key, signal in experiment.instruments.read_clean(one, model).items():
            np.testing.assert_allclose(edited[key].values, signal.values, atol=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_gives_a_valid_recording(name):
    rng = np.random.default_rng(5)
    draw = draw_experiment(name, rng)
    experiment, plans = draw.experiment, _shorten(draw.train[:2], 60)
    truth = experiment.make_hidden_robot()
    made = record_plans(experiment.instruments, truth, plans, rng, state=True)
    validate(made.seen)
    assert len(made.seen.episodes) == 2


@pytest.mark.parametrize("name", others.OTHER_CASES)
def test_a_written_case_is_valid_and_named_as_the_contract_does(name, tmp_path):
    case = _make_written(name)
    save_case(case, tmp_path / "cases", tmp_path / "keys")
    folder = tmp_path / "cases" / name
    model, places = read_names(folder / "model.xml"), read_places(folder)
    for file in (folder / "recording.h5", tmp_path / "keys" / name / "test.h5"):
        recording = read(file)
        validate(recording)
        check_against_model(recording, model)
    count = {"single": 1, "null": 0, "double": 2}[case.key["kind"]]
    assert len(case.key["effects"]) == count
    for effect in case.key["effects"]:
        assert effect["target"] in places.same and effect["effect"] in DRAWN
    if count:
        scores = case.key["test"]
        assert scores["floor"] < scores["stated"]


@pytest.mark.parametrize("kind", drafts.KINDS)
def test_files_of_a_kind_are_valid_and_its_truth_explains_them(
    kind, make_short, tmp_path
):
    from benchmarks.hidden.judge.drives import score_truth

    case, draft, experiment = make_short(kind, {"servo": 2}.get(kind, 1))
    save_case(case, tmp_path / "cases", tmp_path / "keys")
    names = read_names(tmp_path / "cases" / case.name / "model.xml")
    for file in tmp_path.rglob("*.h5"):
        recording = read(file)
        validate(recording)
        check_against_model(recording, names)
    assert draft.list_missing()
    test = case.pieces["test whole"]
    floor = score_truth(experiment, draft.hidden, test)
    # a camera's noise is a larger share of so short a motion than an encoder's
    assert floor < (0.1 if kind == "camera" else 0.02)
    # without any one of them it is not the truth
    rest = [score_truth(experiment, r, test) for _, r in draft.list_missing()]
    assert max(rest) > floor


def test_unread_joints_of_a_linkage_are_where_it_closes(make_short):
    case, _, _ = make_short("loop", 1)
    model, (episode,) = case.robot.model, case.test.episodes.values()
    data = mujoco.MjData(model)
    data.qpos[:] = episode.qpos0
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[:3]).max() < 1e-3


def test_a_stated_effect_is_in_the_model_and_a_hidden_one_is_not():
    draft, experiment, _ = drives.draft_case("clock", 1, 0)
    model, truth = draft.state_model().model, experiment.make_hidden_robot(draft.hidden)
    hidden = truth.spec.compile()
    for joint in draft.robot.load:
        loss = hidden.joint(joint).frictionloss
        assert model.joint(joint).frictionloss == pytest.approx(loss, rel=1e-4)
    assert [one.effect.name for one, _ in draft.list_missing()] == ["clock_shift"]


def test_catalogue_is_the_contracts():
    contract = SHARED / "contract.md"
    if not contract.is_file():
        pytest.skip("no contract here")
    text = contract.read_text()
    assert all(f"`{name}`" in text for name in DRAWN)
    assert not any(f"`{name}`" in text for name in UNLISTED)


def test_placed_effects_have_the_names_of_the_catalogue():
    text = (ROOT / "docs" / "effects.md").read_text()
    lacking = {e.name for e in PLACED.values() if f"### `{e.name}`" not in text}
    assert lacking == {"command_range"}  # a model's wrong range has no name


def test_the_hidden_truth_knows_nothing_of_the_product_s_effects():
    """An error in the product's physics cannot hide in the truth."""
    kit = ROOT / "benchmarks" / "hidden"
    files = [p for p in kit.rglob("*.py") if p.stem != "__main__"]
    assert files
    named = re.compile(r"^\s*(from|import) selfheal\.diagnosis", re.M)
    assert not [path for path in files if named.search(path.read_text())]
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in files
        if path.stem != "__init__" and path.parent.name != "judge"
    ]
    code = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    loaded = subprocess.check_output([sys.executable, "-c", code], text=True, cwd=ROOT)
    assert "selfheal.diagnosis.effects" not in loaded.split()


def test_every_effect_fits_a_robot():
    for effect in (*DRAWN.values(), *UNLISTED.values()):
        assert any(effect.list_targets(make_blank_robot(name)) for name in ROBOTS), (
            effect.name
        )


def test_impossible_case_is_refused():
    with pytest.raises(UnfitDraw, match="no robot"):
        make_case("single", 1, effects=("limb_loss",), robots=("pendulum",))
