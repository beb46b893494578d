"""How long one diagnosis takes and how much memory, and how both grow with joints.

    python -m benchmarks.performance.diagnose_time [--joints 1 7] [--shapes chain tree]

Sixty seconds of log of one chain, or of a tree of legs of three joints each. The given
model lacks dry friction at one joint; of a `load`, which is a model wrong in kind, it
lacks a mass that swings below the last link of a chain. Makes
its part of docs/results. Run it on an otherwise idle machine.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.suites import Record
from benchmarks.writer import make_parser, publish_page
from selfheal.recording import Episode, Recording, Signal, write

EPISODES, SECONDS, RATE = 10, 6.0, 100  # episodes, [s] of each, [Hz] of their samples
STEP, FINER = 0.002, 4  # [s] of the given model's step; the hidden one's are finer
NOISE, FRICTION = 5e-4, 0.3  # [rad]; of the hidden friction, of the load
OFF = {"mass": 0.08, "damping": 0.15}  # shares by which stated values are wrong
LENGTH, MASS = 0.2, 0.3  # [m], [kg] of each link
TARGETS = {"chain 1": "30 s", "chain 7": "60 s", "load 7": "240 s"}
SHAPES = {"chain": 1000, "tree": 3, "load": 1000}  # joints of a leg, at most
KINDS = {
    "chain": "Chains",
    "tree": f"Legs of {SHAPES['tree']} joints",
    "load": f"Chains with {MASS:g} kg that swing {LENGTH:g} m below the last link",
}
GROWS_FROM = 3  # joints; with fewer, start-up and report are much of the time


def find_load(joints: int, leg: int, k: int) -> float:
    """[N m] weight below a joint, one link's length to the side of it.

    Args:
        leg: joints of each leg.
        k: number of the joint, from 1.
    """
    last = min(joints, (k - 1) // leg * leg + leg)
    return MASS * 9.81 * LENGTH * (last - k + 1)


def write_arm(joints: int, leg: int = SHAPES["chain"]) -> str:
    """MJCF of hanging legs of some joints each, which turn about y and z in turns."""
    legs, bodies, servos = "", "", ""
    for k in range(joints, 0, -1):
        axis = "0 1 0" if k % 2 else "0 0 1"
        load, is_first = find_load(joints, leg, k), (k - 1) % leg == 0
        bodies = f"""<body name="link{k}" pos="0 0 {0 if is_first else -LENGTH}">
<joint name="j{k}" axis="{axis}" damping="{0.05 * load:.4g}" armature="0.01"/>
<inertial pos="0.02 0 {-LENGTH / 2}" mass="{MASS}" diaginertia="1e-3 1e-3 1e-4"/>
{bodies}</body>
"""
        if is_first:
            legs, bodies = bodies + legs, ""
        servo = f'<position name="m{k}" joint="j{k}" kp="{8 * load:.4g}" kv="0.2"/>\n'
        servos = servo + servos
    return f"""<mujoco>
