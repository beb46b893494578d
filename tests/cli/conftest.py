"""What tests of `diagnose` and `replay` need: files, and a stand-in."""

import signal
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from selfheal.recording import write
from tests.support.browser import draw_nothing
from tests.support.made_up_diagnosis import DELAY, FINDING, make_diagnosis


class Doctor:
    """Stands in for the diagnoser: says what it is told to, and what it was asked."""

    def __init__(self) -> None:
        self.asked: list[dict] = []
        self.answer = make_diagnosis(findings=(FINDING, DELAY))
        self.interrupts = 0  # times that Ctrl-C is pressed

    def diagnose(self, model, recordings, *, memory, progress, is_over, **given):
        names = ("held_out", "seed", "findings_only")
        self.asked.append(
            {"files": [r.file for r in recordings]} | {k: given[k] for k in names}
        )
        self.memory = Path(memory)
        self.found = sorted(p.name for p in self.memory.glob("*"))
        self.memory.mkdir(exist_ok=True)
        (self.memory / "answer").touch()
        progress("trying coulomb_friction at joint:knee", 0.2)
        progress("trying backlash at joint:knee", 0.4)
        for _ in range(self.interrupts):
            signal.raise_signal(signal.SIGINT)
        if isinstance(self.answer, BaseException):
            raise self.answer
        self.is_over = is_over(1.0)
        text = Path(model).read_text()
        return replace(self.answer, model=str(model), patched=text)

    memory, found = Path(), ()  # of the last diagnosis: where, and what was there

    def replay_recording(self, folder, recording, *, model=None, progress=None):
        self.asked.append({"folder": folder, "file": recording.file, "model": model})
        filled = {}
        for name, episode in recording.episodes.items():
            signals = {
                k: replace(s, values=np.zeros_like(s.values))
                for k, s in episode.signals.items()
                if s.kind == "joint_position"
            }
            filled[name] = replace(episode, signals=signals)
        return replace(recording, episodes=filled)


@pytest.fixture
def doctor(monkeypatch):
    """The stand-in, in its place."""
    stand_in = Doctor()
    for name, function in {
        "diagnose": "diagnose",
        "output.replay": "replay_recording",
    }.items():
        module = ModuleType(f"selfheal.diagnosis.{name}")
        setattr(module, function, getattr(stand_in, function))
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return stand_in


@pytest.fixture
def undrawn():
    """Pages whose figures are empty; tests/report has them drawn."""
    with draw_nothing():
        yield


@pytest.fixture
def files(recording, model, tmp_path):
    """A model, two recordings."""
    for name in ("a.h5", "b.h5"):
        write(recording, tmp_path / name)
    return model, tmp_path / "a.h5", tmp_path / "b.h5"


@pytest.fixture
def heeded_interrupts():
    """Ctrl-C heeded, as it is not where tests run in the background."""
    earlier = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, earlier)
