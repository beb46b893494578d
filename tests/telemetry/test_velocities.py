"""A velocity that is no derivative is told, and noise is not taken for one."""

import numpy as np

from selfheal.telemetry.comparisons import Comparison, find_disagreements
from selfheal.telemetry.series import Series

ROWS = 600  # of an episode


def _find(slopes, noise):
    """Kinds and episodes of what contradicts slopes (N) seen with noise."""
    episode = np.arange(len(slopes)) // ROWS
    ids = tuple(str(i) for i in range(episode[-1] + 1))
    series = Series(0.01, 0.025, episode, np.arange(len(slopes)) // 100, ids, {}, {})
    rng = np.random.default_rng(2)
    read = slopes["read"] + noise * rng.normal(size=len(slopes))
    pair = Comparison(
        "velocity",
        series,
        {"j": slopes["true"]},
        {"j": read},
        range(-3, 4),
        20,
        1.0,
        frozenset(["j"]),
    )
    return [(d.kind, d.episodes) for d in find_disagreements(pair)]


def _sines(sizes, other=()):
    """Sines of some sizes, an episode each; in some the velocity is another's."""
    out = np.zeros(ROWS * len(sizes), [("true", float), ("read", float)])
    for k, size in enumerate(sizes):
        rows = slice(k * ROWS, (k + 1) * ROWS)
        phase = np.arange(ROWS) * 2 * np.pi / 80
        out["true"][rows] = size * np.sin(phase)
        out["read"][rows] = size * np.sin(1.7 * phase if k in other else phase)
    return out


def test_a_small_motion_that_noise_hides_is_no_fault():
    assert _find(_sines((1.0, 1.0, 0.33)), noise=0.33) == []


def test_the_velocity_of_another_motion_is_told():
    told = _find(_sines((1.0, 1.0, 1.0), other=(2,)), noise=0.1)
    assert ("derivative", ("2",)) in told
    assert ("derivative", ("0", "1", "2")) in _find(
        _sines((1.0, 1.0, 1.0), other=(0, 1, 2)), noise=0.1
    )
