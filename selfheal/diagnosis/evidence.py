"""Evidence that a fit is right: takes its residuals, gives what they prove of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..recording.data import Floats
from .fit import Fit, fit
from .noise import above, heard, left_in
from .problem import Problem, whitened
from .scene import by_column
from .terms import Term
from .trial import Base, try_term
from .world import World

BLOCKS = 24  # at most, of neighboring windows, each predicted from the others; chosen
EPISODES = 3  # at least, each to be predicted from the others; chosen
STEADY = 1.0  # standard errors over the blocks that a gain must exceed; chosen
ABOVE = 2.0  # times the noise that an unexplained residual must be, to be one; chosen
LEFT = 1.3  # times the noise, beside names that may stand for others; chosen
UNSCORED = 4.0  # times as far off may be what is not scored; chosen
TAILS = 4.0  # degrees of freedom of single readings' errors (Lange et al. 1989)
FOLDS = 6  # of single readings, each predicted by a fit of its own; chosen
# nats of likelihood, and of a squared error, by which another fit is surely not as good
CERTAIN, SLIGHTLY = 5.0, 0.02
EQUAL = 1.5  # times another's error, above which a fit is not as good; chosen
# of `reseated`: share of the cost that all other windows would save without one, above
# which its start may be wrong, and of the cost, what starts sought anew have to save;
# and how many such windows are looked at; chosen
HARMS, SEATS = 0.01, 2
FAINT = 0.1  # of the residuals' size, what is smaller is no smaller; chosen


@dataclass(frozen=True, eq=False)
class Scored:
    """A fit and how well it predicts what it did not see.

    Attributes:
        fit: of all windows.
        held: (W) squared residuals of each window, predicted from the other folds.
        seat: the problem with the starts that its values ask for; None: as it was.
    """

    fit: Fit
    held: Floats
    seat: Problem | None = None

    @classmethod
    def of(cls, problem: Problem, found: Fit) -> "Scored":
        """With every fold predicted from the others."""
        return cls(found, held_out(problem, found))

    @property
    def error(self) -> float:
        """Of all windows."""
        return self.held.sum()

    @property
    def last(self) -> Term:
        """The term that was tried."""
        return self.fit.terms[-1]

    @property
    def values(self) -> Floats:
        """Of its parameters."""
        return self.fit.values[len(self.fit.values) - len(self.last.parameters) :]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Why an effect is named.

    Attributes:
        gain: nats per effective sample that it adds to held-out predictions.
        p_value: of that gain, corrected for all candidates tried.
        stability: share of resamples of the windows in which it, or what cannot be
            told from it, comes first.
    """

    gain: float
    p_value: float
    stability: float


def blocks_of(problem: Problem) -> np.ndarray:
    """(W) block of each window: neighbors in time share one."""
    return (
        np.arange(len(problem.windows))
        * min(BLOCKS, len(problem.windows))
        // len(problem.windows)
    )


def held_out(problem: Problem, found: Fit, of: np.ndarray | None = None) -> Floats:
    """(W) squared residuals of each fold, with the values that the others ask for.

    These by one Gauss-Newton step from the fit of all; with them folds of whole windows
    are simulated, for where something touches a small step changes much. Parts of a
    window answer linearly, and so do single readings, which `refitted` looks at.

    Args:
        problem: that was fitted.
        found: its fit.
        of: (R) fold of each residual; by default one of `BLOCKS` stretches of time.
    """
    x, jac, r = found.values, found.jacobian, found.residuals
    of = folds_of(problem) if of is None else of
    base = Base.of(problem, found)
    out = np.empty(len(r))
    for fold in np.unique(of):
        rows = of == fold
        _, move = base.without(rows)
        own = np.unique(problem.window_of[rows])
        whole = np.isin(problem.window_of, own).sum() == rows.sum()
        if whole and not problem.windows.is_single:
            out[rows] = problem.take(own).at(found.terms, x + move) ** 2
        else:
            out[rows] = (r[rows] + jac[rows] @ move) ** 2
    return problem.by_window(out)


