"""What an import did, for its user to look at."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from .offsets import Offset
from .timeline import RowCounts


@dataclass(frozen=True)
class EpisodeReport:
    """What became of an episode.

    Attributes:
        start: [s] in the log's clock of what is 0 in the recording.
        seconds: from its first to its last row [s].
        rows: of its time base.
        rates: [Hz] median of each stream's rows.
    """

    id: str
    start: float
    seconds: float
    rows: int
    rates: Mapping[str, float]


@dataclass
class ImportReport(RowCounts):
    """What an import did.

    Attributes:
        assumed: targets whose columns have no stated unit, by the unit assumed.
        offsets: of streams' clocks against that of the joints; nothing is moved by it.
        lag: [s] by which every position follows its command where the two come from
            different streams: shortest and longest; None where that is not so.
        losses: what of a log is damaged and was left out, by the log's path.
    """

    episodes: list[EpisodeReport] = field(default_factory=list)
    assumed: dict[str, list[str]] = field(default_factory=dict)
    offsets: list[Offset] = field(default_factory=list)
    lag: tuple[float, float] | None = None
    losses: dict[str, list[str]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
