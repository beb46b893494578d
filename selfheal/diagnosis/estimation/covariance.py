"""Covariance of a fit's values: takes a fit, gives standard errors and intervals.

With A the Jacobian, Lambda the prior's precision, H = A'A + Lambda, and g_b = A_b'r_b
of the residuals in block b of neighboring segments, the covariances are

    usual:     H^-1 (s^2 A'A + Lambda) H^-1,           s^2 = r'r / (R - P)
    sandwich:  H^-1 (B / (B - 1) sum g_b g_b' + Lambda) H^-1

(Huber 1967, White 1980, over clusters: Liang and Zeger 1986). The prior is one more
reading of each nominal value, off by its own standard deviation.
"""

from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.declaration import Parameter
from .fit import Fit
from .problem import Problem, list_block_rows
from .quadratic_model import prior_precision
from .settings import FIT


def effective_sample_size(problem: Problem, residuals: Floats) -> float:
    """Number of independent samples that squared residuals amount to.

    Each column of each segment, with squared sum E and correlation time tau, counts as
    n / tau samples. Their sum has the size of Satterthwaite's (1946) rule,

        (sum E)^2 / sum (E^2 tau / n).

    Args:
        residuals: (R) [standard deviations].
    """
    width = problem.segments.readings.shape[1]
    energy, spread = 0.0, 0.0
    for part in problem.split_by_segment(residuals):
        for series in part.reshape(-1, width).T:
            squared = float(series @ series)
            if squared > 0:
                energy += squared
                spread += squared**2 / (len(series) / _correlation_time(series))
    return energy**2 / spread if spread else 0.0


def _correlation_time(series: Floats) -> float:
    """Integrated autocorrelation time [samples] of a series (n) about zero.

    tau = 1 + 2 sum rho(k), up to the first lag k whose autocorrelation is not positive
    (Geyer 1992), between 1 and n; by the fast Fourier transform.
    """
    n = len(series)
    if n < FIT.min_correlated_samples:
        return float(n)
    power = np.abs(np.fft.rfft(series, 2 * n)) ** 2
    rho = np.fft.irfft(power)[:n]
    rho = rho / rho[0]
    end = int(np.argmax(rho <= 0)) or n
    return float(min(n, 1 + 2 * rho[1:end].sum()))


def standard_errors(fit: Fit) -> Floats:
    """Standard errors of a fit's values, robust to correlation within a block.

    The larger of the usual and of the sandwich variance. To it are added the squared
    changes of the values by the time step's error and by an error of the commands'
    clock: parameters that are considered and not estimated (Schmidt 1966).

    Args:
        fit: with a Jacobian as fine as it can be (`refine_jacobian`).

    Returns:
        (P) [units of the parameters]; infinite where no reading tells.
    """
    norms = np.sqrt((fit.jacobian**2).sum(axis=0))
    largest = max(norms.max(initial=0.0), FIT.tiny)
    is_observed = norms > FIT.min_column_share * largest
    errors = np.full(len(fit.values), np.inf)
    if not is_observed.any():
        return errors
    jacobian = fit.jacobian[:, is_observed] / norms[is_observed]
    prior = np.diag(prior_precision(fit.terms)[is_observed] / norms[is_observed] ** 2)
    propagation = _Propagation.build(jacobian, prior)
    residuals, information = fit.residuals, propagation.curvature - prior
    gradients = np.stack(
        [jacobian[b].T @ residuals[b] for b in list_block_rows(fit.problem)]
    )
    count, free = len(gradients), len(residuals) - len(jacobian.T)
    usual = information * float(residuals @ residuals) / max(free, 1)
    clustered = gradients.T @ gradients * count / max(count - 1, 1)
    variance = np.maximum(
        *(propagation.compute_variances(_root(c + prior)) for c in (usual, clustered))
    )
    changes = [jacobian.T @ error() for error in (fit.timestep_error, fit.clock_error)]
    variance += sum(propagation.compute_variances(g[:, None]) for g in changes)
    errors[is_observed] = np.sqrt(variance) / norms[is_observed]
    return errors


@dataclass(frozen=True, eq=False)
class _Propagation:
    """How errors of a gradient propagate to values, by H = V diag(l) V'.

    Attributes:
        eigenvalues: (P) l.
        eigenvectors: (P, P) V.
        prior_std: (P) of each eigenvector's direction, before any reading.
    """

    eigenvalues: Floats
    eigenvectors: Floats
    prior_std: Floats

    @classmethod
    def build(cls, jacobian: Floats, prior: Floats) -> "_Propagation":
        """From a Jacobian (R, P) and the prior's precision (P, P).

        Eigenvalues have a floor, for a direction that no reading shows is as uncertain
        as can be, and not certain. It is so low that the prior, small as it may be
        beside many readings, still counts.
        """
        eigenvalues, v = np.linalg.eigh(jacobian.T @ jacobian + prior)
        floor = FIT.min_eigenvalue_share * eigenvalues.max()
        precision = np.maximum((v * (prior @ v)).sum(axis=0), FIT.tiny)
        return cls(np.maximum(eigenvalues, floor), v, 1 / np.sqrt(precision))

    @property
    def curvature(self) -> Floats:
        """(P, P) H, with the floor of its eigenvalues."""
        return self.eigenvectors * self.eigenvalues @ self.eigenvectors.T

    def compute_variances(self, root: Floats) -> Floats:
        """(P) diagonal of H^-1 S H^-1, with S = root root' of a gradient.

        No direction becomes more uncertain than it was before anything was read.
        `root`: (P, k).
        """
        along = (self.eigenvectors / self.eigenvalues).T @ root
        std = np.linalg.norm(along, axis=1)
        kept = self.prior_std / np.maximum(std, self.prior_std)
        return ((self.eigenvectors * kept @ along) ** 2).sum(axis=1)


def _root(matrix: Floats) -> Floats:
    """(P, P) root with root root' = a positive semidefinite matrix (P, P)."""
    eigenvalues, v = np.linalg.eigh(matrix)
    return np.asarray(v * np.sqrt(np.maximum(eigenvalues, 0.0)))


def confidence_interval(
    parameter: Parameter, value: float, error: float
) -> tuple[float, float]:
    """The 90 % interval of an effect's parameter, within its bounds.

    Args:
        value: fitted [unit of the parameter].
        error: standard error [unit of the parameter].

    Returns:
        Lower and upper end [unit of the parameter].
    """
    half = FIT.interval_factor * FIT.interval_standard_errors * error
    return max(parameter.low, value - half), min(parameter.high, value + half)
