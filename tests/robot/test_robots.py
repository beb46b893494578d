"""Robots: the same action, the same answer; recordings that keep the contract."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.body import count_centers_in_torso
from selfheal.body.mjcf import format_mjcf
from selfheal.damage.words import list_names, parse_damages
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


def _change(recording: Recording, key: str, **changes) -> Recording:
    """The recording with fields of an episode changed."""
    episode = replace(recording.episodes[key], **changes)
    return replace(recording, episodes={**recording.episodes, key: episode})


def _read_vertical(values) -> dict:
    """Signals of the toy whose vertical has these values, or is not there."""
    signals = dict(Toy().act(0).episodes["only"].signals)
    vertical = signals.pop("vertical")
    if values is not None:
        signals["vertical"] = replace(vertical, values=values)
    return {"signals": signals}


def _replay(recording: Recording):
    toy = Toy()
    return replay("toy", recording, toy.anatomy, toy.truth)


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
    recording = _played()
    robot = _replay(recording)
    np.testing.assert_allclose(robot.actions, Toy().actions)
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
    robot = _replay(replace(recording, episodes=flipped))
    np.testing.assert_allclose(robot.actions, Toy().actions)


TARGET = Toy().actions[[4]]
SERVOS = tuple(f"joint_{k}_servo" for k in range(4))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"ctrl": TARGET[:, 1:], "ctrl_names": SERVOS[1:]}, "lacks joint_0_servo"),
        (
            {"ctrl": TARGET[:, [0, 1, 2, 3, 0]], "ctrl_names": (*SERVOS, SERVOS[0])},
            "several columns for joint_0_",
        ),
        (_read_vertical(None), "no reading of 'vertical'"),
        (_read_vertical(np.full((1, 3), np.nan)), "no reading of 'vertical'"),
        (_read_vertical(np.ones((1, 2))), "no reading of 'vertical'"),
    ],
)
def test_a_recording_that_tells_too_little_is_refused(changes, said):
    bad = _change(_played(), "take_4", **changes)
    with pytest.raises(RecordingError, match=rf"toy\.h5.*'take_4'.*{said}"):
        _replay(bad)


def test_a_replay_does_without_clearance():
    recording = _played()
    signals = recording.episodes["take_10"].signals
    bare = {"vertical": signals["vertical"]}
    assert len(_replay(_change(recording, "take_10", signals=bare)).actions)


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


@pytest.fixture(scope="module")
def starfish():
    return require_walker(open_robot("starfish", seed=3))


def _moved(robot, damage="", onset=0.0, **how):
    """What a robot reads in 2 s of a move, whole or struck at some time [s]."""
    if damage:
        robot = robot.struck(parse_damages(damage, robot.anatomy), onset)
    rng = np.random.default_rng(1)
    commands = find_pattern("waves").compute_commands(
        0.3 * rng.normal(size=(1, 25)), 8, 2.0
    )[0]
    return robot.move(commands, **how)


def _read(*moved):
    """Values of the signals of a move, by their names."""
    signals = _moved(*moved).episodes["move"].signals
    return {name: signal.values for name, signal in signals.items()}


def test_a_move_is_a_sound_recording_and_the_same_again(starfish):
    first, again = _moved(starfish), _moved(starfish)
    validate(first)
    assert _equal(first, again) and not _equal(first, _moved(starfish, trial=1))
    sensors = list_names(starfish.anatomy)["sensor"]
    assert set(sensors) < set(first.episodes["move"].signals)


def test_a_robot_breaks_in_the_middle_of_a_move(starfish):
    damages = "", "dead:clearance", "left_lower:0.3"
    whole, dead, short = (_read(starfish, damage, 1.0) for damage in damages)
    one, other = whole["clearance"], dead["clearance"]
    assert other[:20] == pytest.approx(one[:20], abs=0.004)  # other noise
    assert np.all(other[20:] == 0) and np.any(one[20:] != 0)
    one, other = whole["torso_orientation"], short["torso_orientation"]
    assert other[:20] == pytest.approx(one[:20], abs=1e-9)
    assert np.abs(other[-1] - one[-1]).max() > 1e-4


@pytest.mark.parametrize("sensor", ["vertical", "clearance", "left_hip_position"])
def test_a_sensor_that_lies_reads_a_share_of_what_is_true(starfish, sensor):
    true, lie = (_read(starfish, said) for said in ("", f"lie:{sensor}:0.3"))
    assert lie[sensor] == pytest.approx(0.3 * true[sensor], abs=1e-12)


def test_damages_add_up_in_whatever_order_a_robot_is_struck(starfish):
    short, dead = (
        parse_damages(said, starfish.anatomy)
        for said in ("left_lower:0.3", "dead:clearance")
    )
    struck = (
        starfish.struck(dead, 1.0).struck(short),
        starfish.struck(short).struck(dead, 1.0),
    )
    assert _equal(*map(_moved, struck))
    found = _read(struck[0])
    assert np.any(found["clearance"][:20] > 0)
    assert np.all(found["clearance"][20:] == 0)
    turned = found["torso_orientation"] - _read(starfish)["torso_orientation"]
    assert np.abs(turned[:20]).max() > 1e-4
