"""Poses of a film: those of the readings and of the predictions, where it was worst."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.output import traces
from selfheal.diagnosis.output.traces import make_pose_trace
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.diagnosis.simulation.score import cut_replay_segments
from tests.support.recorded_robots import ROBOTS, record

GIVEN = (), np.zeros(0)


def _read(name, path, *, drop=(), **how):
    """A simulator of a robot's recording, some of whose signals are missing."""
    path.write_text(ROBOTS[name].xml)
    recording = record(ROBOTS[name], noise=0.0, **how)
    episodes = {
        key: replace(e, signals={k: s for k, s in e.signals.items() if k not in drop})
        for key, e in recording.episodes.items()
    }
    recording = replace(recording, episodes=episodes)
    simulator = build_simulator(ModelCompiler(str(path)), [recording])
    return simulator, cut_replay_segments(simulator)


def _film(simulator, segments, chosen=0, squares=None):
    squares = np.ones(len(segments.sample_steps)) if squares is None else squares
    return make_pose_trace(simulator, segments, chosen, squares, (GIVEN, GIVEN))


def _bend(poses):
    """Angle of the pendulum's rod [rad] in poses (F, 1, 7), which turns about y."""
    return 2 * np.arctan2(poses[:, 0, 5], poses[:, 0, 3])


def test_the_film_shows_what_the_curves_do(tmp_path):
    simulator, segments = _read("pendulum", tmp_path / "a.xml", episodes=2)
    film = _film(simulator, segments, chosen=1)
    rows = segments.find_sample_rows(np.array([1]))
    wanted = ("joint_position", "hinge")
    (channel,) = [c for c in simulator.channels if (c.kind, c.target) == wanted]
    column = channel.first_column
    time = segments.sample_steps[rows] * simulator.timestep
    predicted = simulator.simulate((), np.zeros((1, 0)), segments)[0][rows, column]
    read = segments.readings[rows, column]
    for seen, curve in ((film.measured, read), (film.given, predicted)):
        at = np.interp(film.time, simulator.episodes[1].start + time, curve)
        assert _bend(seen) == pytest.approx(at, abs=0.02 * np.ptp(curve))
    assert (film.given == film.patched).all()
    assert film.episode == simulator.episodes[1].id and film.unread == ()


def test_a_long_stretch_is_shown_where_it_is_worst(tmp_path, monkeypatch):
    monkeypatch.setattr(traces, "LONGEST", 0.5)
    simulator, segments = _read("pendulum", tmp_path / "a.xml", episodes=1, seconds=2.0)
    for worst in (0.0, 1.1, 2.0):
        time = segments.sample_steps * simulator.timestep
        squares = np.exp(-(((time - worst) / 0.05) ** 2))
        film = _film(simulator, segments, squares=squares)
        seen = film.time - simulator.episodes[0].start
        assert np.ptp(seen) == pytest.approx(0.5)
        assert seen[0] - 1e-6 <= worst <= seen[-1] + simulator.timestep + 0.01


def test_joints_that_nothing_reads_are_named_and_move_as_given(tmp_path):
    signals = record(ROBOTS["arm"], seconds=0.1).episodes["000"].signals
    of_elbow = [k for k, s in signals.items() if "elbow" in f"{k} {s.target}"]
    how = {"drop": of_elbow, "episodes": 1, "seconds": 0.5}
    film = _film(*_read("arm", tmp_path / "a.xml", **how))
    assert film.unread == ("elbow",)
    assert np.isfinite(film.measured).all()


def test_bodies_need_no_names(tmp_path):
    path = tmp_path / "a.xml"
    simulator, segments = _read("pendulum", path, episodes=1, seconds=0.5)
    named = _film(simulator, segments)
    path.write_text(ROBOTS["pendulum"].xml.replace('<body name="rod"', "<body"))
    nameless = replace(simulator, compiler=ModelCompiler(str(path)))
    assert (_film(nameless, segments).given == named.given).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_every_kind_of_robot_begins_where_it_was_measured(name, tmp_path):
    simulator, segments = _read(name, tmp_path / "a.xml", episodes=1, seconds=0.5)
    film = _film(simulator, segments)
    for poses in (film.measured, film.given):
        assert np.linalg.norm(poses[..., 3:], axis=-1) == pytest.approx(1.0)
    assert film.given[0] == pytest.approx(film.measured[0], abs=1e-3)
