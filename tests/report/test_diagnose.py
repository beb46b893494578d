"""The page of a diagnosis: in order, in plain words, escaped, drawn in a browser."""

import copy
import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import Segments
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.declaration import PLACEHOLDERS
from selfheal.diagnosis.output.finding_location import improvement_p_value
from selfheal.diagnosis.output.result import (
    Candidate,
    Diagnosis,
    Localization,
    SignalFit,
    Trace,
)
from selfheal.report import diagnose, figures, phrases, tables
from selfheal.report.diagnose import make_diagnosis_page
from selfheal.report.page import make_bars, write_page
from selfheal.report.phrases import state_verdict
from tests.report.test_page import _MEASURE, CHROMIUM, HOSTILE, _console, _words, browse

assert browse  # a fixture
NAN = float("nan")
REGIMES = ("reversal", "slow", "fast", "high_load", "after_step", "always")
FINDING = {
    "effect": "coulomb_friction",
    "target": "joint:knee",
    "equivalent": ["stribeck_friction"],
    "separate_by": "ramp knee slower than 0.05 rad/s for 20 s",
    "parameters": [
        {"name": "frictionloss", "value": 0.14, "low": 0.12, "high": 0.16,
         "unit": "N m"}
    ],
    "where": {
        "signals": [{"name": "knee_position", "share_of_error": 0.81, "p_value": 1e-6}],
        "regime": "reversal",
        "windows": [{"episode": "003", "start": 1.2, "end": 1.9}],
    },
    "evidence": {"heldout_nll_gain": 1.8, "p_value": 0.001, "stability": 0.97},
    "native": True,
}  # fmt: skip
DELAY = {
    "effect": "command_delay",
    "target": "actuator:hip_motor",
    "equivalent": ["sensor_delay"],
    "separate_by": "move the joint by hand with the motor off",
    "parameters": [
        {"name": "delay", "value": 0.0123, "low": 0.0118, "high": 0.0127, "unit": "s"}
    ],
    "where": {"signals": [], "regime": "always", "windows": [],
              "onset": {"episode": "002", "time": 3.4, "low": 3.3, "high": 3.5}},
    "evidence": {"heldout_nll_gain": 0.3, "p_value": 0.004, "stability": 0.9},
    "native": False,
}  # fmt: skip
PLAY = {
    "effect": "backlash",
    "target": "joint:knee",
    "measured": "link",
    "parameters": [{"name": "gap", "value": 0.01, "unit": "rad"}],
    "evidence": {},
}
SUM = {
    "effect": "integral_action",
    "target": "actuator:hip_motor",
    "begins": "settled",
    "parameters": [{"name": "ki", "value": 2.0, "unit": "N m/(rad s)"},
                   {"name": "imax", "value": 1.0, "unit": "N m"}],
    "evidence": {},
}  # fmt: skip
DIFF = """--- model.xml
+++ patched.xml
@@ -12,3 +12,3 @@
     <body name="shank" pos="0 0 -0.2">
-      <joint name="knee" axis="0 1 0" damping="0.05"/>
+      <joint name="knee" axis="0 1 0" damping="0.043" frictionloss="0.14"/>
       <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01"/>
"""


def _document(verdict="explained", findings=(FINDING,)) -> dict:
    return copy.deepcopy({
        "format": "selfheal-diagnosis",
        "version": 1,
        "verdict": verdict,
        "findings": list(findings),
        "refit": [
            {"parameter": "joint:knee/damping", "given": 0.05, "value": 0.043,
             "low": 0.041, "high": 0.045, "unit": "N m s/rad"},
            {"parameter": "body:shank/mass", "given": 0.4, "value": 0.46,
             "low": 0.45, "high": 0.46, "unit": "kg"},
        ],
        "fit": {"held_out": ["a.h5:004", "a.h5:005"], "given": 0.21, "refit": 0.12,
                "patched": 0.03, "floor": 0.025, "explainable_removed": 0.947},
    })  # fmt: skip


