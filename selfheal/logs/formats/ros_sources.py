"""Files with ROS messages: takes bags, gives their topics and messages undecoded."""

import bz2
import io
import struct
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

from ...errors import InputError
from .common import get_size, import_extra

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Schema
    from rosbags.rosbag1.reader import Reader as _Reader

# bytes of a chunk of messages, unpacked; chosen: far above those that recorders write
_MAX_CHUNK = 256_000_000
# of an MCAP record: code, length [B]; of a message: channel, number, times [ns]
_RECORD, _MESSAGE, _MESSAGE_CODE = struct.Struct("<BQ"), struct.Struct("<HIQQ"), 5
_MAGIC_SIZE = 8  # bytes at both ends of an MCAP
_FORMS = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl", "omgidl": "idl"}


@dataclass(frozen=True)
class Topic:
    """What a file states of a topic.

    Attributes:
        kind: name of the type of its messages.
        definition: of the type, empty if the file has none.
        form: of the definition: "msg" or "idl" of ROS, "" of another.
        coding: of the messages: "cdr", "ros1", or another that is not decoded.
        count: of its messages; None where the file does not state it.
    """

    name: str
    kind: str
    definition: bytes
    form: str
    coding: str
    count: int | None


@dataclass(frozen=True)
class Message:
    """A message that is not decoded.

    Attributes:
        time: of receipt [ns] since 1970 UTC.
        share: of the file that was read, from 0 to 1.
    """

    topic: str
    time: int
    content: bytes
    share: float


class Source(ABC):
    """A file with messages.

    Attributes:
        loss: what of the file is damaged and left out, in words; "" if nothing.
    """

    path: Path
    topics: Sequence[Topic]
    loss: str = ""

    @abstractmethod
    def __init__(self, path: Path) -> None: ...

    @abstractmethod
    def read(self, topics: set[str]) -> Iterator[Message]:
        """Messages of some topics, in the order of receipt, or nearly."""


class McapSource(Source):
    """An MCAP file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        reader = import_extra("mcap.reader", "MCAP")
        self._index: Sequence[ChunkIndex] = ()
        summary, self._end = None, get_size(path)
        with path.open("rb") as file:
            if _is_whole(file):
                seeking = reader.SeekingReader(file, record_size_limit=2 * _MAX_CHUNK)
                summary = seeking.get_summary()
            else:
                self._end = _find_end(file)
                left = get_size(path) - self._end
                self.loss = f"it is cut off, its last {left} bytes are no whole record"
        if summary is not None and summary.channels and summary.statistics:
            schemas, channels = summary.schemas, summary.channels
            counts = summary.statistics.channel_message_counts
            self._index = sorted(
                summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset
            )
        else:
            schemas, channels, counts = self._scan()
        if self.loss and not channels:
            raise InputError(f"{path}: it is cut off before its first message")
        self._names = {key: channel.topic for key, channel in channels.items()}
        self._counts = counts
        self.topics = [
            _make_topic(channel, schemas.get(channel.schema_id), counts.get(key, 0))
            for key, channel in channels.items()
        ]

    def read(self, topics: set[str]) -> Iterator[Message]:
        """Messages of some topics, chunk by chunk."""
        from mcap import records

        keys = {key for key, name in self._names.items() if name in topics}
        size, left = get_size(self.path), sum(self._counts.get(key, 0) for key in keys)
        for place, record in self._walk(keys):
            found: Iterable[tuple[int, int, bytes]] = ()
            if isinstance(record, records.Chunk):
                found = _read_chunk(_unpack(record).data)
            elif isinstance(record, records.Message):
                found = [(record.channel_id, record.log_time, record.data)]
            for key, time, content in found:
                if key in keys:
                    left -= 1
                    yield Message(self._names[key], time, content, min(1, place / size))
        if left > 0:
            self.loss = f"{left} messages that it lists are not found"

    def _scan(self) -> "tuple[dict[int, Schema], dict[int, Channel], dict[int, int]]":
        """Schemas, channels and counts of messages, of a file that lists none."""
        from mcap import records
        from mcap.stream_reader import breakup_chunk

        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        counts = Counter[int]()
        for _, record in self._walk(None):
            parts = [record]
            if isinstance(record, records.Chunk):
                parts = breakup_chunk(_unpack(record))
            for part in parts:
                if isinstance(part, records.Channel):
                    channels[part.id] = part
                elif isinstance(part, records.Schema):
                    schemas[part.id] = part
                elif isinstance(part, records.Message):
                    counts[part.channel_id] += 1
        return schemas, channels, counts

    def _walk(self, keys: set[int] | None) -> "Iterator[tuple[int, McapRecord]]":
        """Place [B] and record of chunks, and of what stands in no chunk.

        Chunks of which the index says that they have none of some channels are
        skipped.
        """
        from mcap import records
        from mcap.stream_reader import StreamReader

        wanted = records.Schema, records.Channel, records.Message, records.Chunk
        with self.path.open("rb") as file:
            for start in self._list_starts(keys):
                file.seek(start)
                if start == 0 and self._end <= _MAGIC_SIZE:
                    return
                stream = StreamReader(
                    file,
                    skip_magic=start > 0,
                    emit_chunks=True,
                    record_size_limit=2 * _MAX_CHUNK,
                )
                for record in stream.records:
                    if isinstance(record, wanted):
                        yield file.tell(), record
                    is_last = file.tell() >= self._end
                    if start or is_last or isinstance(record, records.DataEnd):
                        break

    def _list_starts(self, keys: set[int] | None) -> list[int]:
        """Where to start reading: at chunks, or at the start of the file."""
        if keys is None or not self._index:
            return [0]
        return [
            chunk.chunk_start_offset
            for chunk in self._index
            if keys & set(chunk.message_index_offsets)
            or not chunk.message_index_offsets
        ]


def _is_whole(file: IO[bytes]) -> bool:
    """Whether an MCAP ends as it should; a recorder that is killed does not end it."""
    start = file.read(_MAGIC_SIZE)
    file.seek(-min(_MAGIC_SIZE, file.seek(0, io.SEEK_END)), io.SEEK_END)
    end = file.read(_MAGIC_SIZE)
    file.seek(0)
    return start == end


def _find_end(file: IO[bytes]) -> int:
    """Where the last whole record of an MCAP that was cut off ends [B]."""
    size, end = file.seek(0, io.SEEK_END), _MAGIC_SIZE
    while end + _RECORD.size <= size:
        file.seek(end)
        code, length = _RECORD.unpack(file.read(_RECORD.size))
        if not code or end + _RECORD.size + length > size:
            break  # room that was kept for more, or a part of a record
        end += _RECORD.size + length
    return end


def _make_topic(channel: "Channel", schema: "Schema | None", count: int) -> Topic:
    """A topic of an MCAP channel."""
    form = _FORMS.get(schema.encoding, "") if schema else ""
    kind = schema.name if schema else ""
    if channel.message_encoding == "ros1":
        kind = import_extra("rosbags.typesys.msg", "MCAP").normalize_msgtype(kind)
    return Topic(
        name=channel.topic,
        kind=kind,
        definition=schema.data if schema else b"",
        form=form,
        coding=channel.message_encoding,
        count=count,
    )


def _unpack(chunk: "Chunk") -> "Chunk":
    """An MCAP chunk unpacked, its size and its checksum checked."""
    if chunk.uncompressed_size > _MAX_CHUNK:
        raise InputError(f"a chunk of {chunk.uncompressed_size} bytes")
    if chunk.compression == "zstd":
        content = unpack_zstd(chunk.data, chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        content = _unpack_lz4(chunk.data, chunk.uncompressed_size)
    elif chunk.compression:
        raise InputError("a chunk is packed in a way that is not known")
    else:
        content = chunk.data
    if len(content) != chunk.uncompressed_size:
        raise InputError("a chunk has another size than it states")
    if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
        raise InputError("the checksum of a chunk is wrong")
    chunk.data, chunk.compression = content, ""
    return chunk


def _read_chunk(content: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Channel, time of receipt [ns] and content of the messages in a chunk.

    As https://mcap.dev/spec states; `mcap` takes three times as long.
    """
    place = 0
    while place < len(content):
        code, length = _RECORD.unpack_from(content, place)
        place += _RECORD.size
        if code == _MESSAGE_CODE:
            channel, _, time, _ = _MESSAGE.unpack_from(content, place)
            yield channel, time, content[place + _MESSAGE.size : place + length]
        place += length


