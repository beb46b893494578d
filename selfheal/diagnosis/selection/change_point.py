"""Change point: takes fits, gives since when the robot is not as it was before.

Detection is offline, by fits to what came before; the date is that of the largest
cumulative log-likelihood ratio (Page 1954, Hinkley 1970).
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...recording import Recording, split, strip_window
from ...recording.data import Floats
from ..effects.base import Onset, Term
from ..estimation.covariance import effective_sample_size
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import expected_noise_by_segment
from ..estimation.problem import Problem, assign_blocks
from ..estimation.settings import FIT
from ..simulation.simulator import Simulator
from .settings import SELECTION


def detect_change_point(fit: Fit) -> Onset | None:
    """Find since when segments show what earlier ones did not; None: they do not.

    Nominal values are fitted to more and more of the first segments, as long as that
    explains most of them to the noise. At a change point most later segments are then
    far worse than nearly all earlier ones; none is sought once hardly any is. Single
    readings do not tell the noise.

    Args:
        fit: nominal values, fitted to all segments.
    """
    problem = fit.problem
    if problem.regime.has_single_readings:
        return None
    order = np.lexsort((problem.segments.first_step, problem.segments.episode))
    cuts = _list_cuts(problem.segments.episode[order])
    change, largest = None, SELECTION.change_point_error_ratio
    for cut, after in itertools.pairwise([*cuts, len(order)]):
        early = _fit_if_explained(fit, np.sort(order[:cut]))
        if early is None:
            break
        ratios = _noise_ratios(problem, early)[order]
        usual = np.quantile(ratios[:cut], SELECTION.change_point_quantile)
        is_far = ratios[cut:] > SELECTION.change_point_error_ratio * usual
        if np.mean(is_far) < SELECTION.min_changed_share:
            break
        later = ratios[after:] if after < len(order) else ratios[(cut + after) // 2 :]
        if np.median(later) > largest * usual:
            largest = np.median(later) / usual
            # the change lies where fewest segments between the two look like the
            # other side of it
            is_odd = ratios[cut:after] > np.sqrt(usual * np.median(later))
            wrong = np.append(0, np.cumsum(is_odd))
            wrong += np.append(np.cumsum(~is_odd[::-1])[::-1], 0)
            change = cut + int(wrong.argmin())
    if change is None or change == len(order):
        return None
    return _build_onset(problem, order, change, change, change)


def _noise_ratios(problem: Problem, fit: Fit) -> Floats:
    """(W) [1] squared residuals of each segment over those that its noise leaves."""
    problem = problem.with_measured_states
    problem = marginalize_initial_states(problem, fit.terms, fit.values)
    squares = problem.residuals_at(fit.terms, fit.values) ** 2
    noise = expected_noise_by_segment(problem)
    return problem.sum_by_segment(squares) / np.maximum(noise, 1e-12)


def _list_cuts(episode: np.ndarray) -> list[int]:
    """Numbers of segments, in order of time, after which a change is looked for.

    `episode`: (W) of each segment. Cuts lie between episodes, or within a lone one.
    """
    ends = np.flatnonzero(np.diff(episode)) + 1
    cuts = ends[SELECTION.min_explained_episodes - 1 :]
    most = SELECTION.max_change_point_cuts
    if not len(cuts):
        shares = np.arange(SELECTION.min_explained_share, 1, 1 / most)
        cuts = np.unique(np.maximum((shares * len(episode)).astype(int), 1))
    return [int(cut) for cut in cuts[:: -(-len(cuts) // most)]]


def _fit_if_explained(fit: Fit, chosen: np.ndarray) -> Fit | None:
    """Fit some segments; None where most show more than noise and time step.

    Args:
        chosen: (v) numbers of segments.
    """
    part = fit.problem.select(chosen)
    rows = np.isin(fit.problem.segment_of_residual, chosen)
    early = fit_parameters(
        part, fit.terms, fit.values, iterations=4, jacobian=fit.jacobian[rows]
    )
    usual = expected_noise_by_segment(part)
    usual += part.sum_by_segment(early.timestep_error() ** 2)
    squares = part.sum_by_segment(early.residuals**2)
    ratio = np.median(squares / np.maximum(usual, 1e-12))
    return early if ratio <= part.regime.explained_ratio**2 else None


def _build_onset(
    problem: Problem, order: np.ndarray, at: int, low: int, high: int
) -> Onset:
    """The onset at the middle between two segments.

    Args:
        order: (W) their numbers in order of time.
        at: place in that order of the first segment after the change.
        low: the same, where the interval begins.
        high: the same, where it ends.
    """
    simulator, segments = problem.simulator, problem.segments
    number = int(segments.episode[order[at]])
    episode = simulator.episodes[number]

    def middle(k: int) -> float:
        """Middle of the k-th segment, or an end of the episode if not of it [s]."""
        w = order[min(max(k, 0), len(order) - 1)]
        steps = segments.first_step[w] + segments.lengths[w] / 2
        if segments.episode[w] != number or not 0 <= k < len(order):
            steps = 0.0 if k < at else episode.sample_steps[-1]
        return float(episode.start + steps * simulator.timestep)

    is_first = at == 0 or segments.episode[order[at - 1]] != number
    time = episode.start if is_first else (middle(at - 1) + middle(at)) / 2
    interval = middle(low - 1), middle(high)
    return Onset(episode.number, strip_window(episode.id), time, *interval)


def set_onset(terms: Sequence[Term], onset: Onset | None) -> tuple[Term, ...]:
    """Effects that set in at an onset (None: were always there); not nominal terms."""
    return tuple(
        t if t.effect.name == "stated" else replace(t, onset=onset) for t in terms
    )


def locate_change_point(whole: Problem, fit: Fit) -> Fit:
    """Date the onset of effects, or drop it if they may as well always have been there.

    It has to lower the cost by what a parameter more would have to (Schwarz 1978), and
    in sum over the blocks by a standard error.

    Args:
        fit: with effects that set in at some time.
    """
    problem = fit.problem

    def refit(onset: Onset | None, iterations: int) -> Fit:
        """The fit of the effects since then."""
        terms, jacobian = set_onset(fit.terms, onset), fit.jacobian
        return fit_parameters(
            problem, terms, fit.values, iterations=iterations, jacobian=jacobian
        )

    always = refit(None, 4)
    gains = problem.sum_by_segment(always.residuals**2 - fit.residuals**2)
    by_block = np.bincount(assign_blocks(problem), gains)
    samples = effective_sample_size(problem, fit.residuals)
    nats = samples / 2 * np.log(always.cost / max(fit.cost, FIT.tiny))
    error = by_block.std() * np.sqrt(len(by_block))
    if nats < np.log(max(samples, 1)) / 2 or by_block.sum() < error:
        return always
    whole = replace(whole, sigma=problem.sigma, simulator=problem.simulator)
    whole = marginalize_initial_states(whole, fit.terms, fit.values)
    onset = _find_likeliest_onset(whole, fit)
    return refit(onset, 2)


def _find_likeliest_onset(problem: Problem, fit: Fit) -> Onset:
    """The onset of maximum likelihood, and its 90 % profile-likelihood interval.

    Up to a constant, the log-likelihood [nats] of an onset at segment k is

        n / (2 E) * sum over w >= k of (E_w without - E_w with)

    E_w is the squared error of a segment without and with the effects. E is their sum,
    and n the effective sample size.
    """
    dated = [t for t in fit.terms if t.onset]
    with_effects = problem.residuals_at(set_onset(fit.terms, None), fit.values)
    without = problem.residuals_at(*fit.without_terms(*dated))
    gains = problem.sum_by_segment(without**2) - problem.sum_by_segment(with_effects**2)
    residuals = problem.residuals_at(fit.terms, fit.values)
    samples = effective_sample_size(problem, residuals)
    scale = samples / max(float(residuals @ residuals), FIT.tiny)
    order = np.lexsort((problem.segments.first_step, problem.segments.episode))
    nats = scale / 2 * np.append(np.cumsum(gains[order][::-1])[::-1], 0)
    at = int(nats[:-1].argmax())
    limit = nats[at] - SELECTION.change_point_interval_nats
    likely = np.flatnonzero(nats[:-1] > limit)
    return _build_onset(problem, order, at, int(likely[0]), int(likely[-1]))


def choose_held_out_after(
    onset: Onset, recordings: Sequence[Recording], held_out: Simulator
) -> tuple[str, ...]:
    """Names of other episodes to hold out, all of them later than an onset.

    Args:
        held_out: the episodes that are held out now.

    Returns:
        Nothing, where what is held out is later already, or nothing later was recorded.
    """
    begin = (onset.number, onset.time)
    if all((episode.number, episode.start) >= begin for episode in held_out.episodes):
        return ()
    names: list[str] = []
    number = 0
    for recording in recordings:
        numbered = enumerate(recording.episodes.items(), number)
        later = {name: e for i, (name, e) in numbered if i > onset.number}
        number += len(recording.episodes)
        if later:
            chosen = split(replace(recording, episodes=later))[1].episodes
            several = len(recordings) > 1
            names += [f"{recording.file}:{n}" if several else n for n in chosen]
    return tuple(names)
