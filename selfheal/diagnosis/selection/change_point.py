"""When an effect set in: takes fits, gives since when the robot is not as it was."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...recording import Recording, split, whole_of
from ...recording.data import Floats
from ..effects.base import Onset, Term
from ..estimation.covariance import effective_sample_size
from ..estimation.least_squares import Fit, fit_parameters
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import expected_noise_by_segment
from ..estimation.problem import Problem
from ..simulation.simulator import Simulator
from .cross_validation import ScoredFit, fit_and_score
from .evidence import is_as_good
from .settings import SELECTION


def detect_change_point(problem: Problem, found: Fit) -> Onset | None:
    """When pieces begin to show what earlier ones did not; None: they do not.

    What the model states, fitted anew, explains the earlier ones to the noise, and by
    that most of the later ones are far from explained. Poses do not tell the noise.

    Args:
        problem: windows.
        found: what is stated, fitted to all of them.
    """
    if problem.regime.has_single_readings:
        return None
    order = np.lexsort((problem.segments.first_step, problem.segments.episode))
    cuts = _list_cuts(problem.segments.episode[order])
    best, most = None, SELECTION.change_point_error_ratio
    for cut, after in itertools.pairwise([*cuts, len(order)]):
        early = _fit_if_explained(problem, np.sort(order[:cut]), found)
        if early is None:
            break
        ratio = _noise_ratios(problem, early)[order]
        usual = np.quantile(ratio[:cut], SELECTION.change_point_quantile)
        later = ratio[after:] if after < len(order) else ratio[(cut + after) // 2 :]
        if np.median(later) > most * usual:
            most = np.median(later) / usual
            # most between the two look like the early ones up to then
            odd = ratio[cut:after] > np.sqrt(usual * np.median(later))
            wrong = np.append(0, np.cumsum(odd))
            wrong += np.append(np.cumsum(~odd[::-1])[::-1], 0)
            best = cut + int(wrong.argmin())
    if best is None or best == len(order):
        return None
    return _build_onset(problem, order, best, best, best)


def _noise_ratios(problem: Problem, found: Fit) -> Floats:
    """(W) what each window leaves of squares, over what its noise would."""
    problem = replace(problem.unmarginalized, initial_state_shift=None)
    problem = marginalize_initial_states(problem, found.terms, found.values)
    left = problem.sum_by_segment(problem.residuals_at(found.terms, found.values) ** 2)
    return left / np.maximum(expected_noise_by_segment(problem), 1e-12)


def _list_cuts(episode: np.ndarray) -> list[int]:
    """Numbers of windows, in order of time, after which something may have set in."""
    ends = np.flatnonzero(np.diff(episode)) + 1
    cuts = ends[SELECTION.min_explained_episodes - 1 :]
    if not len(cuts):
        cuts = np.unique(
            (
                np.arange(
                    SELECTION.min_explained_share,
                    1,
                    1 / SELECTION.max_change_point_cuts,
                )
                * len(episode)
            ).astype(int)
        )
    return [
        int(cut) for cut in cuts[:: -(-len(cuts) // SELECTION.max_change_point_cuts)]
    ]


def _fit_if_explained(problem: Problem, chosen: np.ndarray, found: Fit) -> Fit | None:
    """A fit to some windows, if most of them show no more than noise and time step."""
    part = problem.select(chosen)
    rows = np.isin(problem.segment_of_residual, chosen)
    best = fit_parameters(
        part, found.terms, found.values, rounds=4, known=found.jacobian[rows]
    )
    of_step = part.timestep_error(best.terms, best.values, best.residuals)
    usual = expected_noise_by_segment(part) + part.sum_by_segment(of_step**2)
    left = part.sum_by_segment(best.residuals**2)
    ratio = np.median(left / np.maximum(usual, 1e-12))
    return best if ratio <= problem.regime.explained_ratio**2 else None


def _build_onset(
    problem: Problem, order: np.ndarray, at: int, low: int, high: int
) -> Onset:
    """At the at-th window in order of time, or from the low-th to the high-th."""
    simulator, segments = problem.simulator, problem.segments
    log = int(segments.episode[order[at]])
    episode = simulator.episodes[log]

    def middle(k: int) -> float:
        """Of a window, as far as it is of the same episode [s]."""
        w = order[min(max(k, 0), len(order) - 1)]
        inside = segments.first_step[w] + segments.lengths[w] / 2
        if segments.episode[w] != log or not 0 <= k < len(order):
            inside = 0.0 if k < at else episode.sample_steps[-1]
        return float(episode.start + inside * simulator.timestep)

    is_first = at == 0 or segments.episode[order[at - 1]] != log
    time = episode.start if is_first else (middle(at - 1) + middle(at)) / 2
    interval = middle(low - 1), middle(high)
    return Onset(episode.number, whole_of(episode.id), time, *interval)


def set_onset(terms: Sequence[Term], onset: Onset | None) -> tuple[Term, ...]:
    """Effects that set in then, or were always there; what is stated always was."""
    return tuple(
        t if t.effect.name == "stated" else replace(t, onset=onset) for t in terms
    )


def locate_change_point(problem: Problem, whole: Problem, now: ScoredFit) -> ScoredFit:
    """The same effects, always there if they may as well have been; else since when.

    Args:
        problem: in whose windows they were fitted.
        whole: all windows, weighed otherwise.
        now: effects that set in somewhen.
    """
    found = now.fit
    always = fit_and_score(
        problem, set_onset(found.terms, None), found.values, rounds=4
    )
    if always.error <= now.error or is_as_good(problem, always, now):
        return always
    whole = replace(whole, sigma=problem.sigma, simulator=problem.simulator)
    whole = marginalize_initial_states(whole, found.terms, found.values)
    onset = _find_likeliest_onset(whole, found)
    return fit_and_score(problem, set_onset(found.terms, onset), found.values, rounds=2)


def _find_likeliest_onset(problem: Problem, found: Fit) -> Onset:
    """When effects set in, by which windows are likelier with them than without."""
    hypotheses = [t for t in found.terms if t.onset]
    apart = [
        problem.residuals_at(set_onset(found.terms, None), found.values),
        problem.residuals_at(*found.without_terms(*hypotheses)),
    ]
    gain = problem.sum_by_segment(apart[1] ** 2) - problem.sum_by_segment(apart[0] ** 2)
    now = problem.residuals_at(found.terms, found.values)
    scale = effective_sample_size(problem, now) / max(float(now @ now), 1e-300)
    order = np.lexsort((problem.segments.first_step, problem.segments.episode))
    nats = scale / 2 * np.append(np.cumsum(gain[order][::-1])[::-1], 0)
    at = int(nats[:-1].argmax())
    likely = np.flatnonzero(nats[:-1] > nats[at] - SELECTION.change_point_interval_nats)
    return _build_onset(problem, order, at, int(likely[0]), int(likely[-1]))


def choose_held_out_after(
    onset: Onset, recordings: Sequence[Recording], held: Simulator
) -> tuple[str, ...]:
    """What to hold out instead, all of it later than an onset.

    Nothing, where what is held out already is, or nothing later was recorded.
    """
    begin = (onset.number, onset.time)
    if all((episode.number, episode.start) >= begin for episode in held.episodes):
        return ()
    names: list[str] = []
    number = 0
    for recording in recordings:
        each = enumerate(recording.episodes.items(), number)
        later = {name: e for i, (name, e) in each if i > onset.number}
        number += len(recording.episodes)
        if later:
            chosen = split(replace(recording, episodes=later))[1].episodes
            several = len(recordings) > 1
            names += [f"{recording.file}:{n}" if several else n for n in chosen]
    return tuple(names)
