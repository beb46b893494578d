"""ROS bags: takes ROS 1 bags, ROS 2 bags in SQLite and MCAP, gives a stream a topic."""

import math
import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from ...errors import InputError
from ..base import Log, LogFormat, Report, Rows
from .common import (
    check_wanted,
    explain_damage,
    import_extra,
    order_naturally,
    read_start,
)
from .ros_sources import Bag1Source, McapSource, Source, SqliteSource
from .ros_topics import Decoder, Piece

_MAGIC: Mapping[bytes, type[Source]] = {
    b"\x89MCAP0\r\n": McapSource,
    b"SQLite format 3\0": SqliteSource,
    b"#ROSBAG V2.0\n": Bag1Source,
}
_PACKED = (".mcap.zstd", ".db3.zstd")
# messages of a topic, and bytes of a log, from which the columns are learned; chosen:
# several publishers of one topic have all sent by then
_LEARNED, _LEARNED_BYTES = 20, 64_000_000
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
    found = (kind for magic, kind in _MAGIC.items() if start.startswith(magic))
    return next(found, None)


class RosLog(Log):
    """A bag, of one file or several: a stream for each topic.

    The columns are the numbers in the messages by their paths, and the time of receipt.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._sources = [self._open_file(file) for file in _list_files(path)]
        self._decoders = dict[str, Decoder]()
        counts = Counter[str]()
        for source in self._sources:
            for topic in source.topics:
                counts[topic.name] += topic.count or 0
                self._decoders.setdefault(topic.name, Decoder(topic))
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
        most = {n: min(_LEARNED, counts[n]) for n in self._decoders if counts[n]}
        self._learn_from(most, _LEARNED_BYTES)
        late = {n: 1 for n in most if not self._decoders[n].learned}
        self._learn_from(late, math.inf)

    def _learn_from(self, most: Mapping[str, int], size: float) -> None:
        """Learn topics from so many messages of each, in a part [B] of the log."""
        short = set(most)
        for source in self._sources if short else ():
            for message in source.read(set(most)):
                decoder = self._decoders[message.topic]
                if message.topic in short:
                    decoder.learn(message.content)
                    if decoder.learned >= most[message.topic]:
                        short.discard(message.topic)
                size -= len(message.content)
                if size < 0 or not short:
                    break

    def read(
        self, wanted: Mapping[str, Sequence[str]], report: Report | None = None
    ) -> Iterator[tuple[str, Rows]]:
        """Read topics; pieces of several alternate."""
        check_wanted(self, wanted)
        pieces = {n: Piece(self._decoders[n], columns) for n, columns in wanted.items()}
        with explain_damage(self.path, "ROS bag"):
            for number, source in enumerate(self._sources):
                for message in source.read(set(wanted)):
                    piece = pieces[message.topic]
                    piece.add(message)
                    if piece.is_full():
                        yield message.topic, piece.take()
                        if report:
                            report((number + message.share) / len(self._sources))
        self._note_losses()
        for name, piece in pieces.items():
            if piece.count:
                yield name, piece.take()
