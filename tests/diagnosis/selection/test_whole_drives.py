"""What drives lack at all joints alike."""

import numpy as np

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.selection.whole_drives import (
    _enrich_equal_drives,
    _fit_equal_drives,
)
from tests.support.problems import make_problem


def _propose(arm, *names: str) -> list:
    """The effects' terms at single places."""
    found = [t for n in names for t in find_effect(n).propose_terms(arm.robot)]
    return [t for t in found if len(t.targets) == 1]


def test_equal_drives_tell_their_lag_from_a_delay(arm):
    usual = _propose(arm, "coulomb_friction", "armature", "command_delay")
    lag = _propose(arm, "actuator_lag")
    hidden = [*_propose(arm, "coulomb_friction"), *lag]
    problem = make_problem(arm, hidden, np.array([0.1, 0.1, 0.04, 0.04]))
    equal = _fit_equal_drives(problem, usual)
    richer = _enrich_equal_drives(equal, usual + lag)
    values = dict(
        zip([t.effect.name for t in richer.terms], richer.values, strict=True)
    )
    assert richer.cost < equal.cost
    assert abs(values["actuator_lag"] - 0.04) < 0.004
    assert abs(values["coulomb_friction"] - 0.1) < 0.01


def test_equal_drives_stay_as_they_are_if_nothing_richer_explains(arm):
    usual = _propose(arm, "coulomb_friction", "command_delay")
    problem = make_problem(arm, _propose(arm, "coulomb_friction"), np.full(2, 0.1))
    equal = _fit_equal_drives(problem, usual)
    more = _propose(arm, "actuator_lag", "stribeck_friction")
    assert _enrich_equal_drives(equal, usual + more) is equal
