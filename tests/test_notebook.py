"""Results in a notebook: short texts, tables, data frames and axes."""

import sys

import matplotlib.axes
import numpy as np
import pytest

import selfheal
from selfheal.errors import InputError
from selfheal.recovery.record import HealRun, HealSettings
from tests.support.made_up_diagnosis import DELAY, FINDING, make_diagnosis
from tests.support.made_up_run import make_run


@pytest.fixture
def results(recording):
    return {
        "recording": recording,
        "diagnosis": make_diagnosis(findings=(FINDING, DELAY)),
        "run": make_run(),
        "heal": HealRun(
            HealSettings("run.h5", (), 9.0),
            {"gait": {"seconds": 1.0}},
            {"distance": {"intact": 1.25}},
        ),
    }


WORDS = {
    "recording": ("arm on a cart", "episodes: 2", "signals: 11"),
    "diagnosis": ("explained", "coulomb_friction at joint:knee", "command_delay"),
    "run": ("toy", "4 of 4 cycles"),
    "heal": ("HealRun", "finished", "gait"),
}
CELLS = {
    "recording": ("tip_speed", "body_linear_velocity", "m/s"),
    "diagnosis": ("frictionloss", "0.14", "N m", "0.0123", "patched"),
    "run": ("torso", "hangs on", "sureness"),
    "heal": ("intact", "1.25"),
}


@pytest.mark.parametrize("kind", WORDS)
def test_a_result_says_in_a_line_what_it_is(results, kind):
    said = repr(results[kind])
    assert len(said) < 200 and all(word in said for word in WORDS[kind]), said


@pytest.mark.parametrize("kind", CELLS)
def test_a_result_is_a_table_in_a_notebook(results, kind):
    shown = results[kind]._repr_html_()
    assert all(f">{cell}<" in shown for cell in CELLS[kind]), shown


def test_a_name_is_no_markup(recording):
    named = selfheal.Recording(recording.episodes, robot="<script>\x1b</script>")
    assert "<script>" not in named._repr_html_() and "\x1b" not in repr(named)


def test_parts_of_a_recording_are_not_printed_whole(recording):
    (episode, *_) = recording.episodes.values()
    assert "samples: 12" in repr(episode)
    assert "body_position of tip [m], shape (12, 3)" in repr(
        episode.signals["tip_position"]
    )


def test_a_recording_becomes_a_data_frame_and_back(recording):
    frame = recording.to_dataframe()
    one = frame[frame["episode"] == "zeta"]
    again = selfheal.Recording.from_dataframe(
        one,
        "time",
        {"motor": "ctrl/motor"},
        {"joint_position": {"arm": "signals/arm_position"}},
    )
    (episode,) = again.episodes.values()
    expected = recording.episodes["zeta"].signals["arm_position"].values
    (signal,) = episode.signals.values()
    np.testing.assert_array_equal(signal.values, expected)


def test_findings_and_parts_become_data_frames(results):
    found = results["diagnosis"].to_dataframe()
    assert list(found["parameter"]) == ["frictionloss", "delay"]
    assert list(found["value"]) == [0.14, 0.0123]
    parts = results["run"].to_dataframe()
    assert tuple(parts["part"]) == results["run"].anatomy.parts


@pytest.mark.parametrize("kind", ["recording", "diagnosis", "run"])
def test_without_pandas_the_way_to_install_it_is_said(results, kind, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match="pip install 'pandas"):
        results[kind].to_dataframe()


@pytest.mark.parametrize("kind", ["recording", "diagnosis", "run"])
def test_a_result_is_drawn_on_axes(results, kind):
    from matplotlib.figure import Figure

    given = Figure().add_subplot()
    assert results[kind].plot(ax=given) is given
    assert given.lines and given.get_xlabel()


def test_without_axes_there_are_new_ones(recording):
    from matplotlib import pyplot

    drawn = recording.plot("tip_speed", episode="alpha")
    assert isinstance(drawn, matplotlib.axes.Axes) and len(drawn.lines) == 3
    pyplot.close(drawn.figure)


@pytest.mark.parametrize("wrong", [{"signals": "knee"}, {"episode": "beta"}])
def test_what_is_not_there_is_not_drawn(recording, wrong):
    with pytest.raises(InputError, match="valid: "):
        recording.plot(**wrong)


def test_a_trace_that_is_not_there_is_not_drawn(results):
    with pytest.raises(InputError, match="no trace 99"):
        results["diagnosis"].plot(99)


def test_the_package_lists_what_there_is():
    assert dir(selfheal) == sorted(selfheal.__all__)
    assert all(hasattr(selfheal, name) for name in dir(selfheal))
