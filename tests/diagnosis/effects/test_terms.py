"""Terms whose places share values, as equal drives have them."""

import numpy as np

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.terms import share_values, spread_values


def test_shared_values_reach_every_place_within_its_own_bounds(arm):
    own = [
        term
        for name in ("armature", "viscous_friction", "load_dependent_friction")
        for term in find_effect(name).propose_terms(arm.robot)
    ]
    shared = share_values(own)
    # friction of one side of a gear is not that of both
    assert len(shared) == 4 and len(own) == 8
    assert {t.targets for t in shared} == {("joint:shoulder", "joint:elbow")}
    for term in shared:
        assert all(
            (term.low <= start).all() and (start <= term.high).all()
            for start in map(np.array, term.initial_values)
        )
    spread = spread_values({t: t.high for t in shared}, own[1:])
    assert set(spread) == set(own[1:])
    assert all((v == t.high).all() for t, v in spread.items())
