"""What an import did, for its user to look at."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from .offsets import Offset
from .timeline import Mended


@dataclass(frozen=True)
class EpisodeReport:
    """What became of an episode.

    Attributes:
        id: in the recording.
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
class ImportReport:
    """What an import did.

    Attributes:
        episodes: all that were written.
        assumed: targets whose columns have no stated unit, by the unit assumed.
        offsets: of streams' clocks against that of the joints; nothing is moved by it.
        lag: [s] by which every position follows its command where the two come from
            different streams: shortest and longest; None where that is not so.
        sorted: rows that stood behind a later one and were sorted in.
        dropped: rows without a time or with one that another row has.
        before_command: rows left out before the first command of their episode.
        losses: what of a log is damaged and was left out, by the log's path.
        remarks: what a user should look at, in sentences.
    """

    episodes: list[EpisodeReport] = field(default_factory=list)
    assumed: dict[str, list[str]] = field(default_factory=dict)
    offsets: list[Offset] = field(default_factory=list)
    lag: tuple[float, float] | None = None
    sorted: int = 0
    dropped: int = 0
    before_command: int = 0
    losses: dict[str, list[str]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def add_mended(self, mended: Mended) -> None:
        """Count what was mended in a log."""
        for name, count in asdict(mended).items():
            setattr(self, name, getattr(self, name) + count)
