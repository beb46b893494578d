"""Balance of torques: takes measured motion, gives equation errors of hypotheses.

The equation error of a window is the mean of the torques by which a hypothesis does not
make the motion that was read. It is linear in inertias and forces, and errors of one
moment do not add up with those of the next.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.places import SignalPlace
from ..effects.protocols import (
    CommandFilter,
    JointAddition,
    JointForce,
    ModelEdit,
    SensorMap,
)
from ..simulation.batch import allow_divergence
from ..simulation.model_variants import split_values
from ..simulation.simulator import COMMAND_LATENESS, collect_reading_changes
from .accelerations import (
    compute_accelerations,
    compute_applied_forces,
    is_force_law,
)
from .errors import ErrorModel, Errors
from .likelihood import Whitening, whiten
from .motion import MOMENTS_PER_WINDOW, MeasuredMotion, Readings

SCREENED_MOMENTS = 500  # in which all candidates are tried


def can_be_linear(term: Term) -> bool:
    """Whether the balance of torques at the measured state shows a term.

    What adds a joint has a state of its own that is not read. If positions come late,
    accelerations are read of other samples: errors of other noise are no likelihoods of
    the same data.
    """
    is_late = any(p.name == "delay" for p in term.parameters) and any(
        isinstance(place, SignalPlace) and place.kind == "joint_position"
        for place in term.places
    )
    return not isinstance(term.effect, JointAddition) and not is_late


@dataclass(frozen=True, eq=False)
class TorqueBalance(ErrorModel):
    """Errors by which hypotheses miss the motion that was read.

    Of each window, the balances of torques [N m or N] of J joints, and K mismatches of
    their velocities [rad/s or m/s].

    Attributes:
        motion: as measured.
    """

    motion: MeasuredMotion

    @property
    def derivative_step(self) -> float:
        """Of a derivative by a parameter [scales]; its square is below rounding."""
        return 1e-2

    @property
    def rows(self) -> int:
        """How many windows."""
        return len(self.motion.windows)

    @property
    def screening_share(self) -> float:
        """How many times as many moments there are as candidates are first tried in."""
        return len(self.motion.moments) / SCREENED_MOMENTS

    def compute_errors(self, terms: Sequence[Term], values: Floats) -> Errors:
        """Errors of n hypotheses with values (n, P); see `compute_errors`."""
        return compute_errors(self.motion, terms, values)

    def compute_changes(
        self, terms: Sequence[Term], values: Floats, errors: Errors
    ) -> Errors:
        """As of any error model; forces alone need no forward dynamics.

        Args:
            terms: of the hypothesis, and the one that is added last.
            values: (n, P) of all of them [units of the parameters].
        """
        if is_force_law(terms[-1].effect) and not any(t.onset for t in terms):
            return _compute_forces(self.motion, terms, values)
        return super().compute_changes(terms, values, errors)

    def compute_nuisance(
        self, terms: Sequence[Term], values: Floats, errors: Errors
    ) -> Errors:
        """Changes (K, ...) of errors by what nobody knows, each of one deviation.

        Commands that act half a step later, velocities that are read half a step later,
        and motion in steps of the simulation rather than in continuous time.

        Args:
            values: (P) of them [units of the parameters].
        """
        motion, simulator = self.motion, self.motion.simulator
        late = replace(motion, simulator=simulator.with_late_commands)
        shift = {
            c.name: {"delay": simulator.timestep / 2}
            for c in simulator.channels
            if c.kind == "joint_velocity"
        }
        found = [
            compute_errors(late, terms, values),
            compute_errors(motion, terms, values, shift),
            compute_errors(motion, terms, values, in_steps=True),
        ]
        size = np.array([0.5 / COMMAND_LATENESS, 1.0, 1.0])
        changes = np.concatenate([f.values - errors.values for f in found])
        return Errors(size[:, None] * changes, np.zeros(len(found)))

    def whiten(self, errors: Errors) -> Whitening:
        """The whitening of a hypothesis's errors."""
        values = errors.values.reshape(-1, self.motion.width)
        return whiten(
            values,
            errors.noise,
            float(errors.volume),
            self.motion.follows,
            errors.slack,
        )

    def thin(self, share: float) -> "tuple[TorqueBalance, np.ndarray]":
        """The balance in so many times fewer windows, and their numbers (r)."""
        rows = np.unique(np.arange(0, self.rows, share).astype(int))
        return TorqueBalance(self.motion.select(rows)), rows


