"""One refit, by `selfheal.diagnosis` and by `mujoco.sysid`: the same values and data.

    pip install 'mujoco[sysid]'
    python -m benchmarks.performance.sysid [--joints 1 7 29] [--robots 3]

Takes hanging chains whose damping, armature, gains and masses are wrong, gives
docs/results/sysid.md. Run it on an otherwise idle machine.
"""

import logging
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid

from benchmarks.performance.diagnose_time import write_arm
from benchmarks.writer import Section, make_parser, publish_results
from selfheal.diagnosis.effects.base import Term
from selfheal.diagnosis.effects.nominal import (
    MASS_BOUND,
    OTHER_BOUND,
    build_nominal_terms,
)
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.marginalization import marginalize_initial_states
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.selection.search_state import reweight_and_fit
from selfheal.diagnosis.simulation import score
from selfheal.diagnosis.simulation.dataset import (
    LONG_SEGMENTS,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
    prepare_dataset,
)
from selfheal.diagnosis.simulation.score import cut_replay_segments
from selfheal.recording import Episode, Recording, Signal

WRONG = 0.8  # of that reach: the largest error of a value; chosen
EPISODES, HELD, SECONDS, NOISE = 6, 2, 5.0, 1e-3  # [s], [rad]; chosen


@dataclass(frozen=True)
class HiddenArm:
    """A hidden arm and what it did.

    Attributes:
        joints: how many it has.
        model: file of the wrong model.
        recording: of the right one; the last HELD episodes are held out.
        truth: factors of the values that are refitted.
    """

    joints: int
    model: Path
    recording: Recording
    truth: np.ndarray

    @property
    def reach(self) -> dict[str, float]:
        """What is refitted, and how far a careful user lets it move [1]."""
        return list_values(self.joints)


def list_values(joints: int) -> dict[str, float]:
    """Values of a chain that are refitted, and how far each may move [1]."""
    numbers = range(1, joints + 1)
    return {
        **{f"joint:j{k}/damping": OTHER_BOUND for k in numbers},
        **{f"joint:j{k}/armature": OTHER_BOUND for k in numbers},
        **{f"actuator:m{k}/kp": OTHER_BOUND for k in numbers},
        **{f"body:link{k}/mass": MASS_BOUND for k in numbers},
    }


def scale_value(model: mujoco.MjModel, name: str, factor: float) -> None:
    """Multiply one of the refitted values in a compiled model.

    Args:
        name: key of `list_values`.
        factor: [1].
    """
    target, _, field = name.partition("/")
    kind, _, thing = target.partition(":")
    if kind == "joint":
        getattr(model, f"dof_{field}")[model.joint(thing).dofadr[0]] *= factor
    elif kind == "body":
        model.body(thing).mass *= factor
        model.body(thing).inertia *= factor
    else:
        model.actuator(thing).gainprm[0] *= factor
        model.actuator(thing).biasprm[1] *= factor


def make_hidden_arm(folder: Path, joints: int, seed: int) -> HiddenArm:
    """An arm whose stated values are wrong, moving to slow sines and steps."""
    rng = np.random.default_rng(seed)
    values = list_values(joints)
    reach = np.array([*values.values()])
    truth = 1 + WRONG * reach * rng.uniform(-1, 1, len(values))
    xml = write_arm(joints)
    model = mujoco.MjModel.from_xml_string(xml)
    for name, factor in zip(values, truth, strict=True):
        scale_value(model, name, factor)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    path = folder / f"{seed}.xml"
    path.write_text(xml)
    names = [f"{k:03d}" for k in range(EPISODES)]
    episodes = {name: _record_episode(model, rng) for name in names}
    return HiddenArm(joints, path, Recording(episodes, file=f"{seed}.h5"), truth)


def _record_episode(model: mujoco.MjModel, rng: np.random.Generator) -> Episode:
    """Commands and readings at every time step, so that nobody has to interpolate."""
    t = np.arange(0, SECONDS, model.opt.timestep)
    joints = model.nv
    f, p = rng.uniform(0.3, 1.5, (joints, 2)), rng.uniform(0, 6, (joints, 3))
    ctrl = np.stack([
        0.4 * np.sin(2 * np.pi * f[j, 0] * t + p[j, 0])
        + 0.3 * np.sin(2 * np.pi * f[j, 1] * t + p[j, 1])
        + 0.3 * np.sign(np.sin(4 * t + p[j, 2]))
        for j in range(joints)
    ], axis=1)  # fmt: skip
    data = mujoco.MjData(model)
    data.qpos[:] = start = 0.3 * rng.normal(size=joints)
    readings = np.empty((len(t), joints))
    for k, u in enumerate(ctrl):
        readings[k], data.ctrl[:] = data.qpos, u
        mujoco.mj_step(model, data)
    readings += NOISE * rng.normal(size=readings.shape)
    signals = {
        name: Signal(readings[:, j], "joint_position", name, "rad")
        for j, name in enumerate(_name_joints(joints))
    }
    servos = tuple(f"m{k}" for k in range(1, joints + 1))
    return Episode(t, ctrl, servos, signals, start, np.zeros(joints))


