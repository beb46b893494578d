"""Laws of what studies are made of: searches, statements, statistics, plans."""

import json

import numpy as np
import pytest

from selfheal.body.body import measure_length_error, scale_parts
from selfheal.body.genome import LENGTH_RANGE, build_bodies, decode_unit_genes
from selfheal.engine.statics import Statics
from selfheal.errors import InputError, UnknownNameError
from selfheal.robot.actions import list_actions_2006, load_published_body
from selfheal.selfmodel.crowding import run_generation
from selfheal.selfmodel.evaluate import PAPER_LOSS, Evaluator, Evidence, stack_channels
from selfheal.selfmodel.lengths import estimate_lengths
from selfheal.selfmodel.scaled import SCALES, ScaleSearch
from selfheal.selfmodel.schema import (
    CHANNELS,
    SENSOR_SETS,
    SearchPlan,
    estimate_models,
    set_lengths,
    simulate_channels,
)
from selfheal.study.after_damage import _state_intervals, run_after_damage
from selfheal.study.calibration import compute_brier_score, make_reliability_table
from selfheal.study.methods import METHODS, run_method
from selfheal.study.plan import STUDIES, StudyRequest, find_study
from selfheal.study.statistics import (
    format_mean_std,
    format_pooled_correlation,
    format_rank_correlation,
    format_share,
    run_fisher_test,
    run_permutation_test,
)

TRUE = np.array([[0.125, 0.1875, 0.2083, 0.2188, 0.275, 0.3958, 0.4821, 0.5469]])


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def known():
    return decode_unit_genes(load_published_body().anatomy, TRUE)


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_plans_distinct_runs_and_shows_none_of_them_yet(name, tmp_path):
    case = tmp_path / "case"
    case.mkdir()
    for file in (case / "model.xml", case / "recording.h5"):
        file.touch()
    (tmp_path / "poses_schema.csv").touch()
    study = find_study(name)
    tasks = study.list_tasks(StudyRequest(2, 5, recordings=tmp_path, cases=tmp_path))
    assert len({task.key for task in tasks}) == len(tasks) > 0
    assert {task.settings["seed"] for task in tasks} == {5, 6}
    assert [json.loads(json.dumps(t.settings)) for t in tasks] == [
        t.settings for t in tasks
    ]
    study.make_tables([])
    study.make_pictures([])


def test_what_a_study_lacks_is_said(tmp_path):
    with pytest.raises(UnknownNameError, match="actions, eea, schema, sealed, table3"):
        find_study("table4")
    for name, message in (("sealed", "--cases"), ("actions", "--recordings")):
        with pytest.raises(InputError, match=message):
            find_study(name).list_tasks(StudyRequest(1))
    with pytest.raises(InputError, match="no case there"):
        find_study("sealed").list_tasks(StudyRequest(1, cases=tmp_path))
    with pytest.raises(InputError, match="no poses_schema.csv there"):
        find_study("schema").list_tasks(StudyRequest(1, recordings=tmp_path))


@pytest.mark.parametrize("name", ["actions", "schema", "table3"])
def test_a_study_cut_short_has_every_row_with_the_same_seeds(name, tmp_path):
    (tmp_path / "poses_schema.csv").touch()
    tasks = find_study(name).list_tasks(StudyRequest(3, recordings=tmp_path))
    real = [t.settings for t in tasks if t.settings["robot"] == "starfish-2006"]
    seeds = [settings["seed"] for settings in real]
    assert seeds == sorted(seeds) and set(seeds) == {0, 1, 2}
    each = [[{**s, "seed": 0} for s in real if s["seed"] == k] for k in range(3)]
    assert each[0] == each[1] == each[2]


def test_the_page_of_actions_has_each_method_against_each(rng):
    def record(method, success, seed):
        outcome = {"success": success, "error": [rng.random() + 9 * (not success)],
                   "disagreement": [rng.random()], "edge_f1": float(success),
                   "evaluations": 1, "choice": 0, "stated": [1.0, 0.9],
                   "right": [True, success]}  # fmt: skip
        return {"settings": {"method": method, "seed": seed}, "outcome": outcome,
                "seconds": 1.0}  # fmt: skip

    study = find_study("actions")
    methods = {
        t.settings["method"]
        for t in study.list_tasks(StudyRequest(1, recordings="any"))
    }
    records = [record(m, m == "ours", k) for m in methods for k in range(12)]
    results, against, *_, sure = study.make_tables(records)
    names = [METHODS[m] for m in METHODS if m in methods]
    assert [row[0] for row in results.rows] == names
    assert len(against.rows) == len(names) * (len(names) - 1) / 2
    for one, other, *p in against.rows:
        differ = "ours" in (one, other)
        assert [float(x) < 0.001 for x in p] == [differ, differ]
    assert "24 statements" in sure.text  # ours alone


