"""Recoveries on disk: all that a recovery went through, to look at or to go on with.

RECOVER.h5: attributes format="selfheal-recover-run", version=1, settings and result as
JSON; a group phases/<name> each, as in a heal's file.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from ..body.damage import Damage
from ..body.legged import Legged, legged
from ..files import atomic_path, open_run
from .estimate import Hypothesis, Trial
from .record import Phase, read_phases, write_phases

FORMAT, VERSION = "selfheal-recover-run", 1
METHODS = {
    "ours": "sensor series, graded damage, the world; trials that separate hypotheses",
    "as-described": "the two searches of 2004, by displacement alone",
    "hardware-only": "the control of 2004: evolution on the robot itself",
}
TRIALS = 3  # after the failure (overview.txt 4.4)


@dataclass(frozen=True)
class RecoverSettings:
    """What a recovery was asked to do.

    Attributes:
        robot: of `body.legged.LEGGED`.
        scenario: its number.
        damage: what happens to the hidden robot.
        method: of `METHODS`.
        seed: of everything random.
        reach: of the joints [deg].
        apart: whether each degree of freedom can break by itself.
        gap: share by which the hidden robot may be off the model.
        trials: after the failure.
        generations: of each search.
    """

    robot: str
    scenario: int
    damage: tuple[Damage, ...]
    method: str = "ours"
    seed: int = 0
    reach: float = 30.0
    apart: bool = False
    gap: float = 0.0
    trials: int = TRIALS
    generations: int = 30

    @property
    def legged(self) -> Legged:
        """The robot's body as it was built."""
        return legged(self.robot, self.reach, self.apart)


@dataclass(frozen=True)
class RecoverRun:
    """A recovery, finished or not.

    Attributes:
        settings: what was asked.
        phases: name -> what came of it, in order.
        result: what `recover --json` prints, empty until the end.
    """

    settings: RecoverSettings
    phases: Mapping[str, Phase] = field(default_factory=dict)
    result: Mapping[str, Any] = field(default_factory=dict)

    def after(self, name: str, phase: Phase) -> "RecoverRun":
        """This recovery and one more phase."""
        return replace(self, phases={**self.phases, name: phase})

    @property
    def trials(self) -> list[Trial]:
        """What the broken robot has answered so far, its failure first."""
        done = self.phases
        asked = {"failure": "original"}
        asked |= {f"trial-{k}": f"explore-{k}" for k in range(1, len(done) + 1)}
        return [Trial(done[by]["weights"], float(done[name]["way"]),
                      done[name]["sensed"])
                for name, by in asked.items() if name in done]  # fmt: skip


def hypotheses_document(hypotheses: Sequence[Hypothesis]) -> list[list[dict]]:
    """Hypotheses as a phase keeps them."""
    return [[asdict(damage) for damage in h] for h in hypotheses]


def hypotheses_of(phase: Phase) -> list[Hypothesis]:
    """The hypotheses that `hypotheses_document` kept in a phase."""
    return [tuple(Damage(**d) for d in h) for h in phase["believed"]]


def save(run: RecoverRun, path: str | os.PathLike[str]) -> None:
    """Write a recovery whole or not at all.

    Raises:
        InputError: nothing can be written there.
    """
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs.update(format=FORMAT, version=VERSION)
        file.attrs["settings"] = json.dumps(asdict(run.settings))
        file.attrs["result"] = json.dumps(dict(run.result))
        write_phases(file, run.phases)


def load(path: str | os.PathLike[str]) -> RecoverRun:
    """Read a recovery.

    Raises:
        RunFileError: missing, held by another process, truncated, no recovery's file,
            or of another version.
    """
    with open_run(path, "recovery's file", form=FORMAT, version=VERSION) as file:
        settings = json.loads(file.attrs["settings"])
        settings["damage"] = tuple(Damage(**d) for d in settings["damage"])
        result = json.loads(file.attrs["result"])
        return RecoverRun(RecoverSettings(**settings), read_phases(file), result)