def _trace(k: int, size: int = 400) -> Trace:
    time = np.linspace(k, k + 2, size)
    true = 0.5 * np.sin(4 * time + k)
    read = true + 0.004 * np.random.default_rng(k).normal(size=size)
    read[size // 3 : size // 3 + 5] = NAN
    given = 0.62 * np.sin(4 * time + k - 0.35)
    refit = 0.53 * np.sin(4 * time + k - 0.12)
    return Trace("004", f"knee_position[{k}]", "rad", time, read, given, refit, true)


def made_up(
    verdict: str = "explained", findings=(FINDING,), *, signals: int = 3
) -> Diagnosis:
    """A diagnosis with made up numbers."""
    rng = np.random.default_rng(0)
    names = ("knee_position", "hip_position", *(f"signal_{k}" for k in range(90)))
    names = names[:signals]
    share = rng.random((signals, len(REGIMES))) ** 4
    share /= max(share.sum(), 1)
    share[0, 0], share[-1, 2] = 0.4, NAN
    p_value = np.where(share > 0.1, 1e-4, 0.4)
    spread = (0.11, 0.13)
    fits = [SignalFit(n, k < 2, (0.21, 0.19, 0.23), (0.12, *spread),
                      (0.03 if k != 1 else 0.13, 0.02, 0.04), 0.02)
            for k, n in enumerate(names)]  # fmt: skip
    tried = [("coulomb_friction", 0.11), ("stribeck_friction", 0.12),
             ("asymmetric_friction", 0.4), ("joint_spring", 0.9)]  # fmt: skip
    return Diagnosis(
        model="leg.xml",
        document=_document(verdict, findings),
        edits=(),
        patched="<mujoco/>",
        diff=DIFF,
        traces=tuple(_trace(k) for k in range(2)),
        located=Localization(names, REGIMES, share, p_value),
        signals=tuple(fits),
        candidates=tuple(
            Candidate(e, "joint:knee", left, k == 0 and bool(findings))
            for k, (e, left) in enumerate(tried)
        ),
        remarks=("The hip never moved faster than 0.2 rad/s.",),
        seconds=41.234,
        simulations=123_456,
    )


def _page(diagnosis: Diagnosis) -> str:
    return make_diagnosis_page(diagnosis, "models/leg.xml", ["a.h5", "b.h5"])


def _told(diagnosis: Diagnosis) -> str:
    return _words(_page(diagnosis))


def _hostile() -> Diagnosis:
    """A diagnosis in which every text tries to break out of the page."""

    def spoil(value):
        if isinstance(value, dict):
            return {key: spoil(each) for key, each in value.items()}
        if isinstance(value, list):
            return [spoil(each) for each in value]
        return f"{value}{HOSTILE}\ud800\x07" if isinstance(value, str) else value

    given = made_up(findings=(FINDING, DELAY))
    names = tuple(map(spoil, given.located.signals))
    return replace(
        given,
        document={**spoil(given.document), "verdict": "explained"},
        diff=spoil(DIFF) + f"\n+{HOSTILE}",
        traces=tuple(
            replace(t, episode=HOSTILE, signal=HOSTILE, unit="$\\frac{x$")
            for t in given.traces
        ),
        located=replace(given.located, signals=names, regimes=(HOSTILE,) * 6),
        signals=tuple(replace(s, name=spoil(s.name)) for s in given.signals),
        candidates=tuple(
            replace(c, effect=HOSTILE, target=HOSTILE) for c in given.candidates
        ),
        remarks=(HOSTILE,),
    )


# ---- the verdict


def test_one_finding_is_told_in_plain_words():
    assert state_verdict(_document()) == (
        "The joint knee has dry friction of 0.14 N m (0.12 to 0.16) that the model "
        "lacks; it explains 95\N{NO-BREAK SPACE}% of the error that can be explained."
    )


def test_several_findings_are_one_sentence():
    said = state_verdict(_document(findings=(FINDING, DELAY)))
    assert said.startswith("2 things differ from the model: the joint knee has dry ")
    assert "the actuator hip_motor acts on its commands 0.0123 s (0.0118 to" in said
    assert "late, since 3.40 s of episode 002; together they explain 95" in said
    assert len(re.findall(r"\.(?!\d)", said)) == 1


def test_the_same_in_several_places_is_one_thing():
    legs = [{**DELAY, "target": f"actuator:{k}"} for k in "abcdefgh"]
    said = state_verdict(_document(findings=legs[:3]))
    assert said.startswith("Each of the actuators a, b and c acts on its commands ")
    assert "; it explains" in said
    assert state_verdict(_document(findings=legs)).startswith(
        "Each of 8 actuators acts "
    )


def test_many_findings_are_counted():
    many = [{**FINDING, "target": "joint:a"}, DELAY]
    many += [{**FINDING, "effect": f"effect_{k}"} for k in range(5)]
    said = state_verdict(_document(findings=many))
    assert said.startswith("7 things differ from the model, first of all: ")
    assert "effect 0 (frictionloss 0.14 N m" in said and "effect 1" not in said
    assert _told(made_up(findings=many)).count("joint:knee") >= 5


@pytest.mark.parametrize(
    "verdict, says, means",
    [
        (
            "nothing",
            "Nothing is missing that these recordings can show",
            "stands under",
        ),
        (
            "unlisted",
            "lacks physics that is not in the catalogue",
            "tells where to look",
        ),
        ("partly", "structured error remains that has no name", "no further effect"),
        ("explained", "explains 95", "as large as noise"),
    ],
)
def test_every_verdict_has_a_sentence_and_what_it_means(verdict, says, means):
    named = verdict in ("explained", "partly")
    words = _told(made_up(verdict, (FINDING,) if named else ()))
    assert says in words and means in words
    assert words.index(says) < words.index("Before and after")
    assert ("What is missing" in words) == named
    assert ("Nothing is named" in words) != named


@pytest.mark.parametrize(
    "removed, says",
    [
        (None, "it brings the held-out error from 0.12 to 0.03."),
        (0.999, "it explains all of the error that can be explained."),
        (1.04, "it explains all of the error"),
        (-0.2, "it explains none of the held-out error (0.12 before)."),
    ],
)
def test_what_a_finding_is_worth_is_said(removed, says):
    document = _document()
    document["fit"]["explainable_removed"] = removed
    assert says in state_verdict(document)


def test_what_is_said_of_the_rest_is_so():
    noise, more = "is as large as noise", "nine tenths or more of what exceeds"
    words = _told(made_up())
    assert noise in words and more not in words and "times the floor" not in words
    words = _told(replace(made_up(), more_than_noise=True))
    assert noise not in words and more in words
    document = _document()
    document["fit"] |= {"patched": 0.1, "floor": 0.02}
    assert "off by 0.1, 5 times the floor" in _told(
        replace(made_up(), document=document)
    )


def test_what_patched_xml_has_of_an_effect_is_said():
    for effect, said in (("asymmetric_friction", "only a part"), ("cogging", "not in")):
        words = _told(
            made_up(findings=({**FINDING, "effect": effect, "native": False},))
        )
        assert said in words


def test_every_effect_has_its_own_words():
    assert set(PLACEHOLDERS) == {"at", "all", *phrases.COMMON}
    for effect in load_catalogue().values():
        names = set(re.findall(r"{(\w+)}", effect.phrase)) - set(PLACEHOLDERS)
        stated = [{"name": n, "value": 1.5, "unit": "1"} for n in names]
        found = {"effect": effect.name, "target": "joint:a", "parameters": stated}
        said = state_verdict(_document(findings=(found,)))
        assert "{" not in said and "shows" not in said and said[0].isupper()
        assert all("1.5" in said for _ in names)


def test_a_plugins_effect_is_told_by_its_name():
    found = {"effect": "magnetic_drag", "target": "world", "parameters": []}
    said = state_verdict(_document(findings=(found,)))
    assert said.startswith("The robot shows magnetic drag that the model lacks; ")
    # an effect of the catalogue with other parameters than its sentence speaks of
    found = {**FINDING, "effect": "cogging"}
    assert "shows cogging (frictionloss 0.14" in state_verdict(
        _document(findings=(found,))
    )


def test_what_the_data_leave_open_is_marked():
    """An interval as wide as a careful user would grant says nothing."""
    made = made_up()
    assert "not pinned down" not in _told(made)
    open_ = {"parameter": "joint:hip/damping", "given": 1.0, "value": 1.1, "low": 0.7,
             "high": 1.3, "unit": "N m s/rad"}  # fmt: skip
    document = {**made.document, "refit": [*made.document["refit"], open_]}
    words = _told(replace(made, document=document))
    assert "Not pinned down: 1;" in words
    assert "not pinned down" in words.partition("joint:hip/damping")[2]


def test_experiments_are_offered_where_the_catalogue_was_not_enough(monkeypatch):
    effect = type("Spring", (), {"name": "joint_spring", "separate_by": "let it hang"})
    monkeypatch.setattr(diagnose, "load_catalogue", lambda: {"joint_spring": effect})
    for verdict, offered in {"unlisted": 1, "partly": 1, "nothing": 0}.items():
        assert _told(made_up(verdict, ())).count("Let it hang: would") == offered


# ---- the rest of the page


def test_the_page_is_in_order_and_whole():
    words = _told(made_up(findings=(FINDING, DELAY, PLAY, SUM)))
    titles = [
        *("Diagnosis of leg.xml", "What is missing", "Before and after"),
        *("Measured against predicted", "Where the re-fitted", "Candidates"),
        *("What the model already states", "The change to the model"),
        *("Held-out recordings", "Remarks", "How this was computed"),
    ]
    places = [words.index(title) for title in titles]
    assert places == sorted(places)
    for said in (
        "cannot be told from stribeck_friction by these data. To separate them: ramp",
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


def test_candidates_carry_their_evidence_and_late_findings_are_added():
    words = _words(tables.format_candidates(made_up().candidates, [FINDING, DELAY]))
    assert "1 coulomb_friction joint:knee 11 % 1.8 0.001 97 % named" in words
    assert "2 stribeck_friction joint:knee 12 % – – – not told apart" in words
    assert "– command_delay actuator:hip_motor – 0.3 0.004 90 % named" in words


def test_a_change_is_colored_and_escaped():
    made = _page(made_up())
    assert '<span class="right">+      &lt;joint name=&quot;knee&quot;' in made
    assert '<span class="wrong">-      &lt;joint' in made
    assert '<span class="soft">+++ patched.xml' in made
    long = replace(made_up(), diff="+x\n" * 900 + "+" + "y" * 5000)
    assert "501 more lines." in _told(long)
    assert "says the same as the given" in _told(replace(made_up(), diff=""))


def test_names_come_out_escaped():
    made = _page(_hostile())
    assert "<script" not in made and "alert(1)" in made
    assert html.escape(HOSTILE) in made
    made.encode("utf-8")


def test_the_page_asks_for_nothing_from_anywhere():
    made = _page(made_up())
    addresses = re.findall(r'\b(?:src|href|action|data|poster)="([^"]*)"', made)
    assert [a for a in addresses if not a.startswith(("#", "data:"))] == []
    assert "@import" not in made and "url(http" not in made


def test_few_windows_tell_as_much_as_few_can():
    at = np.arange(6)
    pieces = Segments(0 * at, at, 1 + 0 * at, at, 1.0 * at, np.zeros((6, 1)))
    assert improvement_p_value(pieces, np.zeros(6)) == 1
    for n in range(1, 7):
        assert improvement_p_value(pieces, 1.0 * (at < n)) == pytest.approx(0.5**n)


def test_missing_numbers_have_a_page():
    given = made_up()
    none = {"value": None, "low": None, "high": None, "unit": None}
    finding = {
        **FINDING,
        "parameters": [{"name": "frictionloss", **none}],
        "where": {"signals": [{"name": "x", "share_of_error": None}]},
        "evidence": {"heldout_nll_gain": None, "p_value": None, "stability": None},
    }
    document = _document(findings=(finding, {**FINDING, "where": {}, "evidence": None}))
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
    words = _told(made)
    assert not re.search(r"\b(nan|None|inf)\b", words.replace("None.", ""))


def test_nothing_at_all_has_a_page():
    empty = np.zeros((0, 0))
    document = _document("nothing", ()) | {"refit": []}
    made = Diagnosis(
        "",
        document,
        (),
        "",
        "",
        (),
        Localization((), (), empty, empty),
        (),
        (),
        (),
        0.0,
        0,
    )
    assert "<figure>" not in _page(made)
    words = _told(made)
    for said in ("no held-out stretch", "cannot tell where", "Remarks None."):
        assert said in words


def test_one_short_constant_trace_is_drawn():
    one = np.ones(1)
    trace = Trace("a", "b", "rad", one, one, one, one, one)
    assert _page(replace(made_up(), traces=(trace,))).count("<svg") == 2


def test_episodes_read_once_are_drawn_as_dots_in_a_row():
    poses = Trace("", "tilt", "1", np.arange(1.0, 7), *np.ones((4, 6)))
    top, below = figures.draw_traces([poses]).axes
    assert "held-out episodes" in top.get_title(loc="left")
    assert below.get_xlabel() == "episode"
    assert {line.get_marker() for line in top.lines} == {"o"}
    (curve, _) = figures.draw_traces([_trace(0)]).axes
    assert "o" not in {line.get_marker() for line in curve.lines}


def test_a_large_diagnosis_stays_below_five_megabytes():
    given = made_up(findings=(FINDING, DELAY) * 20, signals=60)
    long = tuple(_trace(k, size=50_000) for k in range(30))
    made = _page(replace(given, traces=long))
    assert len(made.encode()) < 5_000_000
    assert "The 16 signals with the most error" in made


@pytest.mark.parametrize(
    "value, low, high, unit, said",
    [
        (0.14, 0.12, 0.16, "N m", "0.14 N m (0.12 to 0.16)"),
        (1234.4, 1230, 1240, "1", "1234 (1230 to 1240)"),
        (0.5, None, None, "kg", "0.5 kg"),
        (2e-7, 1e-7, 3e-7, "s", "2e-07 s (1e-07 to 3e-07)"),
        (-0.01, -0.011, -0.009, "rad", "-0.0100 rad (-0.0110 to -0.0090)"),
        ([0.1, 0.25], [0.08, 0.2], [0.12, 0.3], "m", "(0.10, 0.25) m"),
        (None, None, None, "m", "– m"),
    ],
)
def test_a_value_has_the_digits_of_its_interval(value, low, high, unit, said):
    stated = {"value": value, "low": low, "high": high, "unit": unit}
    assert tables.format_quantity(stated) == said


@pytest.mark.parametrize(
    "name, value, stuck",
    [("body:a/mass", 1.15, True), ("body:a/mass", 1.14, False),
     ("body:a/length", 0.97, True), ("joint:a/damping", 1.15, False),
     ("joint:a/damping", 0.7, True)],
)  # fmt: skip
def test_a_value_at_its_bound_is_marked(name, value, stuck):
    entry = {"parameter": name, "given": 2.0, "value": 2 * value, "unit": "1"}
    assert tables.is_at_bound(entry) == stuck


def test_a_bar_that_is_far_too_long_does_not_hide_the_others():
    made = make_bars(
        [("a", "18", 18.0), ("b", "1", 1.0), ("c", "-", NAN), ("d", "2", 2.0)]
    )
    assert re.findall(r"width:([\d.]+)%", made) == ["100.0", "16.7", "0.0", "33.3"]
    assert "width:0.0%" in make_bars([("a", "0", 0.0)]) and make_bars([])


# ---- in a browser


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium (Debian: apt install)")
@pytest.mark.parametrize("diagnosis", [made_up(), _hostile()], ids=["plain", "x"])
def test_a_browser_finds_no_error_and_every_picture_drawn(diagnosis, browse, tmp_path):
    made = _page(diagnosis)
    path, shot = tmp_path / "report.html", tmp_path / "shot.png"
    write_page(made, path)
    _, log = browse(path, f"--screenshot={shot}")
    assert _console(log) == []
    free = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", made)
    (tmp_path / "free.html").write_text(free.replace("</body>", _MEASURE + "</body>"))
    dom, log = browse(tmp_path / "free.html", "--dump-dom")
    assert _console(log) == []
    found = re.search(r'data-pictures="([^"]*)"', dom)
    boxes = json.loads(html.unescape(found.group(1)))
    assert len(boxes) == made.count("<svg") == 2
    assert all(wide > 900 and high > 80 for _, _, wide, high in boxes)
