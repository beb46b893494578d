"""When rows were measured and what parts a log: streams in; clocks out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ...errors import InputError
from ..base import Stream
from ..log_map import Clock, EpisodeRule
from ..motion import Sample
from ..timeline import StreamTime, split_rows
from ..units import find_unit, get_unit
from .column_names import read_name
from .words import read_words

# [s] between rows of a robot's log; chosen: 5 kHz to 2 Hz
_SHORTEST, _LONGEST = 2e-4, 0.5
_GAP = 20  # times the median step, and above a second: another episode; chosen
_LEAST_GAP = 1.0
_PAUSE = 0.5  # [s] between runs; chosen: over which no motion is compared, and no gap
_FEWEST = 20  # rows that show a clock; chosen


@dataclass
class TimeGuess:
    """Clocks of the streams of a log.

    Attributes:
        taken: "STREAM:COLUMN" of the columns of times and episodes.
        notes: what was seen of each stream, with how sure.
    """

    clocks: dict[str, Clock] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)
    notes: dict[str, tuple[float, str]] = field(default_factory=dict)
    episodes: EpisodeRule = field(default_factory=EpisodeRule)


def guess_times(streams: Sequence[Stream], samples: Mapping[str, Sample]) -> TimeGuess:
    """Find the clocks of a log; the samples' times are set by them."""
    found = TimeGuess()
    for stream in streams:
        sample = samples[stream.name]
        clock, sure, why = _guess_clock(stream, sample)
        found.clocks[stream.name] = clock
        found.notes[stream.name] = sure, why
        column = clock.column or ("" if clock.rate else stream.time)
        # other clocks are no signals either
        clocks = {column, *_list_named(stream, sample)} - {""}
        found.taken |= {f"{stream.name}:{name}" for name in clocks}
        if column in sample.columns:
            unit = find_unit(clock.unit) if clock.column else None
            times: np.ndarray = sample.columns[column] * (unit.factor if unit else 1)
        else:
            rows = len(next(iter(sample.columns.values()), ()))
            period = 1 / clock.rate if clock.rate else stream.period or 0.0
            times = period * np.arange(rows)
        sample.time = _join_runs(times.astype(np.float64))
    found.episodes = _guess_episodes(streams, samples, found)
    return found


def _list_named(stream: Stream, sample: Sample) -> list[str]:
    """Columns whose names are of times and which increase."""
    words = read_words().times
    return [
        name
        for name in stream.columns
        if not words.isdisjoint(read_name("", name).own)
        and _is_increasing(sample.columns.get(name))
    ]


def _join_runs(time: np.ndarray) -> np.ndarray:
    """Times (n) [s] where a run whose time begins again follows the one before it."""
    runs = [rows for _, rows in split_rows(StreamTime(time))]
    joined = time.copy()
    for before, rows in pairwise(runs):
        shift = np.nanmax(joined[before]) + _PAUSE - time[rows[0]]
        joined[rows] += shift
    return joined


def _is_increasing(values: np.ndarray | None) -> bool:
    """Whether most steps (n) of a column go up."""
    if values is None or values.size < 2:
        return False
    return bool((np.diff(values) > 0).mean() > 0.9)


def _guess_clock(stream: Stream, sample: Sample) -> tuple[Clock, float, str]:
    """The clock of a stream, how sure it is, and why."""
    if stream.time:
        return Clock(), 0.99, f"the log's own time {stream.time!r}"
    found = list[tuple[Clock, float, str]]()
    for name in _list_named(stream, sample):
        values = sample.columns[name]
        stated = stream.columns[name] or read_name("", name).unit
        unit, sure = _guess_time_unit(stated, values)
        why = f"column {name!r} increases by {_measure_step(values):.4g}"
        found.append((Clock(name, unit), sure, why))
    if found:
        return max(found, key=lambda guess: guess[1])
    if stream.period is not None:
        return Clock(), 0.95, f"the log states {1 / stream.period:.4g} Hz"
    # the first column that increases as a clock does
    for name in stream.columns:
        values = sample.columns.get(name, np.empty(0))
        if values.size < _FEWEST or not _is_increasing(values):
            continue
        unit, sure = _guess_time_unit("", values)
        step, steps = _measure_step(values), np.diff(values)
        steps = steps[steps > 0]
        if np.std(steps) < step and sure > 0.5 and not (steps == 1).all():
            why = f"only column {name!r} increases evenly, by {step:.4g}"
            return Clock(name, unit), 0.7 * sure, why
    return Clock(rate=100.0), 0.0, "the log has no time: write its rate in Hz"


def _measure_step(values: np.ndarray) -> float:
    steps = np.diff(values)
    return float(np.median(steps[steps > 0]))


def _guess_time_unit(stated: str, values: np.ndarray) -> tuple[str, float]:
    """The unit of a column of times (n), and how sure it is."""
    unit = find_unit(stated) if stated else None
    if unit is not None and unit.si == "s":
        return stated, 0.98
    step = _measure_step(values)
    fits = [
        name
        for name, factor in (("s", 1), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
        if _SHORTEST <= step * factor <= _LONGEST
    ]
    return (fits[0], 0.95 if len(fits) == 1 else 0.8) if fits else ("s", 0.3)


def check_time_unit(clock: Clock, what: str, values: np.ndarray) -> str:
    """What is unusual in the unit of a column of times; "" where nothing is.

    Args:
        what: the column, as the beginning of a sentence.
        values: (n) of it.

    Raises:
        InputError: rows come as those of no robot, and the map states no unit.
    """
    if not _is_increasing(values):
        return ""
    step, (unit, _) = _measure_step(values), _guess_time_unit("", values)
    stated = clock.unit or "s"
    seconds, likelier = (step * get_unit(u).factor for u in (stated, unit))
    if _SHORTEST <= seconds <= _LONGEST or unit == stated:
        return ""
    said = (
        f"{what} goes up by {step:.4g} from row to row, which is "
        f"{seconds:.3g} s in {stated} and would be {likelier:.3g} s in {unit}"
    )
    if not clock.unit:
        raise InputError(
            f'{said}; would fit in the map: [time] unit = "{unit}", or unit = "s"'
        )
    return said


def _guess_episodes(
    streams: Sequence[Stream], samples: Mapping[str, Sample], found: TimeGuess
) -> EpisodeRule:
    """What parts the log: a column of its own, a named one, or gaps."""
    for stream in streams:
        sample = samples[stream.name]
        if stream.episode:
            found.taken.add(f"{stream.name}:{stream.episode}")
            return EpisodeRule()
        for name in stream.columns:
            if read_words().episodes.isdisjoint(read_name("", name).own):
                continue
            if name in sample.texts or _is_label(sample.columns.get(name)):
                found.taken.add(f"{stream.name}:{name}")
                return EpisodeRule(column=name)
    times = [s.time[np.isfinite(s.time)] for s in samples.values()]
    steps = np.diff(np.sort(np.concatenate([np.empty(0), *times])))
    usual = max((float(np.median(np.diff(t))) for t in times if t.size > 1), default=0)
    if steps.size and steps.max() > max(_LEAST_GAP, _GAP * usual):
        return EpisodeRule(gap=_LEAST_GAP)
    return EpisodeRule()


def _is_label(values: np.ndarray | None) -> bool:
    """Whether a column (n) holds whole numbers that seldom change."""
    if values is None or not values.size or not np.isfinite(values).all():
        return False
    changes = (np.diff(values) != 0).mean()
    return bool((values == np.round(values)).all() and changes < 0.05)
