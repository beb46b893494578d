"""Accelerations: takes hypotheses and states, gives what each makes of every joint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.base import Effect, Term
from ..effects.commands import CommandGrid
from ..effects.protocols import (
    CommandFilter,
    JointAddition,
    JointForce,
    ModelEdit,
    SensorMap,
    StepState,
)
from ..simulation.batch import (
    BatchState,
    Hypotheses,
    allow_divergence,
    compute_servo_impedance,
    find_diverged,
    make_batch,
    set_commands,
)
from ..simulation.commands import compute_commands
from ..simulation.initial_states import InitialStates
from ..simulation.simulator import MAX_BATCH_NUMBERS, Simulator
from ..simulation.stepwise import EffectForces, list_actions


@dataclass(frozen=True, eq=False)
class Dynamics:
    """How joints of n hypotheses answer at W moments.

    Attributes:
        acceleration: (n, W, nv) [rad/s^2 or m/s^2]; NaN where MuJoCo warns of a bad
            one.
        inertia: (n, W, nv, nv) [kg m^2 or kg].
        frictionloss: (n, W, nv) dry friction [N m or N].
        impedance: (n, nv, 2) stiffness [N m/rad or N/m] and damping [N m s/rad or
            N s/m] of the joints and their servos.
    """

    acceleration: Floats
    inertia: Floats
    frictionloss: Floats
    impedance: Floats


def compute_accelerations(
    simulator: Simulator,
    terms: Sequence[Term],
    values: Floats,
    moments: Segments,
    state_offset: Floats,
    *,
    in_steps: bool,
) -> Dynamics:
    """Accelerations of n hypotheses where W segments begin: forward dynamics.

    In continuous time: no integrator's damping, no error of a time step.

    Args:
        terms: effects that the given model lacks, none of which adds a joint.
        values: (n, P) of all terms' parameters, a row a hypothesis.
        moments: W segments, in whose first states they are; commands count by their
            means over as many steps, about the first one.
        state_offset: (n, W, 2 nv) added to the states that were read, of positions and
            then velocities [rad or m, and per s].
        in_steps: whether they are the change of velocity in a step of the simulation,
            over its length, rather than those of continuous time.
    """
    model = simulator.compiler.nominal
    numbers = len(moments) * (2 * model.nv**2 + 20 * (model.nv + model.nbody))
    size = max(1, int(MAX_BATCH_NUMBERS / numbers))
    out = np.empty((len(values), len(moments), model.nv))
    inertia, friction = np.empty((*out.shape, model.nv)), np.empty_like(out)
    impedance = np.empty((len(values), model.nv, 2))
    for i in range(0, len(values), size):
        some, offset = values[i : i + size], state_offset[i : i + size]
        simulator.counter.add(len(some))
        begun = _Begun.build(simulator, terms, some, moments, offset)
        for whole, part in zip(
            (out, inertia, friction), begun.forward(in_steps), strict=True
        ):
            whole[i : i + size] = part.reshape(len(some), len(moments), *part.shape[1:])
        hypotheses = begun.hypotheses
        dofs = hypotheses.variant.dof
        impedance[i : i + size] = [_find_impedance(m)[dofs] for m in hypotheses.models]
    return Dynamics(out, inertia, friction, impedance)


def _find_impedance(model: mujoco.MjModel) -> Floats:
    """(nv, 2) stiffness and damping of joints, with those of their servos."""
    out = compute_servo_impedance(model)
    out[:, 1] += np.array(model.dof_damping).reshape(model.nv, -1)[:, 0]
    for j in range(model.njnt):
        stiffness = np.ravel(np.array(model.jnt_stiffness[j]))[0]
        out[model.jnt_dofadr[j], 0] += stiffness
    return out


def is_force_law(effect: Effect) -> bool:
    """Whether an effect adds forces that follow from states and commands alone."""
    others = ModelEdit | JointAddition | CommandFilter | SensorMap
    if isinstance(effect, others) or not isinstance(effect, JointForce):
        return False
    return not effect.needs


def compute_applied_forces(
    simulator: Simulator,
    terms: Sequence[Term],
    values: Floats,
    moments: Segments,
    state_offset: Floats,
) -> Floats:
    """Forces (n, W, nv) [N m or N] that the last of some terms adds, a force law.

    Arguments as of `compute_accelerations`.
    """
    begun = _Begun.build(simulator, terms, values, moments, state_offset)
    hypotheses, initial = begun.hypotheses, begun.initial
    applied, none = np.zeros_like(initial.qvel), np.zeros(0)
    time = np.tile(moments.first_step * simulator.timestep, len(values))
    read = initial.qpos, initial.qvel, begun.ctrl, none, none, applied, none
    state = StepState(time, *read, None, initial.integral_errors, simulator.timestep)
    actions = list_actions(hypotheses, len(moments))
    for action in actions[-len(terms[-1].places) :]:
        action.effect.apply_forces(state, action.place, action.values)
    return applied[:, hypotheses.variant.dof].reshape(len(values), len(moments), -1)


def _shift_back(moments: Segments) -> Segments:
    """Segments of the same lengths in whose middles some others begin."""
    first = np.maximum(moments.first_step - moments.lengths // 2, 0)
    return replace(moments, first_step=first)


@dataclass(frozen=True, eq=False)
class _Begun:
    """n hypotheses at W moments: their states, and mean commands (n W, nu) there."""

    hypotheses: Hypotheses
    moments: Segments
    initial: BatchState
    ctrl: Floats
    timestep: float

    @classmethod
    def build(
        cls,
        simulator: Simulator,
        terms: Sequence[Term],
        values: Floats,
        moments: Segments,
        state_offset: Floats,
    ) -> "_Begun":
        """Arguments as of `compute_accelerations`."""
        hypotheses = simulator.build_hypotheses(terms, values, centered=False)
        initial = InitialStates(simulator, hypotheses, moments)
        around = simulator.cache.load_or_compute(
            moments, "steps around", lambda: _shift_back(moments)
        )
        grid = CommandGrid(simulator.timestep, is_centered=True, is_mean=True)
        commands = compute_commands(simulator, hypotheses, around, grid)
        commands = commands[:, : int(moments.lengths.max())]
        state, ctrl = initial.compute(state_offset), commands.mean(axis=1)
        return cls(hypotheses, moments, state, ctrl, simulator.timestep)

    @allow_divergence()
    def forward(self, in_steps: bool) -> tuple[Floats, Floats, Floats]:
        """Accelerations (n W, nv) of the given model's joints, inertia, dry friction.

        Args:
            in_steps: as `compute_accelerations` has it.
        """
        hypotheses, moments, step = self.hypotheses, self.moments, self.timestep
        batch = make_batch(hypotheses, self.initial)
        bound = set_commands(batch, self.ctrl)
        # filled from now on
        acceleration, packed = batch.bind("qacc"), batch.bind("M")
        stage = mujoco.mjtStage.mjSTAGE_ACC
        actions = list_actions(hypotheses, len(moments))
        losses = [np.array(m.dof_frictionloss) for m in hypotheses.models]
        friction = np.repeat(losses, len(moments), axis=0)
        if actions:
            time = np.tile(moments.first_step * step, len(hypotheses.models))
            errors = self.initial.integral_errors
            forces = EffectForces(batch, actions, errors, time, step)
            if any("actuator_torque" in action.effect.needs for action in actions):
                batch.forward(stage=stage)  # fills what is bound before
            forces.apply(bound, 0)
            friction = forces.frictionloss
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
        return out, inertia[:, dofs[:, None], dofs], friction[:, dofs]


def _unpack(model: mujoco.MjModel, packed: Floats) -> Floats:
    """Symmetric matrices (B, nv, nv) of MuJoCo's lower triangles in sparse rows."""
    rows = np.repeat(np.arange(model.nv), model.M_rownnz)
    out = np.zeros((len(packed), model.nv, model.nv))
    out[:, rows, model.M_colind] = packed
    out[:, model.M_colind, rows] = packed
    return out