def folds_of(problem: Problem) -> np.ndarray:
    """(R) fold of each residual: windows next to each other, or parts of long ones."""
    if len(problem.windows) >= BLOCKS:
        return blocks_of(problem)[problem.window_of]
    rows = len(problem.window_of)
    return np.arange(rows) * BLOCKS // rows


def carries_over(
    problem: Problem, old: Fit, new: Fit, seat: Problem | None = None
) -> bool:
    """Whether `new`, in its seat, predicts whole episodes from the others better.

    Pieces next to each other share what is peculiar to an episode; that also holds a
    name that explains nothing else. Each episode counts by the logarithm of its error:
    of one that alone shows an effect's size the others cannot tell it. Two episodes
    are too few to ask.
    """
    log = problem.windows.log[problem.window_of]
    if len(np.unique(log)) < EPISODES:
        return True
    of = problem.windows.log
    before = np.bincount(of, held_out(problem, old, log))
    after = np.bincount(of, held_out(seat or problem, new, log))
    if problem.windows.is_single:
        return bool(after.sum() < before.sum())
    there = before > 0
    return bool(np.log(after[there] / before[there]).sum() < 0)


def refitted(
    base: Base, found: Sequence[Scored], terms: Sequence[Term]
) -> list[Scored]:
    """Fits with one more term than the base, the term fitted anew without each fold.

    Where a robot that holds a pose rests on other feet, one step from the fit of all
    knows too much of what it did not see. A fit that turns out to be worse than another
    is left out.

    Args:
        base: the fit without it.
        found: of all windows.
        terms: theirs are among them, as a search begins with them.
    """
    problem, begin = base.problem, {t.key: t for t in terms}
    count = len(problem.windows)
    fold = np.arange(count) % min(FOLDS, count)
    worst = np.argsort(-np.bincount(fold, problem.by_window(base.fit.residuals**2)))
    tried: list[Scored] = []
    for s in sorted(found, key=lambda s: (len(s.last.parameters), s.error)):
        best = EQUAL * min((t.error for t in tried), default=np.inf)
        held = np.zeros(count)
        if s.error >= best:
            continue
        for k in worst:
            seen, unseen = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
            new = try_term(base.take(seen), begin[s.last.key])
            rest = problem.take(unseen)
            held[unseen] = rest.by_window(rest.at(new.terms, new.values) ** 2)
            if held.sum() > best:
                break
        else:
            tried.append(Scored(s.fit, held))
    return tried


def scored(problem: Problem, terms: Sequence[Term], start: Floats, **more) -> Scored:
    """Fit, and predict every fold from the others."""
    return Scored.of(problem, fit(problem, terms, start, **more))


def better(problem: Problem, old: Scored, new: Scored, tried: float) -> float:
    """p-value that `new` predicts better than `old`, paying for `tried` tries.

    A likelihood ratio of held-out residuals with as many samples as are independent,
    and only where the gain is no single piece's; nor does one piece take a name away:
    also without the block that speaks most for it and the one that does so most against
    it. Of single readings, the less of two.
    """
    from scipy.stats import chi2

    if problem.windows.is_single:
        tries = 1
        nats = min(_likelihoods(problem, new) - _likelihoods(problem, old))
        nats = nats if old.error > new.error else 0.0
    else:
        block, gains = blocks_of(problem), old.held - new.held
        each = np.bincount(block, gains)
        trimmed = ~np.isin(block, [each.argmin(), each.argmax()])
        tries = 2
        nats = max(_gained(problem, old, new, w) for w in (block >= 0, trimmed))
    free = max(1, len(new.fit.values) - len(old.fit.values))
    return float(min(1.0, tries * tried * chi2.sf(2 * max(nats, 0.0), free)))


