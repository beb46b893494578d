"""Broken logs and maps: a file's content and a seed in; another content out."""

import gzip
import io
import json
import tomllib
import warnings
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.hardening.log_files import ENCODERS, Columns, make_columns
from benchmarks.hardening.mutate_bytes import mutate_bytes
from benchmarks.hardening.mutate_json import mutate_json

_CELLS = (b"", b"nan", b"NaN", b"inf", b"-inf", b"1e400", b"-1e307", b"0x10", b"1,5",
          b"text", b"\xff\xfe", b"\xc3\xa9", b"\0", b'"', b'"a\nb"', b"[1, 2]",
          b"2026-01-01T00:00:00Z", b"true", 10_000 * b"9", 300_000 * b"x", b"--", b"\r",
          b"= {", b"[[", b'"""', b"\\u0000", b"9e999999999", b"18446744073709551616"
          )  # fmt: skip
_SPLITS = b",\t\n ="
_NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0, -1.0, 1e300, 5e-324, 2.0**63)
_NAMES = ("", "t", "q_elbow", "é", "a/b", "a:b", "[0]", "a\nb", "\0", 5_000 * "n")
_TEXTS = ("", "x", "\0", "é", "2026-01-01T00:00:00", "1,5", 1000 * "long ")


def mutate_text(content: bytes, seed: int) -> bytes:
    """Change cells, lines or the encoding of a text, at one place or a few."""
    rng = np.random.default_rng(seed)
    for _ in range(rng.choice((1, 1, 2, 3))):
        lines = content.split(b"\n")
        k = int(rng.integers(len(lines)))
        chance = rng.integers(8)
        if chance < 3:
            lines[k] = _change_cell(lines[k], rng)
        elif chance == 3:
            lines[k] = lines[k][: int(rng.integers(len(lines[k]) + 1))]
        elif chance == 4:
            lines.insert(k, lines[int(rng.integers(len(lines)))])
        elif chance == 5:
            del lines[k]
        elif chance == 6:
            lines = lines[: k + 1]
        else:
            codes = ("utf-16", "utf-32", "latin-1", "utf-8-sig", "cp500")
            text = content.decode(errors="replace")
            code = codes[rng.integers(len(codes))]
            return text.encode(code, errors="replace")
        content = b"\n".join(lines)
    return content


def _change_cell(line: bytes, rng: np.random.Generator) -> bytes:
    """A line with one of its cells replaced."""
    cuts = [k for k, byte in enumerate(line) if byte in _SPLITS]
    ends = [-1, *cuts, len(line)]
    k = int(rng.integers(len(ends) - 1))
    return line[: ends[k] + 1] + _CELLS[rng.integers(len(_CELLS))] + line[ends[k + 1] :]


def mutate_gzip(content: bytes, seed: int) -> bytes:
    """Change the text that gzip packed."""
    return gzip.compress(mutate_text(gzip.decompress(content), seed), mtime=0)


def mutate_lines(content: bytes, seed: int) -> bytes:
    """Change one of JSON lines."""
    rng = np.random.default_rng(seed)
    lines = content.split(b"\n")
    k = int(rng.integers(len(lines) - 1))
    lines[k] = mutate_json(lines[k], int(rng.integers(2**31)))
    return b"\n".join(lines)