def compute_errors(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    shift: Mapping[str, Mapping[str, float]] | None = None,
    *,
    in_steps: bool = False,
) -> Errors:
    """Equation errors of n hypotheses.

    The balance of torques of joints with inertia M,

        e = M (a_model - a_read) = tau - M a_read - c,

    is linear in masses, rotors, forces and gains, however far off they are. But it is
    what was read that has the noise. The density of the readings is that of e times
    |de / dreadings|. Up to a constant, the logarithm of that is half of log det N, with
    N the covariance of e by noise of the readings. Without it a free robot would be
    explained by having no mass.

    Args:
        values: (n, P) of them [units of the parameters].
        shift: further changes of signals, as `MeasuredMotion.read` has them.
        in_steps: as `compute_accelerations` has it.
    """
    values = np.atleast_2d(values)
    if not any(t.onset for t in terms):
        return _compute_errors(motion, terms, values, shift or {}, in_steps)
    out = np.empty((len(values), len(motion.windows), motion.width))
    volume = np.zeros(len(values))
    count = len(motion.joints)
    noise = np.empty((len(motion.windows), count, count))
    slack = np.empty((len(motion.windows), count))
    is_active = motion.find_active_terms(terms)
    owner = np.repeat(np.arange(len(terms)), [len(t.parameters) for t in terms])
    for active in np.unique(is_active, axis=0):
        rows = np.flatnonzero((is_active == active).all(axis=1))
        acting = [t for t, acts in zip(terms, active, strict=True) if acts]
        part = _compute_errors(
            motion.select(rows), acting, values[:, active[owner]], shift or {}, in_steps
        )
        out[:, rows] = part.values.reshape(len(values), len(rows), -1)
        volume += part.volume
        if part.noise is not None:
            noise[rows], slack[rows] = part.noise, part.slack
    is_single = len(values) == 1
    known, undecided = (noise, slack) if is_single else (None, 0.0)
    return Errors(out.reshape(len(values), -1), volume, known, undecided)