@pytest.mark.parametrize("method", ["paper", "random-alternate"])
def test_a_run_of_2006_spends_what_its_actions_allow(method, shared_recordings):
    settings = {"robot": "starfish-2006", "method": method, "seed": 4,
                "recordings": str(shared_recordings / "starfish_2006")}  # fmt: skip
    short, longer = (run_method(settings, cycles=n, budget=1) for n in (1, 2))
    ceiling = [15 * (200 * sum(range(1, n + 1)) + n) for n in (1, 2)]
    assert short["evaluations"] < longer["evaluations"]
    assert short["evaluations"] <= ceiling[0] and longer["evaluations"] <= ceiling[1]
    # what was done is not done otherwise because more is to come
    assert longer["actions"][:1] == short["actions"]
    assert longer["error"][:1] == short["error"]


def test_crowding_never_loses_and_a_failed_child_never_wins(rng):
    def score(genes):
        far = ((genes - 0.3) ** 2).sum(axis=1)
        return np.where(genes[:, 0] > 0.9, np.inf, far)

    genes = rng.random((40, 5))
    errors = score(genes)
    best = [errors.min()]
    for _ in range(60):
        genes, errors = run_generation(genes, errors, score, rng)
        assert np.array_equal(errors, score(genes))
        assert ((genes >= 0) & (genes <= 1)).all()
        best.append(errors.min())
    assert (np.diff(best) <= 0).all() and best[-1] < 0.01 < best[0]
    assert np.isfinite(errors).all()


def test_climbers_of_scales_stay_in_range_and_find_a_shortened_part(known, rng):
    anatomy, actions = load_published_body().anatomy, list_actions_2006()
    scale = np.ones((1, 8))
    scale[0, 6] = 0.1
    broken = scale_parts(build_bodies(anatomy, known), scale)
    tried = tuple(range(0, 36, 4))
    seen = Statics().simulate(broken[np.zeros(len(tried), int)], actions[list(tried)])
    evidence = Evidence(tried, stack_channels(seen))
    evaluator = Evaluator(anatomy, Statics(), actions=actions, loss=PAPER_LOSS)
    search = ScaleSearch(evaluator, known=known)
    search.climb(evidence, 0, rng)
    assert np.array_equal(search.genes, np.ones((15, 8)))
    before = search.losses.copy()
    search.climb(evidence, 150, rng)
    assert (search.losses <= before).all() and search.losses[0] < before[0] / 4
    assert search.genes.min() >= SCALES[0] and search.genes.max() <= SCALES[1]
    whole, found = (measure_length_error(search.build_bodies(g), broken)[0]
                    for g in (np.ones((1, 8)), search.genes[:1]))  # fmt: skip
    assert found < whole


def test_estimation_of_lengths_counts_what_it_simulates(known, rng):
    assert len(SENSOR_SETS) == 7
    low, high = LENGTH_RANGE
    ends = set_lengths(known, np.array([[0.0] * 8, [1.0] * 8])).length
    assert np.allclose(ends, [[low] * 8, [high] * 8])
    poses = np.zeros((3, 8))
    poses[:, :4] = rng.uniform(-0.5, 0.5, (3, 4))
    truth = load_published_body()
    felt = simulate_channels(truth[np.zeros(3, int)], poses, Statics())
    assert felt.shape == (3, sum(map(len, CHANNELS.values())))
    plan = SearchPlan(8, lambda genes: set_lengths(known, genes), 20, 5, ("tilt",))
    steps = list(estimate_models(truth, poses, felt, plan, rng))
    assert [spent for *_, spent in steps] == [120 * n for n in (1, 3, 6)]
    assert all(np.isfinite(error) for _, error, _ in steps)


@pytest.mark.parametrize("sensors", [("tilt",), ("clearance", "touch")])
def test_our_lengths_of_robots_whose_zeros_are_off(sensors, known):
    """Of most: a robot of which few poses tell little is off by a centimeter."""
    truth, stages, gaps = load_published_body(), (7, 7), []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        offers = np.radians(30) * rng.choice([-1.0, 1.0], (60, 8))
        zeros, asked = np.radians(rng.normal(0, 1, 8)), []

        def ask(pose, targets=offers + zeros, asked=asked):
            asked.append(pose)
            return simulate_channels(truth, targets[[pose]], Statics())[0]

        how = dict(sensors=sensors, rng=rng, stages=stages)
        found, spent = estimate_lengths(known, truth, offers, ask, **how)
        assert len(set(asked)) == len(asked) == sum(stages) and spent > 0
        gaps.append(np.abs(found.length - truth.length).mean())
    # a servo that is off by a degree moves a foot by 3 mm
    assert np.median(gaps) < 0.005


