"""Study `schema`: paper C's lengths from seven sensor sets, and its 8 x 4 matrix."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ..body.body import Bodies, Floats, compute_edge_f1
from ..body.genome import Genomes, build_bodies, decode_unit_genes
from ..engine.statics import Statics
from ..errors import InputError
from ..robot.actions import load_published_body
from ..robot.rest_readings import read_rest_channels
from ..robot.simulated import SimulatedRobot
from ..schema import Count, Number
from ..selfmodel.lengths import Ask, estimate_lengths
from ..selfmodel.schema import (
    SENSOR_SETS,
    estimate_models,
    make_lengths_plan,
    make_matrix_plan,
    simulate_channels,
)
from .plan import (
    Outcome,
    Picture,
    Record,
    RunSettings,
    Study,
    StudyRequest,
    Table,
    Task,
    select_records,
)
from .statistics import format_mean_std, format_share
from .trees import HIDDEN, REAL, ROBOT_LABELS, extract_column

# papers.md 1.3 and 2, C
_TRUE = (0.125, 0.1875, 0.2083, 0.2188, 0.275, 0.3958, 0.4821, 0.5469)
_SWING, _HIPS = np.radians(30.0), 4
_POSES = {"lengths": 4, "matrix": 9}
_STAGES = (6, 5, 5)  # poses that our way asks for before each estimation; chosen
_FILE = "poses_schema.csv"
_NEW = 100  # poses that models are asked for and were not fitted to; chosen
_LEAST_TILT_GAP = 2.0  # [deg], by which such a pose differs; chosen


@dataclass(frozen=True)
class _Settings:
    robot: str
    what: str
    sensors: str


@dataclass(frozen=True)
class _LengthsOutcome:
    part: Number
    leg: Number
    uneven: Number
    evaluations: Count


@dataclass(frozen=True)
class _MatrixOutcome(_LengthsOutcome):
    edge_f1: Number
    success: bool
    hips: bool
    foretold: Number
    tilt_gap: Number


def _list_tasks(request: StudyRequest) -> list[Task]:
    places = [HIDDEN] if request.recordings is None else [REAL, HIDDEN]
    if REAL in places and not (Path(str(request.recordings)) / _FILE).is_file():
        raise InputError(f"--recordings {request.recordings}: no {_FILE} there")
    work = [
        (what, "+".join(names)) for what in ("lengths", "ours") for names in SENSOR_SETS
    ]
    work.append(("matrix", "+".join(SENSOR_SETS[-1])))
    return [
        Task(f"{robot} {what} {sensors} {seed}",
             {"robot": robot, "what": what, "sensors": sensors, "seed": seed,
              "recordings": str(request.recordings) if robot == REAL else ""})
        for seed in request.seeds for what, sensors in work for robot in places
    ]  # fmt: skip


def _draw_poses(count: int, rng: np.random.Generator) -> Floats:
    """(count, P) random angles of the hips [rad]."""
    targets = np.zeros((count, len(_TRUE)))
    targets[:, :_HIPS] = rng.uniform(-_SWING, _SWING, (count, _HIPS))
    return targets


def _list_corners() -> Floats:
    """(256, P) every joint at an end of paper C's range [rad].

    A leg that slants more tells more of its length.
    """
    return np.array(list(product((-_SWING, _SWING), repeat=len(_TRUE))))


def _offer_hidden(targets: Floats, seed: int) -> tuple[Floats, Ask]:
    """Poses that a hidden robot offers, and what asks it for one."""
    robot = SimulatedRobot(HIDDEN, load_published_body(), seed, offers=targets)
    return targets, lambda k: np.array(
        [*read_rest_channels(robot.act(k), robot.anatomy), *robot.read_touch(k)]
    )


def _offer_real(folder: str, seed: int) -> tuple[Floats, Ask]:
    """The ten poses of the robot itself, in random order."""
    rows = np.genfromtxt(Path(folder) / _FILE, delimiter=",", skip_header=1)
    rows = np.random.default_rng([seed, 14]).permutation(rows)
    targets = np.zeros((len(rows), len(_TRUE)))
    targets[:, :_HIPS] = np.radians(rows[:, 1:5])
    seen = np.hstack([rows[:, 9:12], rows[:, 5:9]])
    return targets, lambda k: seen[k]


def _run_task(settings: RunSettings) -> Outcome:
    seed, what, real = settings["seed"], settings["what"], settings["robot"] == REAL
    if real:
        offers, ask = _offer_real(settings["recordings"], seed)
    elif what == "ours":
        offers, ask = _offer_hidden(_list_corners(), seed)
    else:
        some = _draw_poses(_POSES[what], np.random.default_rng([seed, 13]))
        offers, ask = _offer_hidden(some, seed)
    sensors = tuple(settings["sensors"].split("+"))
    truth, rng = load_published_body(), np.random.default_rng([seed, 15])
    known = decode_unit_genes(truth.anatomy, np.array([_TRUE]))
    if what == "ours":
        stages = (len(offers),) if real else _STAGES
        plan = make_lengths_plan(known, sensors)
        best, spent = estimate_lengths(plan, truth, offers, ask, stages=stages, rng=rng)
        return _measure_lengths(best, truth) | {"evaluations": spent}
    poses = offers[: _POSES[what]]
    seen = np.array([ask(k) for k in range(len(poses))])
    plan = (make_lengths_plan(known, sensors) if what == "lengths"
            else make_matrix_plan(truth, sensors))  # fmt: skip
    *_, (best, error, spent) = estimate_models(truth, poses, seen, plan, rng)
    found = _measure_lengths(best, truth) | {"fit": error, "evaluations": spent}
    return found | _measure_tree(best, truth, seed) if what == "matrix" else found


def _measure_lengths(model: Genomes, truth: Bodies) -> dict[str, float]:
    """How far lengths are off, of parts, of straight legs, and how uneven [mm]."""
    legs = [(i, i + _HIPS) for i in range(_HIPS)]
    made, true = 1000 * model.length[0], 1000 * truth.length[0]
    whole = np.array([[x[list(leg)].sum() for leg in legs] for x in (made, true)])
    return {
        "part": float(np.abs(made - true).mean()),
        "leg": float(np.abs(whole[0] - whole[1]).mean()),
        "uneven": float(whole[0].std()),
    }


def _measure_tree(model: Genomes, truth: Bodies, seed: int) -> dict[str, Any]:
    """How right a tree is, and how well it tells poses that it was not fitted to."""
    body = build_bodies(truth.anatomy, model)
    poses = _draw_poses(_NEW, np.random.default_rng([seed, 16]))
    rows, engine = np.zeros(_NEW, np.int64), Statics()
    seen = [simulate_channels(b[rows], poses, engine)[:, :2] for b in (body, truth)]
    gap = np.abs(seen[0] - seen[1]).max(axis=1)
    return {
        "edge_f1": float(compute_edge_f1(body, truth)[0]),
        "success": bool((body.parent == truth.parent).all()),
        "hips": bool((body.parent[0, :_HIPS] == 0).all()),
        "foretold": float((gap <= _LEAST_TILT_GAP).mean()),
        "tilt_gap": float(np.median(gap)),
    }


def _group_by_sensors(
    records: Sequence[Record], robot: str, what: str
) -> dict[str, list[Record]]:
    """Sensor set -> its runs of lengths."""
    names = ["+".join(s) for s in SENSOR_SETS]
    found = {
        n: select_records(records, robot=robot, what=what, sensors=n) for n in names
    }
    return {name: rs for name, rs in found.items() if rs}


def _make_tables(records: Sequence[Record]) -> list[Table]:
    tables = []
    for robot in (REAL, HIDDEN):
        for what, (title, text) in _WAYS.items():
            found = _group_by_sensors(records, robot, what)
            rows = [
                (
                    name,
                    f"{len(rs):,}",
                    format_mean_std(extract_column(rs, "evaluations"), 0),
                    *(
                        format_mean_std(extract_column(rs, k), 1)
                        for k in ("part", "leg", "uneven")
                    ),
                )
                for name, rs in found.items()
            ]
            if rows:
                note = f"{text} {_LENGTHS}"
                tables.append(
                    Table(f"{title}, {ROBOT_LABELS[robot]}", note, _HEAD, rows)
                )
        if matrix := select_records(records, robot=robot, what="matrix"):
            tables.append(_make_matrix_table(robot, matrix))
    return tables


_HEAD = ("sensors", "runs", "evaluations", "part's error [mm]", "leg's error [mm]",
         "legs uneven [mm]")  # fmt: skip
_WAYS = {
    "lengths": ("Eight lengths, paper C",
                "100 models, 10 generations after each of 4 poses of the hips, knees "
                "straight."),
    "ours": ("Eight lengths, ours",
             "16 poses on the hidden robot, chosen among the 256 with every hip and "
             "knee at an end of paper C's range, all ten of the hips alone on the real "
             "one; lengths and zeros of servos by crowding and least squares that "
             "weigh each pose by what servos and sensors miss by."),
}  # fmt: skip
_LENGTHS = (
    "Lengths from 10 to 200 mm. Part's error: mean |length - true length|, the measure "
    "of the paper; leg's error: the same of upper and lower part together, which is "
    "what a straight leg shows. Uneven: standard deviation of a model's four legs, 0 "
    "in a good model. Mean and standard deviation over runs. The paper has a figure, "
    "and no numbers."
)


def _make_matrix_table(robot: str, rs: Sequence[Record]) -> Table:
    """The 8 x 4 matrix."""
    count = len(rs)
    text = (
        "300 models, 40 generations after each of 9 poses, all sensors; parent, side, "
        "hinge and length of eight parts unknown. Straight knees never move: what "
        "hinge a lower part has cannot be known. Foretold: tilts of 100 new poses "
        f"within {_LEAST_TILT_GAP:g} degrees of the true body's, both by statics."
    )
    row = (
        f"{count:,}",
        format_mean_std(extract_column(rs, "evaluations"), 0),
        format_share(sum(extract_column(rs, "success")), count),
        format_share(sum(extract_column(rs, "hips")), count),
        format_mean_std(extract_column(rs, "edge_f1")),
        format_mean_std([100 * x for x in extract_column(rs, "foretold")], 0),
        format_mean_std(extract_column(rs, "tilt_gap"), 1),
    )
    head = ("runs", "evaluations", "every part on its true parent", "hips on the torso",
            "edge F1", "foretold [%]", "median tilt gap [deg]")  # fmt: skip
    return Table(f"The 8 x 4 matrix, {ROBOT_LABELS[robot]}", text, head, [row])


def _make_pictures(records: Sequence[Record]) -> list[Picture]:
    pictures = []
    for robot in (REAL, HIDDEN):
        for what, (title, _) in _WAYS.items():
            if found := _group_by_sensors(records, robot, what):
                series = {
                    name: extract_column(rs, "part") for name, rs in found.items()
                }
                axis = "mean error of a part [mm]"
                title = f"{title}, {ROBOT_LABELS[robot]}"
                pictures.append(Picture(title, "box", series, axis))
    return pictures


STUDY = Study(
    about="Paper C: eight lengths from seven sets of sensors, then the 8 x 4 matrix.",
    list_tasks=_list_tasks,
    run_task=_run_task,
    make_tables=_make_tables,
    make_pictures=_make_pictures,
    inputs=("recordings",),
    settings=_Settings,
    find_outcome=lambda settings: (
        _MatrixOutcome if settings["what"] == "matrix" else _LengthsOutcome
    ),
)
