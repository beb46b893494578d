"""What a reader of a file format gives: streams of named columns, read in pieces."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

MIN_ROWS = 2  # of a log; by definition of a motion
Floats = NDArray[np.float64]
Values = NDArray[np.float64 | np.object_]  # (n), one a row
Rows = Mapping[str, Values]  # columns of some rows, by name
Report = Callable[[float], None]  # called with the share of a log that was read


@dataclass(frozen=True)
class Stream:
    """Rows that share one clock: a table or a topic.

    A vector in a cell or a message is a column for each element, `name[0]` and so on,
    or `name[joint]` where the log names its elements.

    Attributes:
        name: of the topic or the table; "" where a log holds one table.
        columns: unit of each column by its name, "" where the log states none.
        rows: how many; None where they are not known before reading.
        time: the column of the time [s] at which a row was measured, "" if there is
            none.
        period: [s] from row to row where the log states a rate; None if it does not.
        episode: the column of the episodes' labels; "" if there is none.
    """

    name: str
    columns: Mapping[str, str]
    rows: int | None = None
    time: str = ""
    period: float | None = None
    episode: str = ""


class Log(ABC):
    """A log that was opened.

    Attributes:
        robot: name of the robot where the log states it.
        losses: what of the log is damaged and was left out, in words. It is known
            when all was read.
    """

    path: Path
    streams: Sequence[Stream]
    robot: str | None = None
    losses: Sequence[str] = ()

    @abstractmethod
    def read(
        self, wanted: Mapping[str, Sequence[str]], report: Report | None = None
    ) -> Iterator[tuple[str, Rows]]:
        """Read columns, a piece of a stream at a time.

        A piece is small beside the memory of a computer. Pieces of one stream come in
        the order in which the log has them; those of several streams may alternate.

        Args:
            wanted: names of columns by names of streams.
            report: called with the share that was read, from 0 to 1.

        Yields:
            The name of a stream and the wanted columns of some of its rows. Numbers
            are float64, NaN where one is missing. Times of day are seconds since 1970
            UTC. Texts are Python strings.

        Raises:
            InputError: the log is damaged; says where.
        """


def check_rows(path: Path, rows: int) -> None:
    """Refuse a log in which nothing can have moved.

    Raises:
        InputError: it has one row or none.
    """
    if rows < MIN_ROWS:
        raise InputError(
            f"{path}: it holds {'one row' if rows else 'no row'}; would fit: a row "
            "for each sample of a motion"
        )


class LogFormat(ABC):
    """A file format: a subclass in `logs.formats`, or one that an entry point names.

    The group of entry points is `selfheal.importers`.

    Attributes:
        name: as messages and the documentation call it.
    """

    name: str

    @abstractmethod
    def recognizes(self, path: Path) -> bool:
        """Whether a path, which exists, looks like this format. Reads little of it."""

    @abstractmethod
    def open(self, path: Path) -> Log:
        """Open a log.

        Raises:
            InputError: the log is damaged or is of a kind that is not read; or a
                library is missing, and the message says how to install it.
        """
