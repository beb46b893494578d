"""Names that no terminal and no page may get as they are."""

from unicodedata import category

# those that HDF5 can hold; what Python's text can hold beside them is `HALVES`
NAMES = {
    "color": "\x1b[31mred\x1b[0m",
    "title": "\x1b]0;owned\x07",
    "c1": "\x9b31mred\x85\x90",
    "bidi": "\u202egnp.exe\u2066\u200f",
    "lines": "a\r\nselfheal: all is well\n\u2028\u2029b",
    "controls": "\t\x7f\b\x0b\x0c",
    "formats": "\ue000\U000f0000\ufeff\u200b\U000e0041\uffff",
    "markup": "[red]:smile:<b>&|`",
    "long": "x" * 5000,
    "words": "a long one " * 500,
}
HALVES = "\ud800 caf\udce9"
ALL = "".join([*NAMES.values(), HALVES])


def find_raw(text: str, keep: str = "\n") -> set[str]:
    """Characters of a text that are no visible ones."""
    hidden = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
    return {c for c in text if category(c) in hidden} - {*keep}


def spoil(value, end=ALL):
    """A document whose texts end with something hostile each; keys stay."""
    if isinstance(value, dict):
        return {key: spoil(each, end) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [spoil(each, end) for each in value]
    return value + end if isinstance(value, str) else value
