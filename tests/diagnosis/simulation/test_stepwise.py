"""Simulations step by step: one that diverges is NaN, and nobody is warned."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.protocols import JointForce
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from tests.support.effect_robots import EffectBench, pick_terms, present_values

STEPWISE = [name for name, e in load_catalogue().items() if isinstance(e, JointForce)]


@pytest.fixture
def wild_arm(benches, tmp_path) -> EffectBench:
    """An arm whose model drives itself until its numbers overflow."""
    arm, path = benches["arm"], tmp_path / "model.xml"
    text = arm.path.read_text().replace("implicitfast", "Euler")
    path.write_text(text.replace('damping="0.05"', 'damping="-100"'))
    wild = replace(arm.simulator, compiler=ModelCompiler(str(path)))
    return replace(arm, simulator=wild)


@pytest.mark.parametrize("name", STEPWISE)
def test_a_simulation_that_diverges_is_nan_without_a_warning(name, wild_arm):
    for _, term in pick_terms({"arm": wild_arm}, name):
        values = present_values(term)[None]
        predicted = wild_arm.simulator.simulate([term], values, wild_arm.segments)[0]
        assert np.isnan(predicted).any(), term.targets