def _name_joints(joints: int) -> list[str]:
    """Names of a chain's joints, and of their signals."""
    return [f"j{k}" for k in range(1, joints + 1)]


def name_held_out(robot: HiddenArm) -> list[str]:
    """Names of the episodes that are held out."""
    return [*robot.recording.episodes][-HELD:]


def select_terms(case: Dataset, robot: HiddenArm) -> list[Term]:
    """The case's stated terms that are refitted, in the order of `list_values`."""
    terms = {t.targets[0]: t for t in build_nominal_terms(case.robot)}
    return [terms[name] for name in robot.reach]


def fit_with_selfheal(robot: HiddenArm, seconds: float | None) -> np.ndarray:
    """Factors of all values by the nominal fit of `diagnose`, weighted once anew.

    Args:
        seconds: [s] of the segments; None: whole episodes. Segments begin where
            readings say, and their initial states are marginalized.
    """
    case = prepare_dataset(robot.model, [robot.recording], name_held_out(robot))
    world, terms = case.training, select_terms(case, robot)
    pieces = (
        cut_readable_segments(world, seconds) if seconds else cut_replay_segments(world)
    )
    apart = world.simulate([], np.zeros((1, 0)), pieces)[0] - pieces.readings
    sigma = np.sqrt(np.nanmean(apart**2, axis=0))
    problem = Problem(world, pieces, sigma, centered=False)  # as MuJoCo steps
    begin = np.ones(len(terms))
    if seconds:
        problem = marginalize_initial_states(problem, terms, begin)
    fit = fit_parameters(problem, terms, begin)
    return reweight_and_fit(fit, 8).values


def fit_with_sysid(robot: HiddenArm) -> np.ndarray:
    """Factors of all values by `mujoco.sysid` with its defaults."""
    logging.getLogger("absl").setLevel(logging.ERROR)  # "data dimension does not match"
    spec = mujoco.MjSpec.from_file(str(robot.model))
    model = spec.compile()
    params = sysid.ParameterDict()
    for name, reach in robot.reach.items():
        params.add(sysid.Parameter(name, 1.0, 1 - reach, 1 + reach,
                                   modifier=_make_modifier(model, name)))  # fmt: skip
    starts, controls, sensors, held = [], [], [], name_held_out(robot)
    joints = _name_joints(robot.joints)
    names = [(j, sysid.SignalType.MjStateQPos) for j in joints]
    for key, episode in robot.recording.episodes.items():
        if key not in held:
            read = np.stack([episode.signals[j].values for j in joints], axis=1)
            starts.append(
                sysid.create_initial_state(model, episode.qpos0, episode.qvel0)
            )
            controls.append(sysid.TimeSeries(episode.time, episode.ctrl))
            sensors.append(
                sysid.TimeSeries.from_names(episode.time, read, model, names)
            )
    keys = [key for key in robot.recording.episodes if key not in held]
    runs = sysid.ModelSequences(
        "arm", spec, keys, starts, controls, sensors, allow_missing_sensors=True
    )
    residual = sysid.build_residual_fn(models_sequences=[runs])
    with redirect_stdout(StringIO()):  # it tells every iteration
        found, _ = sysid.optimize(params, residual, verbose=False)
    return found.as_vector()


def _make_modifier(given: mujoco.MjModel, name: str) -> Callable[[Any, Any], None]:
    """What writes a factor of one of the values into an MjSpec."""
    target, _, field = name.partition("/")
    kind, _, thing = target.partition(":")

    def write(spec: mujoco.MjSpec, parameter: Any) -> None:
        factor = parameter.value[0]
        if kind == "joint":
            value = getattr(given, f"dof_{field}")[given.joint(thing).dofadr[0]]
            joint = spec.joint(thing)
            if field == "damping":
                joint.damping[0] = factor * value
            else:
                joint.armature = factor * value
        elif kind == "body":
            spec.body(thing).mass = factor * given.body(thing).mass[0]
            spec.body(thing).inertia = factor * given.body(thing).inertia
        else:
            sysid.apply_pgain(spec, thing, factor * given.actuator(thing).gainprm[0])

    return write


def score_values(robot: HiddenArm, values: np.ndarray) -> float:
    """The contract's score of factors of all values on the held-out episodes."""
    case = prepare_dataset(robot.model, [robot.recording], name_held_out(robot))
    pieces = cut_replay_segments(case.held_out)
    squares = score.sum_squared_errors(
        case.held_out, pieces, select_terms(case, robot), values
    )
    return score.compute_score(
        case.held_out, squares, score.count_readings(case.held_out, pieces)
    )


THEIRS = "mujoco.sysid, defaults"
METHODS: dict[str, Callable[[HiddenArm], np.ndarray]] = {
    "selfheal, whole episodes": partial(fit_with_selfheal, seconds=None),
    "selfheal, pieces of 2 s": partial(fit_with_selfheal, seconds=LONG_SEGMENTS[0]),
    "selfheal, pieces of 0.5 s": partial(fit_with_selfheal, seconds=SHORT_SEGMENT),
    THEIRS: fit_with_sysid,
}


