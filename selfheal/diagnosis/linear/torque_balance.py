"""Balance of torques: takes measured motion, gives equation errors of hypotheses.

The equation error of a window is the mean of the torques by which a hypothesis does not
make the motion that was read. It is linear in inertias and forces, and errors of one
moment do not add up with those of the next.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

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
        shift: further changes of signals, as `MeasuredMotion.read` has them.
        in_steps: as `compute_accelerations` has it.
    """

    motion: MeasuredMotion
    shift: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    in_steps: bool = False

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

    @property
    def follows(self) -> np.ndarray:
        """(R) whether a window follows the one before it in the same episode."""
        return self.motion.follows

    def compute_errors(self, terms: Sequence[Term], values: Floats) -> Errors:
        """Equation errors of n hypotheses with values (n, P) [units of the parameters].

        The balance of torques of joints with inertia M,

            e = M (a_model - a_read) = tau - M a_read - c,

        is linear in masses, rotors, forces and gains, however far off they are. But it
        is what was read that has the noise. The density of the readings is that of e
        times |de / dreadings|. Up to a constant, the logarithm of that is half of
        log det N, with N the covariance of e by noise of the readings. Without it a
        free robot would be explained by having no mass.
        """
        if not any(t.onset for t in terms):
            return self._balance(terms, values)
        motion = self.motion
        out = np.empty((len(values), self.rows, motion.width))
        volume, count = np.zeros(len(values)), len(motion.joints)
        noise, slack = np.empty((self.rows, count, count)), np.empty((self.rows, count))
        is_active = motion.find_active_terms(terms)
        owner = np.repeat(np.arange(len(terms)), [len(t.parameters) for t in terms])
        for active in np.unique(is_active, axis=0):
            rows = np.flatnonzero((is_active == active).all(axis=1))
            acting = [t for t, acts in zip(terms, active, strict=True) if acts]
            some = replace(self, motion=motion.select(rows))
            part = some._balance(acting, values[:, active[owner]])
            out[:, rows] = part.values.reshape(len(values), len(rows), -1)
            volume += part.volume
            if part.noise is not None:
                noise[rows], slack[rows] = part.noise, part.slack
        flat = out.reshape(len(values), -1)
        if len(values) > 1:
            return Errors(flat, volume)
        return Errors(flat, volume, noise, slack)

    def compute_changes(
        self, terms: Sequence[Term], values: Floats, errors: Errors
    ) -> Errors:
        """As of any error model (n, P); forces alone need no forward dynamics."""
        if not is_force_law(terms[-1].effect) or any(t.onset for t in terms):
            return super().compute_changes(terms, values, errors)
        motion = self.motion
        acting, acts, read = self._split(terms, values)
        offset = np.stack([r.offset for r in read])
        forces = compute_applied_forces(
            motion.simulator, acting, acts, motion.moments, offset
        )
        out = np.zeros((len(values), self.rows, motion.width))
        out[..., : len(motion.dofs)] = motion.average(forces[..., motion.dofs])
        return Errors(out.reshape(len(values), -1), np.zeros(len(values)))

    def compute_nuisance(
        self, terms: Sequence[Term], values: Floats, errors: Errors
    ) -> Errors:
        """Changes (K, ...) at values (1, P) by what nobody knows, of one deviation.

        Commands that act half a step later, velocities that are read half a step later,
        and motion in steps of the simulation rather than in continuous time.
        """
        motion, simulator = self.motion, self.motion.simulator
        late = replace(motion, simulator=simulator.with_late_commands)
        shift = {
            c.name: {"delay": simulator.timestep / 2}
            for c in simulator.channels
            if c.kind == "joint_velocity"
        }
        models = (
            TorqueBalance(late),
            TorqueBalance(motion, shift),
            TorqueBalance(motion, in_steps=True),
        )
        found = [model.compute_errors(terms, values).values for model in models]
        size = np.array([0.5 / COMMAND_LATENESS, 1.0, 1.0])
        changes = np.concatenate(found) - errors.values
        return Errors(size[:, None] * changes, np.zeros(len(found)))

    def thin(self, share: float) -> "tuple[TorqueBalance, np.ndarray]":
        """The balance in so many times fewer windows, and their numbers (r)."""
        rows = np.unique(np.arange(0, self.rows, share).astype(int))
        return TorqueBalance(self.motion.select(rows)), rows

    @allow_divergence()
    def _balance(self, terms: Sequence[Term], values: Floats) -> Errors:
        """Equation errors at values (n, P) of terms that act all the time."""
        motion = self.motion
        acting, acts, read = self._split(terms, values)
        found = compute_accelerations(
            motion.simulator,
            acting,
            acts,
            motion.moments,
            np.stack([r.offset for r in read]),
            in_steps=self.in_steps,
        )
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
        flat = np.concatenate([averaged, mismatch], axis=-1).reshape(len(averaged), -1)
        noise = _propagate_noise(motion.noise, mean, impedance)
        volume = 0.5 * np.linalg.slogdet(noise)[1].sum(axis=1)
        if len(noise) > 1:
            return Errors(flat, volume)
        # where noise hides which way a joint moves, or whether it does, friction may
        # have any value up to its loss
        loss = found.frictionloss[0][:, motion.dofs]
        known = erf(read[0].velocity / (np.sqrt(2) * motion.speed_noise))
        slack = motion.average(loss**2 * (1 - known**2))
        return Errors(flat, volume, noise[0], slack)

    def _split(
        self, terms: Sequence[Term], values: Floats
    ) -> tuple[list[Term], Floats, list[Readings]]:
        """What acts on the robot, and what n hypotheses (n, P) make of its readings.

        Returns:
            Terms that do more than change readings, their values (n, p), and n
            readings.
        """
        motion, each = self.motion, split_values(terms, values)
        acting = [
            (t, v) for t, v in zip(terms, each, strict=True) if not _only_reads(t)
        ]
        acts = np.hstack([np.zeros((len(values), 0)), *(v for _, v in acting)])
        changes = collect_reading_changes(terms, each, motion.simulator.channels)
        read = []
        for i in range(len(values)):
            change = {
                name: {k: np.ravel(v[i])[0].item() for k, v in by_kind.items()}
                for name, by_kind in changes.items()
                if name in motion.half_widths
            }
            read.append(motion.read({**self.shift, **change}))
        return [t for t, _ in acting], acts, read


def _only_reads(term: Term) -> bool:
    """Whether a term changes readings and nothing else."""
    others = ModelEdit | JointAddition | CommandFilter | JointForce
    return isinstance(term.effect, SensorMap) and not isinstance(term.effect, others)


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
