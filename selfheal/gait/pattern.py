"""Patterns: a few numbers in, a robot's joint commands over time out."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..body.body import Floats
from ..engine.walk import PERIOD
from ..errors import UnknownNameError

SECONDS = 10.0  # of a gait: paper A's (papers.md 1.7)
SWING = np.radians(70.0)  # paper A's poses lie within (papers.md 1.7)
_SEGMENTS = 9  # of the paper's gait: to p1 .. p4, once more, back to rest
_FADE = 1.0  # [s] in which waves begin; chosen
# Cycles a second that waves may take. Chosen: below 0.2 a swing within the servos'
# speed is longer than the range of the joints, above 0.8 it is only 12 degrees.
_FREQUENCY = (0.2, 0.8)
_PERIOD_STEP = 0.2  # [s] so that a quarter of a cycle is a whole number of samples


class Pattern(Protocol):
    """A way to write a gait as numbers."""

    @property
    def name(self) -> str:
        """Of it."""
        ...

    def count_genes(self, joints: int) -> int:
        """How many numbers a gait of so many joints has."""
        ...

    def compute_commands(self, genes: Floats, joints: int, seconds: float) -> Floats:
        """Joint commands of gaits, one row every `PERIOD`.

        Args:
            genes: (N, D) of N gaits [1].
            seconds: length of the commands [s].

        Returns:
            (N, T, P) commands [rad].
        """
        ...

    def compute_period(self, genes: Floats) -> float:
        """Time after which the gait of genes (D) repeats [s]."""
        ...

    def add_stance(self, genes: Floats, stance: Floats) -> Floats:
        """Genes (N, size) moved by a stance (N, P) [rad]."""
        ...


@dataclass(frozen=True)
class PosePattern:
    """Paper A's gait: four poses, each reached in a straight line, gone round twice.

    Genes are 4 x P, +-1 for +-70 degrees. The command is rest, p1 .. p4, p1 .. p4,
    rest: nine equal segments in 10 s (papers.md 1.7).
    """

    name: str = "poses"

    def count_genes(self, joints: int) -> int:
        """See `Pattern`."""
        return 4 * joints

    def compute_commands(self, genes: Floats, joints: int, seconds: float) -> Floats:
        """Commands through the four poses in turn; a longer time goes round again.

        Args:
            genes: (N, D) of N gaits, poses in units of `SWING` [1].
            seconds: length of the commands [s].

        Returns:
            (N, T, P) commands [rad].
        """
        poses = SWING * np.clip(genes, -1, 1).reshape(len(genes), 4, joints)
        step = SECONDS / _SEGMENTS
        count = int(np.ceil(seconds / step)) + 1
        knots = np.concatenate(
            [np.zeros((len(genes), 1, joints)), poses[:, np.arange(count) % 4]], axis=1
        )
        if seconds == SECONDS:
            knots[:, _SEGMENTS] = 0.0
        at = _list_times(seconds) / step
        low = np.minimum(at.astype(int), knots.shape[1] - 2)
        part = (at - low)[None, :, None]
        return (1 - part) * knots[:, low] + part * knots[:, low + 1]

    def compute_period(self, genes: Floats) -> float:
        """Time in which a gait of genes (D) goes through its four poses [s]."""
        return 4 * SECONDS / _SEGMENTS

    def add_stance(self, genes: Floats, stance: Floats) -> Floats:
        """Genes (N, D) with a stance (N, P) [rad] added to each pose."""
        return genes + np.tile(stance / SWING, 4)


@dataclass(frozen=True)
class WavePattern:
    """Every joint swings in a sine of one common frequency about a middle of its own.

    Genes: middles (P), sines (P), cosines (P), each 1 for 35 degrees, and one for the
    frequency: target_j(t) = m_j + fade(t) (s_j sin wt + c_j cos wt).
    """

    name: str = "waves"

    def count_genes(self, joints: int) -> int:
        """See `Pattern`."""
        return 3 * joints + 1

    def compute_commands(self, genes: Floats, joints: int, seconds: float) -> Floats:
        """Commands that are a sine wave of each joint about its middle, faded in.

        Args:
            genes: (N, D) of N gaits: middles, sines, cosines, frequency [1].
            seconds: length of the commands [s].

        Returns:
            (N, T, P) commands [rad].
        """
        time = _list_times(seconds)
        middle, sine, cosine = (
            SWING / 2 * genes[:, k * joints : (k + 1) * joints, None] for k in range(3)
        )
        phase = 2 * np.pi * self._compute_frequency(genes)[:, None] * time
        swing = sine * np.sin(phase)[:, None] + cosine * np.cos(phase)[:, None]
        fade = np.minimum(time / _FADE, 1.0)
        out = fade * (middle + swing)
        return np.clip(out, -SWING, SWING).transpose(0, 2, 1)

    def compute_period(self, genes: Floats) -> float:
        """Period of the waves of genes (D) [s]."""
        return float(1 / self._compute_frequency(genes[None])[0])

    def add_stance(self, genes: Floats, stance: Floats) -> Floats:
        """Genes (N, D) with a stance (N, P) [rad] added to the middles."""
        out = genes.copy()
        out[:, : stance.shape[1]] += stance / (SWING / 2)
        return out

    @staticmethod
    def _compute_frequency(genes: Floats) -> Floats:
        """(N) [1/s], of a period that is a whole number of `_GRAIN`."""
        low, high = _FREQUENCY
        free = low + (high - low) / (1 + np.exp(-genes[:, -1]))
        whole: Floats = np.round(1 / free / _PERIOD_STEP)
        return 1 / (_PERIOD_STEP * whole)


def _list_times(seconds: float) -> Floats:
    """(T) end of each period [s]."""
    return PERIOD * np.arange(1.0, round(seconds / PERIOD) + 1)


PATTERNS: dict[str, Pattern] = {p.name: p for p in (PosePattern(), WavePattern())}


def find_pattern(name: str) -> Pattern:
    """The pattern of a name.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in PATTERNS:
        raise UnknownNameError("gait", name, PATTERNS)
    return PATTERNS[name]
