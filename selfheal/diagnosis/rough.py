"""Fits where something touches: takes one, gives a better one and its problem."""

from functools import partial

import numpy as np

from ..recording.data import Floats
from .fit import Fit, believed, bounds, step
from .memory import Answer
from .problem import Problem, whitened
from .terms import Term

# rounds at most; simulations begun a hair apart, of which each slope and cost is the
# mean, and how many of a robot of which so much is stated that one round takes all of
# the time; steps of simulation in all, times degrees of freedom (a minute, about); and
# the shares of a step that are tried (more than all of it, for roughness makes slopes
# steeper); chosen
ROUNDS, JOLTS, FEW, EFFORT, SHARES = 8, 4, 2, 6e7, (2.0, 1.0, 0.5)


def eased(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """A fit, moved on over what is rough.

    After an impact readings jump at whatever change, by as much at a small as at a
    large one, and a slope tells of that jump: too steep, in every direction. So slopes
    are taken over a whole scale, and each is the mean of several that begin a hair
    apart, as each cost is (randomized smoothing, Duchi et al. 2012). Starts that were
    sought with other values hold these: they are sought anew for every step.
    """
    terms, values, jac = found.terms, found.values, found.jacobian
    if not len(values):
        return problem, found
    steps = problem.windows.steps.sum() * problem.world.workshop.given.nv
    each = steps * JOLTS * (len(values) + 2 + len(SHARES))
    kicks = JOLTS if each < EFFORT else FEW
    for i in range(max(1, int(min(ROUNDS, EFFORT // each)))):
        seat = whitened(problem, terms, values)
        hairs = seat.hairs(kicks, np.random.default_rng(i))
        work_out = partial(_round, seat, terms, values, hairs)
        new, slopes = seat.recall(("eased", terms, values, i), work_out)
        problem, jac, values = seat, slopes, new
    seat = whitened(problem, terms, values)
    return seat, Fit(terms, values, seat.at(terms, values), problem.carried(seat, jac))


def _round(problem: Problem, terms: tuple[Term, ...], x: Floats, hairs) -> Answer:
    """Values after one step, or the same ones; and the slopes there, a mean."""
    low, high, scale = bounds(terms)
    weights = believed(terms)

    def told(points: Floats) -> Floats:
        """(n, len(hairs), R) residuals."""
        rows = np.repeat(points, len(hairs), axis=0)
        found = problem.residuals(terms, rows, np.tile(hairs, (len(points), 1, 1)))
        return found.reshape(len(points), len(hairs), -1)

    r = told(x[None])[0].mean(axis=0)
    moves = np.where(x + scale > high, -scale, scale)
    ends = [told(point[None])[0].mean(axis=0) for point in x + np.diag(moves)]
    jac = (np.array(ends) - r).T / moves
    h, g = jac.T @ jac + np.diag(weights), jac.T @ r + weights * (x - 1)
    move = step(h, g, low - x, high - x, scale)
    points = np.clip(x + np.append(0.0, SHARES)[:, None] * move, low, high)
    pull = ((points - 1) ** 2) @ weights
    costs = (told(points) ** 2).sum(axis=2).mean(axis=1) + pull
    return points[int(np.argmin(costs))], jac
