"""Shares, errors and tests as a table says them; the statistics are scipy's."""

from collections.abc import Sequence

import numpy as np

from ..body.body import Floats

_DRAWS = 400  # of runs, for an interval; chosen
_LEAST_ERROR = 1e-6  # relative, of a value whose interval ends at a bound; chosen


def compute_wilson_interval(successes: int, count: int) -> tuple[float, float]:
    """The 95 % Wilson interval of a share of at least one trial, both within 0 to 1."""
    from scipy.stats import binomtest

    low, high = binomtest(successes, count).proportion_ci(method="wilson")
    return float(low), float(high)


def format_share(successes: int, count: int) -> str:
    """A share with its 95 % Wilson interval, as "27/30 = 90.0 % (74 to 97)"."""
    if not count:
        return "0/0"
    low, high = compute_wilson_interval(successes, count)
    return (
        f"{successes}/{count} = {100 * successes / count:.1f} % "
        f"({100 * low:.0f} to {100 * high:.0f})"
    )


def format_mean_std(values: Sequence[float], digits: int = 2) -> str:
    """Mean +- standard deviation over runs, as in 2006."""
    found = np.asarray(values, float)
    if not len(found):
        return ""
    wide = found.std(ddof=1) if len(found) > 1 else 0.0
    return f"{found.mean():,.{digits}f} ± {wide:,.{digits}f}"


def run_fisher_test(first: tuple[int, int], second: tuple[int, int]) -> float:
    """Two-sided p of Fisher's exact test of two (successes, count)."""
    from scipy.stats import fisher_exact

    return float(fisher_exact([[k, n - k] for k, n in (first, second)]).pvalue)


def run_homogeneity_test(values: Floats, widths: Floats) -> float:
    """P that all values (n) are one, by the widths (n) of their 90 % intervals.

    Cochran's Q: squared distances from the weighted mean, by chi-square.
    """
    from scipy.stats import chi2, norm

    errors = np.maximum(widths / (2 * norm.ppf(0.95)), _LEAST_ERROR * np.abs(values))
    weights = 1 / np.maximum(errors, np.finfo(float).tiny) ** 2
    mean = (weights * values).sum() / weights.sum()
    return float(chi2.sf((weights * (values - mean) ** 2).sum(), len(values) - 1))


def run_permutation_test(first: Sequence[float], second: Sequence[float]) -> float:
    """Two-sided p of a permutation test of two means; 9,999 draws at most."""
    from scipy.stats import permutation_test

    if min(len(first), len(second)) < 2:
        return float("nan")
    found = permutation_test(
        (np.asarray(first, float), np.asarray(second, float)),
        lambda x, y, axis: x.mean(axis=axis) - y.mean(axis=axis),
        vectorized=True,
        n_resamples=9999,
        rng=np.random.default_rng(0),
    )
    return float(found.pvalue)


def format_rank_correlation(first: Sequence[float], second: Sequence[float]) -> str:
    """Spearman's rank correlation of pairs, its p and their number."""
    from scipy.stats import spearmanr

    x, y = _keep_finite(first, second)
    if not _is_varied(x, y):
        return f"not defined (n = {len(x)})"
    found = spearmanr(x, y)
    return f"{found.statistic:.3f}, p = {found.pvalue:.2g} (n = {len(x):,})"


def format_pooled_correlation(
    first: Sequence[Sequence[float]], second: Sequence[Sequence[float]]
) -> str:
    """Spearman's rank correlation of the pairs of all runs, a list of numbers each.

    Its 95 % interval is of whole runs drawn again, for the pairs of a run go together;
    of one run there is none.
    """
    from scipy.stats import spearmanr

    runs = [_keep_finite(x, y) for x, y in zip(first, second, strict=True)]
    pairs = np.concatenate([np.empty((2, 0)), *runs], axis=1)
    if not _is_varied(*pairs):
        return f"not defined (n = {pairs.shape[1]})"
    written, count = f"{spearmanr(*pairs).statistic:.3f}", f"(n = {pairs.shape[1]:,})"
    if len(runs) == 1:
        return f"{written} {count}"
    draws = np.random.default_rng(0).integers(len(runs), size=(_DRAWS, len(runs)))
    drawn = [np.concatenate([runs[k] for k in draw], axis=1) for draw in draws]
    found = [spearmanr(*some).statistic for some in drawn if _is_varied(*some)]
    low, high = np.percentile(found, [2.5, 97.5])
    return f"{written} ({low:.2f} to {high:.2f}) {count}"


def _keep_finite(first: Sequence[float], second: Sequence[float]) -> Floats:
    """(2, N) the pairs of which both are numbers."""
    pairs = np.array([first, second], float)
    return pairs[:, np.isfinite(pairs).all(axis=0)]


def _is_varied(x: Floats, y: Floats) -> bool:
    """Whether pairs have ranks to be correlated."""
    return bool(len(x) > 2 and np.ptp(x) > 0 and np.ptp(y) > 0)
