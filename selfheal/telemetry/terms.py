"""Torques as sums: takes what motion takes and actuators give, fits missing physics.

Between inverse dynamics (Featherstone 2008, chapter 5) and the torques of actuators may
stand whatever physics a model lacks: each of it is a term with a bounded coefficient.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..recording.data import Floats

# bounds of what missing physics may do, as shares of the model's values; chosen so
# that it stays physics: gains, masses and gravity keep their sign, friction dissipates
GAIN = (-0.7, 1.5)  # of an actuator
DELAY = (-0.02, 0.12)  # [s] of a command
GRAVITY = (-1.05, 1.0)  # none at all: a controller may compensate it
COUPLING = (-0.5, 1.0)  # torques of other joints' motion, and of rates
INERTIA = (-0.5, 4.0)  # rotor inertia, of the joint's own inertia
SPRING = (-0.5, 3.0)  # of gravity's torque, per rad
DRY_RATE = 0.1  # of a joint's usual rate, at which dry friction is whole; chosen


@dataclass(frozen=True, eq=False)
class Terms:
    """The torques of a degree of freedom as a sum with bounded coefficients.

    Attributes:
        parts: (n) its torques, as `TorqueBalance.compute_torques` has them [N m or N].
        missing: (n) torque of the actuators without that of the motion [N m or N].
        x: (n, k) terms of missing physics; the first two are gain and delay of the
            actuators.
        bounds: (2, k) of their coefficients.
        size: (n) square of the torques that the motion takes [(N m)^2 or N^2].
    """

    dof: int
    parts: Mapping[str, Floats]
    missing: Floats
    x: Floats
    bounds: Floats
    size: Floats

    def fit(self, rows: np.ndarray) -> Floats:
        """Coefficients (k) by which the torques balance best in some rows (n)."""
        return solve_bounded(self.x[rows], -self.missing[rows], self.bounds)

    def leave(self, coefficients: Floats) -> Floats:
        """Torques (n) that are left by coefficients (k) [N m or N]."""
        return self.missing + self.x @ coefficients

    def fit_others(
        self, fold: np.ndarray, usable: np.ndarray | bool
    ) -> Iterator[tuple[np.ndarray, Floats]]:
        """Whether rows (n) are of a fold, and coefficients (k) of the usable others."""
        for number in np.unique(fold):
            here = fold == number
            yield here, self.fit(~here & usable)


def make_terms(
    dof: int, parts: Mapping[str, Floats], damping: float, stiffness: float
) -> Terms:
    """The terms of one degree of freedom.

    Args:
        parts: (n) its torques, as `TorqueBalance.compute_torques` has them [N m or N].
        damping: of the joint [N m s/rad].
        stiffness: of gravity, by which a spring is bounded [N m/rad].
    """
    hold, act = parts["hold"], parts["act"]
    coupling = parts["all"] - hold - parts["own"]
    usual = float(np.sqrt(np.mean(parts["v"] ** 2))) + 1e-12
    inf = np.inf
    terms = (
        (act, GAIN),
        (parts["late"], DELAY),
        (-hold, GRAVITY),
        (-coupling, COUPLING),
        (-parts["own"], INERTIA),
        (-parts["v"], (-1.5 * damping, inf)),
        (-np.tanh(parts["v"] / (DRY_RATE * usual)), (0.0, inf)),
        (-parts["q"], (SPRING[0] * stiffness, SPRING[1] * stiffness)),
        (np.ones_like(act), (-inf, inf)),
    )
    x = np.stack([t for t, _ in terms], axis=1)
    size = parts["own"] ** 2 + hold**2 + coupling**2
    bounds = np.array([b for _, b in terms]).T
    return Terms(dof, parts, act - parts["all"], x, bounds, size)


def solve_bounded(x: Floats, y: Floats, bounds: Floats) -> Floats:
    """Coefficients (k) in bounds (2, k) whose sum of terms (n, k) fits values (n)."""
    from scipy.optimize import lsq_linear

    if not len(x):
        return np.zeros(x.shape[1])
    size = np.sqrt((x**2).mean(axis=0))
    used = size > 1e-12
    if not used.any() or len(x) <= used.sum():
        return np.zeros(x.shape[1])
    scale = size[used]
    r = np.asarray(np.linalg.qr(np.column_stack([x[:, used] / scale, y]), mode="r"))
    low, high = bounds[0, used] * scale, bounds[1, used] * scale
    problem = r[:, :-1], r[:, -1], (low, high + 1e-15)
    found = lsq_linear(*problem, method="bvls")
    if found.status in (0, 2):  # out of iterations, or at a step that a bound stopped
        found = lsq_linear(*problem, method="trf")
    out = np.zeros(x.shape[1])
    out[used] = found.x / scale
    return out
