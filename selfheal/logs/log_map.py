"""The map of a log: a TOML file in; which columns are which signals out."""

import os
from dataclasses import field
from typing import Annotated

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from ..documents import check_document, read_toml
from ..errors import InputError

VERSION = 1
COMMAND = "command"  # the kind of columns that become `ctrl`

_Number = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_STRICT: ConfigDict = {"extra": "forbid", "strict": True}


@dataclass(frozen=True, config=_STRICT)
class Clock:
    """When the rows of a stream were measured.

    Attributes:
        column: that holds the time; "" leaves it to the log.
        unit: of that column; "": seconds, where the rows then come as a robot's do.
        rate: [Hz] of the rows, where no column holds the time.
        offset: [s] added to the time.
        stretch: by which the time is multiplied: a clock that runs fast has less
            than 1.
    """

    column: str = ""
    unit: str = ""
    rate: _Positive | None = None
    offset: _Number = 0.0
    stretch: _Positive = 1.0


@dataclass(frozen=True, config=_STRICT)
class TimeBase(Clock):
    """The clock of all streams, and what of their time is taken.

    Attributes:
        start: [s] after the first row, before which nothing is taken.
        end: [s] after the first row, behind which nothing is taken.
        streams: clocks of streams that differ, by their names.
    """

    start: _Number | None = None
    end: _Number | None = None
    streams: dict[str, Clock] = field(default_factory=dict)


@dataclass(frozen=True, config=_STRICT)
class EpisodeRule:
    """What parts a log into episodes.

    Attributes:
        column: whose value changes where another episode begins.
        gap: [s] between two rows that belong to different episodes.
        stream: each row of which begins an episode.
    """

    column: str = ""
    gap: _Positive | None = None
    stream: str | None = None


@dataclass(frozen=True, config=_STRICT)
class ColumnRule:
    """Columns that become signals of one kind, or commands.

    value in the model = sign * scale * (value in SI units) + offset

    Attributes:
        kind: one of the contract, or "command".
        columns: names, `STREAM:COLUMN` where the log holds several streams; one name
            may hold a `*` for all columns that differ there.
        targets: name in the model of each column, or of each 3 or 4 columns of a
            vector; empty: what stands for the `*`, or no target.
        unit: of the columns; "" leaves it to the log.
        sign: 1 or -1, of all columns or of each.
        scale: of all columns or of each: N m per ampere, say.
        offset: in the model's unit, of all columns or of each.
        from_range: two values of a column, such as 0 and 100 %, ...
        to_range: ... and the values in the model's unit which they stand for; without,
            the ends of the joint's range in the model.
        order: of a quaternion: "wxyz" or "xyzw".
        delay: [s] by which the columns are late.
        missing: number of a column that stands for no reading: a row in which all
            columns of the rule hold it has none of them.
    """

    kind: str
    columns: str | list[str]
    targets: list[str] = field(default_factory=list)
    unit: str = ""
    sign: int | list[int] = 1
    scale: _Number | list[_Number] = 1.0
    offset: _Number | list[_Number] = 0.0
    from_range: tuple[_Number, _Number] | None = None
    to_range: tuple[_Number, _Number] | None = None
    order: str = "wxyz"
    delay: _Number = 0.0
    missing: _Number | None = None


@dataclass(frozen=True, config=_STRICT)
class LogMap:
    """Which columns of a log are which signals of a model."""

    signals: list[ColumnRule]
    time: TimeBase = field(default_factory=TimeBase)
    episodes: EpisodeRule = field(default_factory=EpisodeRule)
    version: int = VERSION


def read_map(path: str | os.PathLike[str]) -> LogMap:
    """Read a map.

    Raises:
        InputError: it is missing, no TOML, or states something that is not known.
    """
    return _check_map(read_toml(path, LogMap), os.fspath(path))


def parse_map(document: object, name: str) -> LogMap:
    """The map that a TOML document states.

    Raises:
        InputError: it states something that is not known.
    """
    return _check_map(check_document(document, LogMap, name), name)


def _check_map(found: LogMap, name: str) -> LogMap:
    """A map, if it is of this version and has signals."""
    if found.version != VERSION:
        raise InputError(
            f"{name}: a map of version {found.version}; this program reads {VERSION}"
        )
    if not found.signals:
        raise InputError(f"{name}: it has no [[signals]]; at least one is needed")
    return found
