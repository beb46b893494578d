"""What sensors round off: takes a fit, gives the signals whose noise is their step."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..data.robot_summary import Channel, RobotSummary
from ..effects.base import Effect, Term
from ..estimation.noise import residual_rms
from .evidence import Evidence
from .hypotheses import Hypothesis, NamedEffect
from .settings import SELECTION


def name_quantization(
    hypothesis: Hypothesis, robot: RobotSummary, effects: Iterable[Effect]
) -> Hypothesis:
    """The same, with the signals named that rounding leaves no other noise in.

    The readings alone tell: all of them are multiples of a step, which is then known
    better than from any fit. It is a name where the error of rounding, uniform within a
    step (Widrow 1956), is most of the readings' noise and much of what the fit leaves.
    """
    problem, final = hypothesis.problem, hypothesis.final
    left = residual_rms(problem, final.fit.residuals) ** 2
    by_name = {c.name: c for c in robot.channels}
    for term in (
        t for e in effects if e.rounds_readings for t in e.propose_terms(robot)
    ):
        signal = by_name[term.places[0]["signal"]]
        noise, column = float(signal.scatter[0]), signal.first_column
        error = signal.quantum**2 / 12
        if (
            error < SELECTION.min_quantization_noise_share * noise**2
            or error < SELECTION.min_quantization_residual_share * left[column]
        ):
            continue
        predicted = np.isfinite(problem.segments.readings[:, column]).sum()
        nats = -np.log(
            2 * SELECTION.quantization_tolerance
        )  # of each reading, that could lie anywhere
        evidence = Evidence(nats, float(np.exp(-nats * predicted)), 1.0)
        named = NamedEffect(_bound_step(term, signal), evidence, ())
        fit = final.fit
        fit = replace(
            fit, terms=(*fit.terms, named.term),
            values=np.append(fit.values, signal.quantum),
            jacobian=np.column_stack([fit.jacobian, np.zeros(len(fit.residuals))]),
        )  # fmt: skip
        final = replace(final, fit=fit)
        hypothesis = replace(hypothesis, final=final, named=(*hypothesis.named, named))
    return hypothesis


def _bound_step(term: Term, signal: Channel) -> Term:
    """The term with the steps that the farthest reading is a multiple of."""
    (step,) = term.parameters
    apart = (
        SELECTION.quantization_tolerance
        * signal.quantum**2
        / max(signal.max_abs, signal.quantum)
    )
    near = replace(step, low=signal.quantum - apart, high=signal.quantum + apart)
    return replace(term, parameters=(near,))