def mutate_zip(content: bytes, seed: int) -> bytes:
    """Change a member of a zip archive, drop it, or name it another way."""
    rng = np.random.default_rng(seed)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    k, chance = int(rng.integers(len(members))), rng.integers(6)
    name, inner = members[k]
    if chance == 4:
        del members[k]
    elif chance == 5:
        new = _NAMES[rng.integers(len(_NAMES))].replace("\0", "_")  # of no zip
        members[k] = f"{new}.npy", inner
    else:
        members[k] = name, mutate_bytes(inner, int(rng.integers(2**31)))
    buffer = io.BytesIO()
    with (
        warnings.catch_warnings(action="ignore"),  # of a name that is there already
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name, inner in members:
            archive.writestr(name, inner)
    return buffer.getvalue()


def mutate_toml(content: bytes, seed: int) -> bytes:
    """Change a value of a map, or a few."""
    document = tomllib.loads(content.decode())
    changed = json.loads(mutate_json(json.dumps(document).encode(), seed))
    members = changed if isinstance(changed, dict) else {"version": changed}
    lines = (f"{_quote(k)} = {_format_toml(v)}\n" for k, v in members.items())
    return "".join(lines).encode(errors="replace")


def _format_toml(value: Any) -> str:
    """A value in TOML, whose tables are inline; there is no null."""
    if isinstance(value, dict):
        members = (f"{_quote(k)} = {_format_toml(v)}" for k, v in value.items())
        return f"{{{', '.join(members)}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_format_toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return _quote(value) if isinstance(value, str) else str(value or 0)


def _quote(text: str) -> str:
    return json.dumps(text)


def mutate_mcap(content: bytes, seed: int) -> bytes:
    """Change a message, a type or a topic of an MCAP, which is whole otherwise."""
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer

    rng = np.random.default_rng(seed)
    found = list(make_reader(io.BytesIO(content)).iter_messages())
    odd, chance = int(rng.integers(len(found))), rng.integers(7)
    buffer, channels = io.BytesIO(), dict[str, int]()
    writer = Writer(buffer, compression=CompressionType.NONE, enable_crcs=False)
    writer.start("ros2")
    for k, (schema, channel, message) in enumerate(found):
        assert schema is not None
        topic, inner, time = channel.topic, message.data, message.log_time
        if topic not in channels:
            kind, text, form, coding = schema.name, schema.data, schema.encoding, "cdr"
            is_odd = topic == found[odd][1].topic
            if is_odd and chance == 0:
                text = mutate_text(text, int(rng.integers(2**31)))
            elif is_odd and chance == 1:
                kind = ("", "a", "std_msgs/msg/No", 9_000 * "x")[rng.integers(4)]
            elif is_odd and chance == 2:
                form = ("", "protobuf", "jsonschema", "ros2idl")[rng.integers(4)]
                coding = ("", "protobuf", "json", "ros1")[rng.integers(4)]
            made = writer.register_schema(kind, form, text)
            channels[topic] = writer.register_channel(topic, coding, made)
        if k == odd and chance == 3:
            time = (0, 2**63, 2**64 - 1, 1)[rng.integers(4)]
        elif chance == 4 or (k == odd and chance > 4):
            inner = mutate_bytes(inner, int(rng.integers(2**31)))
        writer.add_message(channels[topic], time, inner, time)
    writer.finish()
    return buffer.getvalue()


def make_column_mutation(name: str) -> Callable[[bytes, int], bytes]:
    """What changes the columns of a log before they are written as its format does.

    Args:
        name: of the log, a key of `ENCODERS`.
    """

    def mutate_columns(content: bytes, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        columns = make_columns()
        for _ in range(rng.choice((1, 1, 2, 3))):
            columns = _change_column(columns, rng)
        return ENCODERS[name](columns)

    return mutate_columns


def _change_column(columns: Columns, rng: np.random.Generator) -> Columns:
    """Columns of which one has other values, another type, or another name."""
    names = list(columns)
    name = names[rng.integers(len(names))]
    column, rows = columns[name], len(columns[name])
    chance = rng.integers(9)
    if chance == 0 and len(names) > 1:
        return {n: c for n, c in columns.items() if n != name}
    if chance == 1:
        new = _NAMES[rng.integers(len(_NAMES))]
        return {new if n == name else n: c for n, c in columns.items()}
    if chance == 2:
        keep = int(rng.integers(rows + 1))
        return {n: c[:keep] for n, c in columns.items()}
    if chance == 3:
        order = rng.permutation(rows)
        return {n: c[order] for n, c in columns.items()}
    if chance == 4:
        texts = rng.choice(np.array(_TEXTS, dtype=object), rows)
        return {**columns, name: texts}
    if chance == 5:
        kind = ("i1", "?", "f4", "f2", "i8", "c16")[rng.integers(6)]
        numbers = np.zeros(rows) if column.dtype.kind == "O" else column
        with np.errstate(all="ignore"):
            return {**columns, name: np.nan_to_num(numbers).astype(kind)}
    poison = _NUMBERS[rng.integers(len(_NUMBERS))]
    numbers = np.zeros(rows) if column.dtype.kind == "O" else column
    where = rng.random(rows) < rng.choice([0.02, 0.5, 1.0])
    return {**columns, name: np.where(where, poison, numbers)}
