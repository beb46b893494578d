"""Linear model: takes measured motion, gives equation errors and their derivatives.

The equation error of a window is the mean of the torques by which a hypothesis does not
make the motion that was read. It is linear in inertias and forces, and errors of one
moment do not add up with those of the next.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from ...recording.data import Floats
from ..effects.base import Term, implements
from ..effects.terms import find_restated
from ..simulation.batch import allow_divergence
from ..simulation.model_variants import split_values
from ..simulation.simulator import COMMAND_LATENESS, collect_reading_changes
from .accelerations import (
    compute_accelerations,
    compute_applied_forces,
    is_force_law,
)
from .motion import MOMENTS_PER_WINDOW, MeasuredMotion, Readings

# share of a column's norm that has to be its own, beside those before it; chosen: what
# is less is the same direction
OWN_SHARE = 1e-3
# of the scale of a parameter, the step of a derivative; its square is below rounding
DERIVATIVE_STEP = 1e-2
ERROR_ROUNDING = 1e-9  # share of the errors below which a change of them is none


@dataclass(frozen=True, eq=False)
class Errors:
    """Equation errors of a hypothesis, or of n, and their volume.

    Attributes:
        values: (..., R (J + K)) balance of torques [N m or N] of J joints in R windows,
            and K mismatches of velocities [rad/s or m/s].
        volume: (...) half the sum of log det N over the windows.
        noise: (R, J, J) N, covariance of what noise of the readings makes of the
            balance in each window, and variance of what it hides of dry friction, of a
            single hypothesis; of several it is not kept.
    """

    values: Floats
    volume: Floats
    noise: Floats | None = None


@dataclass(frozen=True, eq=False)
class Direction:
    """A way in which a term's values may leave the nominal ones, and its response.

    Attributes:
        term: of the values.
        start: (p) values at its origin; NaN where these are infinite [units of the
            parameters].
        steps: (k, p) change of the values by one unit of each coordinate.
        columns: (k, R (J + K)) change of the equation errors.
        volumes: (k) change of their volume.
    """

    term: Term
    start: Floats
    steps: Floats
    columns: Floats
    volumes: Floats


def can_be_linear(term: Term) -> bool:
    """Whether the balance of torques at the measured state shows a term.

    What adds a joint has a state of its own that is not read. If positions come late,
    accelerations are read of other samples: errors of other noise are no likelihoods of
    the same data.
    """
    is_late = any(p.name == "delay" for p in term.parameters) and any(
        place.get("kind") == "joint_position" for place in term.places
    )
    return not implements(term.effect, "edit_spec") and not is_late


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
    what was read that has the noise: the density of the readings is that of e times
    |de / dreadings|, whose logarithm is half of log det N up to a constant, N the
    covariance of e by noise of the readings. Without it a free robot would be explained
    by having no mass.

    Args:
        motion: as measured.
        terms: of the hypotheses.
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
            noise[rows] = part.noise
    known = noise if len(values) == 1 else None
    return Errors(out.reshape(len(values), -1), volume, known)


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
        motion: as measured.
        terms: of the hypotheses.
        values: (n, P) of them [units of the parameters].
        shift: further changes of signals.
        in_steps: as `compute_accelerations` has it.
    """
    acting, acts, read = _split(motion, terms, values, shift)
    found = compute_accelerations(
        motion.simulator, acting, acts, motion.moments,
        np.stack([r.offset for r in read]), in_steps=in_steps,
    )  # fmt: skip
    errors = found.acceleration[..., motion.dofs] - np.stack([r.acceleration for r in read])
    errors *= np.stack([r.gain for r in read])
    m = found.inertia[..., motion.dofs[:, None], motion.dofs]
    torque = np.einsum("nwij,nwj->nwi", m, errors)
    mismatch = np.stack([r.mismatch for r in read])
    averaged = motion.average(np.concatenate([torque, mismatch], axis=-1))
    middle = motion.windows[:, MOMENTS_PER_WINDOW // 2]
    mean = m[:, middle]  # it varies little in a window
    missed = np.stack([r.missed * r.gain[middle] for r in read])
    averaged[..., : len(motion.dofs)] -= np.einsum("nrij,nrj->nri", mean, missed)
    noise = _propagate_noise(motion.noise, mean, found.impedance[:, motion.dofs])
    volume = 0.5 * np.linalg.slogdet(noise)[1].sum(axis=1)
    known = None
    if len(noise) == 1:
        known = noise[0]
        joints = np.arange(len(motion.dofs))
        loss = found.frictionloss[0][:, motion.dofs]
        known[:, joints, joints] += _spread_friction(motion, read[0].velocity, loss)
    return Errors(averaged.reshape(len(averaged), -1), volume, known)


def _spread_friction(motion: MeasuredMotion, velocity: Floats, loss: Floats) -> Floats:
    """Variance (R, J) of the torque of dry friction, for the noise of velocities.

    Where noise hides which way a joint moves, or whether it does, friction may have
    any value up to its loss.

    Args:
        motion: as measured.
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
        motion: as measured.
        terms: of n hypotheses.
        values: (n, P) of them [units of the parameters].
        shift: further changes of signals.

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
    read: dict[str, Readings] = {}  # most hypotheses change readings alike
    found = []
    for change in _list_changes(motion, terms, each, len(values)):
        key = repr(change)
        if key not in read:
            read[key] = motion.read({**shift, **change})
        found.append(read[key])
    return acting, acts, found


def _only_reads(term: Term) -> bool:
    """Whether a term changes readings and nothing else."""
    ways = ("edit_model", "edit_spec", "transform_command", "apply_forces")
    return implements(term.effect, "transform_reading") and not any(
        implements(term.effect, way) for way in ways
    )


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


def differentiate(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    errors: Errors,
    which: Sequence[int] | None = None,
) -> Errors:
    """Derivatives (p, R (J + K)) and (p) of a hypothesis's errors by each value.

    Args:
        motion: as measured.
        terms: of the hypothesis.
        values: (P) [units of the parameters].
        errors: there.
        which: (p) numbers of the values; None: all.
    """
    chosen = np.arange(len(values)) if which is None else np.array(which, int)
    scale = np.concatenate([t.scale for t in terms])
    high = np.concatenate([t.high for t in terms])
    step = DERIVATIVE_STEP * scale
    step = np.where(values + step > high, -step, step)[chosen]
    points = np.tile(values, (len(chosen), 1))
    points[np.arange(len(chosen)), chosen] += step
    moved = compute_errors(motion, terms, points)
    return Errors(
        (moved.values - errors.values) / step[:, None],
        (moved.volume - errors.volume) / step,
    )


def compute_nuisance(
    motion: MeasuredMotion, terms: Sequence[Term], values: Floats, errors: Errors
) -> Errors:
    """Changes (K, ...) of errors by what nobody knows, each of one deviation.

    Commands that act half a step later, velocities that are read half a step later,
    and motion in steps of the simulation rather than in continuous time.

    Args:
        motion: as measured.
        terms: of the hypothesis.
        values: (P) of them [units of the parameters].
        errors: with them.
    """
    simulator = motion.simulator
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


def propose_directions(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    errors: Errors,
    candidates: Sequence[Term],
) -> list[Direction]:
    """The directions of all candidates beside a hypothesis.

    Of each candidate there are the derivatives at nominal values, where these are
    finite, and what each of its initial values changes.

    Args:
        motion: as measured.
        terms: of the hypothesis.
        values: (P) of them [units of the parameters].
        errors: with them.
        candidates: terms that may be added.
    """
    return [
        direction
        for term in candidates
        for direction in _propose(motion, terms, values, errors, term)
    ]


def _propose(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    errors: Errors,
    term: Term,
) -> list[Direction]:
    """The directions of one candidate; arguments as of `propose_directions`."""
    nominal = np.array([p.nominal for p in term.parameters])
    first = np.cumsum([0, *(len(t.parameters) for t in terms)])
    for k, i in find_restated(term, terms).items():  # which is no more as given
        nominal[k] *= values[first[i]]
    points = np.array([np.array(x) for x in dict.fromkeys(term.initial_values)])
    is_finite = bool(np.isfinite(nominal).all())
    steps = np.zeros((0, len(nominal)))
    if is_finite:
        steps = np.diag(DERIVATIVE_STEP * term.scale)
        inside = np.clip(nominal, term.low, term.high)
        steps = np.where((inside + np.diag(steps) > term.high)[:, None], -steps, steps)
    tried = np.vstack([nominal + steps, points]) if is_finite else points
    beside = np.hstack([np.tile(values, (len(tried), 1)), tried])
    if is_force_law(term.effect) and not any(t.onset for t in (*terms, term)):
        changes = _compute_forces(motion, (*terms, term), beside)
        volumes = np.zeros(len(changes))
    else:
        found = compute_errors(motion, (*terms, term), beside)
        changes, volumes = found.values - errors.values, found.volume - errors.volume
    start = nominal if is_finite else np.full(len(nominal), np.nan)
    count, out = len(steps), []
    size = np.linalg.norm(changes, axis=1)
    is_shown = size > ERROR_ROUNDING * np.linalg.norm(errors.values)  # and no NaN
    shown = np.flatnonzero(is_shown[:count])
    if len(shown):
        unit = 1 / DERIVATIVE_STEP
        out.append(
            Direction(
                term, start, unit * steps[shown],
                unit * changes[shown], unit * volumes[shown],
            )
        )  # fmt: skip
    width = 2 if term.effect.is_periodic else 1
    for i in range(count, len(tried) - width + 1, width):
        a = slice(i, i + width)
        columns = changes[a]
        if not is_shown[a].all():
            continue
        if len(shown) and not _is_new(columns, changes[shown]):
            continue
        unit_steps = tried[a] - start if is_finite else tried[a]
        out.append(Direction(term, start, unit_steps, columns, volumes[a]))
    return out


def _compute_forces(
    motion: MeasuredMotion, terms: Sequence[Term], values: Floats
) -> Floats:
    """Changes (n, R (J + K)) of equation errors by the last term, a force law.

    Args:
        motion: as measured.
        terms: of the hypotheses.
        values: (n, P) of them [units of the parameters].
    """
    acting, acts, read = _split(motion, terms, values, {})
    offset = np.stack([r.offset for r in read])
    forces = compute_applied_forces(
        motion.simulator, acting, acts, motion.moments, offset
    )
    out = np.zeros((len(values), len(motion.windows), motion.width))
    out[..., : len(motion.dofs)] = motion.average(forces[..., motion.dofs])
    return out.reshape(len(values), -1)


def _is_new(columns: Floats, known: Floats) -> bool:
    """Whether columns (k, n) are no combination of known ones (m, n); NaN are not."""
    basis, _ = np.linalg.qr(known.T)
    rest = columns - (columns @ basis) @ basis.T
    share = np.linalg.norm(rest, axis=1) / np.linalg.norm(columns, axis=1)
    return bool((share > OWN_SHARE).any())
