"""Linear model: takes measured motion, gives equation errors and their derivatives.

The equation error of a window is the mean of model acceleration less acceleration read,
both along the measured motion. It is linear in forces, and does not accumulate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term, implements
from ..effects.terms import find_restated
from ..simulation.accelerations import compute_accelerations
from ..simulation.model_variants import split_values
from ..simulation.simulator import COMMAND_LATENESS, collect_reading_changes
from .motion import MeasuredMotion, Readings

# share of a column's norm that has to be its own, beside those before it; chosen: what
# is less is the same direction
OWN_SHARE = 1e-3
# of the scale of a parameter, the step of a derivative; its square is below rounding
DERIVATIVE_STEP = 1e-2


@dataclass(frozen=True, eq=False)
class Direction:
    """A way in which a term's values may leave the nominal ones, and its response.

    Attributes:
        term: of the values.
        start: (p) values at its origin [units of the parameters].
        steps: (k, p) change of the values by one unit of each coordinate.
        columns: (k, R J) change of the equation errors [rad/s^2 or m/s^2].
    """

    term: Term
    start: Floats
    steps: Floats
    columns: Floats


def can_be_linear(term: Term) -> bool:
    """Whether accelerations at the measured state show a term.

    What adds a joint has a state of its own that is not read.
    """
    return not implements(term.effect, "edit_spec")


def compute_errors(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    shift: Mapping[str, Mapping[str, float]] | None = None,
    *,
    in_steps: bool = False,
    reference: "Reference | None" = None,
) -> Floats:
    """Equation errors (n, R J) of hypotheses with values (n, P) [rad/s^2 or m/s^2].

    Args:
        motion: as measured.
        terms: of the hypotheses.
        values: (n, P) of them [units of the parameters].
        shift: further changes of signals, as `MeasuredMotion.read` has them.
        in_steps: as `compute_accelerations` has it.
        reference: in whose responses to torques they are; None: in accelerations.
    """
    acting, acts, read = _split(motion, terms, np.atleast_2d(values), shift or {})
    a, inertia = compute_accelerations(
        motion.simulator, acting, acts, motion.moments,
        np.stack([r.offset for r in read]), in_steps=in_steps,
    )  # fmt: skip
    a = a[..., motion.dofs]
    errors = a - np.stack([r.acceleration for r in read])
    if reference is not None:
        m = inertia[..., motion.dofs[:, None], motion.dofs]
        torque = np.einsum("nwij,nwj->nwi", m, errors - reference.noise)
        errors = np.einsum("wij,nwj->nwi", reference.response, torque)
        errors += reference.noise
    errors *= np.stack([r.gain for r in read])
    mismatch = np.stack([r.mismatch for r in read])
    averaged = motion.average(np.concatenate([errors, mismatch], axis=-1))
    return averaged.reshape(len(averaged), -1)


def compute_nuisance(
    motion: MeasuredMotion, terms: Sequence[Term], values: Floats, errors: Floats
) -> Floats:
    """(K, R J) changes of the errors by what nobody knows, each of one deviation.

    Commands that act half a step later, velocities that are read half a step later,
    and motion in steps of the simulation rather than in continuous time.

    Args:
        motion: as measured.
        terms: of the hypothesis.
        values: (P) of them [units of the parameters].
        errors: (R J) with them.
    """
    simulator = motion.simulator
    late = replace(motion, simulator=simulator.with_late_commands)
    shift = {
        c.name: {"delay": simulator.timestep / 2}
        for c in simulator.channels
        if c.kind == "joint_velocity"
    }
    commanded = compute_errors(late, terms, values)[0] - errors
    read = compute_errors(motion, terms, values, shift)[0] - errors
    stepped = compute_errors(motion, terms, values, in_steps=True)[0] - errors
    return np.stack([0.5 / COMMAND_LATENESS * commanded, read, stepped])


@dataclass(frozen=True, eq=False)
class Reference:
    """A hypothesis near which equation errors are linear in inertias, too.

    With its inertia M0 and errors e0, of which about n is noise, another hypothesis has

        e = M0^-1 M (a_model - a_read - n) + n,

    a balance of torques, linear in masses, rotors, forces and gains, however far off
    they are. In accelerations these are not linear; without n a robot without mass
    would explain all noise.

    Attributes:
        response: (W, J, J) M0^-1.
        noise: (W, J) n [rad/s^2 or m/s^2].
    """

    response: Floats
    noise: Floats


def make_reference(
    motion: MeasuredMotion, terms: Sequence[Term], values: Floats
) -> Reference | None:
    """The reference of a hypothesis with values (P); None: not all joints are read."""
    if len(motion.dofs) != motion.simulator.compiler.nominal.nv:
        return None
    acting, acts, read = _split(motion, terms, values[None], {})
    a, inertia = compute_accelerations(
        motion.simulator, acting, acts, motion.moments, read[0].offset[None]
    )
    errors = a[0][:, motion.dofs] - read[0].acceleration
    noise = motion.acceleration_noise
    share = noise**2 / np.maximum(np.median(errors**2, axis=0) / 0.455, noise**2)
    inertia = inertia[0][:, motion.dofs[:, None], motion.dofs]
    return Reference(np.linalg.inv(inertia), share * errors)


def estimate_noise(motion: MeasuredMotion, terms, values, errors) -> Floats:
    """(J + K) standard deviation of the errors that noise of the readings makes."""
    noisy = compute_errors(motion.draw_noise(np.random.default_rng(0)), terms, values)
    change = (noisy[0] - errors).reshape(-1, motion.width)
    return 1.4826 * np.median(np.abs(change), axis=0)


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
                change[name] = {
                    k: np.ravel(v[i])[0].item() for k, v in by_kind.items()
                }
    return out


def differentiate(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    errors: Floats,
    *,
    which: Sequence[int] | None = None,
    reference: Reference | None = None,
) -> Floats:
    """Derivatives (p, R J) of the equation errors by each value.

    Args:
        motion: as measured.
        terms: of the hypothesis.
        values: (P) [units of the parameters].
        errors: (R J) there.
        which: (p) numbers of the values; None: all.
        reference: as `compute_errors` has it.
    """
    chosen = np.arange(len(values)) if which is None else np.array(which, int)
    scale = np.concatenate([t.scale for t in terms])
    high = np.concatenate([t.high for t in terms])
    step = DERIVATIVE_STEP * scale
    step = np.where(values + step > high, -step, step)
    points = np.tile(values, (len(chosen), 1))
    points[np.arange(len(chosen)), chosen] += step[chosen]
    moved = compute_errors(motion, terms, points, reference=reference)
    return (moved - errors) / step[chosen][:, None]


def propose_directions(
    motion: MeasuredMotion,
    terms: Sequence[Term],
    values: Floats,
    errors: Floats,
    candidates: Sequence[Term],
) -> list[Direction]:
    """The directions of all candidates beside a hypothesis.

    Of each candidate there are the derivatives at nominal values, where these are
    finite, and what each of its initial values changes.

    Args:
        motion: as measured.
        terms: of the hypothesis.
        values: (P) of them [units of the parameters].
        errors: (R J) with them.
        candidates: terms that may be added.
    """
    out = []
    for term in candidates:
        nominal = np.array([p.nominal for p in term.parameters])
        for k, i in find_restated(term, terms).items():  # which is no more as given
            nominal[k] *= values[sum(len(t.parameters) for t in terms[:i])]
        points = [np.array(x) for x in dict.fromkeys(term.initial_values)]
        is_finite = bool(np.isfinite(nominal).all())
        inside = np.clip(nominal, term.low, term.high)
        steps = np.diag(DERIVATIVE_STEP * term.scale)
        steps = np.where((inside + np.diag(steps) > term.high)[:, None], -steps, steps)
        tried = np.array([*(inside + steps if is_finite else []), *points])
        beside = np.hstack([np.tile(values, (len(tried), 1)), tried])
        changes = compute_errors(motion, (*terms, term), beside) - errors
        origin = nominal if is_finite else inside
        if is_finite:
            count = len(steps)
            shown = np.linalg.norm(changes[:count], axis=1) > 0
            if shown.any():
                unit = steps[shown] / DERIVATIVE_STEP
                columns = changes[:count][shown] / DERIVATIVE_STEP
                out.append(Direction(term, origin, unit, columns))
            changes, tried = changes[count:], tried[count:]
        groups = [[i] for i in range(len(tried))]
        if term.effect.is_periodic:
            groups = [[i, i + 1] for i in range(0, len(tried) - 1, 2)]
        for group in groups:
            columns = changes[group]
            if not np.linalg.norm(columns, axis=1).all() or not np.isfinite(
                columns
            ).all():
                continue
            known = out[-1] if out and out[-1].term is term else None
            if known is not None and not _is_new(columns, known.columns):
                continue
            start = origin if is_finite else np.full(len(nominal), np.nan)
            unit = tried[group] - start if is_finite else tried[group]
            out.append(Direction(term, start, unit, columns))
    return out


def _is_new(columns: Floats, known: Floats) -> bool:
    """Whether columns (k, n) are no combination of known ones (m, n)."""
    basis, _ = np.linalg.qr(known.T)
    rest = columns - (columns @ basis) @ basis.T
    share = np.linalg.norm(rest, axis=1) / np.linalg.norm(columns, axis=1)
    return bool((share > OWN_SHARE).any())
