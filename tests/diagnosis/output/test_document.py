"""The document of a diagnosis: JSON without NaN, intervals in order."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.effects.declaration import Parameter
from selfheal.diagnosis.effects.nominal import NominalParameter, is_unidentified
from selfheal.diagnosis.output.document import (
    build_refit,
    format_document,
    to_json_values,
)


def test_json_has_no_nan_and_no_numpy():
    thing = {"a": np.float64("nan"), "c": np.array([1.0, np.nan]), "d": "x"}
    thing |= {"b": (np.inf, np.int64(3), np.bool_(True)), "e": None}
    read = json.loads(format_document(thing), parse_constant=pytest.fail)
    expected = {"a": None, "b": [None, 3, True], "c": [1.0, None], "d": "x", "e": None}
    assert read == expected == to_json_values(thing)


def test_the_interval_of_a_negative_value_is_in_order():
    term = SimpleNamespace(
        effect=NominalParameter(None, -2.0, "rad"),
        targets=("joint:a/springref",),
        parameters=(Parameter("x", "1", 1.0, 0.7, 1.3, 0.1),),
    )
    value = np.array([1.1])
    fit = SimpleNamespace(terms=(term,), values=value)
    (read,) = build_refit(fit, value, np.array([0.01]))
    assert read["low"] < read["value"] < read["high"] < 0 and not is_unidentified(read)
