"""Tables of a diagnosis: evidence, digits, bounds, bars."""

import re

import pytest

from selfheal.report import tables
from selfheal.report.page import make_bars
from tests.support.browser import read_words
from tests.support.made_up_diagnosis import DELAY, FINDING, NAN, make_diagnosis


def test_candidates_carry_their_evidence_and_late_findings_are_added():
    chosen = make_diagnosis().candidates
    words = read_words(tables.format_candidates(chosen, [FINDING, DELAY]))
    assert "1 coulomb_friction joint:knee 11 % 1.8 0.001 97 % named" in words
    assert "2 stribeck_friction joint:knee 12 % – – – indistinguishable" in words
    assert "– command_delay actuator:hip_motor – 0.3 0.004 90 % named" in words


@pytest.mark.parametrize(
    "value, low, high, unit, said",
    [
        (0.14, 0.12, 0.16, "N m", "0.14 N m (0.12 to 0.16)"),
        (1234.4, 1230, 1240, "1", "1234 (1230 to 1240)"),
        (0.5, None, None, "kg", "0.5 kg"),
        (2e-7, 1e-7, 3e-7, "s", "2e-07 s (1e-07 to 3e-07)"),
        (-0.01, -0.011, -0.009, "rad", "-0.0100 rad (-0.0110 to -0.0090)"),
        ([0.1, 0.25], [0.08, 0.2], [0.12, 0.3], "m", "(0.10, 0.25) m"),
        (None, None, None, "m", "– m"),
    ],
)
def test_a_value_has_the_digits_of_its_interval(value, low, high, unit, said):
    stated = {"value": value, "low": low, "high": high, "unit": unit}
    assert tables.format_quantity(stated) == said


@pytest.mark.parametrize(
    "name, value, stuck",
    [
        ("body:a/mass", 1.15, True),
        ("body:a/mass", 1.14, False),
        ("joint:a/damping", 0.7, True),
        ("joint:a/damping", 1.15, False),
        ("body:a/length", 0.97, True),
    ],
)
def test_a_value_at_its_bound_is_marked(name, value, stuck):
    entry = {"parameter": name, "given": 2.0, "value": 2 * value, "unit": "1"}
    assert tables.is_at_bound(entry) == stuck


def test_a_bar_that_is_far_too_long_does_not_hide_the_others():
    numbers = {"a": 18.0, "b": 1.0, "c": NAN, "d": 2.0}
    made = make_bars((name, "", number) for name, number in numbers.items())
    assert re.findall(r"width:([\d.]+)%", made) == ["100.0", "16.7", "0.0", "33.3"]
    assert "width:0.0%" in make_bars([("a", "0", 0.0)]) and make_bars([])
