"""Accelerations: takes hypotheses and states, gives what each makes of every joint."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.base import Term
from ..simulation.batch import (
    BatchState,
    Hypotheses,
    allow_divergence,
    find_diverged,
    make_batch,
)
from ..simulation.commands import compute_commands
from ..simulation.initial_states import InitialStates
from ..simulation.simulator import MAX_BATCH_NUMBERS, Simulator
from ..simulation.stepwise import EffectForces, list_actions


def compute_accelerations(
    simulator: Simulator,
    terms: Sequence[Term],
    values: Floats,
    moments: Segments,
    state_offset: Floats,
    *,
    in_steps: bool = False,
) -> tuple[Floats, Floats]:
    """Accelerations of n hypotheses where W segments begin: forward dynamics.

    In continuous time: no integrator's damping, no error of a time step.

    Args:
        simulator: of the recordings.
        terms: effects that the given model lacks, none of which adds a joint.
        values: (n, P) of all terms' parameters, a row a hypothesis.
        moments: W segments, in whose first states they are; commands count by their
            means over as many steps, about the first one.
        state_offset: (n, W, 2 nv) added to the states that were read, of positions and
            then velocities [rad or m, and per s].
        in_steps: whether they are the change of velocity in a step of the simulation,
            over its length, rather than those of continuous time.

    Returns:
        (n, W, nv) [rad/s^2 or m/s^2]; NaN where MuJoCo warns of a bad one. And the
        inertia matrices (n, W, nv, nv) [kg m^2 or kg].
    """
    values = np.atleast_2d(values)
    model = simulator.compiler.nominal
    numbers = len(moments) * (2 * model.nv**2 + 20 * (model.nv + model.nbody))
    size = max(1, int(MAX_BATCH_NUMBERS / numbers))
    out = np.empty((len(values), len(moments), model.nv))
    inertia = np.empty((*out.shape, model.nv))
    around = simulator.cache.load_or_compute(
        moments, "steps around", lambda: _shift_back(moments)
    )
    for i in range(0, len(values), size):
        some = values[i : i + size]
        simulator.counter.add(len(some))
        hypotheses = simulator.build_hypotheses(terms, some, centered=False)
        offset = state_offset[i : i + size]
        initial = InitialStates(
            simulator, simulator.cache, hypotheses, moments
        ).compute(offset)
        commands = compute_commands(
            simulator, simulator.cache, hypotheses, around, centered=True, mean=True
        )[:, : int(moments.lengths.max())]
        found = _forward(
            hypotheses,
            moments,
            initial,
            commands.mean(axis=1),
            simulator.timestep,
            in_steps,
        )
        for whole, part in zip((out, inertia), found, strict=True):
            whole[i : i + size] = part.reshape(len(some), len(moments), *part.shape[1:])
    return out, inertia


def _shift_back(moments: Segments) -> Segments:
    """Segments of the same lengths in whose middles some others begin."""
    first = np.maximum(moments.first_step - moments.lengths // 2, 0)
    return replace(moments, first_step=first)


@allow_divergence()
def _forward(
    hypotheses: Hypotheses,
    moments: Segments,
    initial: BatchState,
    ctrl: Floats,
    step: float,
    in_steps: bool,
) -> tuple[Floats, Floats]:
    """Accelerations (n W, nv) of the given model's joints, and inertia (n W, nv, nv).

    Args:
        hypotheses: n of them.
        moments: W of them.
        initial: states of the n W simulations.
        ctrl: (n W, nu).
        step: of the simulation [s].
        in_steps: as `compute_accelerations` has it.
    """
    batch = make_batch(hypotheses, initial)
    if ctrl.shape[-1]:
        batch.bind("ctrl")[:] = ctrl
    # filled from now on
    acceleration, packed = batch.bind("qacc"), batch.bind("M")
    stage = mujoco.mjtStage.mjSTAGE_ACC
    actions = list_actions(hypotheses, len(moments))
    if actions:
        batch.forward(stage=stage)  # for the torques that effects read
        time = np.tile(moments.first_step * step, len(hypotheses.models))
        bound = batch.bind("ctrl") if ctrl.shape[-1] else None
        EffectForces(batch, actions, initial.integral_errors, step).apply(
            batch.bind("qpos"), batch.bind("qvel"), bound, time
        )
    if in_steps:
        before = batch.bind("qvel").copy()
        batch.step()
        acceleration = (batch.bind("qvel") - before) / step
    else:
        batch.forward(stage=stage)
    dofs = hypotheses.variant.dof
    out = np.array(acceleration[:, dofs])
    out[find_diverged(batch)] = np.nan
    inertia = _unpack(hypotheses.variant.model, packed)
    return out, inertia[:, dofs[:, None], dofs]


def _unpack(model, packed: Floats) -> Floats:
    """Symmetric matrices (B, nv, nv) of MuJoCo's lower triangles in sparse rows."""
    rows = np.repeat(np.arange(model.nv), model.M_rownnz)
    out = np.zeros((len(packed), model.nv, model.nv))
    out[:, rows, model.M_colind] = packed
    out[:, model.M_colind, rows] = packed
    return out
