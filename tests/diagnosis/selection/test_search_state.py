"""What a search holds as alternatives of a name, and when it ends."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.base import Onset
from selfheal.diagnosis.estimation.regime import CONTACT, SMOOTH
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


@pytest.mark.parametrize("regime", [CONTACT, SMOOTH], ids=["contact", "smooth"])
@pytest.mark.parametrize("is_explained", [True, False])
def test_in_contact_one_effect_that_set_in_is_all_that_did_if_it_explains_the_error(
    arm, is_explained, regime
):
    (dry, *_) = find_effect("coulomb_friction").propose_terms(arm.robot)
    search = SimpleNamespace(
        problem=SimpleNamespace(regime=regime), named=(dry,), noise_ratio=1.9,
        is_explained=is_explained, is_white=False, is_explained_by_timestep=False,
        has_bad_channel=False, is_prior_violated=False,
    )  # fmt: skip
    assert not SearchState.is_complete.fget(search)
    search.named = (replace(dry, onset=Onset(1, "001", 0.0, 0.0, 0.1)),)
    expected = is_explained and regime is CONTACT
    assert SearchState.is_complete.fget(search) == expected