def measure_methods(joints: int, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Results of all methods on the same robots, in turn, forwards and backwards."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for method in METHODS.values():  # the first call of each loads and compiles
            method(make_hidden_arm(Path(folder), 1, 0))
        for n, seed in enumerate(seeds):
            hidden = make_hidden_arm(Path(folder), joints, seed)
            row: dict[str, Any] = {
                "joints": joints,
                "seed": seed,
                "given": score_values(hidden, np.ones(len(hidden.reach))),
                "truth": score_values(hidden, hidden.truth),
            }
            for name in [*METHODS][:: -1 if n % 2 else 1]:
                row[name] = _try_method(METHODS[name], hidden)
            rows.append(row)
    return rows


def _try_method(
    method: Callable[[HiddenArm], np.ndarray], hidden: HiddenArm
) -> dict[str, Any]:
    """What a method found, how long it took, and how good it is."""
    start, used = time.perf_counter(), time.process_time()
    values = method(hidden)
    seconds, cpu = time.perf_counter() - start, time.process_time() - used
    off = float(np.sqrt(np.mean((values / hidden.truth - 1) ** 2)))
    return {
        "seconds": seconds,
        "cpu": cpu,
        "score": score_values(hidden, values),
        "off": off,
        "factors": values.tolist(),
    }


def make_section(rows: list[dict[str, Any]]) -> Section:
    """The section with the table of all methods."""
    shown = []
    for name in METHODS:
        wall, cpu, error, off = (_collect_figures(rows, name, k) for k in KEYS)
        against = [
            _collect_figures(rows, name, k) / _collect_figures(rows, THEIRS, k)
            for k in KEYS[:3]
        ]
        shown.append(
            [name, f"{np.median(wall):.2f} s, {np.median(cpu):.2f} s",
             f"{np.median(against[0]):.2f}, {np.median(against[1]):.2f}",
             f"{np.median(error):.5f}",
             f"{np.median(against[2]):.4f} ({against[2].min():.4f} to "
             f"{against[2].max():.4f})", f"{100 * np.median(off):.0f} %"]
        )  # fmt: skip
    header = ["method", "wall, CPU time", "each : theirs", "held-out error",
              "error : theirs (range)", "values off by"]  # fmt: skip
    joints = rows[0]["joints"]
    title = f"{joints} joints, {len(list_values(joints))} values"
    return Section(title, _describe_comparison(rows), header, shown)


KEYS = ("seconds", "cpu", "score", "off")


def _collect_figures(rows: list[dict[str, Any]], method: str, key: str) -> np.ndarray:
    return np.array([row[method][key] for row in rows])


def _describe_comparison(rows: list[dict[str, Any]]) -> str:
    """What was compared."""
    given, truth = (np.median([row[k] for row in rows]) for k in ("given", "truth"))
    most = [f"{100 * WRONG * reach:.0f} %" for reach in (OTHER_BOUND, MASS_BOUND)]
    return (
        f"{len(rows)} hanging chains with position servos. Wrong by up to {most[0]}: "
        f"damping, armature and kp of each joint; by up to {most[1]}: all masses. "
        f"{EPISODES} episodes of {SECONDS:g} s, read at every time step (2 ms) with "
        f"{1000 * NOISE:g} mrad of noise, {HELD} of them held out; initial states "
        "given. All fit the same values within the same bounds, from a recording in "
        "memory to values, taking turns; medians. Error: the contract's score on the "
        f"held-out episodes, {given:.4f} for the given model, {truth:.5f} for the true "
        "one (noise). Off: root mean square of the values' relative errors."
    )


def main() -> None:
    """Fit all robots by all methods and publish."""
    line = make_parser(__doc__ or "")
    line.add_argument("--joints", type=int, nargs="+", default=[1, 7, 29])
    line.add_argument("--robots", type=int, default=3, help="of each number of joints")
    options = line.parse_args()
    if not hasattr(sysid, "optimize"):
        raise SystemExit("mujoco.sysid lacks a library: pip install 'mujoco[sysid]'")
    seeds = range(1, options.robots + 1)
    tables = [measure_methods(joints, seeds) for joints in options.joints]
    sections = [
        Section(
            "What is compared",
            "`mujoco.sysid` replays whole episodes from their initial state, and so "
            "does the first row; `diagnose` searches in pieces of 0.5 s and fits its "
            "result in pieces of 2 s, which need no given state. selfheal also "
            "believes the given values, to half of their bounds: that costs a little "
            "error where readings say nothing, and brings the values nearer to the "
            "truth.",
        ),
        *map(make_section, tables),
    ]
    title = "One refit against `mujoco.sysid`"
    rows = [row for table in tables for row in table]
    publish_results(options.root, "sysid", title, sections, {"robots": rows})


if __name__ == "__main__":
    main()
