"""Recordings on a grid of time steps: commands, quanta, signs of quaternions."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.data.episodes import (
    MIN_SPREAD,
    _average_over_steps,
    _find_quantum,
    _remove_sign_jumps,
    build_channels,
)
from selfheal.recording import reorder_commands
from tests.support.hinge_recordings import STEP, draw_times, make_hinge_recording
from tests.support.recorded_robots import ROBOTS, record


@pytest.mark.parametrize("seed", range(5))
def test_means_of_held_commands_keep_their_integral(seed):
    rng = np.random.default_rng(seed)
    time = draw_times(rng)
    at, ctrl = (time - time[0]) / STEP, rng.normal(size=(time.size, 2))
    total = np.cumsum(_average_over_steps(at, ctrl), axis=0)
    for end in range(1, int(at[-1])):
        np.testing.assert_allclose(
            total[end - 1], _held_until(at, ctrl, end), atol=1e-10
        )


def _held_until(at, ctrl, end) -> np.ndarray:
    """Integral [steps] of held commands from the first sample to a grid point."""
    ends = np.minimum(np.append(at[1:], np.inf), end)
    return np.sum(ctrl * np.maximum(ends - at, 0)[:, None], axis=0)


def test_commands_on_the_grid_stay_as_they_are():
    ctrl = np.random.default_rng(0).normal(size=(20, 3))
    at = 4.0 * np.arange(20)
    means = _average_over_steps(at, ctrl)
    np.testing.assert_allclose(means, np.repeat(ctrl, 4, axis=0)[: len(means)])
    assert len(means) > at[-1]


def test_commands_follow_the_models_order():
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    (episode,) = record(ROBOTS["arm"], episodes=1, seconds=0.2).episodes.values()
    turned = replace(
        episode, ctrl=episode.ctrl[:, ::-1], ctrl_names=episode.ctrl_names[::-1]
    )
    back = reorder_commands(turned, model)
    assert back.ctrl_names == ("shoulder_servo", "elbow_servo")
    np.testing.assert_array_equal(back.ctrl, episode.ctrl)


@pytest.mark.parametrize("step", [0.004, 0.02])
def test_a_quantum_is_found_and_noise_has_none(step):
    rng = np.random.default_rng(2)
    smooth = np.sin(np.arange(2000) / 100)
    assert _find_quantum(step * np.round(smooth / step)) == pytest.approx(step)
    assert _find_quantum(smooth + 1e-3 * rng.normal(size=2000)) == 0


def test_a_signal_that_was_never_read_is_no_channel_unless_asked_for():
    time = np.arange(20) * 0.01
    recording = make_hinge_recording(time, knee=np.full(20, np.nan), hip=np.sin(time))
    assert [c.name for c in build_channels([recording])] == ["hip"]
    assert [c.name for c in build_channels([recording], empty=True)] == ["hip", "knee"]


def test_a_vector_of_which_a_column_was_never_read_has_the_others():
    recording = record(ROBOTS["arm"], episodes=1, seconds=0.5)
    whole = {c.name: c for c in build_channels([recording])}["tip"]
    recording.episodes["000"].signals["tip"].values[:, 1] = np.nan
    part = {c.name: c for c in build_channels([recording])}["tip"]
    assert part.spread == pytest.approx(whole.spread, rel=0.1)
    np.testing.assert_array_equal(part.scatter[[0, 2]], whole.scatter[[0, 2]])
    assert part.scatter[1] == pytest.approx(part.scatter[[0, 2]].mean(), rel=0.5)


def test_rounding_is_no_motion():
    time, still = np.arange(50) * 0.01, np.full(50, 0.7)
    (hip,) = build_channels([make_hinge_recording(time, hip=still)])
    assert hip.spread == MIN_SPREAD


def test_quaternions_become_continuous_and_stay_the_same_orientation():
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 12, 200)
    turn = np.stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle], axis=1)
    flipped = turn * rng.choice([-1.0, 1.0], 200)[:, None]
    flipped[50:60] = np.nan
    out = _remove_sign_jumps(flipped)
    assert np.isnan(out[50:60]).all()
    known = np.isfinite(out).all(axis=1)
    assert (np.sum(out[known][1:] * out[known][:-1], axis=1) > 0).all()
    np.testing.assert_allclose(np.abs(out[known]), np.abs(turn[known]), atol=1e-12)
