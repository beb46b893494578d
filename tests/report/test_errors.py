"""Errors of predictions in the units that people read."""

import numpy as np
import pytest

from selfheal.report import errors
from tests.support.made_up_diagnosis import (
    NAN,
    make_diagnosis,
    make_document,
    read_page_words,
)


@pytest.mark.parametrize(
    "value, unit, said",
    [
        (np.radians(1.94), "rad", "1.9 deg"),
        (0.0123, "m", "12 mm"),
        (2.0, "rad/s", "115 deg/s"),
        (0.31, "N m", "0.31 N m"),
        (1.234, "m", "1234 mm"),
        (0.02, "1", "0.020"),
        (0.5, "s", "0.50 s"),
        (None, "rad", "\N{EN DASH}"),
        (NAN, "m", "\N{EN DASH}"),
        (0.0, "rad", "0 deg"),
        (1e-9, "N m", "1e-09 N m"),
    ],
)
def test_an_error_has_the_unit_that_people_read(value, unit, said):
    assert errors.format_error(value, unit) == said


def test_what_counts_is_stated_over_the_shortest_segments():
    fit = make_document()["fit"]
    longer = {"kind": "joint_position", "unit": "rad", "given": 0.2}
    longer |= dict.fromkeys(("refit", "patched", "floor"), 0.1)
    (said,) = errors.state_errors(fit)
    assert said == (
        "Prediction error of joint positions in the replay: 1.9 deg as given, 0.31 deg "
        "patched (noise 0.10 deg)."
    )
    each = {0.5: fit["errors"], 2.0: [longer]}
    horizons = [{"seconds": s, "errors": errors} for s, errors in each.items()]
    (said,) = errors.state_errors({**fit, "horizons": horizons})
    assert "joint positions over 0.5 s: 1.9 deg as given" in said
    rows = list(errors.list_errors({**fit, "horizons": horizons}))
    assert [row[:3] for row in rows] == [
        ("joint positions", "0.5 s", "1.9 deg"),
        ("joint positions", "2 s", "11 deg"),
        ("joint velocities", "0.5 s", "115 deg/s"),
    ]


def test_of_a_document_without_them_nothing_is_stated():
    fit = {"given": 0.2, "refit": 0.1, "patched": 0.05, "floor": None}
    assert errors.state_errors(fit) == [] and not list(errors.list_errors(fit))


def test_the_page_has_them_beside_the_normalized_ones():
    words = read_page_words(make_diagnosis())
    assert "1.9 deg as given, 0.31 deg patched" in words
    assert "error without it" in words and "4.56 times" in words
