"""Robots: the same action, the same answer; recordings that keep the contract."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.body import count_centers_in_torso
from selfheal.body.damage import list_sensors, parse_damages
from selfheal.body.mjcf import format_mjcf
from selfheal.errors import InputError, RecordingError, UnknownNameError
from selfheal.gait.pattern import find_pattern
from selfheal.recording import (
    Recording,
    check_against_model,
    read,
    read_names,
    validate,
    write,
)
from selfheal.robot.actions import (
    describe_action,
    list_actions_2006,
    load_published_body,
)
from selfheal.robot.base import require_walker
from selfheal.robot.open_robot import list_robots, open_robot
from selfheal.robot.replay import replay
from tests.support.stick_robot import Toy


def _played() -> Recording:
    """A recording of the toy: every action, and the first one once more."""
    toy = Toy()
    order = [*range(len(toy.actions)), 0]
    episodes = {
        f"take_{k}": toy.act(action).episodes["only"] for k, action in enumerate(order)
    }
    return Recording(episodes, "toy", file="toy.h5")


def _without(recording: Recording, signal: str) -> Recording:
    """The recording, its last episode without a signal."""
    *_, key = recording.episodes
    episode = recording.episodes[key]
    signals = {k: v for k, v in episode.signals.items() if k != signal}
    changed = replace(episode, signals=signals)
    return replace(recording, episodes={**recording.episodes, key: changed})


def _equal(one: Recording, other: Recording) -> bool:
    pairs = zip(one.episodes.values(), other.episodes.values(), strict=True)
    return one.episodes.keys() == other.episodes.keys() and all(
        np.array_equal(a.signals[name].values, b.signals[name].values, equal_nan=True)
        for a, b in pairs
        for name in a.signals
    )


def test_the_actions_of_2006_lower_one_or_two_joints():
    actions = list_actions_2006()
    assert actions.shape == (36, 8)
    np.testing.assert_allclose(np.abs(actions), np.radians(30))
    down = (actions < 0).sum(axis=1)
    assert ((down == 1) | (down == 2)).all() and (down == 1).sum() == 8
    assert len(np.unique(actions, axis=0)) == 36
    assert describe_action(Toy().anatomy, Toy().actions[0]) == "joint_0 down"


def test_a_replay_offers_each_action_once_and_answers_with_its_episode():
    recording, toy = _played(), Toy()
    robot = replay("toy", recording, toy.anatomy, toy.truth)
    np.testing.assert_allclose(robot.actions, toy.actions)
    for action in range(len(robot.actions)):
        (name,) = robot.act(action).episodes
        assert name == f"take_{action}"
        assert robot.act(action).episodes[name] is recording.episodes[name]


def test_a_replay_reads_servos_by_name():
    recording = _played()
    flipped = {
        key: replace(e, ctrl=e.ctrl[:, ::-1], ctrl_names=e.ctrl_names[::-1])
        for key, e in recording.episodes.items()
    }
    robot = replay(
        "toy", replace(recording, episodes=flipped), Toy().anatomy, Toy().truth
    )
    np.testing.assert_allclose(robot.actions, Toy().actions)


def test_a_recording_without_a_servo_is_refused():
    recording = _played()
    episode = recording.episodes["take_4"]
    less = replace(episode, ctrl=episode.ctrl[:, 1:], ctrl_names=episode.ctrl_names[1:])
    bad = replace(recording, episodes={**recording.episodes, "take_4": less})
    with pytest.raises(RecordingError, match=r"toy\.h5.*'take_4'.*lacks joint_0_servo"):
        replay("toy", bad, Toy().anatomy, Toy().truth)


def test_a_recording_with_two_columns_for_a_servo_is_refused():
    recording = _played()
    episode = recording.episodes["take_4"]
    more = np.concatenate([episode.ctrl, episode.ctrl[:, :1]], axis=1)
    twice = replace(
        episode, ctrl=more, ctrl_names=(*episode.ctrl_names, "joint_0_servo")
    )
    bad = replace(recording, episodes={**recording.episodes, "take_4": twice})
    with pytest.raises(RecordingError, match="'take_4'.*several columns for joint_0_"):
        replay("toy", bad, Toy().anatomy, Toy().truth)


def test_a_recording_without_vertical_is_refused():
    bad = _without(_played(), "vertical")
    with pytest.raises(RecordingError, match="'take_10'.*no reading of 'vertical'"):
        replay("toy", bad, Toy().anatomy, Toy().truth)


@pytest.mark.parametrize("values", [np.full((1, 3), np.nan), np.ones((1, 2))])
def test_a_recording_whose_vertical_says_nothing_is_refused(values):
    recording = _played()
    episode = recording.episodes["take_2"]
    vertical = replace(episode.signals["vertical"], values=values)
    silent = replace(episode, signals={**episode.signals, "vertical": vertical})
    bad = replace(recording, episodes={**recording.episodes, "take_2": silent})
    with pytest.raises(RecordingError, match="'take_2': no reading of 'vertical'"):
        replay("toy", bad, Toy().anatomy, Toy().truth)


def test_a_replay_does_without_clearance():
    assert len(
        replay(
            "toy", _without(_played(), "clearance"), Toy().anatomy, Toy().truth
        ).actions
    )


@pytest.mark.parametrize("name", ["starfish", "tree:3"])
def test_a_simulated_robot_answers_the_same_action_the_same_way(name):
    one, same, other = (open_robot(name, seed=seed) for seed in (1, 1, 2))
    for action in (0, 20):
        first = one.act(action)
        assert _equal(first, one.act(action)) and _equal(first, same.act(action))
        assert not _equal(first, other.act(action))
    assert not _equal(one.act(1), one.act(0))


@pytest.mark.parametrize("name", ["starfish", "tree:3"])
def test_a_simulated_recording_keeps_the_contract_and_fits_the_body(name, tmp_path):
    robot = open_robot(name)
    recording = robot.act(7)
    validate(recording)
    write(recording, tmp_path / "a.h5")
    assert _equal(read(tmp_path / "a.h5"), recording)
    (tmp_path / "body.xml").write_text(format_mjcf(robot.truth))
    check_against_model(recording, read_names(tmp_path / "body.xml"))
    (episode,) = recording.episodes.values()
    np.testing.assert_array_equal(episode.ctrl[-1], robot.actions[7])
    assert np.linalg.norm(episode.signals["vertical"].values[-1]) == pytest.approx(1)
    for joint, target in zip(robot.anatomy.joints, robot.actions[7], strict=True):
        reached = episode.signals[f"{joint}_position"].values[-1]
        assert 0 < abs(reached - target) < np.radians(8)


def test_a_simulated_recording_can_be_replayed():
    robot = open_robot("starfish", seed=4)
    episodes = {}
    for action in (0, 9):
        episodes |= robot.act(action).episodes
    again = replay("starfish", Recording(episodes), robot.anatomy, robot.truth)
    np.testing.assert_array_equal(again.actions, robot.actions[[0, 9]])
    assert _equal(again.act(1), robot.act(9))


def test_trees_are_numbered_and_their_parts_stay_out_of_the_torso():
    bodies = [open_robot(f"tree:{k}").truth for k in range(6)]
    assert not any(count_centers_in_torso(body)[0] for body in bodies)
    assert len({body.parent.tobytes() for body in bodies}) > 3
    again, default = open_robot("tree:4", seed=9), open_robot("tree", seed=4)
    for robot in (again, default):
        np.testing.assert_array_equal(robot.truth.anchor, bodies[4].anchor)
        assert robot.name == "tree:4"


@pytest.mark.parametrize(
    "name, options, kind, text",
    [
        ("crab", {}, UnknownNameError, "'crab'; valid: starfish, starfish-2006, tree"),
        ("starfish:2", {}, InputError, "takes no argument, so not '2'"),
        ("tree:x", {}, InputError, "a whole number, as tree:7; not 'x'"),
        ("tree:-1", {}, InputError, "not '-1'"),
        ("tree", {"seed": -1}, InputError, "seed must not be negative"),
        ("starfish", {"recordings": "a.h5"}, InputError, "answers from no recording"),
        ("starfish-2006", {}, InputError, "--recordings intact.h5"),
        ("starfish-2006:1", {}, InputError, "takes no argument"),
        ("starfish-2006", {"recordings": "no.h5"}, RecordingError, "no such file"),
    ],
)
def test_robots_that_cannot_be_are_refused(name, options, kind, text):
    with pytest.raises(kind, match=text):
        open_robot(name, **options)


def test_every_robot_says_what_it_is():
    found = list_robots()
    assert {"starfish", "starfish-2006", "tree"} <= found.keys()
    assert all(text and "\n" not in text for text in found.values())


def test_the_robot_of_2006_offers_its_36_actions(shared_recordings):
    file = shared_recordings / "starfish_2006" / "intact.h5"
    robot = open_robot("starfish-2006", recordings=file)
    found = {row.tobytes() for row in np.round(robot.actions, 6)}
    assert found == {row.tobytes() for row in np.round(list_actions_2006(), 6)}
    assert robot.anatomy.joints == load_published_body().anatomy.joints
    for action in (0, 35):
        (episode,) = robot.act(action).episodes.values()
        assert episode.ctrl[-1] == pytest.approx(robot.actions[action])


def _moved(robot, seconds=2.0, **how):
    rng = np.random.default_rng(1)
    commands = find_pattern("waves").compute_commands(
        0.3 * rng.normal(size=(1, 25)), 8, seconds
    )[0]
    return robot.move(commands, **how)


def test_a_move_is_a_sound_recording_and_the_same_again():
    robot = require_walker(open_robot("starfish", seed=3))
    first, again, other = _moved(robot), _moved(robot), _moved(robot, trial=1)
    validate(first)
    signals = [r.episodes["move"].signals for r in (first, again, other)]
    for name, signal in signals[0].items():
        assert np.array_equal(signal.values, signals[1][name].values)
    assert not np.array_equal(
        signals[0]["vertical"].values, signals[2]["vertical"].values
    )
    assert set(list_sensors(robot.anatomy)) < set(signals[0])


def test_a_robot_breaks_in_the_middle_of_a_move():
    robot = require_walker(open_robot("starfish", seed=3))
    dead = robot.struck(parse_damages("dead:clearance", robot.anatomy), 1.0)
    whole, broken = (
        _moved(r).episodes["move"].signals["clearance"].values for r in (robot, dead)
    )
    assert broken[:20] == pytest.approx(whole[:20], abs=0.004)  # other noise
    assert np.all(broken[20:] == 0) and np.any(whole[20:] != 0)


@pytest.mark.parametrize("sensor", ["vertical", "clearance", "left_hip_position"])
def test_a_sensor_that_lies_reads_a_share_of_what_is_true(sensor):
    robot = require_walker(open_robot("starfish", seed=3))
    lying = robot.struck(parse_damages(f"lie:{sensor}:0.3", robot.anatomy))
    true, read = (
        _moved(r).episodes["move"].signals[sensor].values for r in (robot, lying)
    )
    assert read == pytest.approx(0.3 * true, abs=1e-12)


def test_damages_add_up_in_whatever_order_a_robot_is_struck():
    robot = require_walker(open_robot("starfish", seed=3))
    short, dead = (
        parse_damages(said, robot.anatomy)
        for said in ("left_lower:0.3", "dead:clearance")
    )
    struck = (
        robot.struck(dead, 1.0).struck(short),
        robot.struck(short).struck(dead, 1.0),
    )
    signals = [_moved(r).episodes["move"].signals for r in struck]
    for name, signal in signals[0].items():
        assert np.array_equal(signal.values, signals[1][name].values)
    assert np.any(signals[0]["clearance"].values[:20] > 0)
    assert np.all(signals[0]["clearance"].values[20:] == 0)
    whole = _moved(robot).episodes["move"].signals["torso_orientation"].values
    turned = signals[0]["torso_orientation"].values - whole
    assert np.abs(turned[:20]).max() > 1e-4


def test_a_shorter_leg_moves_otherwise_only_after_it_broke():
    robot = require_walker(open_robot("starfish", seed=3))
    short = robot.struck(parse_damages("left_lower:0.3", robot.anatomy), 1.0)
    whole, broken = (
        _moved(r).episodes["move"].signals["torso_orientation"].values
        for r in (robot, short)
    )
    assert broken[:20] == pytest.approx(whole[:20], abs=1e-9)
    assert np.abs(broken[-1] - whole[-1]).max() > 1e-4
