"""Runs of phases: what was asked in; a run that grows phase by phase, kept on disk.

RUN.h5: attributes format and version, settings and result as JSON; a group
phases/<name> each: arrays as datasets, all else as JSON.
"""

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..body.damage import Damage
from ..files import atomic_hdf5, open_run

Phase = Mapping[str, Any]


@dataclass(frozen=True)
class PhasedRun:
    """A run, finished or not.

    Attributes:
        settings: what was asked; a dataclass, `damage` among its fields.
        phases: name -> what came of it, in order.
        result: what the command's `--json` prints, empty until the end.
    """

    WHAT: ClassVar[str]  # its file in words
    FORMAT: ClassVar[str]
    VERSION: ClassVar[int]
    SETTINGS: ClassVar[type]

    settings: Any
    phases: Mapping[str, Phase] = field(default_factory=dict)
    result: Mapping[str, Any] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Time spent so far, interruptions left out [s]."""
        return sum(phase["seconds"] for phase in self.phases.values())


R = TypeVar("R", bound=PhasedRun)


def run_phases(
    run: R,
    step: Callable[[R], tuple[str, Phase] | None],
    result: Callable[[R], Mapping[str, Any]],
) -> Iterator[R]:
    """The run after each phase that is left, and in the end with its result.

    Args:
        run: to begin with, or to go on with.
        step: gives the next phase's name and what came of it; None at the end.
        result: of all phases.
    """
    if run.result:
        yield run
        return
    while True:
        start = time.perf_counter()
        made = step(run)
        if made is None:
            break
        name, phase = made
        timed = {**phase, "seconds": time.perf_counter() - start}
        run = replace(run, phases={**run.phases, name: timed})
        yield run
    yield replace(run, result=result(run))


def save_phased_run(run: PhasedRun, path: str | os.PathLike[str]) -> None:
    """Write a run whole or not at all.

    Raises:
        InputError: nothing can be written there.
    """
    with atomic_hdf5(path) as file:
        file.attrs.update(format=run.FORMAT, version=run.VERSION)
        file.attrs["settings"] = json.dumps(asdict(run.settings))
        file.attrs["result"] = json.dumps(dict(run.result))
        for k, (name, phase) in enumerate(run.phases.items()):
            group = file.create_group(f"phases/{k:03d} {name}")
            plain = {}
            for key, value in phase.items():
                if isinstance(value, np.ndarray):
                    group[key] = value
                else:
                    plain[key] = value
            group["told"] = json.dumps(plain, default=_to_list)


def load_phased_run(path: str | os.PathLike[str], kind: type[R]) -> R:
    """Read a run of a kind.

    Raises:
        RunFileError: missing, held by another process, truncated, of another kind or
            version, or damaged.
    """
    form, version = kind.FORMAT, kind.VERSION
    with open_run(path, kind.WHAT, form=form, version=version) as file:
        settings = json.loads(file.attrs["settings"])
        settings["damage"] = tuple(Damage(**d) for d in settings["damage"])
        result = json.loads(file.attrs["result"])
        phases: dict[str, Phase] = {}
        for name, group in sorted(file.get("phases", {}).items()):
            told = json.loads(group["told"][()])
            arrays = {k: v[()] for k, v in group.items() if k != "told"}
            phases[name.partition(" ")[2]] = {**told, **arrays}
        return kind(kind.SETTINGS(**settings), phases, result)


def _to_list(value: Any) -> Any:
    """An array within other data as a list."""
    return value.tolist()
