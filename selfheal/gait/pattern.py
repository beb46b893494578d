"""Patterns: a few numbers in, a robot's joint commands over time out."""

from abc import ABC, abstractmethod

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


class Pattern(ABC):
    """A kind of gait, written as numbers, its genes."""

    name: str

    @abstractmethod
    def count_genes(self, joints: int) -> int:
        """How many numbers a gait of so many joints has."""

    @abstractmethod
    def compute_commands(self, genes: Floats, joints: int, seconds: float) -> Floats:
        """Joint commands of gaits, one row every `PERIOD`.

        Args:
            genes: (N, D) of N gaits [1].
            seconds: length of the commands [s].

        Returns:
            (N, T, P) commands [rad].
        """

    @abstractmethod
    def compute_period(self, genes: Floats) -> float:
        """Time after which the gait of genes (D) repeats [s]."""

    @abstractmethod
    def add_stance(self, genes: Floats, stance: Floats) -> Floats:
        """Genes (N, D) moved by a stance (N, P) [rad]."""


class _Poses(Pattern):
    """Paper A's gait: four poses, each reached in a straight line, gone round twice.

    Genes are 4 x P, +-1 for +-70 degrees. The command is rest, p1 .. p4, p1 .. p4,
    rest: nine equal segments in 10 s (papers.md 1.7). A longer time goes round again.
    """

    name = "poses"

    def count_genes(self, joints: int) -> int:
        return 4 * joints

    def compute_commands(self, genes: Floats, joints: int, seconds: float) -> Floats:
        poses = SWING * np.clip(genes, -1, 1).reshape(len(genes), 4, joints)
        step = SECONDS / _SEGMENTS
        count = int(np.ceil(seconds / step)) + 1
        rest = np.zeros((len(genes), 1, joints))
        knots = np.concatenate([rest, poses[:, np.arange(count) % 4]], axis=1)
        if seconds == SECONDS:
            knots[:, _SEGMENTS] = 0.0
        at = _list_times(seconds) / step
        low = np.minimum(at.astype(int), knots.shape[1] - 2)
        part = (at - low)[None, :, None]
        return (1 - part) * knots[:, low] + part * knots[:, low + 1]

    def compute_period(self, genes: Floats) -> float:
        return 4 * SECONDS / _SEGMENTS

    def add_stance(self, genes: Floats, stance: Floats) -> Floats:
        return genes + np.tile(stance / SWING, 4)


class _Waves(Pattern):
    """Every joint swings in a sine of one common frequency about a middle of its own.

    Genes: middles (P), sines (P), cosines (P), each 1 for 35 degrees, and one for the
    frequency: target_j(t) = m_j + fade(t) (s_j sin wt + c_j cos wt).
    """

    name = "waves"

    def count_genes(self, joints: int) -> int:
        return 3 * joints + 1

    def compute_commands(self, genes: Floats, joints: int, seconds: float) -> Floats:
        time = _list_times(seconds)
        middle, sine, cosine = (
            SWING / 2 * genes[:, k * joints : (k + 1) * joints, None] for k in range(3)
        )
        phase = 2 * np.pi * _compute_frequency(genes)[:, None] * time
        swing = sine * np.sin(phase)[:, None] + cosine * np.cos(phase)[:, None]
        fade = np.minimum(time / _FADE, 1.0)
        out = fade * (middle + swing)
        return np.clip(out, -SWING, SWING).transpose(0, 2, 1)

    def compute_period(self, genes: Floats) -> float:
        return float(1 / _compute_frequency(genes[None])[0])

    def add_stance(self, genes: Floats, stance: Floats) -> Floats:
        out = genes.copy()
        out[:, : stance.shape[1]] += stance / (SWING / 2)
        return out


def _compute_frequency(genes: Floats) -> Floats:
    """(N) [1/s], of a period that is a whole number of `_PERIOD_STEP`."""
    low, high = _FREQUENCY
    free = low + (high - low) / (1 + np.exp(-genes[:, -1]))
    whole: Floats = np.round(1 / free / _PERIOD_STEP)
    return 1 / (_PERIOD_STEP * whole)


def _list_times(seconds: float) -> Floats:
    """(T) end of each period [s]."""
    return PERIOD * np.arange(1.0, round(seconds / PERIOD) + 1)


PATTERNS: dict[str, Pattern] = {p.name: p for p in (_Poses(), _Waves())}


def find_pattern(name: str) -> Pattern:
    """The pattern of a name.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in PATTERNS:
        raise UnknownNameError("gait", name, PATTERNS)
    return PATTERNS[name]
