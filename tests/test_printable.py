"""Text that cannot be seen is escaped, what has no end is cut, the rest stays."""

import json

import pytest

from selfheal.errors import InputError, RecordingError, UnknownNameError
from selfheal.printable import (
    MAX_LIST,
    MAX_NAME,
    MAX_TEXT,
    MAX_WORD,
    escape_unprintable,
    join_names,
    make_printable,
    quote_name,
    shorten_middle,
)
from tests.support.hostile.names import HALVES, NAMES, find_raw

ORDINARY = "knee_position [rad] – é漢\N{NO-BREAK SPACE}a\\x1b 'b' \N{WAVING HAND SIGN}"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[31m", r"\x1b[31m"),
        ("a\nb\t", r"a\nb\t"),
        ("\u202e\U000e0041", r"\u202e\U000e0041"),
        ("\x9b\x7f", r"\x9b\x7f"),
        (HALVES, r"\ud800 caf\udce9"),
        # bytes of UTF-8, as they come in an ASCII locale
        ("\udcc3\udca9\udcc2\udc9b", r"é\x9b"),
    ],
)
def test_what_cannot_be_seen_is_escaped(text, shown):
    assert escape_unprintable(text) == shown


def test_what_is_kept_is_not_escaped():
    assert escape_unprintable("a\nb\tc\r", keep="\n\t") == "a\nb\tc\\r"


def test_what_is_ordinary_stays():
    for text in (ORDINARY, "/a path/" + "b" * (MAX_WORD - 6), "word " * 399):
        assert make_printable(text) == text


def test_any_text_becomes_a_short_line(rng):
    """Random characters of all of Unicode, most often of its lower part."""
    for _ in range(300):
        top = rng.choice([0x100, 0x3000, 0x110000])
        text = "".join(map(chr, rng.integers(0, top, rng.integers(1, 3000))))
        shown = make_printable(text)
        assert not find_raw(shown, keep="")
        assert len(shown) <= MAX_TEXT
        assert all(len(word) <= MAX_WORD for word in shown.split())
        assert make_printable(shown) == shown
        assert shown.encode("utf-8")
        assert json.loads(json.dumps(text)) == text and json.dumps(text).isascii()
        assert not find_raw(quote_name(text), keep="")
        assert len(quote_name(text)) <= MAX_NAME


def test_what_is_cut_keeps_both_ends():
    assert shorten_middle("abcdefghij", 10) == "abcdefghij"
    assert shorten_middle("abcdefghijk", 10) == "abcd...ijk"
    assert shorten_middle("abcdefghijkl", 9) == "abc...jkl"


def test_a_long_list_of_names_says_how_many_more():
    few, many = ["a", "b"], [f"joint_{k}" for k in range(1000)]
    assert join_names(few) == "a, b" and join_names([]) == ""
    shown, _, more = join_names(many).partition(", ... and ")
    names = shown.split(", ")
    assert names == many[: len(names)] and len(shown) <= MAX_LIST
    assert more == f"{1000 - len(names)} more"
    assert join_names([NAMES["long"], "b"]).endswith(", b")


@pytest.mark.parametrize("name", [*NAMES.values(), HALVES], ids=[*NAMES, "halves"])
@pytest.mark.parametrize(
    "make",
    [
        lambda name: InputError(f"{name}: there is no such file"),
        RecordingError,
        lambda name: UnknownNameError("effect", name, [name, "b"]),
        lambda name: UnknownNameError("effect", "a", [f"{name}{k}" for k in range(99)]),
    ],
)
def test_a_message_is_a_line_whatever_the_names(make, name):
    message = str(make(name))
    assert not find_raw(message, keep="")
    assert 0 < len(message) <= MAX_TEXT


def test_a_message_of_ordinary_names_is_what_was_said():
    assert str(InputError(ORDINARY)) == ORDINARY
    assert str(InputError()) == ""
    said = "unknown effect 'wnd'; valid: slope, wind"
    assert str(UnknownNameError("effect", "wnd", ["wind", "slope"])) == said
