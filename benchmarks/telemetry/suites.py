"""Suites of the telemetry check: recordings with and without faults, checked."""

import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.hidden import others, sealed
from benchmarks.hidden.case import Case
from benchmarks.hidden.robots.shapes import ROBOTS
from benchmarks.hidden.truth import UnfitDraw
from benchmarks.suites import KeyedRuns, Record, Suites
from benchmarks.telemetry.correct import Files, correct, write_setup
from benchmarks.telemetry.drawn_robots import DrawnRobot, draw_robot
from benchmarks.telemetry.faults import inject_faults, judge
from benchmarks.telemetry.setups import Setup, draw_setup
from benchmarks.writer import INTACT
from selfheal.mujoco_files import silence_mujoco
from selfheal.recording import Recording, load_model, read
from selfheal.telemetry import Fault, check_telemetry

Log = tuple[mujoco.MjModel, Recording]
# clean recordings: seeds of each robot of the sealed benchmark, and names of others
GROUPS = {
    "known": (
        (7000, 8104, 8203),
        ("gantry_null", "pen_null_drift", "rover_null", "sled_null", "arm_gain"),
    ),
    "new": ((8311, 8312, 8313), ()),
}
CONCEALED = 7500  # first seed of those with concealed physics
DRAWN = 700_000  # first seed of drawn robots; development used others
DEVICES = (
    ("xl330/model.xml", "xl330/train.h5"),
    ("xl330/servo/model_kp200.xml", "xl330/servo/train_kp200.h5"),
    ("xl330/model_released.xml", "xl330/train_released.h5"),
    ("double_pendulum_c1/model.xml", "double_pendulum_c1/train.h5"),
    ("cube_toss/model.xml", "cube_toss/train.h5"),
    ("starfish_2006/model.xml", "starfish_2006/intact.h5"),
)


def _read_case(make: Callable[[], Case]) -> Log:
    silence_mujoco()
    case = make()
    return case.robot.model, case.train


def list_clean(group: str) -> Iterator[tuple[str, Callable[[], Log]]]:
    """Names and makers of logs of robots that are as their models say."""
    seeds, written = GROUPS[group]
    for robot in ROBOTS:
        for seed in seeds:
            make = partial(sealed.make_case, "null", seed, robots=[robot])
            yield f"{robot} {seed}", partial(_read_case, make)
    for name in written:
        yield name, partial(_read_case, partial(others.make_case, name))


def list_injected(count: int, *, group: str) -> KeyedRuns:
    """Clean logs of a group, checked as they are and with one fault each."""
    for number, (name, make) in enumerate(list_clean(group)):
        yield name, partial(_inject, make, number)


def list_concealed(count: int) -> KeyedRuns:
    """Robots with one or two effects that their models lack."""
    for seed in range(CONCEALED, CONCEALED + count):
        kind = "double" if seed % 3 == 0 else "single"
        make = partial(sealed.make_case, kind, seed)
        yield sealed.name_case(seed), partial(_check, partial(_read_case, make))
    known = {name for _, written in GROUPS.values() for name in written}
    for name in others.OTHER_CASES:
        if name not in known:
            read_case = partial(_read_case, partial(others.make_case, name))
            yield name, partial(_check, read_case)


def list_devices(count: int) -> KeyedRuns:
    """Real robots."""
    for model, file in DEVICES:
        yield file, partial(_check, partial(_read_device, model, file))


def _read_device(model: str, file: str) -> Log:
    folder = INTACT.parents[1]
    return load_model(folder / model), read(folder / file)


def _check(make: Callable[[], Log]) -> Record:
    """Alarms of a log that should give none; nothing where there is no such log."""
    try:
        model, recording = make()
    except UnfitDraw:
        return {}
    return _list_alarms(model, recording)


def _list_alarms(model: mujoco.MjModel, recording: Recording) -> Record:
    start = time.perf_counter()
    faults = check_telemetry(recording, model)
    seconds = time.perf_counter() - start
    return {"seconds": seconds, "alarms": [f"{f.kind}: {f.seen}" for f in faults]}


def _inject(make: Callable[[], Log], number: int) -> Record:
    """Alarms of a clean log, and what was reported of each fault."""
    model, recording = make()
    found = []
    for one in inject_faults(recording, model, np.random.default_rng(number)):
        faults = check_telemetry(one.recording, one.model)
        is_found, located, rest = judge(one.kinds, one.columns, faults)
        said = [f"{f.kind} {', '.join(f.columns)}" for f in rest]
        hit = {"found": is_found, "located": bool(located)}
        found.append({"fault": one.name, **hit, "others": said})
    return {**_list_alarms(model, recording), "injected": found}


def list_drawn(count: int) -> KeyedRuns:
    """Drawn set-ups with a fault, and as many without."""
    for n in range(count):
        first = DRAWN + 1000 * n
        yield f"{first}", partial(_try_faulty, n, first)
        yield f"{first + 500}", partial(_try_clean, first + 500)


def _try_faulty(number: int, seed: int) -> Record:
    """The first robot from a seed on that can have the fault of a number."""
    while (setup := draw_setup(number, robot := draw_robot(seed))) is None:
        seed += 1
    return _try_setup(setup, robot)


def _try_clean(seed: int) -> Record:
    robot = draw_robot(seed)
    return _try_setup(Setup("", (), frozenset(), robot.recording, robot.xml), robot)


def _try_setup(setup: Setup, robot: DrawnRobot) -> Record:
    """What a check says of a set-up, and then of what it says was done."""
    silence_mujoco()
    with tempfile.TemporaryDirectory() as folder:
        files = write_setup(setup, Path(folder), robot.gains)
        faults, left = _check_twice(files)
    _, located, others = judge(setup.kinds, setup.columns, faults)
    return {
        "fault": setup.name,
        "told": bool(located),
        "others": [f.describe() for f in others],
        "left": [f.describe() for f in left],
    }


def _check_twice(files: Files) -> tuple[list[Fault], list[Fault]]:
    """Faults, and those that are left after what they say was done."""
    recording, model = files.import_recording()
    faults = check_telemetry(recording, model)
    if not faults:
        return faults, []
    correct(files, faults, recording)
    return faults, check_telemetry(*files.import_recording())


SUITES: Suites = {
    "drawn": (list_drawn, 121),
    "known": (partial(list_injected, group="known"), 0),
    "new": (partial(list_injected, group="new"), 0),
    "concealed": (list_concealed, 60),
    "devices": (list_devices, 0),
}
