"""The effects that are concealed, by the names of contract section 4.

An implementation of its own: nothing of `selfheal.diagnosis` is used, so that an error
there cannot hide in the truth.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path

from benchmarks.hidden.effects import bodies, drives, joints, unlisted
from benchmarks.hidden.effects.base import Effect


def _read_catalogue() -> dict[str, dict[str, Effect]]:
    """Effects by group and name: how each is drawn and installed, and the rest."""
    text = Path(__file__).with_name("catalogue.toml").read_text()
    rooms = (joints, drives, bodies, unlisted)
    physics = {name: pair for room in rooms for name, pair in room.PHYSICS.items()}
    return {
        group: {
            name: Effect(*physics[name], **{"name": name, **table})
            for name, table in tables.items()
        }
        for group, tables in tomllib.loads(text).items()
    }


_CATALOGUE = _read_catalogue()
DRAWN: Mapping[str, Effect] = _CATALOGUE["drawn"]
PLACED: Mapping[str, Effect] = _CATALOGUE["placed"]
UNLISTED: Mapping[str, Effect] = _CATALOGUE["unlisted"]
