"""A patch and its replay predict what the simulation of its effects did."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.output.build_result import patch_or_nominal
from selfheal.diagnosis.output.replay import replay_recording
from tests.support.effect_robots import (
    NAMES,
    check_replay,
    compare_replay,
    draw_factors,
    find_elbow_term,
    make_document,
    make_effect_bench,
    make_pendulum,
    pick_terms,
    present_values,
    write_diagnosis,
    write_patch_text,
)
from tests.support.recorded_robots import ROBOTS


@pytest.mark.parametrize("name", NAMES)
def test_the_patch_and_its_replay_predict_what_the_diagnosis_did(
    name, benches, tmp_path
):
    """All nominal values are changed; the patched and the given model are replayed."""
    for n, (b, term) in enumerate(pick_terms(benches, name, ends=(-1,))):
        # a contact makes much of a text's last digit
        limit = 0.03 if b.robot.has_contact else 3e-6
        check_replay(b, [term], tmp_path / str(n), limit)


def test_a_replay_applies_what_the_text_could_not_say(tmp_path):
    """Balls that are made have no text of their own; a longer link moves them."""
    ball = '<geom size="0.01" pos="0.1 0 0" mass="0.01"/>'
    made = f'<replicate count="2" offset="0 0 0.01">{ball}</replicate>'
    text = ROBOTS["arm"].xml.replace("<site", f"{made}<site")
    b = make_effect_bench(replace(ROBOTS["arm"], xml=text), tmp_path)
    own = [find_elbow_term(b, "compliance", measured="motor")]
    stated = tuple(build_nominal_terms(b.robot))
    factors, present = draw_factors(stated), [present_values(t) for t in own]
    terms, values = (*stated, *own), np.concatenate([factors, *present])
    s = b.simulator
    case = SimpleNamespace(compiler=s.compiler, training=s, robot=b.robot)
    same, diff, edits, unpatched = patch_or_nominal(case, terms, values)
    assert (same, diff, edits) == (text, "", []) and "<replicate>" in unpatched
    document = make_document(stated, factors, own, present) | {"unpatched": unpatched}
    write_diagnosis(tmp_path / "out", same, document)
    predicted = b.simulator.simulate(terms, values[None], b.segments)[0]
    played = replay_recording(tmp_path / "out", b.recording)
    assert compare_replay(b, played, predicted) < 3e-6


@pytest.mark.parametrize("share", [0.3, 1.0, 1.7])
@pytest.mark.parametrize("stated", ["", 'delay="0.004" nsample="4" interp="linear"'])
def test_a_delay_is_replayed_as_it_was_found(share, stated, tmp_path):
    """MuJoCo rounds a delay to whole steps; the model may have a delay of its own."""
    servo = '<position name="servo" '
    b = make_pendulum(tmp_path, **{servo: f"{servo}{stated} "})
    (term,) = find_effect("command_delay").propose_terms(b.robot)
    values = np.array([share * b.simulator.timestep])
    predicted = b.simulator.simulate((term,), values[None], b.segments)[0]
    document = make_document((), (), [term], [values])
    write_diagnosis(tmp_path / "out", write_patch_text(b, (term,), values), document)
    played = replay_recording(tmp_path / "out", b.recording)
    assert compare_replay(b, played, predicted) < 3e-6
