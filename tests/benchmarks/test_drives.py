"""Cases of missing drives: always the same, the truth explains them, a fit helps."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.drives.case import make_case, save_case, write_mjcf
from benchmarks.drives.joint_reader import JointReader
from benchmarks.drives.kinds import KINDS
from benchmarks.drives.page import compute_figures, make_sections
from benchmarks.drives.pieces import cut_pieces, estimate_state
from benchmarks.drives.plain_fit import average_commands
from benchmarks.drives.references import measure_references, predict_by_truth
from benchmarks.drives.robots import draw_linkage
from benchmarks.drives.score import judge_names, judge_verdict, score_case
from benchmarks.drives.truth import draw_drives, list_effects
from benchmarks.sealed.judge import read_places
from selfheal.recording import check_against_model, read, read_names, validate

pytestmark = pytest.mark.slow


@pytest.fixture
def make_short(monkeypatch):
    """Makes a case of two short episodes."""

    def make(kind, seed, seconds=1.2):
        draft = KINDS[kind]

        def shorten(rng, seed):
            whole = draft(rng, seed)
            log = replace(whole.log, seconds=seconds, episodes=1, held=1)
            return replace(whole, log=log)

        monkeypatch.setitem(KINDS, kind, shorten)
        return make_case(kind, seed)

    return make


def _read(case):
    model = mujoco.MjModel.from_xml_string(write_mjcf(case.robot))
    return JointReader(model, case.train)


def test_truth_is_at_the_noise_the_plain_fit_helps_and_a_case_is_scored(
    make_short, tmp_path
):
    short = make_short("everything", 7, seconds=4.0)
    references = measure_references(short)
    errors = references["errors"]
    assert errors["true"]["whole"] < 0.01
    for name, given in errors["given"].items():
        assert errors["true"][name] <= errors["plain"][name] * 1.05
        assert errors["plain"][name] < 0.7 * given
    folder = save_case(short, tmp_path)
    score = score_case(folder, short, references, {"seconds": 1.0, "late": True})
    assert score["verdict"] == "failed" and score["named"] == 0 < score["needed"]
    assert compute_figures([score])["error / plain, whole"] > 1
    assert make_sections({"everything": [score]})


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "everything"])
def test_files_of_a_kind_are_valid_and_its_truth_explains_them(
    kind, make_short, tmp_path
):
    case = make_short(kind, {"servo": 2}.get(kind, 1))  # 2: the base gives
    folder = save_case(case, tmp_path)
    names = read_names(folder / "model.xml")
    for file in ("recording.h5", "test.h5"):
        recording = read(folder / file)
        validate(recording)
        check_against_model(recording, names)
    assert json.loads((folder / "truth.json").read_text())["effects"]
    reader = _read(case)
    (piece,) = cut_pieces(case.test, reader, np.inf)
    (found,) = predict_by_truth(case, case.truth, [piece], reader.columns)
    assert np.abs(found - piece.seen).max() < 0.02
    assert piece.qpos.shape == (reader.model.nq,)


def test_names_are_right_at_their_place_only(make_short, tmp_path):
    places = read_places(save_case(make_short("everything", 7), tmp_path))
    names = ["coulomb_friction", "stribeck_friction"]
    truth = [{"names": names, "targets": ["joint:j1"], "needed": True}]
    right = {"effect": "stribeck_friction", "target": "joint:j1"}
    wrong = {"effect": "armature", "target": "joint:j1"}
    judged = judge_names([right, wrong], truth, places)
    assert (judged["needed"], judged["named"], judged["missed"]) == (1, 1, [])
    assert (judged["names"], judged["false"]) == (2, ["armature joint:j1"])


def test_a_verdict_agrees_with_the_errors_at_every_horizon():
    errors = {"given": {"a": 1.0, "b": 2.0}, "true": {"a": 0.1, "b": 0.1}}
    assert judge_verdict("explained", {"a": 0.15, "b": 0.2}, errors)
    assert not judge_verdict("explained", {"a": 0.15, "b": 0.5}, errors)
    assert judge_verdict("nothing", {"a": 0.12, "b": 0.12}, errors)
    assert not judge_verdict("nothing", {"a": 0.12, "b": 0.2}, errors)
    assert judge_verdict("partly", {"a": 1.0, "b": 1.0}, errors)


def test_a_state_is_that_of_the_motion():
    time = np.arange(40) / 100
    q = np.stack([1 + 2 * time - 3 * time**3, -time], axis=1)
    qpos, qvel = estimate_state(time, q, np.full_like(q, np.nan), 20)
    np.testing.assert_allclose(qpos, q[20], atol=1e-9)
    np.testing.assert_allclose(qvel, [2 - 9 * 0.2**2, -1], atol=1e-7)


def test_unread_joints_of_a_linkage_are_where_it_closes(make_short):
    reader = _read(make_short("loop", 1))
    qpos, qvel = reader.complete_state(np.array([0.3, 0.4]), np.array([1.0, -2.0]))
    data = mujoco.MjData(reader.model)
    for step in (0.0, 1e-4):
        data.qpos[:] = qpos + step * qvel
        mujoco.mj_forward(reader.model, data)
        assert np.abs(data.efc_pos[:3]).max() < 1e-6


def test_late_commands_are_those_of_before(make_short):
    short = make_short("everything", 7)
    (piece, *_) = cut_pieces(short.train, _read(short), 0.5)
    now, late = (average_commands(piece, 0.002, d) for d in (0.0, 0.01))
    np.testing.assert_allclose(late[5:], now[:-5], atol=1e-9)
    np.testing.assert_allclose(late[:5], np.repeat(piece.ctrl[:1], 5, 0), atol=1e-9)


def test_what_is_removed_is_no_longer_hidden():
    robot = draw_linkage(np.random.default_rng(2))
    truth = draw_drives(np.random.default_rng(3), robot)
    assert truth == draw_drives(np.random.default_rng(3), robot)
    effects = list_effects(robot, truth)
    for effect in effects:
        rest = list_effects(robot, effect.remove(truth))
        assert len(rest) == len(effects) - 1
