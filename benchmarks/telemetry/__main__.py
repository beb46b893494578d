"""The benchmark of the telemetry check: faults put into clean recordings.

    python -m benchmarks.telemetry

Robots are drawn, each with a fault of its log or its set-up, and as many without: they
are checked, what the check says is done by a script, and they are checked again.
Recordings of fourteen robots are checked as they are, then with one fault each: those
that the check was made with, and others that it never saw.
Recordings of robots whose physics differs from the model, and of real ones, have to
give no alarm. Writes docs/results/telemetry.md.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.hidden import others
from benchmarks.hidden.case import Case
from benchmarks.hidden.robots.shapes import ROBOTS
from benchmarks.hidden.sealed import make_case
from benchmarks.hidden.truth import UnfitDraw
from benchmarks.telemetry.faults import inject_faults, judge
from benchmarks.telemetry.study import FIRST_SEED, run_study
from benchmarks.writer import INTACT, Section, make_parser, publish_results
from selfheal.mujoco_files import silence_mujoco
from selfheal.recording import Recording, load_model, read
from selfheal.telemetry import check_telemetry

# clean recordings: seeds of each robot of the sealed benchmark, and names of others
GROUPS = {
    "known": (
        (7000, 8104, 8203),
        ("gantry_null", "pen_null_drift", "rover_null", "sled_null", "arm_gain"),
    ),
    "new": ((8311, 8312, 8313), ()),
}
CONCEALED = 7500  # first seed of those with concealed physics
DEVICES = (
    ("xl330/model.xml", "xl330/train.h5"),
    ("xl330/servo/model_kp200.xml", "xl330/servo/train_kp200.h5"),
    ("xl330/model_released.xml", "xl330/train_released.h5"),
    ("double_pendulum_c1/model.xml", "double_pendulum_c1/train.h5"),
    ("cube_toss/model.xml", "cube_toss/train.h5"),
    ("starfish_2006/model.xml", "starfish_2006/intact.h5"),
)
Row = tuple[str, mujoco.MjModel, Recording]


def list_clean(group: str) -> Iterator[Row]:
    """Names, models and recordings of robots that are as their models say."""
    seeds, written = GROUPS[group]
    for robot in ROBOTS:
        for seed in seeds:
            yield _list_row(f"{robot} {seed}", make_case("null", seed, robots=[robot]))
    for name in written:
        yield _list_row(name, others.make_case(name))


def _list_row(name: str, case: Case) -> Row:
    return name, case.robot.model, case.train


def list_concealed(count: int) -> Iterator[Row]:
    """Robots with one or two effects that their models lack."""
    for seed in range(CONCEALED, CONCEALED + count):
        try:
            case = make_case("double" if seed % 3 == 0 else "single", seed)
        except UnfitDraw:
            continue
        effects = ", ".join(e["effect"] for e in case.key["effects"])
        yield _list_row(f"{case.name} {case.robot.name}: {effects}", case)
    for name in others.OTHER_CASES:
        if all(name not in written for _, written in GROUPS.values()):
            yield _list_row(name, others.make_case(name))


def list_devices() -> Iterator[Row]:
    """Real robots."""
    folder = INTACT.parents[1]
    for model, file in DEVICES:
        yield file, load_model(folder / model), read(folder / file)


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


def check_injected(group: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Alarms of a group's clean recordings, and what was told of each fault."""
    clean: list[dict[str, Any]] = []
    injected: list[dict[str, Any]] = []
    for number, row in enumerate(list_clean(group)):
        name, model, recording = row
        clean += _check_rows(iter([row]))
        rng = np.random.default_rng(number)
        for one in inject_faults(recording, model, rng):
            faults = check_telemetry(one.recording, one.model)
            found, located, others = judge(one.kinds, one.columns, faults)
            said = [f"{f.kind} {', '.join(f.columns)}" for f in others]
            injected.append({"group": group, "name": name, "fault": one.name,
                             "found": found, "located": bool(located),
                             "others": said})  # fmt: skip
            if not located:
                print(name, one.name, said, file=sys.stderr)
    return clean, injected


