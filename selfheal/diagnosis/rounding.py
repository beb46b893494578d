"""What sensors round off: takes a fit, gives the signals whose noise is their step."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from .evidence import Evidence
from .name import Named, Naming
from .noise import left_in
from .scene import Channel, Scene
from .terms import Effect, Term

OFF = 0.05  # of a step, what readings may lie beside its multiples, as `Channel` has it
# share of a reading's noise, and of what a fit leaves, that rounding has to be; chosen
MOST, SOME = 0.5, 0.25


def with_rounding(naming: Naming, scene: Scene, effects: Iterable[Effect]) -> Naming:
    """The same, with the signals named that rounding leaves no other noise in.

    The readings alone tell: all of them are multiples of a step, which is then known
    better than from any fit. It is a name where the error of rounding, uniform within a
    step (Widrow 1956), is most of the readings' noise and much of what the fit leaves.
    """
    problem, final = naming.problem, naming.final
    left = left_in(problem, final.fit.residuals) ** 2
    by_name = {c.name: c for c in scene.signals}
    for term in (t for e in effects if e.rounds for t in e.terms(scene)):
        signal = by_name[term.places[0]["signal"]]
        noise, column = float(signal.scatter[0]), signal.first
        error = signal.lattice**2 / 12
        if error < MOST * noise**2 or error < SOME * left[column]:
            continue
        told = np.isfinite(problem.windows.readings[:, column]).sum()
        nats = -np.log(2 * OFF)  # of each reading, that could lie anywhere
        evidence = Evidence(nats, float(np.exp(-nats * told)), 1.0)
        named = Named(_told(term, signal), evidence, ())
        fit = final.fit
        fit = replace(
            fit, terms=(*fit.terms, named.term),
            values=np.append(fit.values, signal.lattice),
            jacobian=np.column_stack([fit.jacobian, np.zeros(len(fit.residuals))]),
        )  # fmt: skip
        final = replace(final, fit=fit)
        naming = replace(naming, final=final, named=(*naming.named, named))
    return naming


def _told(term: Term, signal: Channel) -> Term:
    """The term with the steps that the farthest reading is a multiple of."""
    (step,) = term.parameters
    apart = OFF * signal.lattice**2 / max(signal.reach, signal.lattice)
    near = replace(step, low=signal.lattice - apart, high=signal.lattice + apart)
    return replace(term, parameters=(near,))