def unpack_zstd(content: bytes, size: int = _MAX_CHUNK) -> bytes:
    """What zstd packed, of at most a size [B] and one byte."""
    zstandard = import_extra("zstandard", "MCAP")
    with zstandard.ZstdDecompressor().stream_reader(content) as reader:
        return reader.read(size + 1)


def _unpack_lz4(content: bytes, size: int = _MAX_CHUNK) -> bytes:
    """What lz4 packed, of at most a size [B] and one byte."""
    frame = import_extra("lz4.frame", "MCAP")
    return frame.LZ4FrameDecompressor().decompress(content, max_length=size + 1)


def _unpack_bz2(content: bytes) -> bytes:
    return bz2.BZ2Decompressor().decompress(content, max_length=_MAX_CHUNK)


class SqliteSource(Source):
    """A ROS 2 bag in SQLite."""

    def __init__(self, path: Path) -> None:
        self.path = path
        forms = import_extra("rosbags.interfaces", "ROS bags").MessageDefinitionFormat
        with closing(self._open()) as reader:
            self.topics = [
                Topic(
                    name=str(found.topic),
                    kind=str(found.msgtype),
                    definition=found.msgdef.data.encode(),
                    form="idl" if found.msgdef.format == forms.IDL else "msg",
                    coding=getattr(found.ext, "serialization_format", "ros1"),
                    count=found.msgcount,
                )
                for found in reader.connections
            ]

    def _open(self) -> "_Reader":
        storage = import_extra("rosbags.rosbag2.storage_sqlite3", "ROS bags")
        reader: _Reader = storage.Sqlite3Reader(self.path)
        reader.open()
        return reader

    def read(self, topics: set[str]) -> Iterator[Message]:
        """Messages of some topics by their time."""
        with closing(self._open()) as reader:
            wanted = [found for found in reader.connections if found.topic in topics]
            total = max(1, sum(found.msgcount for found in wanted))
            messages = reader.messages(wanted) if wanted else ()
            for number, (connection, time, content) in enumerate(messages):
                share = min(1, (number + 1) / total)
                yield Message(connection.topic, time, content, share)


class Bag1Source(SqliteSource):
    """A ROS 1 bag."""

    def _open(self) -> "_Reader":
        module = import_extra("rosbags.rosbag1.reader", "ROS bags")
        limits = {
            module.decompressors["bz2"]: _unpack_bz2,
            module.decompressors["lz4"]: _unpack_lz4,
        }
        reader: _Reader = module.Reader(self.path)
        reader.open()
        for place, chunk in reader.chunks.items():
            unpack = limits.get(chunk.decompressor, chunk.decompressor)
            reader.chunks[place] = chunk._replace(decompressor=unpack)
        return reader
