"""The page of a diagnosis: in order, in words, escaped."""

import re
from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.output.result import Candidate, SignalFit
from selfheal.report import diagnose
from tests.support.diagnosis_folder import make_small_diagnosis
from tests.support.made_up_diagnosis import (
    DELAY,
    FINDING,
    NAN,
    PLAY,
    SUM,
    make_diagnosis,
    make_document,
    make_trace,
    read_page_words,
    write_page_text,
)

VERDICTS = {  # what the page says of each, and what it means
    "nothing": ("Nothing is missing that these recordings can show", "stands under"),
    "unlisted": ("lacks physics that is not in the catalogue", "tells where to look"),
    "undecided": ("Stopped after 3 of 41 effects were tried", "give it more time"),
    "partly": ("structured error remains that has no name", "no further effect"),
    "explained": ("explains 95", "as large as noise"),
}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_has_a_sentence_and_what_it_means(verdict):
    says, means = VERDICTS[verdict]
    named = verdict in ("explained", "partly")
    words = read_page_words(make_diagnosis(verdict, (FINDING,) if named else ()))
    assert says in words and means in words
    assert words.index(says) < words.index("Before and after")
    assert ("What is missing" in words) == named
    assert ("Nothing is named" in words) != named


def test_what_is_said_of_the_rest_is_so():
    noise, more = "is as large as noise", "nine tenths or more of what exceeds"
    words = read_page_words(make_diagnosis())
    assert noise in words and more not in words and "times the floor" not in words
    words = read_page_words(replace(make_diagnosis(), more_than_noise=True))
    assert noise not in words and more in words
    document = make_document()
    document["fit"] |= {"patched": 0.1, "floor": 0.02}
    words = read_page_words(replace(make_diagnosis(), document=document))
    assert "off by 0.1, 5 times the floor" in words


def test_what_patched_xml_has_of_an_effect_is_said():
    for effect, said in (("asymmetric_friction", "only a part"), ("cogging", "not in")):
        found = {**FINDING, "effect": effect, "native": False}
        assert said in read_page_words(make_diagnosis(findings=(found,)))


def test_what_the_data_leave_open_is_marked():
    """An interval as wide as a careful user would grant says nothing."""
    made = make_diagnosis()
    assert "not pinned down" not in read_page_words(made)
    open_ = {"parameter": "joint:hip/damping", "given": 1.0, "value": 1.1}
    open_ |= {"low": 0.7, "high": 1.3, "unit": "N m s/rad"}
    document = {**made.document, "refit": [*made.document["refit"], open_]}
    words = read_page_words(replace(made, document=document))
    assert "Not pinned down: 1;" in words
    assert "not pinned down" in words.partition("joint:hip/damping")[2]


def test_experiments_are_offered_where_the_catalogue_was_not_enough(monkeypatch):
    effect = type("Spring", (), {"name": "joint_spring", "separate_by": "let it hang"})
    monkeypatch.setattr(diagnose, "load_catalogue", lambda: {"joint_spring": effect})
    for verdict, offered in {"unlisted": 1, "partly": 1, "nothing": 0}.items():
        words = read_page_words(make_diagnosis(verdict, ()))
        assert words.count("Let it hang: would") == offered


def test_the_page_is_in_order_and_whole():
    words = read_page_words(make_diagnosis(findings=(FINDING, DELAY, PLAY, SUM)))
    titles = [
        *("Diagnosis of leg.xml", "What is missing", "Before and after"),
        *("Measured against predicted", "Where the re-fitted", "Candidates"),
        *("What the model already states", "The change to the model"),
        *("Held-out recordings", "Remarks", "How this was computed"),
    ]
    places = [words.index(title) for title in titles]
    assert places == sorted(places)
    for said in (
        "cannot be distinguished from stribeck_friction by these data. To separate",
        "from 1.2 to 1.9 s of episode 003",
        "sets in at 3.40 s (3.30 to 3.50) of episode 002",
        "is read at the link's side",
        "its sum had settled before each recording began",
        "plain MuJoCo can express only a part of it",
        "Made worse by the findings: hip_position.",
        "body:shank/mass 0.4 0.460 kg (0.450 to 0.460) +15.0\N{NO-BREAK SPACE}% at its",
        "The hip never moved",
        "windows simulated 123,456",
        "models/leg.xml",
        "a.h5:004, a.h5:005",
    ):
        assert said.replace("\N{NO-BREAK SPACE}", " ") in words, said


def test_a_change_is_colored_and_escaped():
    made = write_page_text(make_diagnosis())
    assert '<span class="right">+      &lt;joint name=&quot;knee&quot;' in made
    assert '<span class="wrong">-      &lt;joint' in made
    assert '<span class="soft">+++ patched.xml' in made
    long = replace(make_diagnosis(), diff="+x\n" * 900 + "+" + "y" * 5000)
    assert "501 more lines." in read_page_words(long)
    same = read_page_words(replace(make_diagnosis(), diff=""))
    assert "says the same as the given" in same


def test_missing_numbers_have_a_page():
    given = make_diagnosis()
    none = {"value": None, "low": None, "high": None, "unit": None}
    finding = {
        **FINDING,
        "parameters": [{"name": "frictionloss", **none}],
        "where": {"signals": [{"name": "x", "share_of_error": None}]},
        "evidence": {"heldout_nll_gain": None, "p_value": None, "stability": None},
    }
    bare = {**FINDING, "where": {}, "evidence": None}
    document = make_document(findings=(finding, bare))
    document["refit"] = [{"parameter": "body:a/mass", "given": 0.0, **none}]
    document["fit"] = dict.fromkeys(document["fit"], None) | {"held_out": []}
    gone = np.full(400, NAN)
    flat = {"read": gone, "given": gone, "refit": gone + np.inf, "patched": gone}
    blind = SignalFit("x", True, *[(NAN, NAN, NAN)] * 3, NAN)
    made = replace(
        given,
        document=document,
        traces=(replace(given.traces[0], **flat), replace(given.traces[1], read=gone)),
        located=replace(given.located, p_value=given.located.share * NAN),
        signals=(blind,),
        candidates=(Candidate("a", "world", NAN, False),),
    )
    words = read_page_words(made)
    assert not re.search(r"\b(nan|None|inf)\b", words.replace("None.", ""))


def test_nothing_at_all_has_a_page():
    made = make_small_diagnosis("", make_document("nothing", ()) | {"refit": []})
    assert "<figure>" not in write_page_text(made)
    words = read_page_words(made)
    for said in ("no held-out stretch", "cannot tell where", "Remarks None."):
        assert said in words


@pytest.mark.slow
def test_a_large_diagnosis_stays_below_five_megabytes():
    given = make_diagnosis(findings=(FINDING, DELAY) * 20, signals=60)
    long = tuple(make_trace(k, size=50_000) for k in range(30))
    made = write_page_text(replace(given, traces=long))
    assert len(made.encode()) < 5_000_000
    assert "The 16 signals with the most error" in made
