"""Progress goes to standard error, as lines alone where nobody sees a bar."""

import pytest

from selfheal.cli._progress import ProgressBar


@pytest.fixture
def seen(monkeypatch, capsys):
    """What is written of a bar and two lines, with or without a terminal."""

    def play(*, quiet: bool, terminal: bool) -> tuple[str, str]:
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setenv("FORCE_COLOR", "1" if terminal else "")
        with ProgressBar("reading", quiet=quiet) as live:
            live.say("first")
            live.show("turning", 0.5)
            live.say("[last]")
        return capsys.readouterr()

    return play


def test_without_a_terminal_there_are_lines_alone(seen):
    assert seen(quiet=False, terminal=False) == ("", "first\n[last]\n")


def test_on_a_terminal_there_is_a_bar_too_and_nothing_on_standard_output(seen):
    out, err = seen(quiet=False, terminal=True)
    assert out == "" and "turning" in err
    assert err.index("first") < err.index("[last]")


def test_quiet_is_silent(seen):
    assert seen(quiet=True, terminal=True) == ("", "")
