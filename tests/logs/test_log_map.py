"""What a map states that nobody knows is said by its place in the map."""

import pytest

from selfheal.errors import InputError
from tests.support.logs.table_log import make_map

SIGNAL = '[[signals]]\nkind = "command"\n'


STREAM = 'signals = []\n[time.streams.str]\noffset = "x"'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f"{SIGNAL}columns = 3",
            "signals[0].columns is 3; would fit: a valid string or a valid array",
        ),
        (
            f'{SIGNAL}columns = ["a", 3]',
            "signals[0].columns[1] is 3; would fit: a valid string",
        ),
        (
            f'{SIGNAL}columns = "a"\nsign = "-"',
            "signals[0].sign is '-'; would fit: a valid integer or a valid array",
        ),
        (f'{SIGNAL}columns = "a"\nnope = 1', "signals[0].nope is not known"),
        (SIGNAL, "signals[0].columns is missing"),
        (STREAM, "time.streams.str.offset is 'x'; would fit: a valid "),
        ("signals = 1", "signals is 1; would fit: a valid array"),
        ("version = 2\nsignals = []", "a map of version 2; this program reads 1"),
        ("signals = []", "it has no [[signals]]"),
    ],
)
def test_what_does_not_fit_is_said_by_its_place(text, said):
    with pytest.raises(InputError) as caught:
        make_map(text)
    assert str(caught.value).startswith(f"map.toml: {said}")
