"""Covariance matrix adaptation: scores of drawn points in, better points out.

The (mu/mu_w, lambda) evolution strategy of Hansen, "The CMA evolution strategy: a
tutorial" (arXiv 1604.00772), its defaults; ask and tell.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..recording.data import Floats
from .ranking import rank_best_first


@dataclass(frozen=True)
class CmaState:
    """Where a search stands.

    Attributes:
        mean: (D).
        sigma: step size.
        cov: (D, D) shape of the steps.
        path: (D) of the step size, and
        path_cov: (D) of the shape, evolution paths.
        generation: number of updates so far.
    """

    mean: Floats
    sigma: float
    cov: Floats
    path: Floats
    path_cov: Floats
    generation: int = 0


def start_search(mean: Floats, sigma: float) -> CmaState:
    """A search from a point (D), with first steps of this size."""
    zero = np.zeros_like(mean)
    return CmaState(mean, sigma, np.eye(len(mean)), zero, zero)


def _decompose_covariance(state: CmaState) -> tuple[Floats, Floats]:
    """Eigenvectors (D, D) and standard deviations (D) of the shape."""
    values, vectors = np.linalg.eigh(state.cov)
    return vectors, np.sqrt(np.maximum(values, 1e-14))


def ask(state: CmaState, count: int, rng: np.random.Generator) -> Floats:
    """Draw points to score.

    Args:
        state: of the search, in D dimensions.

    Returns:
        (N, D) points.
    """
    vectors, widths = _decompose_covariance(state)
    steps = rng.normal(size=(count, len(state.mean))) * widths
    return state.mean + state.sigma * steps @ vectors.T


def tell(state: CmaState, points: Floats, scores: Floats) -> CmaState:
    """The search after a generation.

    Args:
        points: (N, D) that were scored.
        scores: (N) larger is better; what is not finite is worst.
    """
    d, count = len(state.mean), len(points)
    mu = count // 2
    weight = np.log((count + 1) / 2) - np.log(np.arange(1, mu + 1))
    weight /= weight.sum()
    mueff = 1 / (weight**2).sum()
    best = points[rank_best_first(scores)[:mu]]
    steps = (best - state.mean) / state.sigma
    step = weight @ steps
    vectors, widths = _decompose_covariance(state)
    white = vectors @ ((vectors.T @ step) / widths)
    c_sigma = (mueff + 2) / (d + mueff + 5)
    damp = 1 + 2 * max(0.0, np.sqrt((mueff - 1) / (d + 1)) - 1) + c_sigma
    c_c = (4 + mueff / d) / (d + 4 + 2 * mueff / d)
    c_1 = 2 / ((d + 1.3) ** 2 + mueff)
    c_mu = min(1 - c_1, 2 * (mueff - 2 + 1 / mueff) / ((d + 2) ** 2 + mueff))
    path = (1 - c_sigma) * state.path + np.sqrt(c_sigma * (2 - c_sigma) * mueff) * white
    norm = np.sqrt(d) * (1 - 1 / (4 * d) + 1 / (21 * d**2))
    generation = state.generation + 1
    length = np.linalg.norm(path) / np.sqrt(1 - (1 - c_sigma) ** (2 * generation))
    going = float(length < (1.4 + 2 / (d + 1)) * norm)
    path_cov = (1 - c_c) * state.path_cov
    path_cov += going * np.sqrt(c_c * (2 - c_c) * mueff) * step
    lost = c_1 * (1 - going) * c_c * (2 - c_c)
    cov = (1 - c_1 - c_mu + lost) * state.cov
    cov += c_1 * np.outer(path_cov, path_cov) + c_mu * (steps.T * weight) @ steps
    growth = (c_sigma / damp) * (np.linalg.norm(path) / norm - 1)
    return replace(
        state,
        mean=state.mean + state.sigma * step,
        sigma=float(state.sigma * np.exp(min(1.0, growth))),
        cov=(cov + cov.T) / 2,
        path=path,
        path_cov=path_cov,
        generation=generation,
    )
