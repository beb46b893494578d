"""Runs of phases: settings in; a run that grows phase by phase, kept on disk.

RUN.h5: attributes format and version, settings and result as JSON; a group
phases/<name> each: arrays as datasets, all else as JSON.
"""

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, make_dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..damage.kinds import Damage
from ..damage.words import explain_misfit
from ..errors import InputError, RunFileError
from ..files import atomic_hdf5
from ..notebook import format_columns
from ..printable import join_names, make_printable
from ..schema import ArraySchema, Members, Number, open_members

Phase = Mapping[str, Any]  # arrays, and what JSON can say, by their names
Document = dict[str, Any]  # of JSON, as a schema has it
# is called with a phase, what is done in it, and how much of it
Progress = Callable[[str, str, float], None]


def ignore_progress(phase: str, what: str, share: float) -> None:
    """Progress that nobody looks at."""


@dataclass(frozen=True)
class KeptDamage(Damage):
    """A damage as a phase keeps it; one that makes no sense is refused."""

    def __post_init__(self) -> None:
        """Refuse it with a ValueError."""
        if wrong := explain_misfit(self):
            raise ValueError(f"of {wrong}")


@dataclass(frozen=True)
class PhaseSchema:
    """What a file holds of a phase.

    Attributes:
        document: the type of all that is JSON.
        arrays: each dataset by its name.
    """

    document: type
    arrays: Mapping[str, ArraySchema]


def declare_phase(
    optional: Mapping[str, object] = MappingProxyType({}), /, **members: object
) -> PhaseSchema:
    """The schema of a phase, of the types of its values and the schemas of its arrays.

    Args:
        optional: types of values that may be missing.
    """
    arrays = {k: v for k, v in members.items() if isinstance(v, ArraySchema)}
    fields: list[tuple[str, object] | tuple[str, object, object]] = [
        *((name, kind) for name, kind in members.items() if name not in arrays),
        ("seconds", Number),
        *((name, kind, field(default=None)) for name, kind in optional.items()),
    ]
    return PhaseSchema(make_dataclass("Phase", fields, kw_only=True), arrays)


@dataclass(frozen=True)
class PhasedRun:
    """A run, finished or not.

    Attributes:
        settings: a dataclass, `damage` among its fields.
        phases: name -> what came of it, in order.
        result: what the command's `--json` prints, empty until the end.
    """

    WHAT: ClassVar[str]  # its file in words
    FORMAT: ClassVar[str]
    VERSION: ClassVar[int]
    SETTINGS: ClassVar[type]
    RESULT: ClassVar[type]

    settings: Any
    phases: Mapping[str, Phase] = field(default_factory=dict)
    result: Document = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Time spent so far, interruptions left out [s]."""
        return sum(phase["seconds"] for phase in self.phases.values())

    def __repr__(self) -> str:
        return f"<{make_printable(self._describe())}>"

    def _repr_html_(self) -> str:
        ways = self.result.get("distance", {})
        columns = {"": ["distance in a walk [m]"], **{k: [v] for k, v in ways.items()}}
        return format_columns(self._describe(), columns if ways else {})

    def _describe(self) -> str:
        """What it is, in a line."""
        state = "finished" if self.result else "not finished"
        return f"{type(self).__name__}, {state}; phases: {join_names(self.phases)}"

    def measure_sizes(self) -> dict[str, int]:
        """Lengths of arrays that the settings say, by name."""
        return {}

    def list_next_phases(self, done: Sequence[str]) -> Sequence[str]:
        """Names of the phases one of which comes after these; none at the end."""
        raise NotImplementedError

    def find_schema(self, name: str) -> PhaseSchema:
        """What a file holds of a phase."""
        raise NotImplementedError

    @property
    def result_schema(self) -> type:
        """What a file holds of the result."""
        return self.RESULT

    def explain_misfit(self) -> str:
        """What does not fit together in a run that was read; "" if all of it does."""
        return ""


R = TypeVar("R", bound=PhasedRun)


def run_phases(
    run: R,
    step: Callable[[R], tuple[str, Phase] | None],
    result: Callable[[R], Document],
) -> Iterator[R]:
    """The run after each phase that is left, and in the end with its result.

    Args:
        run: to begin with, or to go on with.
        step: gives the next phase's name and what came of it; None at the end.
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
            arrays = {k: v for k, v in phase.items() if isinstance(v, np.ndarray)}
            for key, values in arrays.items():
                group[key] = values
            others = {k: v for k, v in phase.items() if k not in arrays}
            group["told"] = json.dumps(others, default=np.ndarray.tolist)


def load_phased_run(path: str | os.PathLike[str], kind: type[R]) -> R:
    """Read a run of a kind.

    Raises:
        RunFileError: missing, held by another process, truncated, of another kind or
            version, or damaged.
    """
    form, version = kind.FORMAT, kind.VERSION
    with open_members(path, kind.WHAT, form=form, version=version) as file:
        settings = file.read_json("settings", kind.SETTINGS)
        for damage in settings.damage:
            if wrong := explain_misfit(damage):
                raise file.make_error("attribute settings.damage", f"of {wrong}")
        run = kind(settings)
        run = replace(run, result=file.read_document("result", run.result_schema))
        try:
            file.sizes.update(run.measure_sizes())
        except InputError as error:
            said = f"of no robot that there is ({error})"
            raise file.make_error("attribute settings", said) from error
        run = replace(run, phases=_read_phases(file, run))
        if wrong := run.explain_misfit():
            raise RunFileError(f"{file.title}: {wrong}")
    return run


def _read_phases(file: Members, run: PhasedRun) -> dict[str, Phase]:
    """The phases of an open file, in order."""
    phases: dict[str, Phase] = {}
    if "phases" not in file.list_names():
        return phases
    group = file.open_group("phases")
    for k, member in enumerate(group.list_names()):
        expected = run.list_next_phases(tuple(phases))
        number, _, name = member.partition(" ")
        if number != f"{k:03d}" or name not in expected:
            fits = " or ".join(f"'{k:03d} {each}'" for each in expected)
            fits = fits or "no phase more"
            raise group.make_error(f"member {k + 1}", repr(member), fits)
        schema, members = run.find_schema(name), group.open_group(member)
        text = members.read("told", str)
        members.parse("told", text, schema.document)
        arrays = members.read_table(schema.arrays)
        phases[name] = {**json.loads(text), **arrays}
        file.sizes.update(members.sizes)
    return phases
