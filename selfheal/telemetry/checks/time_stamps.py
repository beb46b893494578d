"""Faults of time: takes an episode's time stamps, finds gaps, bursts and jitter."""

from collections.abc import Iterator, Mapping

import numpy as np

from ...recording.data import Episode, Floats
from ..context import Context
from ..fault import Fault

MIN_SAMPLES = 30  # of an episode; chosen
# sampling times without a sample that are a gap, and least length of one [s]; chosen
GAP_STEPS, GAP_SECONDS = 8.0, 0.1
# of a sampling time, below which two samples are one that was written twice, and share
# of an episode's samples that are; chosen
DUPLICATE_STEPS, DUPLICATE_SHARE = 0.02, 0.002
# standard deviation of the times from sample to sample, in sampling times, beyond
# which stamps are doubted; chosen: more than uniform jitter of 35 % to each side
JITTER = 0.4


def find(context: Context) -> Iterator[Fault]:
    """Gaps, duplicates and jitter of the time stamps."""
    found: dict[str, list[tuple[float, str, str]]] = {}
    for name, episode in context.recording.episodes.items():
        if episode.time.size >= MIN_SAMPLES:
            for kind, (size, said) in _examine(episode).items():
                found.setdefault(kind, []).append((size, name, said))
    for kind, cases in found.items():
        _, worst, said = max(cases, key=lambda c: c[0])
        correction = {
            "gap": f"split the episode {worst!r} at the gap",
            "duplicate": "leave out the rows that repeat a time",
            "jitter": "[time] rate = HZ in the map, if the rows were taken evenly",
        }[kind]
        ids, seen = tuple(name for _, name, _ in cases), f"episode {worst!r}: {said}"
        yield Fault(kind, ids, (), "", seen, corrections=(correction,))


def _examine(episode: Episode) -> Mapping[str, tuple[float, str]]:
    """By kind: how bad it is, and a sentence."""
    steps = np.diff(episode.time)
    usual = float(np.median(steps))
    out: dict[str, tuple[float, str]] = {}
    longest = int(np.argmax(steps))
    gaps = steps > max(GAP_STEPS * usual, GAP_SECONDS)
    if gaps.any():
        out["gap"] = (
            float(steps[longest]),
            f"{gaps.sum()} gaps, the longest {steps[longest]:.3g} s from "
            f"{episode.time[longest]:.6g} s on, where samples usually come each "
            f"{1e3 * usual:.3g} ms",
        )
    twice = steps < DUPLICATE_STEPS * usual
    if twice.mean() > DUPLICATE_SHARE:
        out["duplicate"] = (
            float(twice.mean()),
            f"{100 * twice.mean():.2g} % of samples come less than "
            f"{1e3 * DUPLICATE_STEPS * usual:.2g} ms after the one before",
        )
    rest = steps[~gaps & ~twice]
    spread = float(np.std(rest) / usual)
    if spread > JITTER and _is_even_instead(episode):
        out["jitter"] = (
            spread,
            f"times from sample to sample vary by {100 * spread:.0f} % of "
            f"{1e3 * usual:.3g} ms, and the readings are smoother at even times",
        )
    return out


def _is_even_instead(episode: Episode) -> bool:
    """Whether readings are smoother at even times than at the stamps."""
    even = np.linspace(episode.time[0], episode.time[-1], episode.time.size)
    better = []
    for signal in episode.signals.values():
        for x in signal.values.reshape(episode.time.size, -1).T:
            read = np.isfinite(x)
            if read.sum() > MIN_SAMPLES and np.std(x[read]) > 0:
                stamped = _roughness(episode.time[read], x[read])
                better.append(_roughness(even[read], x[read]) < stamped / 2)
    return bool(better) and float(np.mean(better)) > 0.5


def _roughness(time: Floats, x: Floats) -> float:
    """Mean square of what a parabola through both neighbors misses."""
    t0, t1, t2, t3 = time[:-3], time[1:-2], time[2:-1], time[3:]
    w0 = (t1 - t2) * (t1 - t3) / ((t0 - t2) * (t0 - t3))
    w2 = (t1 - t0) * (t1 - t3) / ((t2 - t0) * (t2 - t3))
    w3 = (t1 - t0) * (t1 - t2) / ((t3 - t0) * (t3 - t2))
    miss = x[1:-2] - w0 * x[:-3] - w2 * x[2:-1] - w3 * x[3:]
    weight = 1 + w0**2 + w2**2 + w3**2
    return float(np.median(miss**2 / weight))
