"""Heals on disk: all that a heal went through, to look at or to go on with.

HEAL.h5: attributes format="selfheal-heal-run", version=1, settings and result as JSON;
a group phases/<name> each: arrays as datasets, all else as JSON.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ..body.damage import Damage
from ..files import atomic_path, open_run
from ..gait.synthesis import Gait

FORMAT, VERSION = "selfheal-heal-run", 1

Phase = Mapping[str, Any]


@dataclass(frozen=True)
class HealSettings:
    """What a heal was asked to do.

    Attributes:
        run: path of the self-modeling run that it starts from.
        damage: what happens to the hidden robot.
        onset: when, in seconds of the walk that is watched.
        gait: name of the gaits' pattern.
        heading: direction to walk [rad].
        seed: of everything random.
    """

    run: str
    damage: tuple[Damage, ...]
    onset: float
    gait: str = "waves"
    heading: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class HealRun:
    """A heal, finished or not.

    Attributes:
        settings: what was asked.
        phases: name -> what came of it, in order.
        result: what `heal --json` prints, empty until the end.
    """

    settings: HealSettings
    phases: Mapping[str, Phase] = field(default_factory=dict)
    result: Mapping[str, Any] = field(default_factory=dict)

    def after(self, name: str, phase: Phase) -> "HealRun":
        """This heal and one more phase."""
        return replace(self, phases={**self.phases, name: phase})

    @property
    def seconds(self) -> float:
        """Spent so far, interruptions left out."""
        return sum(phase["seconds"] for phase in self.phases.values())

    @property
    def asked(self) -> list[Phase]:
        """The actions taken after the alarm."""
        return [p for name, p in self.phases.items() if name.startswith("ask")]


def gait_document(gait: Gait) -> dict[str, Any]:
    """A gait as a phase keeps it."""
    return asdict(gait)


def gait_of(phase: Phase) -> Gait:
    """The gait that `gait_document` kept in a phase."""
    kept = phase["gait"]
    return Gait(**{**kept, "genes": np.asarray(kept["genes"], float)})


def save(run: HealRun, path: str | os.PathLike[str]) -> None:
    """Write a heal whole or not at all.

    Raises:
        InputError: nothing can be written there.
    """
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs.update(format=FORMAT, version=VERSION)
        file.attrs["settings"] = json.dumps(asdict(run.settings))
        file.attrs["result"] = json.dumps(dict(run.result))
        write_phases(file, run.phases)


def write_phases(file: Any, phases: Mapping[str, Phase]) -> None:
    """Put phases into an open run file: arrays as datasets, all else as JSON."""
    for k, (name, phase) in enumerate(phases.items()):
        group = file.create_group(f"phases/{k:03d} {name}")
        plain = {}
        for key, value in phase.items():
            if isinstance(value, np.ndarray):
                group[key] = value
            else:
                plain[key] = value
        group["told"] = json.dumps(plain, default=_plain)


def read_phases(file: Any) -> dict[str, Phase]:
    """The phases that `write_phases` put there, in order."""
    phases: dict[str, Phase] = {}
    for name, group in sorted(file.get("phases", {}).items()):
        told = json.loads(group["told"][()])
        arrays = {k: v[()] for k, v in group.items() if k != "told"}
        phases[name.partition(" ")[2]] = {**told, **arrays}
    return phases


def _plain(value: Any) -> Any:
    """An array within other data as a list."""
    return value.tolist()


def load(path: str | os.PathLike[str]) -> HealRun:
    """Read a heal.

    Raises:
        RunFileError: missing, held by another process, truncated, no heal's file, or of
            another version.
    """
    with open_run(path, "heal's file", form=FORMAT, version=VERSION) as file:
        return _read(file)


def _read(file: Any) -> HealRun:
    """The heal in an open file."""
    settings = json.loads(file.attrs["settings"])
    settings["damage"] = tuple(Damage(**d) for d in settings["damage"])
    result = json.loads(file.attrs["result"])
    return HealRun(HealSettings(**settings), read_phases(file), result)
