"""Text of files and users in; what a terminal, a page or a message can carry out.

A name may hold anything: sequences that command a terminal, characters that turn the
direction of reading, halves of characters that no encoding writes, a million letters.
"""

import re
from collections.abc import Iterable
from unicodedata import category

# longest that are shown whole, in characters; chosen:
MAX_NAME = 80  # a name in quotes, so that two of them and a sentence fit three lines
MAX_WORD = 300  # anything without a space: longer than the paths that people use
MAX_LIST = 800  # a list of names: all effects, and the names of a humanoid
MAX_TEXT = 2000  # a message, a line, a cell of a table: a screenful

_LONG_WORD = re.compile(rf"\S{{{MAX_WORD + 1},}}")
_SUSPECT = re.compile(r"[^ -~]")
# bytes of a path that the locale could not read as text (PEP 383)
_BYTES = re.compile("[\udc80-\udcff]+")


def make_printable(text: str, keep: str = "", most: int = MAX_TEXT) -> str:
    """A text without what cannot be seen or has no end; what is ordinary stays.

    Args:
        text: from a file or a user, perhaps inside a sentence of ours.
        keep: characters that are not escaped, a newline say.
        most: characters of the result; words are at most `MAX_WORD` long, too.
    """
    shown = escape_unprintable(text, keep)
    shown = _LONG_WORD.sub(lambda word: shorten_middle(word[0], MAX_WORD), shown)
    return shorten_middle(shown, most, mark=" ... ")  # no word grows by it


def escape_unprintable(text: str, keep: str = "") -> str:
    r"""A text with Python's escapes, as \x1b and \u202e, of what cannot be seen.

    Those are control and format characters, surrogates, what Unicode assigns to nobody
    and what ends a line (its categories Cc, Cf, Cs, Co, Cn, Zl and Zp). A backslash
    stays as it is, so that what is escaped twice is escaped once. Bytes of a path that
    are UTF-8 are read as such, where the locale did not.
    """

    def escape(found: re.Match[str]) -> str:
        c = found[0]
        if c in keep or c.isprintable() or category(c) == "Zs":
            return c
        return c.encode("unicode_escape").decode()

    return _SUSPECT.sub(escape, _BYTES.sub(_decode, text))


def _decode(found: re.Match[str]) -> str:
    """Bytes of a path as text, as far as they are UTF-8."""
    raw = found[0].encode("ascii", "surrogateescape")
    return raw.decode("utf-8", "surrogateescape")


def shorten_middle(text: str, most: int, mark: str = "...") -> str:
    """A text of at most so many characters.

    Args:
        most: characters of the result; more than `mark` and one has.
        mark: in place of what is missing in the middle.
    """
    if len(text) <= most:
        return text
    end = (most - len(mark)) // 2
    return f"{text[: most - len(mark) - end]}{mark}{text[-end:]}"


def quote_name(name: str) -> str:
    """A name as a message shows it: in quotes, of at most `MAX_NAME` characters."""
    return shorten_middle(repr(name), MAX_NAME)


def join_names(names: Iterable[str]) -> str:
    """Names with commas, the first ones of a list longer than `MAX_LIST` characters."""
    every = [shorten_middle(name, MAX_WORD) for name in names]
    shown, room = every[:1], MAX_LIST - sum(map(len, every[:1]))
    for name in every[1:]:
        room -= len(", ") + len(name)
        if room < 0:
            return f"{', '.join(shown)}, ... and {len(every) - len(shown)} more"
        shown.append(name)
    return ", ".join(shown)
