"""Robots that a file describes: what they know, who answers, and what is refused."""

import re

import numpy as np
import pytest

import selfheal
from selfheal.body.mjcf import format_mjcf
from selfheal.engine.plant import build_rated_plant
from selfheal.engine.walk import PERIOD
from selfheal.errors import InputError
from selfheal.recording import Recording, read, write
from selfheal.robot.base import require_mover
from selfheal.robot.open_robot import open_robot
from selfheal.robot.rest_readings import read_rest_channels
from tests.support.mjcf_models import write_file
from tests.support.paths import ROOT

ARM = """
name = "arm"
sensors = ["position:*", "gravity:hand"]
ordered = false
[torso]
size = [0.1, 0.1, 0.1]
mass = 1.2
fixed = true
[[parts]]
names = ["fore", "hand"]
length = 0.1
radius = 0.01
mass = 0.1
[[parts]]
names = ["upper"]
joints = ["shoulder"]
length = 0.2
radius = 0.02
mass = 0.3
hinge = "left"
bend = 90
housing = { size = [0.04, 0.04, 0.04], mass = 0.1 }
[body]
upper = "torso front"
fore = "upper front 0.4"
hand = "fore front"
"""
SHIPPED = sorted((ROOT / "models" / "described").glob("*.toml"))


def _describe(tmp_path, *changes, name="arm.toml"):
    text = ARM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return str(write_file(tmp_path / name, text))


def _drive(tmp_path, code):
    """The file of an arm for which a class of this code answers, if there is one."""
    if code is not None:
        write_file(tmp_path / "arm_driver.py", code)
    change = ("[torso]", 'driver = "arm_driver.py:Arm"\n[torso]')
    return _describe(tmp_path, change, name="real.toml")


def test_what_a_file_says_is_what_the_robot_knows(tmp_path):
    robot = open_robot(_describe(tmp_path), seed=3)
    known = robot.anatomy
    assert known.parts == ("fore", "hand", "upper")
    assert known.joints == ("fore", "hand", "shoulder")
    assert known.hinges == (2, 2, 0) and known.fixed and not known.ordered
    np.testing.assert_allclose(known.bends, [0, 0, np.pi / 2])
    tips = ("position:fore", "position:hand", "position:upper")
    assert known.sensors == (*tips, "gravity:hand")
    assert robot.truth.parent.tolist() == [[3, 1, 0]]
    assert robot.actions.shape == (6, 3)  # of three joints, singly and in pairs


def test_a_part_that_hangs_down_points_down(tmp_path):
    robot = open_robot(_describe(tmp_path))
    from selfheal.body.body import compute_part_points

    tips = compute_part_points(robot.truth, 1.0)[0]
    roots = compute_part_points(robot.truth, 0.0)[0]
    np.testing.assert_allclose((tips - roots)[2], [0, 0, -0.2], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('hinge = "left"', 'hinge = "sideways"', "unknown hinge 'sideways'"),
        ("length = 0.2", "length = -0.2", r"parts\[1\].length"),
        ("mass = 1.2", "weight = 1.2", "torso.mass is missing"),
        ('names = ["upper"]', 'names = ["hand"]', "two parts are named 'hand'"),
        ('upper = "torso front"', 'upper = "hand front"', "hangs on itself"),
        ('upper = "torso front"', 'upper = "torso top"', "unknown side of torso 'top'"),
        ('upper = "torso front"', 'upper = ""', "would fit: torso left"),
        ('hand = "fore front"', "", "differ in hand"),
        ('"gravity:hand"', '"torque:finger"', "unknown part of sensor torque 'finger'"),
        ('"gravity:hand"', '"clearance"', "says nothing of a robot that is fixed"),
        ("ordered = false", "ordered = true", "unknown place of fore"),
        ('joints = ["shoulder"]', 'joints = ["a", "b"]', "2 joints of 1 parts"),
    ],
)
def test_what_does_not_fit_is_said_of_its_place(tmp_path, old, new, said):
    path = _describe(tmp_path, (old, new))
    with pytest.raises(InputError, match=f"^{re.escape(path)}: .*{said}"):
        open_robot(path)


def test_a_robot_for_which_nothing_answers_is_refused(tmp_path):
    text = ARM[: ARM.index("[body]")]
    path = write_file(tmp_path / "real.toml", text)
    with pytest.raises(InputError, match=r"nothing answers.*--recordings.*driver"):
        open_robot(str(path))


DRIVER = """
import selfheal.robot.open_robot as robots
HIDDEN = robots.open_robot({path!r}, seed=5)

class Arm:
    def move(self, targets):
        self.row = [list(t) for t in HIDDEN.actions].index(list(targets.values()))

    def read(self):
        (episode,) = HIDDEN.act(self.row).episodes.values()
        return {{n: s.values[-1] for n, s in episode.signals.items() if n != {skip!r}}}
"""


