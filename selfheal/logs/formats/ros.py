"""ROS bags: takes ROS 1 bags, ROS 2 bags in SQLite and MCAP, gives a stream a topic."""

import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..base import Log, LogFormat, Report, Rows, Stream
from .common import (
    check_wanted,
    explain_damage,
    import_extra,
    order_naturally,
    read_start,
)
from .ros_documents import CODINGS, DocumentFields, make_decode
from .ros_messages import Fields
from .ros_sources import (
    Bag1Source,
    McapSource,
    Source,
    SqliteSource,
    Topic,
    unpack_zstd,
)
from .ros_types import UnknownTypeError, make_typestore

RECEIPT = "bag time"  # the column of the time at which a message was received
_MAGIC = {b"\x89MCAP0\r\n": McapSource, b"SQLite format 3\0": SqliteSource,
          b"#ROSBAG V2.0\n": Bag1Source}  # fmt: skip
_ZSTD = b"\x28\xb5\x2f\xfd"  # stands at the start of no message that is not packed
_PACKED = (".mcap.zstd", ".db3.zstd")
# messages of a topic, and bytes of a log, from which the columns are learned; chosen:
# several publishers of one topic have all spoken by then
_LEARNED, _LEARNED_BYTES = 20, 64_000_000
_PIECE_ROWS, _PIECE_VALUES = 4_096, 100_000  # of a topic; chosen: 1 MB for each topic
# by which zstd may have packed a file; chosen: ten times what it does to joint states
_MAX_EXPANSION = 100


class RosFormat(LogFormat):
    """ROS bags of both versions, in files or folders."""

    name = "ROS bag (.bag, .db3, .mcap, a folder of them)"

    def recognizes(self, path: Path) -> bool:
        """Whether it is a bag, or a folder that holds some."""
        return bool(_list_files(path))

    def open(self, path: Path) -> Log:
        """Open a bag."""
        import_extra("rosbags.typesys", "ROS bags")
        with explain_damage(path, "ROS bag"):
            return RosLog(path)


def _list_files(path: Path) -> list[Path]:
    """The bags at a path, in the order of their numbers."""
    if not path.is_dir():
        is_bag = path.name.endswith(_PACKED) or _find_source(path)
        return [path] if is_bag else []
    files = [f for f in path.iterdir() if f.name.endswith((".mcap", ".db3", *_PACKED))]
    return sorted(files, key=lambda file: order_naturally(file.name))


def _find_source(path: Path) -> type[Source] | None:
    """What reads a file, by its first bytes."""
    start = read_start(path)
    found = [kind for magic, kind in _MAGIC.items() if start.startswith(magic)]
    return found[0] if found else None


