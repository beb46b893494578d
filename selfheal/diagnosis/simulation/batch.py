"""Batches: takes hypotheses and initial states, gives simulations to run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from ...machine import count_cores
from ...recording import find_output
from ...recording.data import Floats
from ..effects.base import Term
from ..effects.commands import CommandGrid
from .model_variants import ModelVariant, read_model_field
from .sensors import SensorReader

if TYPE_CHECKING:
    from mujoco.batch import Batch

# share of the inertia of a motion that centered damping may take away, at most; chosen:
# lighter joints could not be simulated
MAX_INERTIA_LOSS = 0.5


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """What n simulations of each segment take to be true.

    Attributes:
        variant: the given model with the joints that the terms add.
        models: (n) twins of the variant, with each hypothesis's values.
        terms: effects that all hypotheses have.
        term_values: (n, p) of each term.
        reading_changes: by signal and kind of change, (n) or (n, width), as
            `collect_reading_changes` gives them.
        grid: of the steps and their commands. Where it is centered, steps are read as
            a leapfrog's; see `Simulator.simulate`.
    """

    variant: ModelVariant
    models: Sequence["mujoco.MjModel"]
    terms: Sequence[Term]
    term_values: Sequence[Floats]
    reading_changes: Mapping[str, Mapping[str, Floats]]
    grid: CommandGrid


@dataclass(frozen=True, eq=False)
class BatchState:
    """Where N = n W simulations begin, all segments of a hypothesis in a row.

    Attributes:
        qpos: (N, nq) of the variant.
        qvel: (N, nv) of the variant.
        activation: (N, na); None where no actuator has one.
        integral_errors: (N) [rad s] of each servo with an integral, by actuator.
        history: (N, nhistory) buffers of delayed actuators; None where none is.
    """

    qpos: Floats
    qvel: Floats
    activation: Floats | None
    integral_errors: Mapping[int, Floats]
    history: Floats | None


def center_damping(
    model: mujoco.MjModel, step: float, inverse_inertias: Floats
) -> None:
    """Make damping act on the mean of a step's two velocities, by a change of inertia.

    With inertia M, damping D, force f and step h, the damping acts

        by (M + D h) dv = h (f - D v)      on the velocity after the step,
        by M dv = h (f - D v)              on the velocity before the step,
        by (M + D h / 2) dv = h (f - D v)  on their mean.

    MuJoCo does the first to joints under Euler, and to joints and servos under its
    implicit integrators. It does the second to servos under Euler, and to joints where
    the model disables their implicit damping (MuJoCo, numerical integration).

    What is taken from the joints' inertia is limited where joints that move together
    would be left with next to none.

    Args:
        step: of the simulation [s].
        inverse_inertias: (k, nv, nv) of the joints in k poses.
    """
    motor = compute_servo_impedance(model)[:, 1]
    joint = np.array(model.dof_damping).reshape(model.nv, -1)[:, 0]
    explicit = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    if model.opt.integrator != int(mujoco.mjtIntegrator.mjINT_EULER):
        motor = -motor
        joint = -joint
    elif not model.opt.disableflags & explicit:
        joint = -joint
    change = step / 2 * (joint + motor)
    model.dof_armature += np.maximum(change, 0)
    model.dof_armature -= _limit_loss(np.maximum(-change, 0), inverse_inertias)


def compute_servo_impedance(model: mujoco.MjModel) -> Floats:
    """(nv, 2) stiffness and damping of the servos of each joint of a compiled model."""
    out = np.zeros((model.nv, 2))
    for a in range(model.nactuator):
        if model.actuator_trntype[a] in (0, 1) and model.actuator_biastype[a] == 1:
            dof = model.jnt_dofadr[model.actuator_trnid[a, 0]]
            gear = model.actuator_gear[find_output(model, a), 0]
            out[dof] -= gear**2 * model.actuator_biasprm[a, 1:3]
    return out


def _limit_loss(loss: Floats, inverse_inertias: Floats) -> Floats:
    """A loss L (nv) that leaves at least half of the inertia M of each motion.

    M - diag(L) >= M / 2 where the eigenvalues of L^1/2 M^-1 L^1/2 are at most 1/2, and
    none is larger than their sum, the trace. A joint that is light beside what it loses
    is limited alone first.
    """
    diagonals = np.diagonal(inverse_inertias, axis1=1, axis2=2).max(axis=0, initial=0.0)
    loss = np.minimum(loss, MAX_INERTIA_LOSS / np.maximum(diagonals, 1e-12))
    if loss @ diagonals <= MAX_INERTIA_LOSS:
        return loss
    root = np.sqrt(loss)
    shares = np.linalg.eigvalsh(inverse_inertias * root * root[:, None])
    return loss * min(1.0, MAX_INERTIA_LOSS / shares.max())


def make_batch(hypotheses: Hypotheses, initial: BatchState) -> "Batch":
    """Make a MuJoCo batch of N simulations, in their initial states, on all cores.

    All share one model, with arrays by simulation of the fields in which hypotheses
    differ, so that effects can write into these.
    """
    from mujoco.batch import Batch

    variant, count = hypotheses.variant, len(initial.qpos)
    threads = min(count, count_cores())
    batch = Batch(variant.model, count, nthread=threads)
    segments = count // len(hypotheses.models)
    for name, nominal in variant.nominal_fields.items():
        read = (read_model_field(m, name) for m in hypotheses.models)
        values = [value for value in read if value is not None]
        if any(v.tobytes() != nominal for v in values):
            batch.expand(name)[:] = np.repeat(np.stack(values), segments, axis=0)
    _set_states(batch, initial)
    return batch


def _set_states(batch: "Batch", initial: BatchState) -> None:
    """Set the states of a batch to the initial ones."""
    batch.bind("qpos")[:], batch.bind("qvel")[:] = initial.qpos, initial.qvel
    batch.bind("time")[:] = 0
    if initial.activation is not None:
        batch.bind("act")[:] = initial.activation
    if initial.history is not None:
        batch.bind("history")[:] = initial.history


def set_commands(batch: "Batch", commands: Floats) -> Floats:
    """Set the commands (B, nu) of a batch; where they stand there, or none of them."""
    if not commands.shape[-1]:
        return commands
    bound: Floats = batch.bind("ctrl")
    bound[:] = commands
    return bound


def shift_velocity_back(batch: "Batch", initial: BatchState) -> Floats:
    """Set a batch that made one step back, with velocities of half a step earlier.

    By v[-1/2] = v[0] - (v[1] - v[0]) / 2.

    Args:
        batch: of N simulations, after one step; changed.

    Returns:
        (N, nv) these velocities [rad/s or m/s].
    """
    velocity = initial.qvel - (batch.bind("qvel") - initial.qvel) / 2
    _set_states(batch, initial)
    batch.bind("qvel")[:] = velocity
    return velocity


def restore_whole_steps(
    batch: "Batch",
    recorded: Mapping[str, Floats],
    commands: Floats,
    sensors: SensorReader,
    sampled_steps: np.ndarray,
) -> None:
    """Change velocities, and what follows from them, to those of whole steps.

    A leapfrog has them half a step earlier: where things touch, and velocities jump,
    v[k] = (v[k-1/2] + v[k+1/2]) / 2. Elsewhere v[k] = (3 v[k-1/2] - v[k-3/2]) / 2, for
    logs are often read as commands change: acceleration jumps then by some D, and the
    mean would be h D / 4 off.

    Args:
        batch: that was simulated, and will not be simulated on.
        recorded: fields (K, B, ...) at each step; changed.
        commands: (B, K, nu).
        sensors: what is read of the fields.
        sampled_steps: (S) at which velocities of bodies and sensors are recomputed.
    """
    early = recorded["qvel"].copy()
    recorded["qvel"][:-1] = (early[:-1] + early[1:]) / 2
    if not sensors.is_touching:
        recorded["qvel"][1:] = (3 * early[1:] - early[:-1]) / 2
    rates, accelerations = sensors.rates, sensors.accelerations
    if not ("cvel" in recorded or len(rates) or len(accelerations)):
        return
    stages = mujoco.mjtStage
    stage = stages.mjSTAGE_ACC if len(accelerations) else stages.mjSTAGE_VEL
    if stage == stages.mjSTAGE_VEL:  # which no constraint changes
        flags = batch.expand("opt.disableflags")
        flags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    bound = {name: batch.bind(name) for name in ("qpos", "qvel", *sensors.needs)}
    for k in sampled_steps:
        at_step = {name: values[k] for name, values in recorded.items()}
        bound["qpos"][:] = at_step["qpos"]
        if len(accelerations):  # only what the other velocity changes is added
            set_commands(batch, commands[:, k])
            bound["qvel"][:] = early[k]
            batch.forward(stage=stage)
            at_step["sensordata"][:, accelerations] -= bound["sensordata"][
                :, accelerations
            ]
        bound["qvel"][:] = at_step["qvel"]
        batch.forward(stage=stage)
        if len(accelerations):
            at_step["sensordata"][:, accelerations] += bound["sensordata"][
                :, accelerations
            ]
        if len(rates):
            at_step["sensordata"][:, rates] = bound["sensordata"][:, rates]
        if "cvel" in at_step:
            at_step["cvel"][:] = bound["cvel"]


def allow_divergence() -> np.errstate:
    """NumPy without warnings of overflow and NaN, in this thread, while entered.

    A simulation that diverges computes with such numbers until it ends, and
    `find_diverged` says then that none of them counts.
    """
    return np.errstate(over="ignore", invalid="ignore")


def find_diverged(batch: "Batch") -> np.ndarray:
    """(B) whether MuJoCo warned of a bad position, velocity or acceleration."""
    bad = [
        int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{x}"))
        for x in ("QPOS", "QVEL", "QACC")
    ]
    return batch.warning[:, bad, 1].any(axis=1)