def _gained(problem: Problem, old: Scored, new: Scored, of: np.ndarray) -> float:
    """Nats by which `new` predicts some windows (W) better; 0 if that is not steady."""
    _, block = np.unique(blocks_of(problem)[of], return_inverse=True)
    gains = np.bincount(block, (old.held - new.held)[of])
    if len(gains) < 2 or gains.sum() <= STEADY * gains.std(ddof=1) * len(gains) ** 0.5:
        return 0.0
    ratio = old.held[of].sum() / max(new.held[of].sum(), 1e-300)
    # the larger residuals are the old ones, and the more alike their neighbors
    r = old.fit.residuals * of[problem.window_of]
    return float(0.5 * effective(problem, r) * np.log(ratio))


def _likelihoods(problem: Problem, fit: Scored) -> Floats:
    """Log-likelihoods (2) [nats] of windows' squared residuals, of unknown scale.

    Of a normal error, by which a pose in which the robot tips tells most, and of one
    with Student's tails that a window's columns share, by which it may be an accident.
    The scale of the latter by Lange, Little, Taylor (1989), eq. 6.
    """
    known, held = np.isfinite(problem.windows.readings), fit.held
    count = np.zeros(len(held))
    for c in problem.world.signals:
        whole = known[:, c.columns].all(axis=1)
        count += np.bincount(problem.windows.window, whole, len(held)) * c.freedom
    square = mean = max(held.sum() / count.sum(), 1e-300)
    for _ in range(100):
        weight = (TAILS + count) / (TAILS + held / square)
        square = max(float((weight * held).sum() / count.sum()), FAINT**2 * mean)
    apart = (TAILS + count) / 2 * np.log1p(held / square / TAILS)
    normal = -count.sum() / 2 * np.log(mean)
    return np.array([normal, -count.sum() / 2 * np.log(square) - apart.sum()])


def economy(problem: Problem, fit: Scored) -> float:
    """Log-likelihood [nats] of single readings, for which each number costs (BIC)."""
    readings = np.isfinite(problem.windows.readings).sum()
    price = 0.5 * np.log(readings) * len(fit.fit.values)
    return float(_likelihoods(problem, fit)[0] - price)


def as_good(problem: Problem, other: Scored, lead: Scored, errors: float = 1.0) -> bool:
    """Whether the windows do not tell that `other` predicts worse than `lead`.

    Where little but noise is left, likelihoods tell, if not by one window alone; a
    model that is wrong for both has to be so by more than it varies.
    """
    if problem.windows.is_single:
        return economy(problem, lead) - economy(problem, other) < errors
    if _is_likelier(problem, lead, other):
        return False
    apart = np.bincount(blocks_of(problem), other.held - lead.held)
    noise = apart.std(ddof=1) * np.sqrt(len(apart)) if len(apart) > 1 else np.inf
    ratio = other.error / max(lead.error, 1e-300)
    nats = 0.5 * effective(problem, lead.fit.residuals) * np.log(max(ratio, 1e-300))
    return bool(apart.sum() <= errors * noise and ratio < EQUAL) or bool(nats < errors)


def _is_likelier(problem: Problem, lead: Scored, other: Scored) -> bool:
    """Whether `other` surely leaves more, by more than `lead` leaves beside noise."""
    rest = np.arange(len(lead.held)) != np.argmax(other.held - lead.held)
    ratio = other.held[rest].sum() / max(lead.held[rest].sum(), 1e-300)
    left = above(problem, lead.fit.residuals) ** 2
    nats = 0.5 * effective(problem, lead.fit.residuals) * np.log(max(ratio, 1e-300))
    return bool(nats > CERTAIN and ratio > max(left, 1 + SLIGHTLY))


def stability(
    problem: Problem, tried: Sequence[Scored], winners: Sequence[Scored]
) -> float:
    """Share of bootstraps of the blocks in which one of the winners comes first."""
    rng = np.random.default_rng(0)
    block = blocks_of(problem)
    sums = np.array([np.bincount(block, s.held) for s in tried])
    draws = rng.integers(sums.shape[1], size=(400, sums.shape[1]))
    first = sums[:, draws].sum(axis=-1).argmin(axis=0)
    keys = {s.last.key for s in winners}
    return float(np.mean([tried[i].last.key in keys for i in first]))


