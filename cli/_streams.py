"""Standard streams that print any text: names in files and paths may have any."""

import codecs
import sys
from io import TextIOWrapper


def print_any_text() -> None:
    """Let standard output and error take any text, whatever the locale.

    ASCII is what a locale without a language leaves: UTF-8 is written then. Of a path
    the bytes come out as they are; what an encoding lacks becomes "?".
    """
    codecs.register_error("selfheal", _encode_anyway)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            is_ascii = codecs.lookup(stream.encoding).name == "ascii"
            stream.reconfigure(
                encoding="utf-8" if is_ascii else None, errors="selfheal"
            )


def _encode_anyway(error: UnicodeError) -> tuple[bytes, int]:
    """Bytes of what an encoding lacks, and where to go on."""
    assert isinstance(error, UnicodeEncodeError)
    codes = map(ord, error.object[error.start : error.end])
    # 0xDC80 to 0xDCFF: a byte of a path that is no text (PEP 383)
    taken = [code - 0xDC00 if 0xDC80 <= code <= 0xDCFF else ord("?") for code in codes]
    return bytes(taken), error.end