<compiler angle="radian"/>
<option timestep="{STEP}" integrator="implicitfast"/>
<worldbody>
{legs}</worldbody>
<actuator>
{servos}</actuator>
</mujoco>
"""


def compile_hidden_arm(
    joints: int, shape: str, rng: np.random.Generator
) -> mujoco.MjModel:
    """Model of the recorded arm: finer steps, wrong values, friction or a load."""
    leg = SHAPES[shape]
    spec = mujoco.MjSpec.from_string(write_arm(joints, leg))
    spec.option.timestep = STEP / FINER
    for body in spec.bodies[1:]:
        body.mass *= 1 + OFF["mass"] * rng.uniform(-1, 1)
    for joint in spec.joints:
        joint.damping[0] *= 1 + OFF["damping"] * rng.uniform(-1, 1)
    if shape == "load":
        hung = spec.body(f"link{joints}").add_body(pos=[0, 0, -LENGTH])
        hung.add_joint(axis=[1, 0, 0], damping=[1e-3, 0, 0])
        hung.add_geom(size=[0.02, 0, 0], pos=[0, 0, -LENGTH], mass=MASS)
        return spec.compile()
    k = (joints + 1) // 2
    spec.joint(f"j{k}").frictionloss = FRICTION * find_load(joints, leg, k)
    return spec.compile()


def record_arm(joints: int, shape: str, seed: int) -> Recording:
    """Recording of the hidden arm while it follows sines and steps."""
    rng = np.random.default_rng(seed)
    model = compile_hidden_arm(joints, shape, rng)
    episodes = {f"{n:03d}": _record_episode(model, rng) for n in range(EPISODES)}
    return Recording(episodes, file="recording.h5")


def _record_episode(model: mujoco.MjModel, rng: np.random.Generator) -> Episode:
    each = round(1 / RATE / model.opt.timestep)
    t = np.arange(round(SECONDS * RATE)) / RATE
    f, p = rng.uniform(0.2, 1.0, (2, model.nu)), rng.uniform(0, 6.3, (2, model.nu))
    ctrl = 0.5 * np.sin(2 * np.pi * f[0] * t[:, None] + p[0])
    ctrl += 0.2 * np.sign(np.sin(2 * np.pi * f[1] * t[:, None] + p[1]))
    data, readings = mujoco.MjData(model), np.empty((len(t), model.nu))
    for row, u in enumerate(ctrl):
        readings[row], data.ctrl[:] = data.qpos[: model.nu], u
        mujoco.mj_step(model, data, each)
    readings += NOISE * rng.normal(size=readings.shape)
    signals = {
        f"j{k + 1}_position": Signal(
            readings[:, k], "joint_position", f"j{k + 1}", "rad"
        )
        for k in range(model.nu)
    }
    return Episode(t, ctrl, tuple(f"m{k + 1}" for k in range(model.nu)), signals)


def time_plain_mujoco(model: mujoco.MjModel, seconds: float) -> float:
    """Wall time [s] in which MuJoCo alone simulates so long a log, on one core."""
    data = mujoco.MjData(model)
    start = time.perf_counter()
    mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
    return time.perf_counter() - start


def run_command(room: Path) -> Record:
    """Diagnose model.xml and recording.h5 of a folder: time, memory and findings."""
    words = ["selfheal", "diagnose", "model.xml", "recording.h5", "--out", "d"]
    start = time.perf_counter()
    process = subprocess.Popen(words, cwd=room, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    if status:
        sys.exit(f"{' '.join(words)}: exit {os.waitstatus_to_exitcode(status)}")
    said = json.loads((room / "d" / "diagnosis.json").read_text())
    return {
        "seconds": seconds,
        "cpu": usage.ru_utime + usage.ru_stime,
        "megabytes": usage.ru_maxrss / 1024,
        "verdict": said["verdict"],
        "named": [f"{f['effect']} {f['target']}" for f in said["findings"]],
    }


def measure_diagnosis(joints: int, shape: str, seed: int) -> Record:
    """Time, memory and findings of one diagnosis by the command."""
    model = write_arm(joints, SHAPES[shape])
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        (room / "model.xml").write_text(model)
        write(record_arm(joints, shape, seed), room / "recording.h5")
        run = run_command(room)
    given = mujoco.MjModel.from_xml_string(model)
    plain = time_plain_mujoco(given, EPISODES * SECONDS)
    return {"joints": joints, "shape": shape, "plain": plain, **run}


def describe_growth(rows: list[Record]) -> str:
    """The exponent of time in the number of joints, by least squares of logarithms."""
    rows = [r for r in rows if r["joints"] >= GROWS_FROM]
    if len(rows) < 3:
        return ""
    joints, seconds = (np.log([r[k] for r in rows]) for k in ("joints", "seconds"))
    exponent = np.polyfit(joints, seconds, 1)[0]
    return f" From {GROWS_FROM} joints on, time grows as joints to the {exponent:.2f}."


def main() -> None:
    """Diagnose each arm once and publish."""
    line = make_parser(__doc__ or "")
    line.add_argument("--joints", type=int, nargs="+", default=[1, 7])
    line.add_argument("--shapes", nargs="+", choices=list(SHAPES), default=["chain"])
    line.add_argument("--seed", type=int, default=0)
    options = line.parse_args()
    tables = {
        shape: [measure_diagnosis(j, shape, options.seed) for j in options.joints]
        for shape in options.shapes
    }
    growth = {shape: describe_growth(rows) for shape, rows in tables.items()}
    figures = {"tables": tables, "kinds": KINDS, "targets": TARGETS, "growth": growth}
    page = Path(__file__).with_name("diagnose_time.md")
    publish_page(options.root, "diagnose-time", page, figures)


if __name__ == "__main__":
    main()