def test_feet_alone_tell_lengths_without_slopes(known, rng):
    truth, offers = (
        load_published_body(),
        np.radians(30) * rng.choice([-1.0, 1.0], (30, 8)),
    )

    def ask(pose):
        return simulate_channels(truth, offers[[pose]], Statics())[0]

    found, _ = estimate_lengths(
        known, truth, offers, ask, sensors=("touch",), stages=(4, 4), rng=rng
    )
    low, high = LENGTH_RANGE
    assert ((found.length >= low) & (found.length <= high)).all()


def test_what_is_stated_of_a_length_holds_the_belief_that_it_states(rng):
    anatomy = load_published_body().anatomy
    every = np.ones((105, 8))
    for k in range(104):
        every[k + 1, k // 13] = np.linspace(0.1, 1.8, 13)[k % 13]
    for _ in range(20):
        belief = rng.dirichlet(np.full(105, 0.1))
        for part, (low, high, share_of, _) in enumerate(
            _state_intervals(every, belief, anatomy)
        ):
            inside = (every[:, part] > low) & (every[:, part] < high)
            assert 0.9 - 1e-9 <= share_of <= belief[inside].sum() + 1e-9


def test_lengths_stated_are_counted_against_true_ones():
    whole, short = [0.5, 1.5, 0.9, 1.0], [0.5, 1.5, 0.9, 0.1]
    outcome = {"success": True, "error": [0.1], "actions": [3], "evaluations": 1,
               "lengths": [whole, whole, whole, short]}  # fmt: skip
    settings = {"robot": "starfish", "phase": "after", "method": "ours"}
    record = {"settings": settings, "outcome": outcome, "seconds": 1.0}
    *_, table = find_study("table3").make_tables([record] * 5)
    (every, alone) = table.rows
    assert every[3].startswith("90.0 %") and every[4].startswith("15/20 = 75.0 %")
    assert alone[4].startswith("0/5") and (every[5], alone[5]) == ("0.2100", "0.8100")


def test_the_same_seed_gives_the_same_outcome(shared_recordings):
    folder = str(shared_recordings / "starfish_2006")
    settings = {"robot": "starfish-2006", "method": "ours", "recordings": folder}
    first, again, other = (run_after_damage({**settings, "seed": s}) for s in (3, 3, 4))
    assert json.dumps(first) == json.dumps(again) != json.dumps(other)
    assert len(first["actions"]) == len(set(first["actions"])) == 16
    assert first["success"] and first["error"][-1] < 0.5


def test_an_interval_of_pooled_pairs_is_of_runs_not_of_pairs(rng):
    def ends(x, y):
        told, interval, _ = format_pooled_correlation(x, y).split(" (")
        low, high = (float(end) for end in interval.rstrip(")").split(" to "))
        assert low <= float(told) <= high
        return low, high

    x, y = rng.normal(size=(2, 40, 1))
    y = x + y
    alone, repeated = ends(x, y), ends(np.tile(x, 25), np.tile(y, 25))
    assert repeated == pytest.approx(alone, abs=0.03)  # says nothing new
    fresh = rng.normal(size=(2, 40, 25))
    low, high = ends(fresh[0], fresh[0] + fresh[1])
    assert high - low < (alone[1] - alone[0]) / 2
    assert (
        format_pooled_correlation([x.ravel()], [y.ravel()]).count("(") == 1
    )  # one run: no interval
    gap = np.where(np.arange(40)[:, None] == 7, np.nan, y)
    assert format_pooled_correlation(x, gap).endswith(
        "(n = 39)"
    ) and format_pooled_correlation([], []).endswith("(n = 0)")


def test_statistics_are_those_of_their_names(rng):
    assert format_share(27, 30) == "27/30 = 90.0 % (74 to 97)"
    assert format_share(0, 0) == "0/0" and format_mean_std([]) == ""
    assert format_mean_std([1.0, 3.0]) == "2.00 ± 1.41"
    assert run_fisher_test((13, 30), (8, 30)) == pytest.approx(
        0.28, abs=0.01
    )  # papers.md 1.6
    same, more = rng.normal(size=40), rng.normal(size=40) + 3
    assert (
        run_permutation_test(same, same[::-1]) > 0.9
        and run_permutation_test(same, more) < 0.001
    )
    assert format_rank_correlation(same, np.exp(same)).startswith("1.000")
    for told in (
        format_rank_correlation([1, 2, 3], [1, 1, 1]),
        format_pooled_correlation([[1, 2, 3]], [[1, 1, 1]]),
    ):
        assert told == "not defined (n = 3)"
    stated = rng.random(4000)
    true = rng.random(4000) < stated
    honest = list(zip(stated, true, strict=True))
    boasting = [(0.99 if s > 0.5 else 0.01, t) for s, t in honest]
    assert compute_brier_score(honest) < compute_brier_score(boasting)
    verdicts = [{row[-1] for row in make_reliability_table("", "", p).rows}
                for p in (honest, boasting)]  # fmt: skip
    assert verdicts == [{"yes"}, {"no"}]
