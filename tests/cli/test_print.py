"""Tables in narrow terminals: no word is broken, nothing is lost."""

import pytest

from selfheal.cli._print import print_table

LONG = (
    "load_dependent_friction",
    "actuator:left_shoulder_motor",
    "load_coefficient 0.14 (0.12 to 0.16)",
    "4.60 times",
)
SHORT = (
    "coulomb_friction",
    "joint:knee",
    "frictionloss 0.14 N m (0.12 to 0.16)",
    "2 times",
)
HEAD = ("effect", "where", "value (90 % interval)", "error without it")


@pytest.fixture
def printed(monkeypatch, capsys):
    """Prints a table on a terminal of some width; returns its lines."""

    def play(width: int, *rows, head=HEAD, **more) -> list[str]:
        monkeypatch.setenv("COLUMNS", str(width))
        print_table(head, rows, **more)
        return capsys.readouterr().out.splitlines()

    return play


@pytest.mark.parametrize("width", [30, 60, 80, 100, 200])
@pytest.mark.parametrize("rows", [(SHORT,), (LONG, SHORT)])
def test_no_word_is_broken(width, rows, printed):
    lines = printed(width, *rows)
    assert max(map(len, lines)) <= width
    words = set(" ".join(lines).split())
    for row in rows:
        for cell in row:
            assert set(cell.split()) <= {*words, *(w.rstrip(";") for w in words)}


def test_a_table_that_fits_stays_one_and_a_wide_one_becomes_a_list(printed):
    assert "\N{BOX DRAWINGS LIGHT VERTICAL}" in printed(80, SHORT)[3]
    lines = printed(80, LONG, SHORT)
    assert lines[0] == LONG[0] and lines[1].startswith(f"  where: {LONG[1]}; value (")
    assert SHORT[0] in lines


def test_columns_that_are_to_stay_whole_do(printed):
    lines = printed(60, ("a b c", "d e " * 30), head=("name", "what"), whole=1)
    assert any("a b c" in line for line in lines)
    lines = printed(20, ("a b c d e f g h i", "d e"), head=("name", "what"), whole=1)
    assert lines[0] == "a b c d e f g h i" and lines[1] == "  what: d e"


def test_a_cell_of_several_lines_keeps_them(printed):
    lines = printed(60, (["first", "second"], "x"), head=("name", "what"))
    assert sum("first" in line or "second" in line for line in lines) == 2
