"""Climbers of part scales."""

import numpy as np

from selfheal.body.body import measure_length_error, scale_parts
from selfheal.body.genome import build_bodies
from selfheal.engine.statics import Statics
from selfheal.robot.actions import list_actions_2006, load_published_body
from selfheal.selfmodel.evaluate import PAPER_LOSS, Evaluator, Evidence
from selfheal.selfmodel.scaled import SCALES, ScaleSearch


def test_climbers_of_scales_stay_in_range_and_find_a_shortened_part(known, rng):
    anatomy, actions = load_published_body().anatomy, list_actions_2006()
    scale = np.ones((1, 8))
    scale[0, 6] = 0.1
    broken = scale_parts(build_bodies(anatomy, known), scale)
    tried = tuple(range(0, 36, 4))
    seen = Statics().simulate(broken[np.zeros(len(tried), int)], actions[list(tried)])
    evidence = Evidence(tried, seen.channels)
    evaluator = Evaluator(anatomy, Statics(), actions=actions, loss=PAPER_LOSS)
    search = ScaleSearch(evaluator, known=known)
    search.climb(evidence, 0, rng)
    assert np.array_equal(search.genes, np.ones((15, 8)))
    before = search.losses.copy()
    search.climb(evidence, 150, rng)
    assert (search.losses <= before).all() and search.losses[0] < before[0] / 4
    assert search.genes.min() >= SCALES[0] and search.genes.max() <= SCALES[1]
    genes = np.vstack([np.ones(8), search.genes[0]])
    bodies = search.build_bodies(search.decode_genes(genes), genes)
    whole, found = measure_length_error(bodies, broken)
    assert found < whole
