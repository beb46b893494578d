"""The contract's score, written once more, and scores of real recordings."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.simulation import score
from selfheal.recording import read
from tests.support.diagnosis_folder import score_model, write_empty_diagnosis
from tests.support.problems import Explosion
from tests.support.recorded_robots import ROBOTS, bench, change_readings, record

POSITION_LIKE = ("joint_position", "body_position", "body_orientation", "sensor")


def contract_score(predicted, measured) -> tuple[float, dict[str, float]]:
    """Contract section 2, word by word: the number, and each signal's."""
    each = {}
    for name in sorted({n for e in measured.episodes.values() for n in e.signals}):
        squares, read_there = [], []
        for key, episode in measured.episodes.items():
            if name not in episode.signals:
                continue
            signal = episode.signals[name]
            true = signal.values.reshape(episode.time.size, -1)
            played = predicted.episodes[key].signals[name].values.reshape(true.shape)
            if signal.kind == "body_orientation":
                wrong = np.sum(true * played, axis=1) < 0
                played = np.where(wrong[:, None], -played, played)
            known = np.isfinite(true).all(axis=1)
            squares += [np.sum((played - true)[known] ** 2, axis=1)]
            read_there += [true[known]]
        spread = np.sqrt(np.concatenate(read_there).var(axis=0).sum())
        each[name] = float(np.sqrt(np.concatenate(squares).mean()) / spread)
    kinds = {
        n: s.kind for e in measured.episodes.values() for n, s in e.signals.items()
    }
    scored = [v for n, v in each.items() if kinds[n] in POSITION_LIKE]
    return float(np.sqrt(np.mean(np.square(scored)))), each


def _heavier(model) -> None:
    model.body_mass[-1] *= 1.3


@pytest.mark.parametrize("name", ["pendulum", "arm", "cart_pole", "box"])
def test_the_score_is_the_contracts(name, tmp_path):
    recording = _with_gaps(record(ROBOTS[name], seconds=0.7, change=_heavier, seed=3))
    model = tmp_path / "model.xml"
    model.write_text(ROBOTS[name].xml)
    played = replay_recording(
        write_empty_diagnosis(tmp_path / "none", model), recording
    )
    number, each = contract_score(played, recording)
    ours, by_signal, names = score_model(model, recording)
    assert ours == pytest.approx(number, rel=1e-6)
    np.testing.assert_allclose(by_signal, [each[n] for n in names], rtol=1e-6)
    assert number > 1e-3


def _with_gaps(recording):
    """The recording without some of its samples."""
    rng = np.random.default_rng(0)

    def thin(values):
        values = values.copy()
        values[rng.permutation(len(values))[: len(values) // 5]] = np.nan
        return values

    return change_readings(recording, thin)


def test_an_orientation_and_its_opposite_are_one(tmp_path):
    model = tmp_path / "model.xml"
    model.write_text(ROBOTS["box"].xml)
    recording = record(ROBOTS["box"], seconds=0.3)
    other = change_readings(recording, np.negative, signals=["turn"])
    assert score_model(model, other)[0] == pytest.approx(
        score_model(model, recording)[0]
    )


def test_an_exact_model_scores_its_noise(tmp_path):
    b = bench("pendulum", tmp_path, seconds=1.0, finer=1)
    number, _, _ = score_model(b.path, b.recording)
    (channel,) = b.simulator.channels
    assert number == pytest.approx(1e-3 / channel.spread, rel=0.15)
    assert number == pytest.approx(score.compute_noise_floor(b.simulator)[0], rel=0.25)


def test_without_a_given_state_segments_of_half_a_second_are_scored(tmp_path):
    b = bench("pendulum", tmp_path, episodes=2, seconds=2.0, states=False, finer=1)
    segments = score.cut_replay_segments(b.simulator)
    assert np.abs(segments.lengths * b.simulator.timestep - 0.5).max() < 0.1
    number, _, _ = score_model(b.path, b.recording)
    (channel,) = b.simulator.channels
    assert number < 5e-3 / channel.spread


def test_a_diverging_model_scores_infinitely_and_raises_nothing(tmp_path):
    b = bench("pendulum", tmp_path, episodes=1, seconds=0.3)
    segments = score.cut_replay_segments(b.simulator)
    terms = Explosion().propose_terms(b.robot)
    with np.errstate(all="ignore"):
        squares = score.sum_squared_errors(
            b.simulator, segments, terms, np.array([25.0])
        )
    assert np.isinf(
        score.compute_score(
            b.simulator, squares, score.count_readings(b.simulator, segments)
        )
    )


def test_an_interval_holds_its_value(tmp_path):
    b = bench("pendulum", tmp_path, episodes=8, seconds=0.5)
    segments = score.cut_replay_segments(b.simulator)
    squares = score.sum_squared_errors(b.simulator, segments, (), np.zeros(0))
    count = score.count_readings(b.simulator, segments)
    value, low, high = score.bootstrap_interval(b.simulator, squares, count, 0)
    assert low <= value <= high and low < high


REAL = [
    ("xl330/model_released.xml", "xl330/test_released.h5", 2.76),
    ("xl330/servo/model_kp400.xml", "xl330/servo/test_kp400.h5", 0.237),
    pytest.param(
        "double_pendulum_c1/model.xml",
        "double_pendulum_c1/test.h5",
        0.608,
        marks=pytest.mark.slow,
    ),
    ("cube_toss/model.xml", "cube_toss/test.h5", 0.712),
    ("starfish_2006/published_body.xml", "starfish_2006/damaged.h5", 0.6),
]


@pytest.mark.parametrize("model, file, given", REAL)
def test_the_score_of_a_real_recording_is_the_published_one(
    model, file, given, shared_recordings, tmp_path
):
    path = shared_recordings / model
    recording = read(shared_recordings / file)
    about = 0.1 if "starfish" in file else 0.02
    if "starfish" in file:  # odd actions prove, by the direction of up alone
        recording = _odd_verticals(recording)
    played = replay_recording(write_empty_diagnosis(tmp_path / "none", path), recording)
    number, _ = contract_score(played, recording)
    assert number == pytest.approx(given, rel=about)
    assert score_model(path, recording)[0] == pytest.approx(number, rel=1e-4)


def _odd_verticals(recording):
    episodes = {
        key: replace(e, signals={"vertical": e.signals["vertical"]})
        for n, (key, e) in enumerate(recording.episodes.items())
        if n % 2
    }
    return replace(recording, episodes=episodes)
