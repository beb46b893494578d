"""Evidence that a fit is right: takes its residuals, gives what they prove of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..recording.data import Floats
from .fit import Fit, fit_parameters
from .noise import noise_ratio, residual_rms, update_noise_model
from .problem import Problem, marginalize_initial_states
from .scene import repeat_by_column
from .terms import Term
from .trial import LinearizedFit, fit_candidate
from .world import Simulator

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
class ScoredFit:
    """A fit and how well it predicts what it did not see.

    Attributes:
        fit: of all windows.
        held: (W) squared residuals of each window, predicted from the other folds.
        seat: the problem with the starts that its values ask for; None: as it was.
    """

    fit: Fit
    held_out_errors: Floats
    reestimated: Problem | None = None

    @classmethod
    def from_fit(cls, problem: Problem, found: Fit) -> "ScoredFit":
        """With every fold predicted from the others."""
        return cls(found, predict_held_out(problem, found))

    @property
    def error(self) -> float:
        """Of all windows."""
        return self.held_out_errors.sum()

    @property
    def candidate(self) -> Term:
        """The term that was tried."""
        return self.fit.terms[-1]

    @property
    def values(self) -> Floats:
        """Of its parameters."""
        return self.fit.values[len(self.fit.values) - len(self.candidate.parameters) :]


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


def assign_blocks(problem: Problem) -> np.ndarray:
    """(W) block of each window: neighbors in time share one."""
    return (
        np.arange(len(problem.segments))
        * min(BLOCKS, len(problem.segments))
        // len(problem.segments)
    )


def predict_held_out(
    problem: Problem, found: Fit, of: np.ndarray | None = None
) -> Floats:
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
    of = assign_folds(problem) if of is None else of
    base = LinearizedFit.from_fit(problem, found)
    out = np.empty(len(r))
    for fold in np.unique(of):
        rows = of == fold
        _, move = base.drop_residuals(rows)
        own = np.unique(problem.segment_of_residual[rows])
        whole = np.isin(problem.segment_of_residual, own).sum() == rows.sum()
        if whole and not problem.segments.is_single_readings:
            out[rows] = problem.select(own).residuals_at(found.terms, x + move) ** 2
        else:
            out[rows] = (r[rows] + jac[rows] @ move) ** 2
    return problem.sum_by_segment(out)


def assign_folds(problem: Problem) -> np.ndarray:
    """(R) fold of each residual: windows next to each other, or parts of long ones."""
    if len(problem.segments) >= BLOCKS:
        return assign_blocks(problem)[problem.segment_of_residual]
    rows = len(problem.segment_of_residual)
    return np.arange(rows) * BLOCKS // rows


def generalizes_across_episodes(
    problem: Problem, old: Fit, new: Fit, seat: Problem | None = None
) -> bool:
    """Whether `new`, in its seat, predicts whole episodes from the others better.

    Pieces next to each other share what is peculiar to an episode; that also holds a
    name that explains nothing else. Each episode counts by the logarithm of its error:
    of one that alone shows an effect's size the others cannot tell it. Two episodes
    are too few to ask.
    """
    log = problem.segments.episode[problem.segment_of_residual]
    if len(np.unique(log)) < EPISODES:
        return True
    of = problem.segments.episode
    before = np.bincount(of, predict_held_out(problem, old, log))
    after = np.bincount(of, predict_held_out(seat or problem, new, log))
    if problem.segments.is_single_readings:
        return bool(after.sum() < before.sum())
    there = before > 0
    return bool(np.log(after[there] / before[there]).sum() < 0)


def refit_without_folds(
    base: LinearizedFit, found: Sequence[ScoredFit], terms: Sequence[Term]
) -> list[ScoredFit]:
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
    count = len(problem.segments)
    fold = np.arange(count) % min(FOLDS, count)
    worst = np.argsort(
        -np.bincount(fold, problem.sum_by_segment(base.fit.residuals**2))
    )
    tried: list[ScoredFit] = []
    for s in sorted(found, key=lambda s: (len(s.candidate.parameters), s.error)):
        best = EQUAL * min((t.error for t in tried), default=np.inf)
        held = np.zeros(count)
        if s.error >= best:
            continue
        for k in worst:
            seen, unseen = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
            new = fit_candidate(base.select(seen), begin[s.candidate.key])
            rest = problem.select(unseen)
            held[unseen] = rest.sum_by_segment(
                rest.residuals_at(new.terms, new.values) ** 2
            )
            if held.sum() > best:
                break
        else:
            tried.append(ScoredFit(s.fit, held))
    return tried


def fit_and_score(
    problem: Problem, terms: Sequence[Term], start: Floats, **more
) -> ScoredFit:
    """Fit, and predict every fold from the others."""
    return ScoredFit.from_fit(problem, fit_parameters(problem, terms, start, **more))


def improvement_p_value(
    problem: Problem, old: ScoredFit, new: ScoredFit, tried: float
) -> float:
    """p-value that `new` predicts better than `old`, paying for `tried` tries.

    A likelihood ratio of held-out residuals with as many samples as are independent,
    and only where the gain is no single piece's; nor does one piece take a name away:
    also without the block that speaks most for it and the one that does so most against
    it. Of single readings, the less of two.
    """
    from scipy.stats import chi2

    if problem.segments.is_single_readings:
        tries = 1
        nats = min(_log_likelihoods(problem, new) - _log_likelihoods(problem, old))
        nats = nats if old.error > new.error else 0.0
    else:
        block, gains = assign_blocks(problem), old.held_out_errors - new.held_out_errors
        each = np.bincount(block, gains)
        trimmed = ~np.isin(block, [each.argmin(), each.argmax()])
        tries = 2
        nats = max(_steady_gain(problem, old, new, w) for w in (block >= 0, trimmed))
    free = max(1, len(new.fit.values) - len(old.fit.values))
    return float(min(1.0, tries * tried * chi2.sf(2 * max(nats, 0.0), free)))


def _steady_gain(
    problem: Problem, old: ScoredFit, new: ScoredFit, of: np.ndarray
) -> float:
    """Nats by which `new` predicts some windows (W) better; 0 if that is not steady."""
    _, block = np.unique(assign_blocks(problem)[of], return_inverse=True)
    gains = np.bincount(block, (old.held_out_errors - new.held_out_errors)[of])
    if len(gains) < 2 or gains.sum() <= STEADY * gains.std(ddof=1) * len(gains) ** 0.5:
        return 0.0
    ratio = old.held_out_errors[of].sum() / max(new.held_out_errors[of].sum(), 1e-300)
    # the larger residuals are the old ones, and the more alike their neighbors
    r = old.fit.residuals * of[problem.segment_of_residual]
    return float(0.5 * effective_sample_size(problem, r) * np.log(ratio))


def _log_likelihoods(problem: Problem, fit: ScoredFit) -> Floats:
    """Log-likelihoods (2) [nats] of windows' squared residuals, of unknown scale.

    Of a normal error, by which a pose in which the robot tips tells most, and of one
    with Student's tails that a window's columns share, by which it may be an accident.
    The scale of the latter by Lange, Little, Taylor (1989), eq. 6.
    """
    known, held = np.isfinite(problem.segments.readings), fit.held_out_errors
    count = np.zeros(len(held))
    for c in problem.simulator.channels:
        whole = known[:, c.columns].all(axis=1)
        count += (
            np.bincount(problem.segments.segment_of_sample, whole, len(held))
            * c.free_columns
        )
    square = mean = max(held.sum() / count.sum(), 1e-300)
    for _ in range(100):
        weight = (TAILS + count) / (TAILS + held / square)
        square = max(float((weight * held).sum() / count.sum()), FAINT**2 * mean)
    apart = (TAILS + count) / 2 * np.log1p(held / square / TAILS)
    normal = -count.sum() / 2 * np.log(mean)
    return np.array([normal, -count.sum() / 2 * np.log(square) - apart.sum()])


def bic(problem: Problem, fit: ScoredFit) -> float:
    """Log-likelihood [nats] of single readings, for which each number costs (BIC)."""
    readings = np.isfinite(problem.segments.readings).sum()
    price = 0.5 * np.log(readings) * len(fit.fit.values)
    return float(_log_likelihoods(problem, fit)[0] - price)


def is_as_good(
    problem: Problem, other: ScoredFit, lead: ScoredFit, errors: float = 1.0
) -> bool:
    """Whether the windows do not tell that `other` predicts worse than `lead`.

    Where little but noise is left, likelihoods tell, if not by one window alone; a
    model that is wrong for both has to be so by more than it varies.
    """
    if problem.segments.is_single_readings:
        return bic(problem, lead) - bic(problem, other) < errors
    if _is_clearly_likelier(problem, lead, other):
        return False
    apart = np.bincount(
        assign_blocks(problem), other.held_out_errors - lead.held_out_errors
    )
    noise = apart.std(ddof=1) * np.sqrt(len(apart)) if len(apart) > 1 else np.inf
    ratio = other.error / max(lead.error, 1e-300)
    nats = (
        0.5
        * effective_sample_size(problem, lead.fit.residuals)
        * np.log(max(ratio, 1e-300))
    )
    return bool(apart.sum() <= errors * noise and ratio < EQUAL) or bool(nats < errors)


def _is_clearly_likelier(problem: Problem, lead: ScoredFit, other: ScoredFit) -> bool:
    """Whether `other` surely leaves more, by more than `lead` leaves beside noise."""
    rest = np.arange(len(lead.held_out_errors)) != np.argmax(
        other.held_out_errors - lead.held_out_errors
    )
    ratio = other.held_out_errors[rest].sum() / max(
        lead.held_out_errors[rest].sum(), 1e-300
    )
    left = noise_ratio(problem, lead.fit.residuals) ** 2
    nats = (
        0.5
        * effective_sample_size(problem, lead.fit.residuals)
        * np.log(max(ratio, 1e-300))
    )
    return bool(nats > CERTAIN and ratio > max(left, 1 + SLIGHTLY))


def bootstrap_stability(
    problem: Problem, tried: Sequence[ScoredFit], winners: Sequence[ScoredFit]
) -> float:
    """Share of bootstraps of the blocks in which one of the winners comes first."""
    rng = np.random.default_rng(0)
    block = assign_blocks(problem)
    sums = np.array([np.bincount(block, s.held_out_errors) for s in tried])
    draws = rng.integers(sums.shape[1], size=(400, sums.shape[1]))
    first = sums[:, draws].sum(axis=-1).argmin(axis=0)
    keys = {s.candidate.key for s in winners}
    return float(np.mean([tried[i].candidate.key in keys for i in first]))


def effective_sample_size(problem: Problem, r: Floats) -> float:
    """How many independent samples the squared residuals (R) amount to.

    Each column of each window counts by its correlation time; the sum's spread by
    Satterthwaite's (1946) rule.
    """
    width = problem.segments.readings.shape[1]
    r = r.reshape(-1, width)
    edges = np.searchsorted(
        problem.segments.segment_of_sample, np.arange(len(problem.segments) + 1)
    )
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


def downweight_unscored(problem: Problem, found: Fit) -> Floats:
    """Sigma (C), larger where something stays unexplained for what is not scored.

    A fit is a compromise there.
    """
    if noise_ratio(problem, found.residuals) <= LEFT:
        return problem.sigma
    scored = repeat_by_column(problem.simulator.channels, "is_scored")
    return np.where(scored, problem.sigma, UNSCORED * problem.sigma)


def reweight_residuals(problem: Problem, found: Fit) -> Problem:
    """Each column's residuals measured by how large they are now.

    What is heard of the noise changes how far starts are believed, and starts that are
    believed too much leave what is no noise: so it is heard once more.
    """
    residuals = found.residuals
    problem = _weight_by_residuals(
        problem, found, residuals, update_noise_model(problem, residuals)
    )
    if problem.segments.is_single_readings:
        return problem
    residuals = problem.residuals_at(found.terms, found.values)
    world = update_noise_model(problem, residuals)
    if world is problem.simulator:
        return problem
    return _weight_by_residuals(problem, found, residuals, world)


def _weight_by_residuals(
    problem: Problem, found: Fit, residuals: Floats, world: Simulator
) -> Problem:
    """The problem in a world that knows its noise, weighed by residuals (R)."""
    noise = np.concatenate([c.noise for c in world.channels])
    least = np.where(np.isfinite(noise), noise, 0.0)
    sigma = np.maximum(residual_rms(problem, residuals), least)
    sigma = np.where(sigma > 0, sigma, problem.sigma)
    new = replace(problem, sigma=sigma, simulator=world)
    return marginalize_initial_states(new, found.terms, found.values)


def reestimate_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Problem:
    """The problem with starts sought with these values, if any had to be sought.

    A start that was sought without a friction is where a robot without it would have
    begun; a chaotic one then leaves no way to what is true. Where something touches,
    that takes too long.
    """
    if (
        problem.initial_state_shift is None
        or problem.is_nonsmooth
        or problem.segments.is_single_readings
    ):
        return problem
    return marginalize_initial_states(problem, terms, values)


def reestimate_misleading_states(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """The fit with starts sought anew where a window holds its values off.

    Whether a robot sticks or slips at first may hang on a start that was sought with
    other values; those then stay where that window alone would have them. So starts are
    sought with the values that all others ask for.
    """
    for _ in range(0 if problem.segments.is_single_readings else SEATS):
        base, windows = (
            LinearizedFit.from_fit(problem, found),
            range(len(problem.segments)),
        )
        each = [base.drop_residuals(problem.segment_of_residual == w) for w in windows]
        saved, move = max(each, key=lambda x: x[0])
        if saved < HARMS * found.cost:
            break
        values = found.values + move
        new = marginalize_initial_states(problem, found.terms, values)
        tried = fit_parameters(new, found.terms, values, rounds=3, known=found.jacobian)
        if tried.cost > (1 - HARMS) * found.cost:
            break
        problem, found = new, tried
    return problem, found
