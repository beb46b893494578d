"""Figures of a diagnosis: traces of episodes and of poses."""

from dataclasses import replace

import numpy as np

from selfheal.diagnosis.output.result import Trace
from selfheal.report import figures
from tests.support.made_up_diagnosis import make_diagnosis, make_trace, write_page_text


def test_one_short_constant_trace_is_drawn():
    one = np.ones(1)
    trace = Trace("a", "b", "rad", one, one, one, one, one)
    made = write_page_text(replace(make_diagnosis(), traces=(trace,)))
    assert made.count("<svg") == 2


def test_episodes_read_once_are_drawn_as_dots_in_a_row():
    poses = Trace("", "tilt", "1", np.arange(1.0, 7), *np.ones((4, 6)))
    top, below = figures.draw_traces([poses]).axes
    assert "held-out episodes" in top.get_title(loc="left")
    assert below.get_xlabel() == "episode"
    assert {line.get_marker() for line in top.lines} == {"o"}
    (curve, _) = figures.draw_traces([make_trace(0)]).axes
    assert "o" not in {line.get_marker() for line in curve.lines}