def run(concealed: int, drawn: int, first: int) -> dict[str, Any]:
    """All checks, as numbers.

    Args:
        concealed: seeds of robots with other physics than their models.
        drawn: robots that are drawn, with a fault and without.
    """
    every = {group: check_injected(group) for group in GROUPS}
    return {
        **{f"clean, {group}": clean for group, (clean, _) in every.items()},
        "injected": [one for _, injected in every.values() for one in injected],
        "concealed": _check_rows(list_concealed(concealed)),
        "devices": _check_rows(list_devices()),
        "drawn": run_study(drawn, first),
    }


def make_sections(data: dict[str, Any]) -> list[Section]:
    """The page."""
    injected = data["injected"]
    quiet = [key for key in data if key not in ("injected", "drawn")]
    rows = [
        [fault, *_count_faults(injected, fault)]
        for fault in dict.fromkeys(r["fault"] for r in injected)
    ]
    missed = [
        [r["name"], r["fault"], "found elsewhere" if r["found"] else "not found",
         "; ".join(r["others"])]
        for r in injected if not r["located"]
    ]  # fmt: skip
    alarms = [
        [key, len(data[key]), sum(bool(r["alarms"]) for r in data[key]),
         f"{max(r['seconds'] for r in data[key]):.1f}"]
        for key in quiet
    ]  # fmt: skip
    false = [
        [r["name"], "; ".join(r["alarms"])]
        for key in quiet
        for r in data[key] if r["alarms"]
    ]  # fmt: skip
    found = [
        *_describe_drawn(data["drawn"]),
        Section(
            "Faults put into clean recordings",
            "One fault each. Located: the columns that are told, or those told to be "
            "as likely, have the fault. Known: the check and its constants were made "
            "with these recordings. New: no threshold was changed after they were "
            "seen.",
            (
                "fault",
                *(
                    f"{g}: {w}"
                    for g in GROUPS
                    for w in ("recordings", "found", "located")
                ),
            ),
            rows,
        ),
        Section(
            "Alarms where there is no fault",
            "clean: the recordings above as they are. concealed: one or two effects "
            "that the model lacks. devices: real robots.",
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


def _describe_drawn(drawn: dict[str, list[dict[str, Any]]]) -> list[Section]:
    """What was said of drawn robots, by fault, and each that went wrong."""
    rows = []
    for name in (*dict.fromkeys(r["fault"] for r in drawn["faulty"]), "all"):
        of = [r for r in drawn["faulty"] if name in (r["fault"], "all")]
        rows.append([name, len(of), *(
            sum(bool(r[key]) for r in of) for key in ("told", "others", "left")
        )])  # fmt: skip
    clean = drawn["clean"]
    rows.append(["none", len(clean), "", sum(bool(r["others"]) for r in clean), ""])
    wrong = [
        [r["seed"], r["fault"], "yes" if r["told"] else "no", "; ".join(r["others"]),
         "; ".join(r["left"])]
        for r in (*drawn["faulty"], *clean)
        if r["others"] or r["left"] or not (r["told"] or r in clean)
    ]  # fmt: skip
    found = [Section(
        "Drawn robots and set-ups",
        "Chains of two to six hinges with a fault, and others without. Told: the kind "
        "and the columns. Left: faults that are told once a script has done what the "
        "check says, by the log's map, the model's file and selfheal model prepare.",
        ("fault", "robots", "told", "with another alarm", "with a fault left"), rows,
    )]  # fmt: skip
    if wrong:
        head = ("seed", "fault", "told", "other faults told", "left")
        found.append(Section("Drawn robots that went wrong", "Each.", head, wrong))
    return found


def _count_faults(injected: list[dict[str, Any]], fault: str) -> list[int]:
    """Recordings, found and located of each group."""
    found = []
    for group in GROUPS:
        rows = [r for r in injected if (r["group"], r["fault"]) == (group, fault)]
        found += [len(rows), *(sum(r[k] for r in rows) for k in ("found", "located"))]
    return found


def main() -> int:
    """Read the command line, run, write the page."""
    line = make_parser(__doc__ or "")
    line.add_argument("--concealed", type=int, default=60, help="seeds tried")
    line.add_argument("--drawn", type=int, default=121, help="robots drawn")
    line.add_argument("--first", type=int, default=FIRST_SEED, help="seed of these")
    options = line.parse_args()
    silence_mujoco()
    root: Path = options.root
    data = run(options.concealed, options.drawn, options.first)
    title = "Faults of logs that the telemetry check finds"
    publish_results(root, "telemetry", title, make_sections(data), data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
