"""When an effect set in: takes fits, gives since when the robot is not as it was."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..recording import Recording, split, whole_of
from ..recording.data import Floats
from .evidence import ABOVE, LEFT, Scored, as_good, effective, scored
from .fit import Fit, fit
from .noise import noise_by_window
from .problem import Problem, whitened
from .terms import Onset, Term
from .world import World

# least number of episodes, or share of a lone one, that what is stated explains; into
# how many parts those are cut at most that may come before; chosen
WHOLE, PART, CUTS = 2, 0.25, 8
# how much more error most later pieces have than nearly all earlier ones; chosen
MORE, NEARLY = 2.5, 0.9
INSIDE = 1.35  # nats within which an onset is as likely: 90 % of chi-square, halved


def began(problem: Problem, found: Fit) -> Onset | None:
    """When pieces begin to show what earlier ones did not; None: they do not.

    What the model states, fitted anew, explains the earlier ones to the noise, and by
    that most of the later ones are far from explained. Poses do not tell the noise.

    Args:
        problem: windows.
        found: what is stated, fitted to all of them.
    """
    if problem.windows.is_single:
        return None
    order = np.lexsort((problem.windows.start, problem.windows.log))
    cuts = _cuts(problem.windows.log[order])
    best, most = None, MORE
    for cut, after in itertools.pairwise([*cuts, len(order)]):
        early = _explained(problem, np.sort(order[:cut]), found)
        if early is None:
            break
        ratio = _ratios(problem, early)[order]
        usual = np.quantile(ratio[:cut], NEARLY)
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
    return _onset(problem, order, best, best, best)


def _ratios(problem: Problem, found: Fit) -> Floats:
    """(W) what each window leaves of squares, over what its noise would."""
    problem = replace(problem.raw, shift=None)
    problem = whitened(problem, found.terms, found.values)
    left = problem.by_window(problem.at(found.terms, found.values) ** 2)
    return left / np.maximum(noise_by_window(problem), 1e-12)


def _cuts(log: np.ndarray) -> list[int]:
    """Numbers of windows, in order of time, after which something may have set in."""
    ends = np.flatnonzero(np.diff(log)) + 1
    cuts = ends[WHOLE - 1 :]
    if not len(cuts):
        cuts = np.unique((np.arange(PART, 1, 1 / CUTS) * len(log)).astype(int))
    return [int(cut) for cut in cuts[:: -(-len(cuts) // CUTS)]]


def _explained(problem: Problem, chosen: np.ndarray, found: Fit) -> Fit | None:
    """A fit to some windows, if most of them show no more than noise and time step."""
    part = problem.take(chosen)
    rows = np.isin(problem.window_of, chosen)
    best = fit(part, found.terms, found.values, rounds=4, known=found.jacobian[rows])
    of_step = part.of_step(best.terms, best.values, best.residuals)
    usual = noise_by_window(part) + part.by_window(of_step**2)
    left = part.by_window(best.residuals**2)
    most = ABOVE if problem.world.touches else LEFT
    return best if np.median(left / np.maximum(usual, 1e-12)) <= most**2 else None


def _onset(problem: Problem, order: np.ndarray, at: int, low: int, high: int) -> Onset:
    """At the at-th window in order of time, or from the low-th to the high-th."""
    world, windows = problem.world, problem.windows
    log = int(windows.log[order[at]])
    episode = world.logs[log]

    def middle(k: int) -> float:
        """Of a window, as far as it is of the same episode [s]."""
        w = order[min(max(k, 0), len(order) - 1)]
        inside = windows.start[w] + windows.steps[w] / 2
        if windows.log[w] != log or not 0 <= k < len(order):
            inside = 0.0 if k < at else episode.at[-1]
        return float(episode.start + inside * world.step)

    is_first = at == 0 or windows.log[order[at - 1]] != log
    time = episode.start if is_first else (middle(at - 1) + middle(at)) / 2
    interval = middle(low - 1), middle(high)
    return Onset(episode.number, whole_of(episode.id), time, *interval)


def dated(terms: Sequence[Term], onset: Onset | None) -> tuple[Term, ...]:
    """Effects that set in then, or were always there; what is stated always was."""
    return tuple(
        t if t.effect.name == "stated" else replace(t, onset=onset) for t in terms
    )


def placed(problem: Problem, whole: Problem, now: Scored) -> Scored:
    """The same effects, always there if they may as well have been; else since when.

    Args:
        problem: in whose windows they were fitted.
        whole: all windows, weighed otherwise.
        now: effects that set in somewhen.
    """
    found = now.fit
    always = scored(problem, dated(found.terms, None), found.values, rounds=4)
    if always.error <= now.error or as_good(problem, always, now):
        return always
    whole = replace(whole, sigma=problem.sigma, world=problem.world)
    whole = whitened(whole, found.terms, found.values)
    onset = _likeliest(whole, found)
    return scored(problem, dated(found.terms, onset), found.values, rounds=2)


def _likeliest(problem: Problem, found: Fit) -> Onset:
    """When effects set in, by which windows are likelier with them than without."""
    those = [t for t in found.terms if t.onset]
    apart = [
        problem.at(dated(found.terms, None), found.values),
        problem.at(*found.but(*those)),
    ]
    gain = problem.by_window(apart[1] ** 2) - problem.by_window(apart[0] ** 2)
    now = problem.at(found.terms, found.values)
    scale = effective(problem, now) / max(float(now @ now), 1e-300)
    order = np.lexsort((problem.windows.start, problem.windows.log))
    nats = scale / 2 * np.append(np.cumsum(gain[order][::-1])[::-1], 0)
    at = int(nats[:-1].argmax())
    likely = np.flatnonzero(nats[:-1] > nats[at] - INSIDE)
    return _onset(problem, order, at, int(likely[0]), int(likely[-1]))


def held_out_later(
    onset: Onset, recordings: Sequence[Recording], held: World
) -> tuple[str, ...]:
    """What to hold out instead, all of it later than an onset.

    Nothing, where what is held out already is, or nothing later was recorded.
    """
    begin = (onset.number, onset.time)
    if all((log.number, log.start) >= begin for log in held.logs):
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
