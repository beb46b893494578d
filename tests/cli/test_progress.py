"""Progress goes to standard error, as lines alone where nobody sees a bar."""

import time
from types import SimpleNamespace

import pytest

from selfheal.cli import _progress
from selfheal.cli._progress import ProgressBar, StageProgress, format_left
from selfheal.cli.heal import _SECONDS, _PhaseProgress
from selfheal.cli.identify import _CycleProgress
from selfheal.cli.recover import _RunProgress
from selfheal.recovery.recover_run import RecoverRun

PLAIN = {"as_json": False, "progress": False}


@pytest.fixture
def seen(monkeypatch, capsys):
    """Show a bar and two lines, with or without a terminal; returns both outputs."""

    def play(*, terminal: bool, **more: bool) -> tuple[str, str]:
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setenv("FORCE_COLOR", "1" if terminal else "")
        with ProgressBar("reading", **{**PLAIN, **more}) as live:
            live.say("first")
            live.show("turning", 0.5)
            live.say("[last]")
        return capsys.readouterr()

    return play


@pytest.fixture
def clock(monkeypatch):
    """Time as a test has it."""
    now = SimpleNamespace(seconds=0.0)
    stand_in = SimpleNamespace(perf_counter=lambda: now.seconds)
    monkeypatch.setattr(_progress, "time", stand_in)
    assert time.perf_counter() > 0
    return now


def test_without_a_terminal_there_are_lines_alone(seen):
    assert seen(terminal=False) == ("", "first\n[last]\n")


@pytest.mark.parametrize("as_json", [False, True])
def test_on_a_terminal_there_is_a_bar_too_and_nothing_on_standard_output(seen, as_json):
    out, err = seen(terminal=True, as_json=as_json)
    assert out == "" and "turning" in err
    assert err.index("first") < err.index("[last]")


def test_for_a_script_it_is_silent_unless_asked(seen):
    assert seen(terminal=False, as_json=True) == ("", "")
    out, err = seen(terminal=False, as_json=True, progress=True)
    assert out == "" and " 50 %" in err and "turning" in err and "left" in err


def test_the_time_left_goes_on_between_two_reports(clock):
    live = ProgressBar("reading", **PLAIN)
    clock.seconds = 4.0
    assert live.share == 0 and "left" not in live.state  # nothing is known
    clock.seconds = 10.0
    live.show("fitting", 0.25)
    assert live.share == pytest.approx(0.25) and "about 30 s left" in live.state
    clock.seconds = 20.0
    assert live.share == pytest.approx(0.5) and "about 20 s left" in live.state
    clock.seconds = 60.0  # longer than was thought
    assert 0.9 < live.share < 1 and "about 3 s left" in live.state


def test_a_bar_never_goes_back(clock):
    live = ProgressBar("reading", **PLAIN)
    shares = []
    for seconds, share in (10.0, 0.5), (15.0, 0.3), (30.0, 0.2), (60.0, 0.9):
        clock.seconds = seconds
        live.show("fitting", share)
        shares.append(live.share)
    assert shares == sorted(shares) and shares[-1] == pytest.approx(0.9)
    clock.seconds = 61.0
    assert "about 6 s left" in live.state  # of the last report alone


@pytest.mark.parametrize(
    "seconds, said",
    [
        (0.2, "about 1 s left"),
        (7.4, "about 7 s left"),
        (43, "about 45 s left"),
        (89, "about 90 s left"),
        (100, "about 2 min left"),
        (1000, "about 17 min left"),
    ],
)
def test_a_time_left_is_said_no_more_exactly_than_it_is_known(seconds, said):
    assert format_left(seconds) == said


def test_shares_of_stages_are_shares_of_the_whole():
    stages = StageProgress({"walk": 1.0, "ask": 3.0})
    each = [("walk", 0.0), ("walk", 1.0), ("ask", 0.0), ("ask", 0.5), ("ask", 1.0)]
    assert [stages.compute_share(*e) for e in each] == [0.0, 0.25, 0.25, 0.625, 1.0]


def test_stages_that_were_done_earlier_take_no_time():
    resumed = StageProgress({"walk": 5.0, "ask": 3.0, "heal": 1.0})
    assert [resumed.compute_share("ask", x) for x in (0.5, 1.0)] == [0.375, 0.75]
    assert resumed.compute_share("heal", 1.0) == 1.0
    started = StageProgress({"walk": 5.0, "ask": 3.0}, start=2.0)
    assert [started.compute_share("walk", x) for x in (0.0, 1.0)] == [0.2, 0.7]


class _Live:
    """Stands in for a bar: what it was told, at times that a test sets."""

    def __init__(self) -> None:
        self.seconds, self.shares = 0.0, list[float]()

    def show(self, what: str, share: float) -> None:
        self.shares += [share] if share else []

    def say(self, line: str, head: str = "") -> None:
        pass


def test_shares_of_a_heal_grow_to_nearly_one():
    told = _PhaseProgress(live := _Live(), _SECONDS)
    for phase in list(_SECONDS)[:-1]:
        for share in (0.0, 0.5, 0.9):
            told(phase, "walking", share)
    assert live.shares == sorted(live.shares) and live.shares[0] > 0
    assert 0.8 < live.shares[-1] < 1  # the page is left


@pytest.mark.parametrize("method", ["ours", "as-described", "hardware-only"])
def test_shares_of_several_recoveries_are_those_of_all(method):
    live, last = _Live(), 0.0
    phases = RecoverRun.list_phases(
        SimpleNamespace(method=method, trials=2, more_trials=1)
    )
    for number in range(2):
        told = _RunProgress(live, number, 2)
        told.phases, told.may_end = phases, method == "ours"
        for phase in phases:
            told(phase, "walking", 0.5)
            if not (told.may_end and phase[-1] in "23"):  # nobody knew of it
                assert last < live.shares[-1] < (number + 1) / 2
                last = live.shares[-1]


def test_the_simulations_of_an_identification_tell_the_time_left():
    told = _CycleProgress(live := _Live())
    told.run = SimpleNamespace(cycles=[], settings=SimpleNamespace(budget=1000))
    live.seconds = 2.0
    told(1)
    told(3)
    assert len(live.shares) == 1  # what it compiles are no simulations
    told.begun = 10, 10.0
    predicted = []
    for done in (0.3, 0.6, 0.9):
        live.seconds = 10.0 + 10.0 * done**0.65
        told(round(10 + 990 * done))
        predicted.append(live.seconds / live.shares[-1])
    assert predicted == pytest.approx([20.0 / 0.92] * 3, rel=0.01)
