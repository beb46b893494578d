"""Batches that MuJoCo runs: takes models, starts and commands, gives true signals."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.base import StepState, Term, implements
from .model_variants import ModelVariant, read_model_field
from .sensors import SensorReader

GROUP = 64  # simulations, that are worth a thread where effects act; chosen


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """What n simulations of each window take to be true.

    Attributes:
        plant: with the joints that the terms add.
        models: (n) compiled.
        terms: of all.
        values: (n, P).
        shares: the same, by term.
        reads: of a signal: bias (n, width), gain, delay, step (n).
        centered: as `World.simulate` has it.
    """

    variant: ModelVariant
    models: Sequence["mujoco.MjModel"]
    terms: Sequence[Term]
    values: Floats
    term_values: Sequence[Floats]
    reading_changes: Mapping[str, Mapping[str, Floats]]
    centered: bool


def center_damping(model, step: float) -> None:
    """Let damping act on the mean of a step's two velocities, by a change of inertia.

    (M + D h) dv = h (f - D v) takes the later one, M dv = h (f - D v) the earlier one,
    and (M + D h / 2) dv = h (f - D v) their mean.
    """
    motor = np.zeros(model.nv)
    for a in range(model.nu):
        if model.actuator_trntype[a] in (0, 1) and model.actuator_biastype[a] == 1:
            dof = model.jnt_dofadr[model.actuator_trnid[a, 0]]
            motor[dof] -= model.actuator_gear[a, 0] ** 2 * model.actuator_biasprm[a, 2]
    joint = np.array(model.dof_damping).reshape(model.nv, -1)[:, 0]
    explicit = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    if model.opt.integrator != int(mujoco.mjtIntegrator.mjINT_EULER):
        motor = -motor
        joint = -joint
    elif not model.opt.disableflags & explicit:
        joint = -joint
    change = step / 2 * (joint + motor)
    model.dof_armature += np.maximum(change, -0.5 * model.dof_M0)


def simulate_batch(
    hypotheses: Hypotheses,
    segments: Segments,
    start,
    commands: Floats,
    sensors: SensorReader,
    looked_at: np.ndarray,
    *,
    step: float,
) -> Floats:
    """True signals (N, K, C) of n hypotheses in W windows, N = n W.

    Args:
        hypotheses: what is true.
        segments: where each simulation begins.
        start: as `States.begin` gives it.
        commands: (N, K, nu), as they reach the actuators.
        sensors: what is read.
        looked_at: steps at which it is.
        step: of the simulation [s].
    """
    if any(implements(t.effect, "apply_forces") for t in hypotheses.terms):
        return _run_stepwise(
            hypotheses, segments, start, commands, sensors, looked_at, step
        )
    return _run_rollout(hypotheses, start, commands, sensors, looked_at)


def _run_rollout(
    hypotheses: Hypotheses,
    start,
    commands: Floats,
    sensors: SensorReader,
    looked_at: np.ndarray,
) -> Floats:
    """True signals (N, K, C), where MuJoCo alone does all the work."""
    variant = hypotheses.variant
    steps = commands.shape[1]
    rows = np.arange(len(commands))
    threads = min(len(rows), len(os.sched_getaffinity(0)))
    batch = _make_batch(hypotheses, rows, start, threads, alone=True)
    fields = sorted({"qpos", "qvel", *sensors.needs})
    first_velocity = start[1]
    if hypotheses.centered:
        batch.rollout(1, commands[:, :1] if variant.model.nu else None, record=["qvel"])
        first_velocity = _shift_velocity_back(batch, variant, rows, start)
    seen = batch.rollout(steps, commands if variant.model.nu else None, record=fields)
    # a step leaves position and velocity new, and all else as before it
    for name, first in (("qpos", start[0]), ("qvel", first_velocity)):
        seen[name] = np.concatenate([first[:, None], seen[name][:, :-1]], axis=1)
    if hypotheses.centered:
        by_step = {name: values.swapaxes(0, 1) for name, values in seen.items()}
        _restore_whole_steps(
            batch, by_step, commands.swapaxes(0, 1), sensors, looked_at
        )
    predicted = sensors.read_all(seen)
    predicted[_find_diverged(batch)] = np.nan
    return predicted


def _run_stepwise(
    hypotheses: Hypotheses,
    segments: Segments,
    start,
    commands: Floats,
    sensors: SensorReader,
    looked_at: np.ndarray,
    step: float,
) -> Floats:
    """True signals (N, K, C), where effects act at every step."""
    variant, n, w = hypotheses.variant, len(hypotheses.models), len(segments)
    acts = [
        (t.effect, variant.map_place(place), np.repeat(part, w, axis=0))
        for t, part in zip(hypotheses.terms, hypotheses.term_values, strict=True)
        if implements(t.effect, "apply_forces")
        for place in t.places
    ]
    begin = np.tile(segments.first_step * step, n)
    # a thread a group: threads that wait for each other at every step are slow, and
    # those of small groups wait for Python
    threads = int(np.clip(n * w // GROUP, 1, len(os.sched_getaffinity(0))))
    groups = np.array_split(np.arange(n * w), threads)

    def told(rows: np.ndarray) -> Floats:
        return _run_group(
            _make_batch(hypotheses, rows, start, 1, alone=False), variant,
            [(e, p, v[rows]) for e, p, v in acts],
            {a: s[rows] for a, s in start[3].items()}, commands[rows],
            begin[rows], sensors, looked_at, step,
            (rows, start) if hypotheses.centered else None,
        )  # fmt: skip

    if len(groups) == 1:
        return told(groups[0])
    with ThreadPoolExecutor(len(groups)) as pool:
        return np.concatenate(list(pool.map(told, groups)))


def _make_batch(hypotheses: Hypotheses, rows, start, threads: int, *, alone: bool):
    """Simulations `rows` of the N of n models by W windows, at their start.

    Where MuJoCo works alone each has its model; else, for effects to write into, the
    numbers in which the models differ are the batch's.
    """
    from mujoco.batch import Batch

    variant, of = hypotheses.variant, rows // (len(start[0]) // len(hypotheses.models))
    batch = Batch(variant.model, len(rows), nthread=threads)
    if alone:
        batch.set_models([hypotheses.models[i] for i in of])
    else:
        for name, usual in variant.nominal_fields.items():
            values = [read_model_field(m, name) for m in hypotheses.models]
            if any(v.tobytes() != usual for v in values):
                batch.expand(name)[:] = np.stack(values)[of]
    _set_states(batch, variant, rows, start)
    return batch


def _set_states(batch, variant: ModelVariant, rows, start) -> None:
    """Let simulations be at their start."""
    batch.bind("qpos")[:], batch.bind("qvel")[:] = start[0][rows], start[1][rows]
    batch.bind("time")[:] = 0
    if variant.model.na:
        batch.bind("act")[:] = start[2][rows]
    if variant.model.nhistory:
        batch.bind("history")[:] = start[4][rows]


def _shift_velocity_back(batch, variant: ModelVariant, rows, start) -> Floats:
    """Let simulations that made one step start again, by velocities of before."""
    velocity = start[1][rows]
    velocity = velocity - (batch.bind("qvel") - velocity) / 2
    _set_states(batch, variant, rows, start)
    batch.bind("qvel")[:] = velocity
    return velocity


def _restore_whole_steps(
    batch,
    seen: Mapping[str, Floats],
    commands: Floats,
    sensors: SensorReader,
    looked_at,
) -> None:
    """Let velocities, and what sensors tell of them, be those of whole steps.

    A leapfrog has them half a step earlier: at a step they are the mean of two.

    Args:
        batch: that was simulated.
        seen: of each step, fields (K, N, ...); changed.
        commands: (K, N, nu).
        sensors: what is read.
        looked_at: steps at which a body's motion is.
    """
    early = seen["qvel"].copy()
    seen["qvel"][:-1] = (early[:-1] + early[1:]) / 2
    rates, pulls = sensors.rates, sensors.accelerations
    if not ("cvel" in seen or len(rates) or len(pulls)):
        return
    stage = mujoco.mjtStage.mjSTAGE_ACC if len(pulls) else mujoco.mjtStage.mjSTAGE_VEL
    bound = {name: batch.bind(name) for name in ("qpos", "qvel", *sensors.needs)}
    for k in looked_at:
        now = {name: values[k] for name, values in seen.items()}
        bound["qpos"][:] = now["qpos"]
        if len(pulls):  # what the other velocity changes
            if commands.shape[-1]:
                batch.bind("ctrl")[:] = commands[k]
            bound["qvel"][:] = early[k]
            batch.forward(stage=stage)
            now["sensordata"][:, pulls] -= bound["sensordata"][:, pulls]
        bound["qvel"][:] = now["qvel"]
        batch.forward(stage=stage)
        if len(pulls):
            now["sensordata"][:, pulls] += bound["sensordata"][:, pulls]
        if len(rates):
            now["sensordata"][:, rates] = bound["sensordata"][:, rates]
        if "cvel" in now:
            now["cvel"][:] = bound["cvel"]


def _find_diverged(batch) -> np.ndarray:
    """(N) whether MuJoCo warned that a simulation is no longer one."""
    bad = [
        int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{x}"))
        for x in ("QPOS", "QVEL", "QACC")
    ]
    return batch.warning[:, bad, 1].any(axis=1)


def _run_group(
    batch,
    variant: ModelVariant,
    acts,
    sums,
    commands: Floats,
    begin,
    sensors,
    looked_at,
    dt: float,
    again,
) -> Floats:
    """True signals (N, K, C) of simulations in which effects act at every step."""
    fields = sorted({"qpos", "qvel", *sensors.needs})
    bound = {name: batch.bind(name) for name in fields}
    ctrl = batch.bind("ctrl") if variant.model.nu else None
    commands = commands.swapaxes(0, 1).copy()
    forces = _EffectForces(batch, acts, sums, dt)
    if again:
        if ctrl is not None:
            ctrl[:] = commands[0]
        forces.apply(bound["qpos"], bound["qvel"], ctrl, begin)
        batch.step()
        _shift_velocity_back(batch, variant, *again)
        forces.sums = {a: s.copy() for a, s in sums.items()}
    seen = {k: np.empty((len(commands), *v.shape), v.dtype) for k, v in bound.items()}
    of_now = [(seen[k], bound[k]) for k in ("qpos", "qvel")]
    of_step = [(seen[k], bound[k]) for k in fields if k not in ("qpos", "qvel")]
    for k, command in enumerate(commands):
        if ctrl is not None:
            ctrl[:] = command
        for all_of_it, now in of_now:
            all_of_it[k] = now
        forces.apply(bound["qpos"], bound["qvel"], ctrl, begin + k * dt)
        batch.step()
        for all_of_it, now in of_step:
            all_of_it[k] = now
    if again:
        _restore_whole_steps(batch, seen, commands, sensors, looked_at)
    predicted = sensors.read_all(seen)
    predicted[:, _find_diverged(batch)] = np.nan
    return predicted.swapaxes(0, 1)


class _EffectForces:
    """What effects do at each step, written into a batch."""

    def __init__(self, batch, acts, sums: Mapping[int, Floats], step: float) -> None:
        self.acts = acts
        self.applied = batch.bind("qfrc_applied")
        self.torque, self.bias = batch.bind("qfrc_actuator"), batch.bind("qfrc_bias")
        self.loss = batch.expand("dof_frictionloss")
        self.usual_loss = self.loss.copy()
        self.limits: Floats | None = None
        self.sums = {a: s.copy() for a, s in sums.items()}
        self.dt = step
        if any(effect.writes_forcerange for effect, _, _ in acts):
            limited = batch.expand("actuator_forcelimited")
            self.limits = batch.expand("actuator_forcerange")
            wide = np.where(limited[..., None] > 0, self.limits, [-np.inf, np.inf])
            self.usual_limits = np.clip(wide, -1e9, 1e9)
            limited[:] = 1

    def apply(self, qpos, qvel, ctrl, time) -> None:
        """Let every effect act on the state of now."""
        self.applied[:] = 0
        self.loss[:] = self.usual_loss
        if self.limits is not None:
            self.limits[:] = self.usual_limits
        state = StepState(
            time, qpos, qvel, ctrl, self.torque, self.bias, self.applied,
            self.loss, self.limits, self.sums, self.dt,
        )  # fmt: skip
        for effect, place, values in self.acts:
            effect.apply_forces(state, place, values)
