"""Standard streams that print any text, and none that controls a terminal."""

import codecs
import sys
from collections.abc import Iterable
from io import TextIOWrapper
from typing import Any, TextIO

from selfheal.printable import escape_unprintable


class PrintableStream:
    """A stream that shows control characters, whoever writes them, but newlines.

    Attributes:
        raw: the stream that it writes to.
    """

    def __init__(self, raw: TextIO) -> None:
        self.raw = raw

    def write(self, text: str) -> int:
        """Write text with escapes of what is not printable."""
        self.raw.write(escape_unprintable(text, keep="\n"))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write several."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.raw, name)


def guard_streams() -> None:
    """Let standard output and error take any text, whatever the locale.

    ASCII is what a locale without a language leaves: UTF-8 is written then. What an
    encoding lacks becomes an escape.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, TextIOWrapper):
            is_ascii = codecs.lookup(stream.encoding).name == "ascii"
            encoding = "utf-8" if is_ascii else None
            stream.reconfigure(encoding=encoding, errors="backslashreplace")
        if stream and not isinstance(stream, PrintableStream):
            setattr(sys, name, PrintableStream(stream))


def unwrap(stream: "TextIO | PrintableStream") -> TextIO:
    """What a `PrintableStream` writes to; any other stream itself."""
    return stream.raw if isinstance(stream, PrintableStream) else stream
