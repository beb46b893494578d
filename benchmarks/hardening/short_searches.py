"""Searches that take a second: they write the same files as the usual ones."""

from typing import Any

import numpy as np


def shorten_searches() -> None:
    """Make gaits, heals, recoveries and diagnoses short in this process."""
    from selfheal.diagnosis import diagnose
    from selfheal.diagnosis.effects import load_catalogue
    from selfheal.recovery import hypotheses
    from selfheal.report import heal
    from tests.support import short_heal, short_recover

    short_heal.shorten(_replace)
    short_recover.shorten(_replace)
    _replace(hypotheses, "_SCALES", (0.1, 0.5))
    for name in ("_JAMS", "AZIMUTHS"):
        _replace(hypotheses, name, np.zeros(1))
    for name in ("STRENGTHS", "_FRICTIONS"):
        _replace(hypotheses, name, (0.3,))
    _replace(heal, "make_film", lambda *args, **more: "")
    few = {name: load_catalogue()[name] for name in ("armature", "coulomb_friction")}
    _replace(diagnose, "load_catalogue", lambda: few)
    _shorten_recoveries()


def _shorten_recoveries() -> None:
    """Two generations and one trial, where a user asked for nothing else."""
    from selfheal.recovery.recover_run import RecoverSettings

    made: Any = RecoverSettings.__init__
    usual = {"generations": 2, "trials": 1}
    _replace(RecoverSettings, "__init__",
             lambda self, *args, **more: made(self, *args, **{**usual, **more})
             )  # fmt: skip


def _replace(place: object, name: str, value: object) -> None:
    """Set an attribute that is there; one that is not is a mistake."""
    if not hasattr(place, name):
        raise AttributeError(f"{place!r} has no {name!r}")
    setattr(place, name, value)
