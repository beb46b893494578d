"""Statistics are those of their names."""

import numpy as np
import pytest

from selfheal.study.calibration import compute_brier_score, make_reliability_table
from selfheal.study.statistics import (
    format_mean_std,
    format_pooled_correlation,
    format_rank_correlation,
    format_share,
    run_fisher_test,
    run_permutation_test,
)


def test_an_interval_of_pooled_pairs_is_of_runs_not_of_pairs(rng):
    def ends(x, y):
        value, interval, _ = format_pooled_correlation(x, y).split(" (")
        low, high = (float(end) for end in interval.rstrip(")").split(" to "))
        assert low <= float(value) <= high
        return low, high

    x, y = rng.normal(size=(2, 40, 1))
    y = x + y
    alone, repeated = ends(x, y), ends(np.tile(x, 25), np.tile(y, 25))
    assert repeated == pytest.approx(alone, abs=0.03)  # says nothing new
    fresh = rng.normal(size=(2, 40, 25))
    low, high = ends(fresh[0], fresh[0] + fresh[1])
    assert high - low < (alone[1] - alone[0]) / 2
    one = format_pooled_correlation([x.ravel()], [y.ravel()])
    assert one.count("(") == 1  # of one run there is no interval
    gap = np.where(np.arange(40)[:, None] == 7, np.nan, y)
    assert format_pooled_correlation(x, gap).endswith("(n = 39)")
    assert format_pooled_correlation([], []).endswith("(n = 0)")


def test_statistics_are_those_of_their_names(rng):
    assert format_share(27, 30) == "27/30 = 90.0 % (74 to 97)"
    assert format_share(0, 0) == "0/0" and format_mean_std([]) == ""
    assert format_mean_std([1.0, 3.0]) == "2.00 ± 1.41"
    p = run_fisher_test((13, 30), (8, 30))
    assert p == pytest.approx(0.28, abs=0.01)  # papers.md 1.6
    same, more = rng.normal(size=40), rng.normal(size=40) + 3
    assert run_permutation_test(same, same[::-1]) > 0.9
    assert run_permutation_test(same, more) < 0.001
    assert format_rank_correlation(same, np.exp(same)).startswith("1.000")
    for written in (
        format_rank_correlation([1, 2, 3], [1, 1, 1]),
        format_pooled_correlation([[1, 2, 3]], [[1, 1, 1]]),
    ):
        assert written == "not defined (n = 3)"
    stated = rng.random(4000)
    true = rng.random(4000) < stated
    honest = list(zip(stated, true, strict=True))
    boasting = [(0.99 if s > 0.5 else 0.01, t) for s, t in honest]
    assert compute_brier_score(honest) < compute_brier_score(boasting)
    tables = [make_reliability_table("", "", p) for p in (honest, boasting)]
    assert [{row[-1] for row in t.rows} for t in tables] == [{"yes"}, {"no"}]
