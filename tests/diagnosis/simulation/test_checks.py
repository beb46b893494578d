"""What cannot be diagnosed or replayed is refused, with what is wrong and would fit."""

from dataclasses import replace

import numpy as np
import pytest

import selfheal
from selfheal.diagnosis import diagnose as module
from selfheal.diagnosis.simulation.checks import find_divergence
from selfheal.diagnosis.simulation.score import cut_replay_segments
from selfheal.errors import ModelError, RecordingError
from selfheal.recording import Signal
from tests.support.recorded_robots import ROBOTS, bench, record

ARM = ROBOTS["arm"]
UNSTABLE = ARM.xml.replace('kp="20" kv="0.8"', 'kp="2e7" kv="0"').replace(
    "implicitfast", "Euler"
)


class Reached(Exception):
    """The inputs are usable: the search for effects begins."""


@pytest.fixture(autouse=True)
def begins(monkeypatch):
    def begin(*_, **__):
        raise Reached

    monkeypatch.setattr(module, "start_search", begin)


@pytest.fixture(scope="module")
def usable():
    """Four episodes of an arm; the third is held out."""
    return record(ARM, episodes=4, seconds=1.5, finer=1)


@pytest.fixture
def diagnose(tmp_path):
    """Begins a diagnosis of the arm, or of another text."""

    def begin(recording, text=ARM.xml):
        (tmp_path / "model.xml").write_text(text)
        return selfheal.diagnose(tmp_path / "model.xml", recording)

    return begin


def _each(recording, change, only=None):
    """The recording with every episode changed, or one."""
    episodes = {
        key: change(episode) if only in (None, key) else episode
        for key, episode in recording.episodes.items()
    }
    return replace(recording, episodes=episodes)


def _signals(change):
    """A change of an episode that changes the values of its signals."""
    return lambda e: replace(
        e,
        signals={n: replace(s, values=change(s.values)) for n, s in e.signals.items()},
    )


def _stand(episode):
    """A robot that is commanded nothing, and does not move."""
    still = replace(episode, ctrl=np.zeros_like(episode.ctrl))
    return _signals(np.zeros_like)(still)


def _only(*kinds):
    return lambda episode: replace(
        episode,
        signals={n: s for n, s in episode.signals.items() if s.kind in kinds},
    )


def _meaning(**more):
    """A signal of the elbow whose readings are something else."""
    return lambda e: replace(
        e, signals={**e.signals, "elbow": replace(e.signals["elbow"], **more)}
    )


def _cut(samples):
    return lambda episode: replace(
        _signals(lambda values: values[:samples])(episode),
        time=episode.time[:samples],
        ctrl=episode.ctrl[:samples],
    )


BAD = {
    "a few samples": (_cut(10), None, "0.27 s of readings are too few.* 1.5 s"),
    "still": (_stand, None, "no position-like signal moves.*elbow"),
    "dead": (_signals(np.zeros_like), None, "frozen: all readings of 'shoulder'"),
    "torque alone": (_only("joint_torque"), None, "no signal of kind joint_position"),
    "unread": (_signals(lambda v: v * np.nan), None, "no signal holds a reading"),
    "nothing to judge on": (
        _signals(lambda v: v * np.nan),
        "002",
        r"held out \(toy.h5:002\) has no reading",
    ),
    "no signal to judge on": (_only(), "002", r"held out \(toy.h5:002\) has no"),
    "another meaning": (
        lambda e: replace(
            e,
            signals={
                "elbow": Signal(np.zeros((150, 3)), "body_position", "lower", "m")
            },
        ),
        "001",
        "signal 'elbow': body_position of 'lower' in 'm' here and joint_position",
    ),
    "another joint": (
        _meaning(target="elbwo"),
        "001",
        "'001', signal 'elbow': the model has no joint 'elbwo'.*'shoulder', 'elbow'",
    ),
    "another unit": (
        _meaning(unit="m"),
        "001",
        "unit 'm' does not fit joint 'elbow'; .*: 'rad'",
    ),
    "years": (
        lambda e: replace(e, time=e.time * 1e6),
        "001",
        "'001' lasts 1.49e.06 s, which are .* steps of the model's 0.002 s",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_no_fit_could_make_sense_of_is_refused(case, diagnose, usable):
    change, only, said = BAD[case]
    with pytest.raises(RecordingError, match=said):
        diagnose(_each(usable, change, only))


@pytest.mark.parametrize("step", ["0", "-0.002", "inf"])
def test_a_time_step_that_is_none_is_refused(step, usable, tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(ARM.xml.replace('timestep="0.002"', f'timestep="{step}"'))
    with pytest.raises(ModelError, match=r"timestep is .* s; would fit: more than 0"):
        selfheal.diagnose(path, usable)


def test_joints_that_no_signal_measures_are_named(diagnose):
    """Episodes of single readings are not cut, so that segments are few."""
    blind = record(ROBOTS["half_seen_arm"], episodes=3, seconds=1.5, finer=1)
    said = r"position of joint 'elbow', .* and 2 are"
    with pytest.raises(RecordingError, match=said):
        diagnose(blind)


def test_a_pause_in_an_episode_is_no_matter(diagnose, usable):
    """A minute without a sample, and the parabola of neither side crosses it."""
    late = _each(usable, lambda e: replace(e, time=e.time + 60 * (e.time > 0.7)), "001")
    with pytest.raises(Reached):
        diagnose(late)


# names


def _beside(text: str) -> str:
    """The arm with something more in its world."""
    return ARM.xml.replace("</worldbody>", f"{text}</worldbody>")


def _stateless(episode):
    return replace(episode, qpos0=None, qvel0=None)


def test_what_turns_must_have_a_name(diagnose, usable):
    bell = _beside('<body name="bell"><joint/><geom size="0.01"/></body>')
    said = "no name has a joint of body 'bell'; would fit: a name for every"
    with pytest.raises(ModelError, match=said):
        diagnose(_each(usable, _stateless), bell)


@pytest.mark.parametrize(
    "text",
    [
        '<body><geom size="0.01"/><site/></body>',
        '<body name="ball"><freejoint/><geom size="0.01"/></body>',
        '<body><joint name="clapper"/><geom size="0.01"/></body>',
    ],
)
def test_what_no_finding_speaks_of_needs_no_name(text, diagnose, usable):
    with pytest.raises(Reached):
        diagnose(_each(usable, _stateless), _beside(text))


# divergence


def test_a_model_that_diverges_at_once_is_reported_with_episode_and_time(
    diagnose, usable
):
    said = r"model\.xml: the model diverges, first in episode '000' at 0\.00\d* s"
    with pytest.raises(ModelError, match=said):
        diagnose(usable, UNSTABLE)


def test_the_moment_of_divergence_is_found(tmp_path):
    """A command that no arm can stand, from 0.6 s of the second episode on."""
    robot = replace(ARM, xml=ARM.xml.replace("implicitfast", "Euler"))
    b = bench(robot, tmp_path, episodes=3, seconds=1.0)
    assert find_divergence(b.simulator, cut_replay_segments(b.simulator))[0] == 0
    wild = b.simulator.episodes[1].ctrl.copy()
    wild[round(0.6 / b.simulator.timestep) :] = 1e9
    logs = (
        b.simulator.episodes[0],
        replace(b.simulator.episodes[1], ctrl=wild),
        b.simulator.episodes[2],
    )
    simulator = replace(b.simulator, episodes=logs)
    count, episode, time = find_divergence(simulator, cut_replay_segments(simulator))
    assert (count, episode) == (1, "001")
    assert time == pytest.approx(0.6, abs=3 * simulator.timestep)
