"""Cases of missing drives: always the same, the truth explains them, a fit helps."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.drives import case as cases
from benchmarks.drives.case import KINDS, make_case, save_case
from benchmarks.drives.page import compute_figures, make_sections
from benchmarks.drives.pieces import cut_pieces, estimate_state, read_joints
from benchmarks.drives.plain_fit import average_commands
from benchmarks.drives.references import measure_references
from benchmarks.drives.score import judge_names, judge_verdict, score_case
from benchmarks.sealed.judge import read_places
from selfheal.recording import check_against_model, read, read_names, validate


@pytest.fixture(scope="module")
def short():
    """A pendulum's case of a few seconds."""
    draw = cases.draw_log
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            cases, "draw_log",
            lambda *a, **k: replace(draw(*a, **k), seconds=2.2, episodes=2, held=1),
        )  # fmt: skip
        yield make_case("everything", 7)


@pytest.fixture(scope="module")
def references(short):
    return measure_references(short)


def test_the_truth_is_at_the_noise_and_the_plain_fit_beats_the_given_model(references):
    errors = references["errors"]
    assert errors["true"]["whole"] < 0.01
    for name, given in errors["given"].items():
        assert errors["true"][name] <= errors["plain"][name] * 1.05
        assert errors["plain"][name] < 0.7 * given


def test_files_are_valid_and_a_case_without_a_diagnosis_is_scored(
    short, references, tmp_path
):
    folder = save_case(short, tmp_path)
    names = read_names(folder / "model.xml")
    for file in ("recording.h5", "test.h5"):
        recording = read(folder / file)
        validate(recording)
        check_against_model(recording, names)
    assert json.loads((folder / "truth.json").read_text())["effects"]
    score = score_case(folder, short, references, {"seconds": 1.0, "late": True})
    assert score["verdict"] == "failed" and score["named"] == 0 < score["needed"]
    assert compute_figures([score])["error / plain, whole"] > 1
    assert make_sections({"everything": [score]})


def test_names_are_right_at_their_place_only(short, tmp_path):
    places = read_places(save_case(short, tmp_path))
    truth = [{"effect": "coulomb_friction", "targets": ["joint:j1"], "needed": True}]
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


def test_late_commands_are_those_of_before(short):
    (piece, *_) = cut_pieces(short.train, short.robot.joints, 0.5)
    now, late = (average_commands(piece, 0.002, d) for d in (0.0, 0.01))
    np.testing.assert_allclose(late[5:], now[:-5], atol=1e-9)
    np.testing.assert_allclose(late[:5], np.repeat(piece.ctrl[:1], 5, 0), atol=1e-9)


def test_a_seed_is_one_case(short):
    one, again = (cases.draw_drives(np.random.default_rng(3), short.robot)
                  for _ in range(2))  # fmt: skip
    assert one == again and set(KINDS)


def test_pieces_lie_in_their_episode(short):
    for piece in cut_pieces(short.test, short.robot.joints, 0.5):
        seen = read_joints(piece.episode, short.robot.joints, "joint_position")
        rows = slice(piece.first, piece.first + len(piece.time))
        np.testing.assert_array_equal(piece.seen, seen[rows])
    model = mujoco.MjModel.from_xml_string(cases.write_mjcf(short.robot))
    assert model.nu == len(short.robot.joints)
