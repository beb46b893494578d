"""Moves of hidden robots: what they tell of the servos, beside what is hidden."""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import selfheal
from benchmarks.recordings import select_rows
from benchmarks.suites import KeyedRuns, Record, Suites
from selfheal.body.body import Bodies, Floats
from selfheal.body.genome import build_bodies
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.engine.plant import Plant, build_rated_plant
from selfheal.engine.walk import PERIOD, SAMPLE
from selfheal.gait.synthesis import (
    GaitTask,
    LikelyPlants,
    project_on_heading,
    synthesize_gaits,
    walk_gait,
)
from selfheal.recording import Episode, Recording
from selfheal.robot.open_robot import open_robot
from selfheal.robot.simulated import SimulatedRobot
from selfheal.robot.simulated_walk import draw_hidden_plant

FIRST, MOVES, TRIAL = 6000, 4, 900
_WALK = 10.0  # [s] that the gait is walked


def list_runs(count: int, *, robot: str) -> KeyedRuns:
    """Runs of hidden robots, with seeds from 6000 on."""
    for seed in range(FIRST, FIRST + count):
        yield f"{seed}", partial(_measure, robot.format(seed), seed)


def _measure(name: str, seed: int) -> Record:
    """Identify a robot with moves, and compare with what it hides."""
    robot = open_robot(name, seed=seed)
    assert isinstance(robot, SimulatedRobot)
    with tempfile.TemporaryDirectory() as room:
        run = selfheal.identify(robot, seed=seed, moves=MOVES, out=room, force=True)
        found = run.result["dynamics"]
        document = json.loads((Path(room) / "dynamics/diagnosis.json").read_text())
        body = build_bodies(run.anatomy, run.cycles[-1].genomes[:1])
        plant = _read_plant(body, document)
        walks = _compare_walks(robot, seed, body, plant, Path(room))
    physics, hidden, offset = robot._draw_hidden_physics(
        np.random.default_rng([seed, 0])
    )
    truth = draw_hidden_plant(physics, hidden, offset, np.random.default_rng([seed, 4]))
    horizons = document["fit"]["horizons"]
    return {
        "exact": bool((body.parent == robot.truth.parent).all()),
        "held": found["held"],
        "verdict": found["verdict"],
        "horizons": [
            {k: h[k] for k in ("seconds", "given", "refit", "patched", "floor")}
            for h in horizons
        ],
        "effects": sorted({f["effect"] for f in document["findings"]}),
        "speed": [float(plant.speed.mean()), float(truth.speed[0])],
        "delay": [plant.delay, truth.delay],
        "offset": [plant.offset.tolist(), offset.tolist()],
        **walks,
    }


def _read_plant(body: Bodies, document: Mapping[str, Any]) -> Plant:
    """The rated plant of a body, with what a diagnosis found of its servos."""
    plant, joints = build_rated_plant(body), list(body.anatomy.joints)
    speed, offset, delay = plant.speed.copy(), plant.offset.copy(), 0.0
    for finding in document["findings"]:
        name = finding["target"].partition(":")[2]
        value = finding["parameters"][0]["value"]
        if finding["effect"] == "rate_limit":
            speed[joints.index(name.removesuffix("_servo"))] = value
        elif finding["effect"] == "sensor_bias":
            offset[joints.index(name.removesuffix("_position"))] = value
        elif finding["effect"] == "clock_shift":
            delay += value
        elif finding["effect"] == "command_delay":
            delay += value / len(joints)
    return replace(plant, speed=speed, offset=offset, delay=delay)


def _compare_walks(
    robot: SimulatedRobot, seed: int, body: Bodies, plant: Plant, room: Path
) -> Record:
    """How a gait walks, and how far models say; joints' errors over its ten seconds."""
    rated = build_rated_plant(body)
    (gait,) = synthesize_gaits(LikelyPlants([rated]), GaitTask(seed=seed))
    commands = gait.commands(body.anatomy.size, _WALK)
    walked = robot.move(commands, trial=TRIAL).episodes["move"]
    end = walked.signals["torso_position"].values[-1]
    real = float(project_on_heading(end, gait.heading)[0])
    out: Record = {"walked": real, "present": gait.predicted}
    for name, each in (("rated", rated), ("found", plant)):
        walks = walk_gait([each], gait, _WALK)
        way = project_on_heading(walks.position[0, -1], gait.heading)[0]
        gap = walks.angles[0] - _read_angles(walked, body)
        out[name] = float(way)
        out[f"{name}_joints"] = float(np.degrees(np.sqrt((gap**2).mean())))
    inputs = _resample(walked, commands, body)
    for name, folder in (("body", None), ("dynamics", room / "dynamics")):
        found = _replay(inputs, room, folder)
        gap = _read_angles(found, body) - _read_angles(walked, body)
        seen = found.signals["torso_position"].values[-1]
        out[name] = float(project_on_heading(seen, gait.heading)[0])
        out[f"{name}_joints"] = float(np.degrees(np.sqrt((gap**2).mean())))
    return out


def _read_angles(episode: Episode, body: Bodies) -> Floats:
    """(S, P) angles of the joints [rad] at each sample of a walk."""
    angles = np.stack(
        [episode.signals[f"{joint}_position"].values for joint in body.anatomy.joints],
        axis=1,
    )
    return angles[np.isfinite(angles).all(axis=1)]


def _resample(walked: Episode, commands: Floats, body: Bodies) -> Episode:
    """The walk with every command, from rest on, and readings to be predicted."""
    import mujoco

    from selfheal.body.mjcf import build_spec

    model = build_spec(body).compile()
    every = round(SAMPLE / PERIOD)
    time = np.linspace(0, len(commands) * PERIOD, len(commands) + 1)
    kinds = ("joint_position", "body_position")
    signals = {}
    for name, signal in walked.signals.items():
        if signal.kind in kinds:
            values = np.full((len(time), *signal.values.shape[1:]), np.nan)
            values[every::every] = signal.values
            signals[name] = replace(signal, values=values)
    sent = np.vstack([commands, commands[-1:]])
    qpos, qvel = mujoco.MjData(model).qpos.copy(), np.zeros(model.nv)
    return Episode(time, sent, walked.ctrl_names, signals, qpos, qvel)


def _replay(inputs: Episode, room: Path, folder: Path | None) -> Episode:
    """What the best body predicts, with a diagnosis or as it is, at the samples."""
    from selfheal.diagnosis.output.document import format_document

    if folder is None:
        folder = room / "nothing"
        folder.mkdir()
        document = json.loads((room / "dynamics/diagnosis.json").read_text())
        document |= {"findings": [], "refit": []}
        (folder / "diagnosis.json").write_text(format_document(document))
    recording = Recording({"move": inputs})
    found = replay_recording(folder, recording, model=room / "best.xml").episodes[
        "move"
    ]
    rows = np.flatnonzero(np.isfinite(next(iter(inputs.signals.values())).values))
    return select_rows(found, rows)


SUITES: Suites = {
    "starfish": (partial(list_runs, robot="starfish"), 5),
    # limbs of trees may have to carry them
    "trees": (partial(list_runs, robot="tree:{}"), 1),
}
