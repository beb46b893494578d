"""A diagnosis of made-up numbers, for its page and its command."""

import copy
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from selfheal.diagnosis.output.result import (
    Candidate,
    Diagnosis,
    Localization,
    SignalFit,
    Trace,
)
from selfheal.report import diagnose
from selfheal.report.diagnose import make_diagnosis_page
from tests.support.browser import HOSTILE, draw_nothing, read_words
from tests.support.hostile import names

NAN = float("nan")
ODD = "\ud800\x07\u202e\x9b31m\x1b]0;\u2028"  # what cannot be seen
REGIMES = ("reversal", "slow", "fast", "high_load", "after_step", "always")
FINDING = {
    "effect": "coulomb_friction",
    "target": "joint:knee",
    "equivalent": ["stribeck_friction"],
    "separate_by": "ramp knee slower than 0.05 rad/s for 20 s",
    "parameters": [
        {
            "name": "frictionloss",
            "value": 0.14,
            "low": 0.12,
            "high": 0.16,
            "unit": "N m",
        }
    ],
    "where": {
        "signals": [{"name": "knee_position", "share_of_error": 0.81, "p_value": 1e-6}],
        "regime": "reversal",
        "windows": [{"episode": "003", "start": 1.2, "end": 1.9}],
    },
    "evidence": {
        "heldout_nll_gain": 1.8,
        "p_value": 0.001,
        "stability": 0.97,
        "heldout_error_growth": 4.56,
    },
    "native": True,
}
ONSET = {"episode": "002", "time": 3.4, "low": 3.3, "high": 3.5}
DELAY = {
    "effect": "command_delay",
    "target": "actuator:hip_motor",
    "equivalent": ["sensor_delay"],
    "separate_by": "move the joint by hand with the motor off",
    "parameters": [
        {"name": "delay", "value": 0.0123, "low": 0.0118, "high": 0.0127, "unit": "s"}
    ],
    "where": {"signals": [], "regime": "always", "windows": [], "onset": ONSET},
    "evidence": {"heldout_nll_gain": 0.3, "p_value": 0.004, "stability": 0.9},
    "native": False,
}
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
    "parameters": [
        {"name": "ki", "value": 2.0, "unit": "N m/(rad s)"},
        {"name": "imax", "value": 1.0, "unit": "N m"},
    ],
    "evidence": {},
}
DIFF = """--- model.xml
+++ patched.xml
@@ -12,3 +12,3 @@
     <body name="shank" pos="0 0 -0.2">
-      <joint name="knee" axis="0 1 0" damping="0.05"/>
+      <joint name="knee" axis="0 1 0" damping="0.043" frictionloss="0.14"/>
       <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01"/>
"""


STOPPED = {
    "while": "trying hard_stop at joint:hip",
    "tried": 3,
    "of": 41,
    "not_tried": ["cogging"],
}
POSITION = {"kind": "joint_position", "unit": "rad", "given": 0.0333, "refit": 0.0201}
VELOCITY = {"kind": "joint_velocity", "unit": "rad/s", "given": 2.0, "refit": 1.0}
FIT = {
    "held_out": ["a.h5:004", "a.h5:005"],
    "given": 0.21,
    "refit": 0.12,
    "patched": 0.03,
    "floor": 0.025,
    "explainable_removed": 0.947,
    "errors": [
        {**POSITION, "patched": 0.0054, "floor": 0.0018},
        {**VELOCITY, "patched": 0.5, "floor": None},
    ],
}
DAMPING = {"parameter": "joint:knee/damping", "given": 0.05, "unit": "N m s/rad"}
MASS = {"parameter": "body:shank/mass", "given": 0.4, "unit": "kg"}


def make_document(verdict="explained", findings=(FINDING,)) -> dict:
    """The document of that diagnosis."""
    made = {"format": "selfheal-diagnosis", "version": 1, "verdict": verdict}
    made |= {"findings": list(findings), "fit": FIT}
    made["refit"] = [
        {**DAMPING, "value": 0.043, "low": 0.041, "high": 0.045},
        {**MASS, "value": 0.46, "low": 0.45, "high": 0.46},
    ]
    stopped = {"stopped": STOPPED} if verdict == "undecided" else {}
    return copy.deepcopy(made | stopped)


def make_trace(k: int, size: int = 400) -> Trace:
    """Readings and predictions of one signal, with a gap."""
    time = np.linspace(k, k + 2, size)
    true = 0.5 * np.sin(4 * time + k)
    read = true + 0.004 * np.random.default_rng(k).normal(size=size)
    read[size // 3 : size // 3 + 5] = NAN
    given = 0.62 * np.sin(4 * time + k - 0.35)
    refit = 0.53 * np.sin(4 * time + k - 0.12)
    return Trace("004", f"knee_position[{k}]", "rad", time, read, given, refit, true)


def make_diagnosis(
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
    given, refit = (0.21, 0.19, 0.23), (0.12, *spread)
    fits = [
        SignalFit(n, k < 2, given, refit, (0.13 if k == 1 else 0.03, 0.02, 0.04), 0.02)
        for k, n in enumerate(names)
    ]
    tried = {"coulomb_friction": 0.11, "stribeck_friction": 0.12}
    tried |= {"asymmetric_friction": 0.4, "joint_spring": 0.9}
    return Diagnosis(
        model="leg.xml",
        document=make_document(verdict, findings),
        edits=(),
        patched="<mujoco/>",
        diff=DIFF,
        traces=tuple(make_trace(k) for k in range(2)),
        located=Localization(names, REGIMES, share, p_value),
        signals=tuple(fits),
        candidates=tuple(
            Candidate(e, "joint:knee", left, k == 0 and bool(findings))
            for k, (e, left) in enumerate(tried.items())
        ),
        remarks=("The hip never moved faster than 0.2 rad/s.",),
        seconds=41.234,
        simulations=123_456,
    )


def make_hostile_diagnosis() -> Diagnosis:
    """A diagnosis in which every text tries to break out of the page."""
    spoil = partial(names.spoil, end=f"{HOSTILE}{ODD}")
    given = make_diagnosis(findings=(FINDING, DELAY))
    signals = tuple(map(spoil, given.located.signals))
    return replace(
        given,
        document={**spoil(given.document), "verdict": "explained"},
        diff=spoil(DIFF) + f"\n+{HOSTILE}",
        traces=tuple(
            replace(t, episode=HOSTILE, signal=HOSTILE, unit="$\\frac{x$")
            for t in given.traces
        ),
        located=replace(given.located, signals=signals, regimes=(HOSTILE,) * 6),
        signals=tuple(replace(s, name=spoil(s.name)) for s in given.signals),
        candidates=tuple(
            replace(c, effect=HOSTILE, target=HOSTILE) for c in given.candidates
        ),
        remarks=(HOSTILE,),
    )


def write_page_text(diagnosis: Diagnosis, *, live: bool = False) -> str:
    """The page of a diagnosis as HTML, with or without scripts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnose, "is_live_available", lambda: live)
        return make_diagnosis_page(diagnosis, "models/leg.xml", ["a.h5", "b.h5"])


def read_page_words(diagnosis: Diagnosis) -> str:
    """The words of the page of a diagnosis."""
    with draw_nothing():
        return read_words(write_page_text(diagnosis))
