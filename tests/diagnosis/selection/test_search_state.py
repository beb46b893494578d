"""What a search holds as alternatives of a name."""

from types import SimpleNamespace

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.selection.criteria import Claim
from selfheal.diagnosis.selection.evidence import Evidence
from selfheal.diagnosis.selection.search_state import SearchState


def test_a_name_without_rivals_may_give_way_to_its_other_forms(arm):
    forms = find_effect("load_dependent_friction").propose_terms(arm.robot)
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    at = [t for t in forms if t.targets == dry.targets]
    search = SimpleNamespace(claims={}, candidates=[dry, *forms])
    assert len(at) == 2
    assert SearchState.find_alternatives(search, at[0]) == at[1:]
    assert SearchState.find_alternatives(search, at[1]) == at[:1]
    assert SearchState.find_alternatives(search, dry) == []
    search.claims = {at[0].key: Claim(Evidence(1.0, 1e-3, 1.0), (), (dry,))}
    assert SearchState.find_alternatives(search, at[0]) == (dry,)
