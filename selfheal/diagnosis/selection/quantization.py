"""Quantized signals: takes a fit, gives it with the signals whose noise is rounding."""

from dataclasses import replace

import numpy as np

from ..data.robot_summary import Channel, RobotSummary
from ..effects.base import Term
from ..effects.measurement import Quantization
from ..estimation.fit import Fit
from ..estimation.noise import residual_rms
from .hypotheses import Hypothesis, NamedEffect
from .search_state import Evidence
from .settings import SELECTION


def name_quantization(hypothesis: Hypothesis, robot: RobotSummary) -> Hypothesis:
    """Name the signals whose readings are rounded and have little other noise.

    The readings alone tell: all of them are multiples of a step q, which is then known
    better than from any fit. Its error is uniform within a step, with variance q^2 / 12
    (Widrow 1956). It has to be most of the readings' noise and much of the residuals.

    Args:
        hypothesis: with a fit to what the readings were before rounding.
    """
    problem, final = hypothesis.problem, hypothesis.final
    residual = residual_rms(problem, final.residuals) ** 2
    by_name = {c.name: c for c in robot.channels}
    for term in Quantization().propose_terms(robot):
        channel = by_name[term.targets[0].partition(":")[2]]
        noise, column = float(channel.scatter[0]), channel.first_column
        variance = channel.quantum**2 / 12
        if variance < SELECTION.min_quantization_noise_share * noise**2:
            continue
        if variance < SELECTION.min_quantization_residual_share * residual[column]:
            continue
        readings = np.isfinite(problem.segments.readings[:, column]).sum()
        # of each reading, which could lie anywhere within a step
        nats = -np.log(2 * SELECTION.quantization_tolerance)
        evidence = Evidence(nats, float(np.exp(-nats * readings)), 1.0)
        named = NamedEffect(_bound_step(term, channel), evidence, ())
        final = append_step(final, named.term, channel.quantum)
        hypothesis = replace(hypothesis, final=final, named=(*hypothesis.named, named))
    return hypothesis


def append_step(fit: Fit, term: Term, step: float) -> Fit:
    """The fit with the step of a quantized signal, which it does not see.

    Args:
        fit: to readings before they were rounded.
        step: [unit of the signal].
    """
    return replace(
        fit,
        terms=(*fit.terms, term),
        values=np.append(fit.values, step),
        jacobian=np.column_stack([fit.jacobian, np.zeros(len(fit.residuals))]),
    )


def _bound_step(term: Term, channel: Channel) -> Term:
    """The term with bounds of the step, from the reading that is the most steps off.

    q (1 +- tolerance / n), where n = max|reading| / q steps must not drift apart.
    """
    (step,) = term.parameters
    apart = (
        SELECTION.quantization_tolerance
        * channel.quantum**2
        / max(channel.max_abs, channel.quantum)
    )
    bounded = replace(step, low=channel.quantum - apart, high=channel.quantum + apart)
    return replace(term, parameters=(bounded,))