class RosLog(Log):
    """A bag, of one file or several.

    Attributes:
        path: of the file or the folder.
        streams: one for each topic. The columns are the numbers in the messages by
            their paths, and the time of receipt.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._sources = [self._open_file(file) for file in _list_files(path)]
        self._decoders = dict[str, _Decoder]()
        counts = Counter[str]()
        for source in self._sources:
            for topic in source.topics:
                counts[topic.name] += topic.count or 0
                self._decoders.setdefault(topic.name, _Decoder(topic))
        self._learn(counts)
        self._note_losses()
        self.streams = [
            decoder.make_stream(counts[name])
            for name, decoder in self._decoders.items()
        ]

    def _note_losses(self) -> None:
        self.losses = [
            f"{source.path.name}: {source.loss}" if self.path.is_dir() else source.loss
            for source in self._sources
            if source.loss
        ]

    def _open_file(self, path: Path) -> Source:
        if path.suffix == ".zstd":
            path = self._unpack(path)
        kind = _find_source(path)
        if kind is None:
            raise InputError(f"{path}: no ROS bag: its first bytes are others")
        return kind(path)

    def _unpack(self, path: Path) -> Path:
        """Unpack a file to a folder that goes with this log."""
        zstandard = import_extra("zstandard", "ROS bags")
        folder = tempfile.mkdtemp(prefix="selfheal-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        target = Path(folder, path.stem)
        left = _MAX_EXPANSION * path.stat().st_size
        with path.open("rb") as packed, target.open("wb") as file:
            reader = zstandard.ZstdDecompressor().stream_reader(packed)
            while block := reader.read(1_000_000):
                file.write(block)
                left -= len(block)
                if left < 0:
                    raise InputError(f"{path}: it is packed too much to be a bag")
        return target

    def _learn(self, counts: Mapping[str, int]) -> None:
        """Learn the columns of each topic from some of its messages."""
        spoken = {name for name in self._decoders if counts[name]}
        short, size = set(spoken), 0
        for source in self._sources:
            for message in source.read(spoken):
                decoder = self._decoders[message.topic]
                if message.topic in short:
                    decoder.learn(message.content)
                    if decoder.learned == min(_LEARNED, counts[message.topic]):
                        short.discard(message.topic)
                size += len(message.content)
                if size > _LEARNED_BYTES or not short:
                    break
        late = {name for name in spoken if not self._decoders[name].learned}
        for source in self._sources:
            for message in source.read(late) if late else ():
                self._decoders[message.topic].learn(message.content)
                late.discard(message.topic)
                if not late:
                    break

    def read(
        self, wanted: Mapping[str, Sequence[str]], report: Report | None = None
    ) -> Iterator[tuple[str, Rows]]:
        """Read topics; pieces of several alternate."""
        check_wanted(self, wanted)
        pieces = {
            name: _Piece(self._decoders[name], columns)
            for name, columns in wanted.items()
        }
        with explain_damage(self.path, "ROS bag"):
            for number, source in enumerate(self._sources):
                for message in source.read(set(wanted)):
                    piece = pieces[message.topic]
                    piece.add(message.time, message.content)
                    if piece.is_full():
                        yield message.topic, piece.take()
                        if report:
                            report((number + message.share) / len(self._sources))
        self._note_losses()
        for name, piece in pieces.items():
            if piece.count:
                yield name, piece.take()


def _make_decoding(topic: Topic) -> tuple[Callable[[bytes], Any], Any]:
    """What decodes the messages of a topic, and what finds the numbers in them.

    Raises:
        UnknownTypeError: they are of a kind that is not decoded.
    """
    if topic.coding in CODINGS:
        decode = make_decode(topic.coding, topic.kind, topic.definition)
        return decode, DocumentFields()
    if topic.coding not in ("cdr", "ros1"):
        raise UnknownTypeError(f"a coding {topic.coding!r}")
    text = topic.definition.decode(errors="replace")
    store = make_typestore(topic.kind, text if topic.form else "", topic.form)
    deserialize = getattr(store, f"deserialize_{topic.coding}")
    return partial(_decode_ros, deserialize, topic.kind), Fields(store, topic.kind)


def _decode_ros(deserialize: Any, kind: str, content: bytes) -> Any:
    return deserialize(content, kind)


class _Decoder:
    """What decodes the messages of a topic.

    Attributes:
        topic: that it decodes.
        fields: of its messages; None where they cannot be decoded.
        learned: how many messages it has seen.
    """

    def __init__(self, topic: Topic) -> None:
        self.topic = topic
        self.fields: Fields | DocumentFields | None = None
        self.learned = 0
        self._stamps = list[float]()
        try:
            self._decode, self.fields = _make_decoding(topic)
        except UnknownTypeError:
            return  # there is still the time of receipt

    def decode(self, content: bytes) -> Any:
        """A message, which may be packed by itself."""
        if content.startswith(_ZSTD):
            content = unpack_zstd(content)
        return self._decode(content)

    def learn(self, content: bytes) -> None:
        """Look which columns a message has."""
        self.learned += 1
        if self.fields is None:
            return
        message = self.decode(content)
        self.fields.learn(message)
        if self.fields.stamp:
            self._stamps.append(self.fields.read_stamp(message))

    def make_stream(self, count: int) -> Stream:
        """The stream of the topic, which has so many messages."""
        columns = self.fields.list_columns() if self.fields else []
        stamp, stamps = self.fields.stamp if self.fields else "", np.array(self._stamps)
        is_stamped = stamps.any() and (np.diff(stamps) > 0).all()
        times = {RECEIPT: "s"} | {name: "s" for name in columns if name == stamp}
        return Stream(
            name=self.topic.name,
            columns={**times, **{name: "" for name in columns if name != stamp}},
            rows=count,
            time=stamp if is_stamped else RECEIPT,
        )


class _Piece:
    """Rows of a topic that are being filled."""

    def __init__(self, decoder: _Decoder, columns: Sequence[str]) -> None:
        self._decoder, self._columns = decoder, columns
        self.count = 0
        rows = min(_PIECE_ROWS, max(16, _PIECE_VALUES // max(1, len(columns))))
        self._rows = np.full((rows, len(columns)), np.nan)
        places = {name: k for k, name in enumerate(columns)}
        self._receipt = places.pop(RECEIPT, None)
        self._fields = deepcopy(decoder.fields) if places else None
        if self._fields:  # a copy: what is wanted of it is of this reading alone
            self._fields.bind(places)

    def add(self, time: int, content: bytes) -> None:
        """Add a message that was received at a time [ns]."""
        row = self._rows[self.count]
        if self._fields:
            self._fields.fill(self._decoder.decode(content), row)
        if self._receipt is not None:
            row[self._receipt] = time / 1e9
        self.count += 1

    def is_full(self) -> bool:
        """Whether no row is left."""
        return self.count == len(self._rows)

    def take(self) -> Rows:
        """The rows so far; begins anew."""
        found = self._rows[: self.count].T.copy()
        self._rows[:] = np.nan
        self.count = 0
        return dict(zip(self._columns, found, strict=True))
