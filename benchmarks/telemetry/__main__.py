"""The benchmark of the telemetry check: faults put into clean recordings.

    python -m benchmarks.telemetry

Twenty recordings of eleven robots are checked as they are, then with one fault each.
Recordings of robots whose physics differs from the model, and of real ones, have to
give no alarm. Writes docs/results/telemetry.md.
"""

import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.other_cases.cases import OTHER_CASES
from benchmarks.other_cases.make import make_case as make_other_case
from benchmarks.sealed.cases import make_case
from benchmarks.sealed.hidden_robot import UnfitDraw
from benchmarks.sealed.robots import ROBOTS
from benchmarks.telemetry.faults import Injection, inject_faults
from benchmarks.writer import INTACT, Section, make_parser, publish_results
from selfheal.mujoco_files import silence_mujoco
from selfheal.recording import Recording, load_model, read
from selfheal.telemetry import Fault, check_telemetry

SEEDS = (7000, 7001)  # of the clean recordings of each robot
CONCEALED = 7100  # first seed of those with concealed physics
OTHERS = ("gantry_null", "pen_null_drift")  # clean ones of another style
DEVICES = (
    ("xl330/model.xml", "xl330/train.h5"),
    ("xl330/servo/model_kp200.xml", "xl330/servo/train_kp200.h5"),
    ("xl330/model_released.xml", "xl330/train_released.h5"),
    ("double_pendulum_c1/model.xml", "double_pendulum_c1/train.h5"),
    ("cube_toss/model.xml", "cube_toss/train.h5"),
    ("starfish_2006/model.xml", "starfish_2006/intact.h5"),
)
Row = tuple[str, mujoco.MjModel, Recording]


def list_clean() -> Iterator[Row]:
    """Names, models and recordings of robots that are as their models say."""
    for robot in ROBOTS:
        for seed in SEEDS:
            case = make_case("null", seed, robots=[robot])
            model = mujoco.MjModel.from_xml_string(case.robot.xml)
            yield f"{robot} {seed}", model, case.train
    for other in OTHER_CASES:
        if other.name in OTHERS:
            made = make_other_case(other)
            model = mujoco.MjModel.from_xml_string(made.robot.xml)
            yield other.name, model, made.train


def list_concealed(count: int) -> Iterator[Row]:
    """Robots with one or two effects that their models lack."""
    for seed in range(CONCEALED, CONCEALED + count):
        try:
            case = make_case("double" if seed % 3 == 0 else "single", seed)
        except UnfitDraw:
            continue
        effects = ", ".join(e["effect"] for e in case.key["effects"])
        model = mujoco.MjModel.from_xml_string(case.robot.xml)
        yield f"{case.name} {case.robot.name}: {effects}", model, case.train
    for other in OTHER_CASES:
        if other.name not in OTHERS:
            made = make_other_case(other)
            model = mujoco.MjModel.from_xml_string(made.robot.xml)
            yield other.name, model, made.train


def list_devices() -> Iterator[Row]:
    """Real robots."""
    folder = INTACT.parents[1]
    for model, file in DEVICES:
        yield file, load_model(folder / model), read(folder / file)


def judge(injection: Injection, faults: list[Fault]) -> tuple[bool, bool, list[str]]:
    """Whether a fault was found and located, and what else was told."""
    right = [f for f in faults if f.kind in injection.kinds]
    located = [
        f
        for f in right
        if not injection.columns
        or injection.columns & {*f.columns}
        or injection.columns & {*f.alternatives}
    ]
    others = [f"{f.kind} {', '.join(f.columns)}" for f in faults if f not in located]
    return bool(right), bool(located), others


def _check_rows(rows: Iterator[Row]) -> list[dict[str, Any]]:
    """Alarms of recordings that should give none."""
    found = []
    for name, model, recording in rows:
        start = time.perf_counter()
        faults = check_telemetry(recording, model)
        seconds = time.perf_counter() - start
        found.append({"name": name, "seconds": seconds,
                      "alarms": [f"{f.kind}: {f.seen}" for f in faults]})  # fmt: skip
        if faults:
            print(name, found[-1]["alarms"], file=sys.stderr)
    return found


def run(concealed: int) -> dict[str, Any]:
    """All checks, as numbers."""
    clean, injected = [], []
    for number, row in enumerate(list_clean()):
        name, model, recording = row
        clean += _check_rows(iter([row]))
        rng = np.random.default_rng(number)
        for one in inject_faults(recording, model, rng):
            faults = check_telemetry(one.recording, one.model)
            found, located, others = judge(one, faults)
            injected.append({"name": name, "fault": one.name, "found": found,
                             "located": located, "others": others})  # fmt: skip
            if not located:
                print(
                    name, one.name, sorted(one.columns), found, others, file=sys.stderr
                )
    return {
        "clean": clean,
        "injected": injected,
        "concealed": _check_rows(list_concealed(concealed)),
        "devices": _check_rows(list_devices()),
    }


def make_sections(data: dict[str, Any]) -> list[Section]:
    """The page."""
    injected = data["injected"]
    total = Counter(r["fault"] for r in injected)
    rows = [
        [
            fault,
            count,
            sum(r["found"] for r in injected if r["fault"] == fault),
            sum(r["located"] for r in injected if r["fault"] == fault),
        ]
        for fault, count in total.items()
    ]
    missed = [
        [r["name"], r["fault"], "found elsewhere" if r["found"] else "not found",
         "; ".join(r["others"])]
        for r in injected if not r["located"]
    ]  # fmt: skip
    alarms = [
        [key, len(data[key]), sum(bool(r["alarms"]) for r in data[key]),
         f"{max(r['seconds'] for r in data[key]):.1f}"]
        for key in ("clean", "concealed", "devices")
    ]  # fmt: skip
    false = [
        [r["name"], "; ".join(r["alarms"])]
        for key in ("clean", "concealed", "devices")
        for r in data[key] if r["alarms"]
    ]  # fmt: skip
    found = [
        Section(
            "Faults put into clean recordings",
            "One fault each. Located: the columns that are told, or those told to be "
            "as likely, have the fault.",
            ("fault", "recordings", "found", "located"),
            rows,
        ),
        Section(
            "Alarms where there is no fault",
            "clean: the recordings above. concealed: one or two effects that the model "
            "lacks. devices: real robots.",
            ("recordings", "count", "with an alarm", "slowest check [s]"),
            alarms,
        ),
    ]
    if missed:
        head = ("recording", "fault", "what was said", "other faults told")
        found.append(Section("Not located", "Each of them.", head, missed))
    if false:
        found.append(
            Section("False alarms", "Each of them.", ("recording", "alarm"), false)
        )
    return found


def main() -> int:
    """Read the command line, run, write the page."""
    line = make_parser(__doc__ or "")
    line.add_argument("--concealed", type=int, default=60, help="seeds tried")
    options = line.parse_args()
    silence_mujoco()
    root: Path = options.root
    data = run(options.concealed)
    title = "Faults of logs that the telemetry check finds"
    publish_results(root, "telemetry", title, make_sections(data), data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
