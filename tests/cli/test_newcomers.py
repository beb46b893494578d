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
    """A newcomer's way.

    Attributes:
        robot: text of the model that he has.
        log: name of his log.
        write: writes that of runs.
        found: effect and target of what is concealed.
        friction: that is concealed in the target [N m]; 0 where commands come late.
        rate: [Hz] of the log.
        preset: that he gives.
        prepare: options with which he makes a model with drives of his own.
    """

    robot: str
    log: str
    write: Callable[[Path, list[Run], list[str]], None]
    found: tuple[str, str]
    friction: float = 0.15
    rate: float = 100.0
    preset: str = ""
    prepare: tuple[str, ...] = ()


_ELBOW = ("coulomb_friction", "joint:elbow")
_LIFT = ("coulomb_friction", "joint:shoulder_lift")
_CHAIN = robots.make_chain(ARM, SERVO)
ROUTES = {
    "csv": Route(_CHAIN, "log.csv", write_csv, _ELBOW),
    "csv without names": Route(_CHAIN, "log.csv", logs.write_numbers, _ELBOW),
    "ros2 and urdf": Route(
        robots.make_urdf(list(ARM)),
        "bag",
        write_ros2_bag,
        _ELBOW,
        prepare=("--kp", "15", "--kv", "1.5"),
    ),
    "ros2_control": Route(
        _CHAIN,
        "bag",
        logs.write_controller_mcap,
        ("clock_shift", "world"),
        0.0,
        preset="ros2_control",
    ),
    "lerobot in degrees": Route(
        robots.make_chain(DESK_ARM, SERVO),
        "set",
        partial(logs.write_lerobot3, limits=[*DESK_ARM.values()], in_degrees=True),
        _LIFT,
        0.25,
        30.0,
    ),
    "lerobot in shares": Route(
        robots.make_chain(DESK_ARM, SERVO),
        "set",
        partial(logs.write_lerobot3, limits=[*DESK_ARM.values()], in_degrees=False),
        _LIFT,
        0.25,
        30.0,
        "lerobot-so101",
    ),
    "legged_gym, hung": Route(
        robots.make_chain(LEG, MOTOR, FREE_BASE),
        "log.pt",
        logs.write_legged_gym,
        ("coulomb_friction", "joint:FL_calf_joint"),
        0.3,
        100.0,
        "legged_gym",
        ("--kp", "20", "--kv", "1.5", "--weld-base"),
    ),
    STANDING: Route(
        robots.make_quadruped(HIPS),
        "log.npz",
        logs.write_standing,
        ("coulomb_friction", "joint:RL_hip"),
        0.5,
        preset="legged_gym",
    ),
    "servo in JSON": Route(
        robots.make_chain({"servo": (-2.0, 2.0)}, SERVO),
        "log.json",
        logs.write_servo_json,
        ("coulomb_friction", "joint:servo"),
        rate=50.0,
    ),
    "robomimic": Route(_CHAIN, "demo.hdf5", logs.write_robomimic, _ELBOW, rate=50.0),
    "matlab": Route(_CHAIN, "log.mat", logs.write_matlab, _ELBOW),
}


def _simulate(route: Route, text: str) -> list[Run]:
    """Runs of the robot with what its model lacks."""

    def conceal(model):
        if route.friction:
            joint = model.joint(route.found[1].removeprefix("joint:"))
            model.dof_frictionloss[joint.dofadr[0]] = route.friction

    if "freejoint" in text:
        return robots.simulate_standing(text, conceal)
    runs = simulate_runs(text, conceal, rate=route.rate, seconds=6.0)
    if route.friction:
        return runs
    # a trajectory controller's goals have no steps, and speeds of a bus are noisy
    rng = np.random.default_rng(0)
    return [
        Run(
            r.time[:-LATE],
            r.goal[LATE:],
            r.position[:-LATE],
            (r.velocity + rng.normal(0, 0.02, r.velocity.shape))[:-LATE],
        )
        for k, r in enumerate(runs)
        if k != 1
    ]


def _follow(route: Route, folder: Path) -> list[Run]:
    """All lines up to the check of the recording; the runs that the log holds."""
    model, log, recording = folder / "model.xml", folder / route.log, folder / "rec.h5"
    if route.prepare:
        own = folder / f"own.{'urdf' if '<robot' in route.robot else 'xml'}"
        own.write_text(route.robot)
        run_well("model", "prepare", own, *route.prepare, "--out", model)
    else:
        model.write_text(route.robot)
    runs = _simulate(route, model.read_text())
    compiled = load_model(model)
    joints = [compiled.joint(j).name for j in range(compiled.njnt)]
    route.write(log, runs, [name for name in joints if name])
    words = ("recording", "import", log, "--model", model)
    preset = ("--preset", route.preset) if route.preset else ()
    told = json.loads(
        run_well(*words, "--guess", *preset, "--out", folder / "map.toml", "--json")
    )
    assert not told["missing"]
    run_well(*words, "--map", folder / "map.toml", "--out", recording)
    said = run_well(
        "recording", "check", recording, "--model", model, "--map", folder / "map.toml"
    )
    assert "no fault of the log was found" in said
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
    run_well(
        "diagnose",
        tmp_path / "model.xml",
        tmp_path / "rec.h5",
        "--out",
        tmp_path / "found",
    )
    document = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    found = [(f["effect"], f["target"]) for f in document["findings"]]
    assert found == [ROUTES[name].found]


@pytest.mark.slow
@needs_field
def test_a_hung_go2_gets_through_to_the_check(tmp_path):
    """Its motors are torque motors, its log holds goals, its base hangs."""
    own, model, log = (
        tmp_path / "go2.xml",
        tmp_path / "model.xml",
        FIELD / "go2_air" / "traj_0.pt",
    )
    text = (FIELD / "go2_air" / "go2_upstream.xml").read_text()
    own.write_text(text)
    run_well(
        "model", "prepare", own, "--kp", 20, "--kv", 1.5, "--weld-base", "--out", model
    )
    words = ("recording", "import", log, "--model", model)
    told = json.loads(
        run_well(
            *words,
            "--guess",
            "--preset",
            "legged_gym",
            "--out",
            tmp_path / "map.toml",
            "--json",
        )
    )
    assert not told["missing"] and not re.search("KP", " ".join(told["remarks"]))
    run_well(*words, "--map", tmp_path / "map.toml", "--out", tmp_path / "rec.h5")
    said = run_well("recording", "check", tmp_path / "rec.h5", "--model", model)
    assert "no fault of the log was found" in said
