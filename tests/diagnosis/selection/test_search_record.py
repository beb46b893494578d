"""What a search tells of how far it came."""

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.selection.search_record import SearchRecord


def test_an_effect_that_was_tried_at_some_places_alone_is_left(arm):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)
    rotor = find_effect("armature").propose_terms(arm.robot)
    assert len(dry) == len(rotor) == 2
    record = SearchRecord()
    record.add_tried([*dry, rotor[0]])
    for left in (["armature"], []):
        record.end_search([*dry, *rotor])
        assert record.untried == left and record.effects == 2
        record.add_tried([rotor[1]])
