"""What a map of the columns leaves unexplained: squares in, comparisons of maps out."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ..recording.data import Floats
from .states import ColumnMap, States, thin

SMALL = 0.01  # of the mean difference of blocks, that is not ranked; chosen
CHANGED = 0.3  # change of a share's logarithm that is no noise; chosen
MIN_BLOCKS = 6  # of which half is held out at a time; chosen: three fit nine terms


@dataclass(frozen=True, eq=False)
class Residuals:
    """What a map leaves of D torques, or of the motion of D joints and bodies.

    Attributes:
        share: (D) share of the mean square that is left [1].
        error: (D) mean square that is left, in units in which maps are compared.
        blocks: (B, D) the same of each block, in units of `scale`.
        scale: (D) unit of the blocks.
        size: (D) mean square of what is explained, in units of `error`.
    """

    share: Floats
    error: Floats
    blocks: Floats
    scale: Floats
    size: Floats

    @property
    def worst(self) -> float:
        """The largest share that is left."""
        return float(self.share.max(initial=0.0))

    def select_changed(self, other: "Residuals") -> Floats:
        """Shares that are left (n) of what `other` explains differently [1]."""
        return self.share[np.abs(np.log(self.error / other.error)) > CHANGED]

    def gain_over(self, other: "Residuals") -> tuple[float, float]:
        """Nats a row by which this explains more than another map, and its p-value.

        The p-value is that of a one-sided Wilcoxon signed-rank test over the blocks
        (Wilcoxon 1945).
        """
        from scipy.stats import wilcoxon

        # of differences of squares, those that are small say nothing: blocks at rest
        each = np.sum((other.blocks - self.blocks) / other.scale, axis=1)
        each = each[np.isfinite(each)]
        each = each[np.abs(each) > SMALL * np.mean(np.abs(each))]
        gain = float(np.sum(np.log(other.error / self.error) / 2))
        if len(each) < MIN_BLOCKS or not np.any(each):
            return gain, 1.0
        return gain, float(wilcoxon(each, alternative="greater").pvalue)


class Explainer(ABC):
    """What explains the motion of one recording, in the same rows for every map.

    Attributes:
        limits: shares [1] that a log must leave to be doubted, and that one which is
            read otherwise may leave.
        says: what is the case then.
        basis: of the p-value of that.
        reason: why it explains nothing; "" where it does.
        rows: (n) of the series.
        block: (n) number of the block of each.
        count: of these blocks.
        names: (n) id of the episode of each row.
    """

    limits: tuple[float, float]
    says: str
    basis: str

    def __init__(self, states: States) -> None:
        """Explain nothing where the states are not known."""
        self.states, self.series, self.model = states, states.series, states.model
        self.reason = states.reason
        self._known = dict[str, Residuals]()

    def choose(self, known: np.ndarray, most: int) -> None:
        """Choose `most` rows out of those (N) that are known."""
        self.rows = thin(np.flatnonzero(known), most)
        blocks = np.unique(self.series.block[self.rows])
        self.block = np.searchsorted(blocks, self.series.block[self.rows])
        self.count = len(blocks)
        self.names = self.series.name_episodes(self.rows)

    @property
    def block_names(self) -> np.ndarray:
        """Id (B) of the episode of each block."""
        return self.names[np.unique(self.block, return_index=True)[1]]

    def evaluate(self, column_map: ColumnMap, every: int = 1) -> Residuals:
        """What a map of the columns leaves in each so many rows; kept for the next."""
        key = repr((column_map, every))
        if key not in self._known:
            self._known[key] = self._evaluate(column_map, slice(None, None, every))
        return self._known[key]

    @abstractmethod
    def _evaluate(self, column_map: ColumnMap, chosen: slice) -> Residuals:
        """What a map leaves in the rows that are chosen."""


def average_blocks(values: Floats, block: np.ndarray, count: int) -> Floats:
    """Mean (count) of values (n) in each of so many blocks (n); 0 where it has none."""
    rows = np.maximum(np.bincount(block, minlength=count), 1)
    return np.bincount(block, values, minlength=count) / rows