def effective(problem: Problem, r: Floats) -> float:
    """How many independent samples the squared residuals (R) amount to.

    Each column of each window counts by its correlation time; the sum's spread by
    Satterthwaite's (1946) rule.
    """
    width = problem.windows.readings.shape[1]
    r = r.reshape(-1, width)
    edges = np.searchsorted(problem.windows.window, np.arange(len(problem.windows) + 1))
    energy, spread = 0.0, 0.0
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        for x in r[a:b].T:
            size = float(x @ x)
            if size > 0:
                energy += size
                spread += size**2 / (len(x) / _correlation_time(x))
    return energy**2 / spread if spread else 0.0


def _correlation_time(x: Floats) -> float:
    """Integrated correlation time of a series [samples], about zero."""
    n = len(x)
    if n < 4:
        return float(n)
    power = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    rho = np.fft.irfft(power)[:n]
    rho = rho / rho[0]
    end = int(np.argmax(rho <= 0)) or n
    return float(min(n, 1 + 2 * rho[1:end].sum()))


def for_score(problem: Problem, found: Fit) -> Floats:
    """Sigma (C), larger where something stays unexplained for what is not scored.

    A fit is a compromise there.
    """
    if above(problem, found.residuals) <= LEFT:
        return problem.sigma
    scored = by_column(problem.world.signals, "scored")
    return np.where(scored, problem.sigma, UNSCORED * problem.sigma)


def reweighed(problem: Problem, found: Fit) -> Problem:
    """Each column's residuals measured by how large they are now.

    What is heard of the noise changes how far starts are believed, and starts that are
    believed too much leave what is no noise: so it is heard once more.
    """
    residuals = found.residuals
    problem = _weighed(problem, found, residuals, heard(problem, residuals))
    if problem.windows.is_single:
        return problem
    residuals = problem.at(found.terms, found.values)
    world = heard(problem, residuals)
    if world is problem.world:
        return problem
    return _weighed(problem, found, residuals, world)


def _weighed(problem: Problem, found: Fit, residuals: Floats, world: World) -> Problem:
    """The problem in a world that knows its noise, weighed by residuals (R)."""
    noise = np.concatenate([c.noise for c in world.signals])
    least = np.where(np.isfinite(noise), noise, 0.0)
    sigma = np.maximum(left_in(problem, residuals), least)
    sigma = np.where(sigma > 0, sigma, problem.sigma)
    new = replace(problem, sigma=sigma, world=world)
    return whitened(new, found.terms, found.values)


def seated(problem: Problem, terms: Sequence[Term], values: Floats) -> Problem:
    """The problem with starts sought with these values, if any had to be sought.

    A start that was sought without a friction is where a robot without it would have
    begun; a chaotic one then leaves no way to what is true. Where something touches,
    that takes too long.
    """
    if problem.shift is None or problem.is_rough or problem.windows.is_single:
        return problem
    return whitened(problem, terms, values)


def reseated(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """The fit with starts sought anew where a window holds its values off.

    Whether a robot sticks or slips at first may hang on a start that was sought with
    other values; those then stay where that window alone would have them. So starts are
    sought with the values that all others ask for.
    """
    for _ in range(0 if problem.windows.is_single else SEATS):
        base, windows = Base.of(problem, found), range(len(problem.windows))
        each = [base.without(problem.window_of == w) for w in windows]
        saved, move = max(each, key=lambda x: x[0])
        if saved < HARMS * found.cost:
            break
        values = found.values + move
        new = whitened(problem, found.terms, values)
        tried = fit(new, found.terms, values, rounds=3, known=found.jacobian)
        if tried.cost > (1 - HARMS) * found.cost:
            break
        problem, found = new, tried
    return problem, found