def test_a_python_class_and_a_recording_answer_as_the_robot_does(tmp_path):
    hidden = open_robot(_describe(tmp_path), seed=5)
    path = _drive(tmp_path, DRIVER.format(path=str(tmp_path / "arm.toml"), skip=""))
    real = open_robot(path)
    runs = [r for k in range(6) for r in hidden.act(k).episodes.items()]
    write(Recording(dict(runs), "arm", "test"), tmp_path / "runs.h5")
    played = open_robot(path, recordings=tmp_path / "runs.h5")
    assert len(read(tmp_path / "runs.h5").episodes) == len(played.actions) == 6
    for k in range(6):
        expected = read_rest_channels(hidden.act(k), hidden.anatomy)
        for robot in (real, played):
            got = read_rest_channels(robot.act(k), robot.anatomy)
            np.testing.assert_allclose(got, expected)


def test_a_class_that_does_not_fit_is_refused(tmp_path):
    hidden = _describe(tmp_path)
    for code, said in (
        (None, "arm_driver.py"),
        ("class Arm:\n    def move(self, t): ...\n", r"Arm has no method read\(\)"),
        (DRIVER.format(path=hidden, skip="hand_tip"), "no 'hand_tip', for the sensor"),
        ("1 / 0", "cannot be made: ZeroDivisionError"),
    ):
        path = _drive(tmp_path, code)
        with pytest.raises(InputError, match=said):
            open_robot(path).act(0)


FOLLOWS = """
class Arm:
    def move(self, targets): ...
    def read(self): ...
    def follow(self, commands, period):
        times = [2 * period, 3.5 * period]
        return {{"time": times, {more}}}
"""


def test_a_class_that_follows_commands_gives_a_recording_of_all_of_them(tmp_path):
    code = FOLLOWS.format(more='"hand_position": [1, 2]')
    robot = open_robot(_drive(tmp_path, code))
    commands = np.arange(5 * robot.anatomy.size).reshape(5, -1) / 100
    (episode,) = require_mover(robot).move(commands).episodes.values()
    np.testing.assert_allclose(episode.time, PERIOD * np.array([0, 1, 2, 3, 3.5, 4]))
    np.testing.assert_array_equal(episode.ctrl, commands[[0, 1, 2, 3, 3, 4]])
    read = episode.signals["hand_position"]
    assert (read.kind, read.target, read.unit) == ("joint_position", "hand", "rad")
    np.testing.assert_array_equal(read.values[[2, 4]], [1, 2])
    assert np.isnan(read.values[[0, 1, 3, 5]]).all()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", "follow.. gave time; would fit: time, and some of vertical"),
        ('"hand_position": [1, 2, 3]', "no arrays of one length"),
        ('"hand_position": ["near", "far"]', "no arrays of one length"),
    ],
)
def test_a_class_that_follows_and_says_nothing_of_use_is_refused(more, said, tmp_path):
    robot = open_robot(_drive(tmp_path, FOLLOWS.format(more=more)))
    with pytest.raises(InputError, match=said):
        require_mover(robot).move(np.zeros((5, robot.anatomy.size)))


def test_the_body_of_an_arm_whose_links_stand_in_any_order_is_found(tmp_path):
    arm, out = _describe(tmp_path), tmp_path / "run"
    run = selfheal.identify(arm, seed=1, budget=4000, out=out)
    assert len(run.cycles) == 6
    assert run.cycles[-1].genomes.parent[0].tolist() == [3, 1, 0]
    assert (out / "report.html").exists()
    again = selfheal.identify(resume=out / "run.h5")
    assert again.result["parent"] == [3, 1, 0]


def test_a_bolted_robot_is_refused_where_it_should_walk(tmp_path):
    arm = open_robot(_describe(tmp_path))
    with pytest.raises(InputError, match="'arm' is bolted down; would fit"):
        build_rated_plant(arm.truth)


def test_an_mjcf_is_read_as_the_body_that_it_states(tmp_path):
    robot = open_robot(_describe(tmp_path))
    path = write_file(tmp_path / "arm.xml", format_mjcf(robot.truth))
    same = open_robot(str(path))
    assert same.anatomy.fixed and same.anatomy.parts == robot.anatomy.parts
    np.testing.assert_allclose(same.anatomy.bends, robot.anatomy.bends, atol=1e-6)
    np.testing.assert_allclose(same.truth.axis, robot.truth.axis, atol=1e-6)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_a_shipped_description_is_a_robot_that_answers(path):
    robot = open_robot(str(path), seed=1)
    felt = read_rest_channels(robot.act(0), robot.anatomy)
    assert np.isfinite(felt).all() and len(robot.actions) >= 15