@allow_divergence()
def _compute_errors(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    shift: Mapping[str, Mapping[str, float]],
    in_steps: bool,
) -> Errors:
    """Equation errors of n hypotheses whose terms act all the time.

    Args:
        values: (n, P) of them [units of the parameters].
        in_steps: as `compute_accelerations` has it.
    """
    acting, acts, read = _split(motion, terms, values, shift)
    found = compute_accelerations(
        motion.simulator, acting, acts, motion.moments,
        np.stack([r.offset for r in read]), in_steps=in_steps,
    )  # fmt: skip
    errors = found.acceleration[..., motion.dofs] - np.stack(
        [r.acceleration for r in read]
    )
    errors *= np.stack([r.gain for r in read])
    m = found.inertia[..., motion.dofs[:, None], motion.dofs]
    torque = np.einsum("nwij,nwj->nwi", m, errors)
    middle = motion.windows[:, MOMENTS_PER_WINDOW // 2]
    mean = m[:, middle]  # it varies little in a window
    missed = np.stack([r.missed * r.gain[middle, :, None] for r in read])
    impedance = found.impedance[:, motion.dofs]
    averaged = motion.average(torque)
    averaged -= np.einsum("nrij,nrj->nri", mean, missed[..., 2])
    averaged -= (impedance[:, None] * missed[..., :2]).sum(axis=-1)
    mismatch = np.stack([r.mismatch for r in read])
    averaged = np.concatenate([averaged, mismatch], axis=-1)
    noise = _propagate_noise(motion.noise, mean, impedance)
    volume = 0.5 * np.linalg.slogdet(noise)[1].sum(axis=1)
    flat = averaged.reshape(len(averaged), -1)
    if len(noise) > 1:
        return Errors(flat, volume)
    loss = found.frictionloss[0][:, motion.dofs]
    return Errors(
        flat, volume, noise[0], _spread_friction(motion, read[0].velocity, loss)
    )


def _spread_friction(motion: MeasuredMotion, velocity: Floats, loss: Floats) -> Floats:
    """Variance (R, J) of the torque of dry friction, for the noise of velocities.

    Where noise hides which way a joint moves, or whether it does, friction may have
    any value up to its loss.

    Args:
        velocity: (W, J) as read.
        loss: (W, J) dry friction.
    """
    known = erf(velocity / (np.sqrt(2) * motion.speed_noise))
    return motion.average(loss**2 * (1 - known**2))


def _propagate_noise(noise: Floats, inertia: Floats, impedance: Floats) -> Floats:
    """Covariance (n, R, J, J) of what noise of the readings makes of equation errors.

    To first order, by accelerations that inertia multiplies, and by positions and
    velocities that servos answer to.

    Args:
        noise: (J, 3, 3) covariance of a joint's position, velocity and acceleration.
        inertia: (n, R, J, J).
        impedance: (n, J, 2) stiffness and damping.
    """
    count = len(noise)
    slopes = np.zeros((*inertia.shape, 3))
    joints = np.arange(count)
    slopes[:, :, joints, joints, :2] = impedance[:, None]
    slopes[..., 2] = inertia
    return np.einsum("nrikx,kxy,nrjky->nrij", slopes, noise, slopes, optimize=True)


def _split(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    shift: Mapping[str, Mapping[str, float]],
) -> tuple[list[Term], Floats, list[Readings]]:
    """What acts on the robot, and what each hypothesis makes of its readings.

    Args:
        values: (n, P) of them [units of the parameters].

    Returns:
        Terms that do more than change readings, their values (n, p), and n readings.
    """
    each = split_values(terms, values)
    is_reading = [_only_reads(t) for t in terms]
    acting = [t for t, reads in zip(terms, is_reading, strict=True) if not reads]
    acts = np.hstack([
        np.zeros((len(values), 0)),
        *(v for v, reads in zip(each, is_reading, strict=True) if not reads),
    ])  # fmt: skip
    changes = _list_changes(motion, terms, each, len(values))
    return acting, acts, [motion.read({**shift, **change}) for change in changes]


def _only_reads(term: Term) -> bool:
    """Whether a term changes readings and nothing else."""
    ways = ModelEdit | JointAddition | CommandFilter | JointForce
    return isinstance(term.effect, SensorMap) and not isinstance(term.effect, ways)


def _list_changes(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    term_values: Sequence[Floats],
    count: int,
) -> list[dict]:
    """What each of `count` hypotheses changes of the joints' signals."""
    changes = collect_reading_changes(terms, term_values, motion.simulator.channels)
    out: list[dict] = [{} for _ in range(count)]
    for name, by_kind in changes.items():
        if name in motion.half_widths:
            for i, change in enumerate(out):
                change[name] = {k: np.ravel(v[i])[0].item() for k, v in by_kind.items()}
    return out


def _compute_forces(
    motion: MeasuredMotion, terms: Sequence[Term], values: Floats
) -> Errors:
    """Changes of equation errors by the last term, a force law, at n values.

    Args:
        values: (n, P) of them [units of the parameters].
    """
    acting, acts, read = _split(motion, terms, values, {})
    offset = np.stack([r.offset for r in read])
    forces = compute_applied_forces(
        motion.simulator, acting, acts, motion.moments, offset
    )
    out = np.zeros((len(values), len(motion.windows), motion.width))
    out[..., : len(motion.dofs)] = motion.average(forces[..., motion.dofs])
    return Errors(out.reshape(len(values), -1), np.zeros(len(values)))
