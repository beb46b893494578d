"""Topics of bags: takes messages as they were recorded, gives rows of columns."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache

import numpy as np

from ..base import Floats, Rows, Stream
from ..timeline import Indices, shorten_rows
from .common import MAX_COLUMNS
from .ros_documents import CODINGS, make_decode, walk_document
from .ros_messages import Part, RosWalk
from .ros_sources import Message, Topic, unpack_zstd
from .ros_types import UnknownTypeError, make_typestore

RECEIPT = "bag time"  # the column of the time at which a message was received
_STAMPS = ("header.stamp", "timestamp")  # of ROS's types, and of Foxglove's
_ZSTD = b"\x28\xb5\x2f\xfd"  # stands at the start of no message that is not packed
_PIECE_ROWS, _PIECE_VALUES = 4_096, 100_000  # of a topic; chosen: 1 MB for each topic


def _make_walk(topic: Topic) -> Callable[[bytes], Iterator[Part]]:
    """What finds the numbers in the messages of a topic.

    Raises:
        UnknownTypeError: they are of a kind that is not decoded.
    """
    if topic.coding in CODINGS:
        decode = make_decode(topic.coding, topic.kind, topic.definition)
        return lambda content: walk_document(decode(content))
    if topic.coding not in ("cdr", "ros1"):
        raise UnknownTypeError(f"a coding {topic.coding!r}")
    text = topic.definition.decode(errors="replace")
    store = make_typestore(topic.kind, text if topic.form else "", topic.form)
    deserialize = getattr(store, f"deserialize_{topic.coding}")
    walk = RosWalk(store)
    return lambda content: walk(deserialize(content, topic.kind))


class Decoder:
    """What decodes the messages of a topic, whose columns it learns."""

    def __init__(self, topic: Topic) -> None:
        self.topic, self.learned = topic, 0
        self._columns = dict[str, bool]()  # whether each is a time
        self._stamps = {name: list[float]() for name in _STAMPS}
        try:
            self._walk = _make_walk(topic)
        except UnknownTypeError:  # there is still the time of receipt
            self._walk = lambda _: iter(())

    def walk(self, content: bytes) -> Iterator[Part]:
        """The numbers in a message, which may be packed by itself."""
        is_packed = content.startswith(_ZSTD)
        return self._walk(unpack_zstd(content) if is_packed else content)

    def learn(self, content: bytes) -> None:
        """Look which columns a message has."""
        self.learned += 1
        times = dict[str, float]()
        for part in self.walk(content):
            for name in part.list_columns():
                if len(self._columns) < MAX_COLUMNS:
                    self._columns.setdefault(name, part.is_time)
            if part.is_time:
                times[part.path] = float(part.values)
        for name, stamps in self._stamps.items():
            stamps.append(times.get(name, np.nan))

    def make_stream(self, count: int) -> Stream:
        """The stream of the topic, which has so many messages."""
        stamp = next((name for name in _STAMPS if self._columns.get(name)), "")
        times = np.array(self._stamps.get(stamp, ()))
        is_stamped = times.any() and (np.diff(times) > 0).all()
        columns = {RECEIPT: "s"} | ({stamp: "s"} if stamp else {})
        columns |= {name: "" for name in self._columns if name != stamp}
        time = stamp if is_stamped else RECEIPT
        return Stream(self.topic.name, columns, count, time)


class Piece:
    """Rows of a topic that are being filled."""

    def __init__(self, decoder: Decoder, columns: Sequence[str]) -> None:
        self.count = 0
        rows = min(_PIECE_ROWS, max(16, _PIECE_VALUES // max(1, len(columns))))
        self._rows = np.full((rows, len(columns)), np.nan)
        self._places: Mapping[str, int] = {name: k for k, name in enumerate(columns)}
        self._receipt = self._places.get(RECEIPT)
        is_decoded = len(columns) > (self._receipt is not None)
        self._walk = decoder.walk if is_decoded else None
        self._match = lru_cache(maxsize=1000)(self._find_places)

    def add(self, message: Message) -> None:
        """Add a message."""
        row = self._rows[self.count]
        for part in self._walk(message.content) if self._walk else ():
            if part.labels is None:
                place = self._places.get(part.path)
                if place is not None:
                    row[place] = part.values
            else:
                sources, targets = self._match(part.path, part.labels)
                row[targets] = part.values[sources]  # type: ignore[index]
        if self._receipt is not None:
            row[self._receipt] = message.time / 1e9
        self.count += 1

    def _find_places(
        self, path: str, labels: tuple[str, ...] | range
    ) -> tuple[Indices | slice, Indices | slice]:
        """Which elements of a vector are wanted, and their places in a row."""
        columns = Part(path, labels, 0.0).list_columns()
        places = [(k, self._places.get(name, -1)) for k, name in enumerate(columns)]
        pairs = np.array([pair for pair in places if pair[1] >= 0], dtype=int)
        sources, targets = pairs.reshape(-1, 2).T
        return shorten_rows(sources), shorten_rows(targets)

    def is_full(self) -> bool:
        """Whether no row is left."""
        return self.count == len(self._rows)

    def take(self) -> Rows:
        """The rows so far; begins anew."""
        found: Floats = self._rows[: self.count].T.copy()
        self._rows[:] = np.nan
        self.count = 0
        return dict(zip(self._places, found, strict=True))
