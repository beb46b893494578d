"""The page of an identification: what it says, escaped, drawn in a browser."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.genome import build_bodies
from selfheal.report import facts
from selfheal.report.identify import make_identify_page
from selfheal.selfmodel.run import Run
from tests.support.browser import (
    draw_nothing,
    read_words,
)
from tests.support.made_up_run import change_last_cycle, make_run


def _read_page(run: Run) -> str:
    """The words of a run's page."""
    with draw_nothing():
        return read_words(make_identify_page(run))


def test_the_page_says_what_was_inferred_and_how_far_off_it_is():
    run = make_run()
    body = build_bodies(run.anatomy, run.cycles[-1].genomes[:1])
    words = _read_page(make_run())
    correct = int((body.parent == run.truth.parent).sum())
    assert f"with {correct} of 3 attachments correct" in words
    for name, value in facts.list_errors(run, body):
        assert f"{name} {value}" in words
    assert words.count(" wrong: ") == 3 - correct
    assert "not finished" not in words and "on statics 1,000" in words


def test_a_run_without_truth_calls_nothing_wrong():
    words = _read_page(make_run(truth=False))
    assert "Nobody knows the true body" in words
    assert "wrong:" not in words and "attachments correct" not in words


def test_an_unfinished_run_says_so():
    run = make_run(cycles=4)
    run = replace(run, result={}, settings=replace(run.settings, cycles=16))
    assert "not finished: 4 of 16 actions so far" in _read_page(run)


def test_a_run_that_has_not_begun_has_a_page():
    run = replace(make_run(cycles=0), result={})
    words = _read_page(run)
    assert "No action has been tried yet" in words and "Settings" in words


@pytest.mark.parametrize("parts", [1, 2, 12])
def test_robots_of_other_sizes_have_a_page(parts):
    assert make_identify_page(make_run(parts=parts)).count("<svg") == 5


def test_one_cycle_with_one_rival_has_a_page():
    words = _read_page(make_run(cycles=1, rivals=1))
    assert "Candidates kept: 1." in words and "After 1 action and" in words


def test_the_first_sentence_has_the_tilt_error_of_the_result():
    run = make_run()
    done = replace(run, result={"tilt_error": 43.21})
    assert "tilt error of 43.21 degrees" in _read_page(done)
    unfinished = change_last_cycle(replace(run, result={}), tilt_error=12.34)
    assert "tilt error of 12.34 degrees" in _read_page(unfinished)


def test_missing_readings_and_diverged_rivals_have_a_page():
    run = make_run()
    last = run.cycles[-1]
    cycles = [replace(c, felt=c.felt * [1, 1, np.nan]) for c in run.cycles]
    run = change_last_cycle(
        replace(run, cycles=tuple(cycles)),
        sureness=np.full(3, np.nan),
        tables=np.full_like(last.tables, np.nan),
        losses=np.full_like(last.losses, np.inf),
        tilt_error=np.nan,
        disagreement=np.nan,
    )
    words = _read_page(run)
    assert "clearance" not in words and "nan" not in words
    assert "clearance" in _read_page(make_run())


def test_hinges_are_named_where_they_are_unknown():
    run = make_run()
    full = replace(run, settings=replace(run.settings, space="full"))
    assert "hinge" in _read_page(full)
    assert "hinge" not in _read_page(make_run())


@pytest.mark.slow
def test_a_long_run_stays_below_five_megabytes():
    made = make_identify_page(make_run(parts=8, cycles=36, rivals=16))
    assert len(made.encode()) < 5_000_000
