"""Stated values that a patch need not change: takes fits, gives fits that change less.

A value goes back to what the model states where the data do not contradict that, and
has no more digits than they support.
"""

from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.nominal import NominalParameter
from ..estimation.covariance import standard_errors
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_by_updates
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.quadratic_model import is_stated, stack_bounds
from ..estimation.settings import FIT
from ..simulation.model_variants import split_values
from .hypotheses import Hypothesis
from .settings import SELECTION


def fix_effects(fit: Fit) -> tuple[Term, ...]:
    """The terms of a fit with bounds that leave effects no other values than theirs."""
    each = fit.values_by_term.items()
    return tuple(t if t.effect.name == "stated" else _fix(t, v) for t, v in each)


def _fix(term: Term, values: Floats) -> Term:
    """The term with bounds that leave its parameters no other values than these (p)."""
    parameters = tuple(
        replace(p, low=float(v), high=float(v))
        for p, v in zip(term.parameters, values, strict=True)
    )
    return replace(term, parameters=parameters)


def hold_stated(hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis fitted again with every stated value as the model states it."""

    def hold(fit: Fit) -> Fit:
        """The fit of the effects alone."""
        return _fit_restored(fit, np.flatnonzero(is_stated(fit.terms)), 3)

    nominal, final = (hold(fit) for fit in (hypothesis.nominal, hypothesis.final))
    return replace(hypothesis, nominal=nominal, final=final)


def release_bounds(fit: Fit) -> Fit:
    """The fit with stated values at their bounds as the model states them.

    All others are fitted again, effects too. At a bound the data ask for something
    else than the value.
    """
    while True:
        at_bound = [
            t.effect.name == "stated" and t.is_at_bound(v) and bool((v != 1).any())
            for t, v in fit.values_by_term.items()
        ]
        columns = np.repeat(at_bound, [len(t.parameters) for t in fit.terms])
        if not columns.any():
            return fit
        fit = _fit_restored(fit, np.flatnonzero(columns), 6)


def restore_stated(base: LinearizedFit, errors: Floats) -> LinearizedFit:
    """Give back to the model what the data do not contradict, and round the rest.

    A stated value returns if what the model states lies in its interval, given what has
    returned before. What costs least comes first, and all others are fitted again.
    Those that are left have the digits that their intervals support. Effects keep their
    values.

    Args:
        base: a fit of stated values and effects.
        errors: (P) standard errors of its values [1].
    """
    terms, half = base.fit.terms, FIT.interval_standard_errors * errors
    restored = _find_restorable(base, FIT.interval_factor * half)
    fit = replace(base.fit, terms=fix_effects(base.fit))
    less = _fit_restored(fit, restored, 4) if restored.size else fit
    half = np.where(np.isin(np.arange(len(half)), restored), 0.0, half)
    values = _round(LinearizedFit.from_fit(less), half, is_stated(terms))
    return LinearizedFit.from_fit(replace(less, terms=terms, values=values))


def round_effects(hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis with its effects' values in the digits that intervals support.

    Those that change nothing, such as a shift along a joint's axis, are nominal.
    """
    fit = _reset_idle(hypothesis.final)
    errors = standard_errors(fit)
    half = FIT.interval_factor * FIT.interval_standard_errors * errors
    values = _round(LinearizedFit.from_fit(fit), half, ~is_stated(fit.terms))
    residuals = fit.residuals + fit.jacobian @ (values - fit.values)
    rounded = replace(fit, values=values, residuals=residuals)
    return replace(hypothesis, final=rounded)


def _reset_idle(fit: Fit) -> Fit:
    """The fit with nominal values where these change no residual.

    A stop that is never met has no slope either, but may be where another one is met.
    """
    low, high, _ = stack_bounds(fit.terms)
    nominal = np.array([p.nominal for t in fit.terms for p in t.parameters], float)
    reach = np.linalg.norm(fit.jacobian, axis=0) * (high - low)
    is_idle = (reach < 1) & np.isfinite(nominal) & ~is_stated(fit.terms)
    idle = np.flatnonzero(is_idle & (nominal != fit.values))
    values, points = fit.values.copy(), np.tile(fit.values, (len(idle), 1))
    points[np.arange(len(idle)), idle] = nominal[idle]
    if len(idle):
        moved = fit.problem.compute_residuals(fit.terms, points)
        idle = idle[np.linalg.norm(moved - fit.residuals, axis=1) < 1]
    values[idle] = nominal[idle]
    return replace(fit, values=values)


def _find_restorable(base: LinearizedFit, half: Floats) -> np.ndarray:
    """Numbers of the stated values that return to what the model states.

    Backward elimination by the quadratic model of the cost beside the effects, which
    stay: with C = H^-1 and deviations d = x - 1, value i returns at a cost of
    d_i^2 / C_ii, and the others then move by -C_i d_i / C_ii. Its interval shrinks as
    the root of C_ii.

    Args:
        half: (P) half the interval of each value.
    """
    fit = base.fit
    stated = np.flatnonzero(is_stated(fit.terms))
    deviation = fit.values[stated] - 1
    covariance = np.linalg.pinv(base.curvature[np.ix_(stated, stated)], hermitian=True)
    whole = np.maximum(np.diagonal(covariance), FIT.tiny)
    is_open = np.ones(len(stated), bool)
    found = []
    while True:
        variance = np.maximum(np.diagonal(covariance), FIT.tiny)
        reach = np.nan_to_num(half[stated]) * np.sqrt(variance / whole)
        returns = is_open & (np.abs(deviation) <= reach)
        if not returns.any():
            break
        i = int(np.where(returns, deviation**2 / variance, np.inf).argmin())
        is_open[i] = False
        found.append(stated[i])
        response = covariance[i] / variance[i]
        deviation = deviation - response * deviation[i]
        covariance = covariance - np.outer(response, covariance[i])
    return np.array(found, int)


def _fit_restored(fit: Fit, restored: np.ndarray, iterations: int) -> Fit:
    """Fit again with some stated values as the model states them.

    Args:
        iterations: of the fit, at most.
    """
    base = LinearizedFit.from_fit(fit)
    values = fit.values + base.move(restored, 1 - fit.values[restored])
    is_restored = np.isin(np.arange(len(values)), restored)
    each = zip(
        fit.terms, split_values(fit.terms, is_restored.astype(float)), strict=True
    )
    terms = [_fix(t, np.ones(len(r))) if r.any() else t for t, r in each]
    return fit_by_updates(fit.problem, terms, values, iterations, fit.jacobian)


def _round(base: LinearizedFit, half: Floats, chosen: np.ndarray) -> Floats:
    """Values (P) of a fit, some of them in the digits that their intervals support.

    A value is rounded as it is stated, a factor of it not. Where the values are known
    far better together than one by one, they get more digits.

    Args:
        half: (P) half the interval of each value; 0 or infinite: not to be rounded.
        chosen: (P) which ones.
    """
    fit = base.fit
    low, high, _ = stack_bounds(fit.terms)
    effects = [t.effect for t in fit.terms for _ in t.parameters]
    unit = np.array(
        [e.value if isinstance(e, NominalParameter) else 1.0 for e in effects]
    )
    coarsest = half * np.abs(unit) * SELECTION.max_rounding_step
    chosen = chosen & np.isfinite(half) & (coarsest > 0)
    coarsest = np.log10(np.where(chosen, coarsest, 1.0))
    for more in range(SELECTION.max_extra_digits):
        rounded = fit.values.copy()
        for i in np.flatnonzero(chosen):
            places = more - int(np.floor(coarsest[i]))
            rounded[i] = round(float(fit.values[i] * unit[i]), places) / unit[i]
        rounded = np.where((low <= rounded) & (rounded <= high), rounded, fit.values)
        change = rounded - fit.values
        cost = 2 * base.gradient @ change + change @ base.curvature @ change
        if cost < SELECTION.max_rounding_cost * (fit.cost + fit.prior_penalty):
            return rounded
    return fit.values
