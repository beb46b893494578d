"""What a study is: a name in; its runs, how one is done, and its tables out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from typing_extensions import TypedDict

from ..errors import UnknownNameError
from ..schema import Count, Number

# name -> the module that has it as STUDY; imported when it is needed
STUDIES = {
    name: f"{__package__}.{name}"
    for name in ("table3", "actions", "schema", "eea", "diagnose")
}

JsonObject = Mapping[str, Any]  # of a study, whose schema checks it
RunSettings = JsonObject
Outcome = JsonObject


class Record(TypedDict):
    """What came of a run, as its study's file has it.

    Attributes:
        outcome: None where it failed.
        error: "" where it did not.
        seconds: that it took [s].
        megabytes: peak of its process until then.
        worker: name of that.
    """

    key: str
    settings: dict
    outcome: Any
    error: str
    seconds: Number
    megabytes: Count
    worker: str


@dataclass(frozen=True)
class Task:
    """One independent run of a study.

    Attributes:
        key: its name, unique in the study.
        settings: all that it depends on, its seed included, as JSON can hold it.
    """

    key: str
    settings: RunSettings


@dataclass(frozen=True)
class StudyRequest:
    """What a user wants of a study.

    Attributes:
        runs: of each row of its tables.
        seed: of the first run of each row; the others follow one by one.
        recordings: folder of the readings of 2006, None where there are none.
        cases: folder of robots to diagnose, None where none is given.
    """

    runs: int
    seed: int = 0
    recordings: Path | None = None
    cases: Path | None = None

    @property
    def seeds(self) -> range:
        """One a run."""
        return range(self.seed, self.seed + self.runs)


@dataclass(frozen=True)
class Table:
    """A part of what a study shows.

    Attributes:
        title: its heading.
        text: what it shows and what it does not.
        head: names of the columns.
        rows: cells, a row as long as `head`.
    """

    title: str
    text: str
    head: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()


Pairs = Sequence[tuple[float, bool]]


@dataclass(frozen=True)
class Boxes:
    """Numbers to be drawn, a box a series.

    Attributes:
        axis: what the numbers are, with their unit.
    """

    title: str
    series: Mapping[str, Sequence[float]]
    axis: str


@dataclass(frozen=True)
class Reliability:
    """Stated probabilities to be drawn against whether they came true."""

    title: str
    series: Mapping[str, Pairs]


Picture = Boxes | Reliability


@dataclass(frozen=True)
class Study:
    """A table of a paper as something that can be repeated.

    Attributes:
        about: it in a line.
        list_tasks: the runs that are wanted.
        run_task: does one, in a worker process: its settings in, its outcome out, as
            JSON can hold it. The same settings give the same outcome.
        make_tables: of the finished runs, each with "settings" and "outcome".
        make_pictures: of the finished runs, too.
        inputs: names of what `StudyRequest` must or may have besides runs and seed.
        settings: schema of a run's settings, as its tables read them.
        find_outcome: gives the schema of a finished run's outcome, by its settings.
    """

    about: str
    list_tasks: Callable[[StudyRequest], Sequence[Task]]
    run_task: Callable[[RunSettings], Outcome]
    make_tables: Callable[[Sequence[Record]], Sequence[Table]]
    make_pictures: Callable[[Sequence[Record]], Sequence[Picture]] = lambda records: ()
    inputs: tuple[str, ...] = ()
    settings: type = dict
    find_outcome: Callable[[RunSettings], type] = lambda settings: dict


def make_task(named: RunSettings, **other: str) -> Task:
    """A task that the values of some of its settings name."""
    return Task(" ".join(map(str, named.values())), {**named, **other})


def select_records(records: Sequence[Record], **wanted: object) -> list[Record]:
    """Records of runs that had certain settings."""
    return [r for r in records if all(r["settings"][k] == v for k, v in wanted.items())]


def find_study(name: str) -> Study:
    """The study of a name.

    Raises:
        UnknownNameError: no such study.
    """
    if name not in STUDIES:
        raise UnknownNameError("study", name, STUDIES)
    return import_module(STUDIES[name]).STUDY
