"""Searches that take a second: they write the same files as the usual ones."""

from typing import Any


def shorten_searches() -> None:
    """Make gaits, heals, recoveries and diagnoses short in this process."""
    from selfheal.diagnosis import diagnose
    from selfheal.diagnosis.effects import load_catalogue
    from tests.support import short_heal, short_recover
    from tests.support.killed_process import replace_attribute

    short_heal.shorten(replace_attribute)
    short_recover.shorten(replace_attribute)
    few = {name: load_catalogue()[name] for name in ("armature", "coulomb_friction")}
    replace_attribute(diagnose, "load_catalogue", lambda: few)
    _shorten_recoveries()


def _shorten_recoveries() -> None:
    """Two generations and one trial, where a user asked for nothing else."""
    from selfheal.recovery.recover_run import RecoverSettings
    from tests.support.killed_process import replace_attribute

    made: Any = RecoverSettings.__init__
    usual = {"generations": 2, "trials": 1}
    replace_attribute(
        RecoverSettings,
        "__init__",
        lambda self, *args, **more: made(self, *args, **{**usual, **more}),
    )
