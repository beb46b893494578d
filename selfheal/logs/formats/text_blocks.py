"""Text files in blocks of whole lines, worked on by several threads in their order."""

import codecs
import gzip
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ...errors import InputError
from .common import get_size, read_start

T = TypeVar("T")
R = TypeVar("R")
BLOCK = 1_000_000  # bytes that are parsed at once; chosen: a line has fewer
GZIP = b"\x1f\x8b"  # at the start of what gzip packed
# blocks that are parsed at once; chosen: more threads wait for the one that writes
_MOST_THREADS = 4


@dataclass(frozen=True)
class Block:
    """Some lines of a text.

    Attributes:
        lines: in UTF-8.
        is_first: whether the text begins with them.
        is_last: whether it ends with them.
        share: of the file that was read when they were, from 0 to 1.
    """

    lines: bytes
    is_first: bool
    is_last: bool
    share: float


def open_text(path: Path) -> Any:
    """Open a text file to read its bytes, which gzip may have packed."""
    packed = read_start(path).startswith(GZIP)
    return gzip.open(path) if packed else path.open("rb")


def cut_blocks(path: Path, encoding: str) -> Iterator[Block]:
    """All lines of a text file, at least one a block.

    Args:
        path: of the file.
        encoding: of the text.

    Raises:
        InputError: a line is longer than a block.
        OSError, EOFError, ValueError: the file is damaged.
    """
    decode = codecs.getincrementaldecoder(encoding)().decode
    size, rest, is_first = get_size(path), b"", True
    with closing(open_text(path)) as file:
        place = getattr(file, "fileobj", file)  # of gzip, where the packed file is
        is_last = False
        while not is_last:
            read = file.read(BLOCK)
            is_last = len(read) < BLOCK
            if encoding != "utf-8":
                read = decode(read, is_last).encode()
            read = rest + read
            end = len(read) if is_last else _find_end(read)
            lines, rest = read[:end], read[end:]
            if len(rest) > BLOCK:
                raise InputError("a line is too long")
            if lines:
                share = min(1.0, place.tell() / size)
                yield Block(lines, is_first, is_last, share)
                is_first = False


def _find_end(text: bytes) -> int:
    """Where the last whole line ends; a return at the very end may go on."""
    end = text.rfind(b"\n") + 1
    return end or text.rfind(b"\r", 0, len(text) - 1) + 1


def map_in_order(work: Callable[[T], R], items: Iterator[T]) -> Iterator[R]:
    """What a function makes of items, some of them at a time ahead.

    Args:
        work: is called in threads; lets other threads run most of the time.
        items: are taken as results are.
    """
    threads = min(_MOST_THREADS, os.cpu_count() or 1)
    waiting = deque[Future[R]]()
    with ThreadPoolExecutor(threads) as pool:
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
