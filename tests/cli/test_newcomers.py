"""From somebody's log to a verdict, by the lines of the pages alone.

Each log is of a small robot in which one effect is concealed, as software that people
use writes it, or a real one.
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from selfheal.example.simulate import Run, simulate_runs
from selfheal.example.write_logs import write_csv, write_ros2_bag
from selfheal.recording import load_model, read
from tests.support.commands.run import run_well
from tests.support.logs import newcomer_robots as robots
from tests.support.logs import newcomers as logs
from tests.support.logs.reading import FIELD, needs_field

ARM = {"shoulder": (-2.0, 2.0), "elbow": (-2.0, 2.0)}
DESK_ARM = {
    "shoulder_pan": (-1.9, 1.9),
    "shoulder_lift": (-1.7, 1.7),
    "gripper": (-0.2, 1.7),
}
LEG = {f"FL_{part}_joint": (-2.0, 2.0) for part in ("hip", "thigh", "calf")}
HIPS = [f"{leg}_hip" for leg in ("FL", "FR", "RL", "RR")]
SERVO = '<position name="{}" joint="{}" kp="15" kv="1.5"/>'
MOTOR = '<motor name="{}_motor" joint="{}" ctrlrange="-40 40"/>'
FREE_BASE = '<freejoint/><geom size="0.1" contype="0" conaffinity="0"/>'
STANDING = "quadruped with a free base"
LATE = 4  # rows by which commands come late


@dataclass(frozen=True)
class Route:
    """From a robot's model and log to a diagnosis.

    Attributes:
        robot: text of its model.
        write: writes the log of runs.
        target: of the friction that is concealed; "world": commands come late instead.
        friction: [N m].
        rate: [Hz] of the log.
        prepare: options with which a model with drives is made.
    """

    robot: str
    log: str
    write: Callable[[Path, list[Run], list[str]], None]
    target: str = "elbow"
    friction: float = 0.15
    rate: float = 100.0
    preset: str = ""
    prepare: str = ""

    @property
    def found(self) -> tuple[str, str]:
        """Effect and target of what is concealed."""
        if self.target == "world":
            return "clock_shift", "world"
        return "coulomb_friction", f"joint:{self.target}"


_CHAIN, _DESK = robots.make_chain(ARM, SERVO), robots.make_chain(DESK_ARM, SERVO)
_LEG, _URDF = robots.make_chain(LEG, MOTOR, FREE_BASE), robots.make_urdf(list(ARM))
_SERVO = robots.make_chain({"servo": (-2.0, 2.0)}, SERVO)
_LIFT = ("shoulder_lift", 0.25, 30.0)
_CALF = ("FL_calf_joint", 0.3, 100.0, "legged_gym")
_write_lerobot = partial(logs.write_lerobot3, limits=[*DESK_ARM.values()])
_write_degrees, _write_shares = (
    partial(_write_lerobot, in_degrees=in_degrees) for in_degrees in (True, False)
)
_HUNG = "--kp 20 --kv 1.5 --weld-base"
ROUTES = {
    "csv": Route(_CHAIN, "log.csv", write_csv),
    "csv without names": Route(_CHAIN, "log.csv", logs.write_numbers),
    "ros2 and urdf": Route(_URDF, "bag", write_ros2_bag, prepare="--kp 15 --kv 1.5"),
    "ros2_control": Route(
        _CHAIN, "bag", logs.write_controller_mcap, "world", preset="ros2_control"
    ),
    "lerobot in degrees": Route(_DESK, "set", _write_degrees, *_LIFT),
    "lerobot in shares": Route(_DESK, "set", _write_shares, *_LIFT, "lerobot-so101"),
    "legged_gym, hung": Route(_LEG, "log.pt", logs.write_legged_gym, *_CALF, _HUNG),
    STANDING: Route(
        robots.make_quadruped(HIPS),
        "log.npz",
        logs.write_standing,
        "RL_hip",
        0.5,
        preset="legged_gym",
    ),
    "servo in JSON": Route(
        _SERVO, "log.json", logs.write_servo_json, "servo", rate=50.0
    ),
    "robomimic": Route(_CHAIN, "demo.hdf5", logs.write_robomimic, rate=50.0),
    "matlab": Route(_CHAIN, "log.mat", logs.write_matlab),
}


def _simulate(route: Route, text: str) -> list[Run]:
    """Runs of the robot with what its model lacks."""

    def conceal(model):
        if route.target != "world":
            joint = model.joint(route.target)
            model.dof_frictionloss[joint.dofadr[0]] = route.friction

    if "freejoint" in text:
        return robots.simulate_standing(text, conceal)
    runs = simulate_runs(text, conceal, rate=route.rate, seconds=6.0)
    if route.target != "world":
        return runs
    # a trajectory controller's goals have no steps, and speeds of a bus are noisy
    rng, late = np.random.default_rng(0), []
    for r in (runs[0], *runs[2:]):
        v = r.velocity + rng.normal(0, 0.02, r.velocity.shape)
        late.append(Run(r.time[:-LATE], r.goal[LATE:], r.position[:-LATE], v[:-LATE]))
    return late


def _prepare(folder: Path, robot: str, options: str) -> None:
    """The model with drives."""
    own = folder / f"own.{'urdf' if '<robot' in robot else 'xml'}"
    own.write_text(robot)
    run_well("model", "prepare", own, *options.split(), "--out", folder / "model.xml")


def _import(folder: Path, log: Path, preset: str) -> dict:
    """What is guessed of a log, whose recording is then without a fault."""
    model, map_file = folder / "model.xml", folder / "map.toml"
    recording = folder / "rec.h5"
    words = ("recording", "import", log, "--model", model)
    known = ("--preset", preset) if preset else ()
    told = run_well(*words, "--guess", *known, "--out", map_file, "--json")
    run_well(*words, "--map", map_file, "--out", recording)
    checked = ("check", recording, "--model", model, "--map", map_file)
    assert "no fault of the log was found" in run_well("recording", *checked)
    guess = json.loads(told)
    assert not guess["missing"]
    return guess


def _follow(route: Route, folder: Path) -> list[Run]:
    """All lines up to the check of the recording; the runs that the log holds."""
    model = folder / "model.xml"
    if route.prepare:
        _prepare(folder, route.robot, route.prepare)
    else:
        model.write_text(route.robot)
    runs, compiled = _simulate(route, model.read_text()), load_model(model)
    joints = [compiled.joint(j).name for j in range(compiled.njnt)]
    route.write(folder / route.log, runs, [name for name in joints if name])
    _import(folder, folder / route.log, route.preset)
    return runs


@pytest.mark.parametrize("name", ROUTES)
def test_a_guess_makes_a_recording_of_what_the_robot_did(name, tmp_path):
    route = ROUTES[name]
    runs = _follow(route, tmp_path)
    episodes = list(read(tmp_path / "rec.h5").episodes.values())
    assert len(episodes) == len(runs)
    model = load_model(tmp_path / "model.xml")
    told = [model.joint(int(model.actuator(a).trnid[0])).name for a in range(model.nu)]
    for episode, run in zip(episodes, runs, strict=True):
        assert episode.time[-1] == pytest.approx(run.time[-1], abs=2e-3)
        np.testing.assert_allclose(episode.ctrl, run.goal, atol=2e-5)
        for joint, values in zip(told, run.position.T, strict=True):
            read_values = episode.signals[f"{joint}_position"].values
            low, high = model.joint(joint).range
            clipped = np.clip(values, low, high) if "lerobot" in name else values
            np.testing.assert_allclose(read_values, clipped, atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in ROUTES if name != STANDING])
def test_the_verdict_names_what_was_concealed_and_nothing_else(name, tmp_path):
    _follow(ROUTES[name], tmp_path)
    given = tmp_path / "model.xml", tmp_path / "rec.h5"
    run_well("diagnose", *given, "--out", tmp_path / "found")
    document = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    found = [(f["effect"], f["target"]) for f in document["findings"]]
    assert found == [ROUTES[name].found]


@pytest.mark.slow
@needs_field
def test_a_hung_go2_gets_through_to_the_check(tmp_path):
    """Its motors are torque motors, its log holds goals, its base hangs."""
    folder = FIELD / "go2_air"
    _prepare(tmp_path, (folder / "go2_upstream.xml").read_text(), _HUNG)
    guess = _import(tmp_path, folder / "traj_0.pt", "legged_gym")
    assert not re.search("KP", " ".join(guess["remarks"]))
