"""Errors of hypotheses: what a linear model is made of, and its derivatives.

An error model says how far hypotheses miss what was read: by the balance of torques
(`torque_balance`), or by predictions of segments (`segment_errors`).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from .likelihood import Whitening, whiten


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of a hypothesis, or of n, and their volume; or derivatives by n values.

    Attributes:
        values: (..., R C) of C columns in R rows.
        volume: (...) [nats] logarithm of how far the readings move for a change of the
            errors, up to a constant: their density is that of the errors times it.
        noise: (R, J, J) covariance of what noise of the readings makes of the first J
            columns in each row, of a single hypothesis; of several it is not kept.
        slack: (R, J) variance of forces that the hypothesis leaves undecided, likewise.
    """

    values: Floats
    volume: Floats
    noise: Floats | None = None
    slack: Floats | float = 0.0

    @property
    def first(self) -> "Errors":
        """Errors of the first of several hypotheses."""
        return replace(self, values=self.values[0], volume=self.volume[0])

    @classmethod
    def join(cls, *parts: "Errors") -> "Errors":
        """Derivatives of several values in a row."""
        return cls(
            np.vstack([p.values for p in parts]),
            np.concatenate([p.volume for p in parts]),
        )

    def select(self, chosen: np.ndarray | slice) -> "Errors":
        """Derivatives by some of the values."""
        return Errors(self.values[chosen], self.volume[chosen])


class ErrorModel(ABC):
    """What a linear fit asks of the errors of hypotheses."""

    @property
    @abstractmethod
    def derivative_step(self) -> float:
        """Of a derivative by a parameter [scales]."""

    @property
    def is_rough(self) -> bool:
        """Whether another Jacobian tells no more, as impacts make errors jump."""
        return False

    @property
    @abstractmethod
    def rows(self) -> int:
        """R, in order of time."""

    @property
    @abstractmethod
    def screening_share(self) -> float:
        """How many times as many rows there are as candidates are first tried in."""

    @abstractmethod
    def compute_errors(self, terms: Sequence[Term], values: Floats) -> Errors:
        """Errors of n hypotheses with values (n, P) [units of the parameters]."""

    def compute_changes(
        self, terms: Sequence[Term], values: Floats, errors: Errors
    ) -> Errors:
        """Changes of a hypothesis's errors by its last term, at n values (n, P)."""
        found = self.compute_errors(terms, values)
        return Errors(found.values - errors.values, found.volume - errors.volume)

    @abstractmethod
    def compute_nuisance(
        self, terms: Sequence[Term], values: Floats, errors: Errors
    ) -> Errors:
        """Changes (K, ...) at values (1, P) by what nobody knows, of one deviation."""

    @property
    @abstractmethod
    def follows(self) -> np.ndarray:
        """(R) whether a row follows the one before it in time."""

    def whiten(self, errors: Errors) -> Whitening:
        """The whitening of a hypothesis's errors."""
        values = errors.values.reshape(self.rows, -1)
        volume = float(np.sum(errors.volume))
        return whiten(values, errors.noise, volume, self.follows, errors.slack)

    @abstractmethod
    def thin(self, share: float) -> "tuple[ErrorModel, np.ndarray]":
        """A model with so many times fewer rows, and their numbers (r)."""

    def adapt(self, terms: Sequence[Term], values: Floats) -> "ErrorModel":
        """The model made for a hypothesis with values (P), if it hangs on one."""
        return self


@dataclass(frozen=True, eq=False)
class Direction:
    """A way in which a term's values may leave the nominal ones, and its response.

    Attributes:
        term: of the values.
        start: (p) values at its origin; NaN where these are infinite [units of the
            parameters].
        steps: (k, p) change of the values by one unit of each coordinate.
        columns: (k, R C) change of the errors.
        volumes: (k) change of their volume.
    """

    term: Term
    start: Floats
    steps: Floats
    columns: Floats
    volumes: Floats

    @property
    def _is_sinusoid(self) -> bool:
        """Whether coordinates are those of a sine and a cosine of one frequency."""
        return self.term.is_wave and len(self.steps) == 2

    def compute_values(self, coordinates: Floats) -> Floats:
        """Values (p) of the term at coordinates (k), within its bounds."""
        if not np.isfinite(self.start).all():
            values = self.steps[0]
        elif self._is_sinusoid:
            sine, cosine = coordinates
            amplitude, frequency, phase = self.start + self.steps[0]
            turned = np.mod(phase + np.arctan2(cosine, sine), 2 * np.pi)
            size = np.hypot(sine, cosine)
            values = np.array([amplitude * size, frequency, turned])
        else:
            values = self.start + coordinates @ self.steps
        return np.clip(values, self.term.low, self.term.high)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Bounds (k) of coordinates, each alone, within those of the values."""
        count, term = len(self.steps), self.term
        if not self.start.size or not np.isfinite(self.start).all():  # it acts or not
            return np.zeros(count), np.ones(count)
        if self._is_sinusoid:
            most = term.high[0] / (self.start + self.steps[0])[0]
            return np.full(count, -most), np.full(count, most)
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        for k, step in enumerate(self.steps):
            for p in np.flatnonzero(step):
                ends = np.array([term.low[p], term.high[p]]) - self.start[p]
                a, b = np.sort(ends / step[p])
                low[k], high[k] = max(low[k], a), min(high[k], b)
        return np.minimum(low, 0), np.maximum(high, 0)


def differentiate(
    model: ErrorModel,
    terms: Sequence[Term],
    values: Floats,
    errors: Errors,
    which: Sequence[int] | None = None,
) -> Errors:
    """Derivatives (p, R C) and (p) of a hypothesis's errors by each value.

    Args:
        values: (P) [units of the parameters].
        which: (p) numbers of the values; None: all.
    """
    chosen = np.arange(len(values)) if which is None else np.array(which, int)
    if not len(chosen):
        return Errors(np.zeros((0, errors.values.size)), np.zeros(0))
    scale = np.concatenate([t.scale for t in terms])
    high = np.concatenate([t.high for t in terms])
    step = model.derivative_step * scale
    step = np.where(values + step > high, -step, step)[chosen]
    points = np.tile(values, (len(chosen), 1))
    points[np.arange(len(chosen)), chosen] += step
    moved = model.compute_errors(terms, points)
    return Errors(
        (moved.values - errors.values) / step[:, None],
        (moved.volume - errors.volume) / step,
    )
