"""Bags of messages: messages in, files of ROS and MCAP out."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys.store import Typestore

START = 1_700_000_000_000_000_000  # [ns]
STEP = 10_000_000  # [ns]


def write_bag(
    path: Path,
    store: Typestore,
    messages: Iterable[tuple[str, object]],
    plugin: StoragePlugin = StoragePlugin.MCAP,
    **settings: object,
) -> Path:
    """A ROS 2 bag of topics and messages, one every 10 ms.

    Args:
        settings: of the compression, as rosbags has them.
    """
    writer = Writer2(path, version=9, storage_plugin=plugin)
    if settings:
        writer.set_compression(**settings)
    connections = {}
    with writer:
        for k, (topic, message) in enumerate(messages):
            kind = message.__msgtype__
            if topic not in connections:
                made = writer.add_connection(topic, kind, typestore=store)
                connections[topic] = made
            raw = store.serialize_cdr(message, kind)
            writer.write(connections[topic], START + k * STEP, raw)
    return path


def write_mcap(
    path: Path,
    channels: Sequence[tuple[str, str]],
    schema: tuple[str, str, bytes],
    messages: Iterable[tuple[int, bytes]],
    **settings: object,
) -> Path:
    """An MCAP of messages, one every 10 ms, by the library `mcap`.

    Args:
        channels: topic and coding of each.
        schema: name, form and definition of the type of all.
        messages: number of the channel, and content.
        settings: of the writer.
    """
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=500, **settings)
        writer.start()
        number = writer.register_schema(*schema)
        ids = [writer.register_channel(*channel, number) for channel in channels]
        for k, (channel, content) in enumerate(messages):
            time = START + k * STEP
            writer.add_message(ids[channel], time, content, time)
        writer.finish()
    return path
