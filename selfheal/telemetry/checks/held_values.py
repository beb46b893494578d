"""Held values: takes raw columns, finds those that are frozen or clipped."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...recording import Recording
from ...recording.data import Floats
from ..context import READ, Context
from ..fault import ColumnCorrection, Fault, format_columns

# s and samples that a column must hold one value to be frozen; chosen
MIN_HELD_SECONDS, MIN_HELD_SAMPLES = 0.25, 15
MAX_P_VALUE = 1e-9  # of readings that are all the same; chosen: quantized ones are, too
LIVE_SHARE = 0.5  # of a column's steps that change it, to be one that flickers; chosen
ALONE_REPEATS = 0.4  # of the one column of its kind, while its command moves; chosen
# share of a column's samples at its extreme value, and of runs there, to be clipped;
# chosen: an eighth of a percent and three
CLIPPED_SHARE, CLIPPED_RUNS = 0.02, 2
BASIS = (
    "the probability that so many readings repeat, where a reading repeats as often "
    "as elsewhere in this column or in its like"
)
# quantile of a column's steps that a jump after a freeze exceeds by this factor, and
# quanta by which a clipped value is reached; chosen: a motion does not start like that
JUMP_QUANTILE, JUMP = 0.98, 3.0
ENTRY_QUANTA = 4.0
# episode, time [s] or value [unit], seconds or samples, log of the p-value
Case = tuple[str, float, float, float]


class _Run(NamedTuple):
    """Samples that hold one value, in samples that were read."""

    start: int
    length: int
    value: float


def _list_runs(values: Floats) -> list[_Run]:
    """Every unbroken run of one value in a column (n), which has some."""
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    lengths = np.diff(starts, append=values.size)
    rows = zip(starts.tolist(), lengths.tolist(), values[starts].tolist(), strict=True)
    return [_Run(*row) for row in rows]


def find(context: Context) -> Iterator[Fault]:
    """Signals that are frozen, or clipped at a value, in any episode."""
    recording = context.recording
    commands = {n: j.commands for j in context.joints.values() for n in j.columns}
    share = _measure_repeats(context)
    frozen: dict[tuple[str, bool], list[Case]] = {}
    clipped: dict[str, list[Case]] = {}
    for episode, signal, time, values in _list_live(context):
        if _is_idle(recording, episode, commands.get(signal, ())):
            continue
        alone = share[signal] is None
        if alone and (not commands.get(signal) or np.ptp(values) > 0):
            continue
        repeats = max(share[signal] or ALONE_REPEATS, 1e-3)
        if repeats > LIVE_SHARE:
            continue
        runs = _list_runs(values)
        longest = max(runs, key=lambda r: r.length)
        if case := _judge_clipped(episode, values, runs, repeats):
            clipped.setdefault(signal, []).append(case)
        elif case := _judge_frozen(episode, time, values, longest, repeats):
            whole = longest.length == values.size
            frozen.setdefault((signal, whole), []).append(case)
    for (name, whole), cases in frozen.items():
        episode, start, seconds, _ = min(cases, key=lambda c: c[3])
        if whole:
            held = f"all readings of {format_columns([name])} are the same"
        else:
            held = (
                f"{format_columns([name])} holds one value for {seconds:.2f} s from "
                f"{start:.2f} s on in episode {episode!r}"
            )
        seen = f"{held} while the other columns change"
        yield _make_fault(recording, "frozen", name, cases, seen)
    for name, cases in clipped.items():
        episode, value, *_ = min(cases, key=lambda c: c[3])
        unit = recording.episodes[episode].signals[name].unit
        seen = (
            f"{format_columns([name])} is clipped at {value:.4g} {unit} in episode "
            f"{episode!r}: it reaches that value again and again, and never passes it"
        )
        yield _make_fault(recording, "saturated", name, cases, seen)


def _make_fault(
    recording: Recording, kind: str, name: str, cases: Sequence[Case], seen: str
) -> Fault:
    """The fault of one signal in some episodes."""
    ids = tuple(case[0] for case in cases)
    target = recording.episodes[ids[0]].signals[name].target
    p = float(np.exp(max(min(case[3] for case in cases), -600)))
    rule = ColumnCorrection(name, {"skip": True})
    return Fault(kind, ids, (name,), target, seen, p, BASIS, (rule,))


def _judge_frozen(
    episode: str, time: Floats, values: Floats, run: _Run, repeats: float
) -> Case | None:
    """The longest run of one value, where it is no rest of what is measured.

    `repeats` is the probability that a reading of the column (T) repeats.
    """
    last = run.start + run.length - 1
    seconds = float(time[last] - time[run.start])
    log_p = (run.length - 1) * np.log(repeats)
    if (
        seconds < MIN_HELD_SECONDS
        or run.length < MIN_HELD_SAMPLES
        or log_p > np.log(MAX_P_VALUE)
    ):
        return None
    if run.length < values.size:
        steps = np.abs(np.diff(values))
        usual = np.quantile(np.delete(steps, slice(run.start, last)), JUMP_QUANTILE)
        edges = [steps[k] for k in (run.start - 1, last) if 0 <= k < steps.size]
        if max(edges) < JUMP * usual:
            return None
    return episode, float(time[run.start]), seconds, log_p


def _judge_clipped(
    episode: str, values: Floats, runs: Sequence[_Run], repeats: float
) -> Case | None:
    """Runs at the highest or lowest value, where it was reached at speed.

    `repeats` is the probability that a reading of the column (T) repeats.
    """
    steps = np.abs(np.diff(values))
    quantum = float(np.min(steps[steps > 0], initial=np.inf))
    for edge in (values.max(), values.min()):
        there = [r for r in runs if r.value == edge and r.length > 3]
        count = sum(r.length for r in there)
        log_p = (count - len(there)) * np.log(repeats)
        entries = [steps[r.start - 1] for r in there if r.start]
        if (
            len(there) >= CLIPPED_RUNS
            and CLIPPED_SHARE * values.size < count < values.size
            and log_p < np.log(MAX_P_VALUE)
            and np.median(entries) > ENTRY_QUANTA * quantum
        ):
            return episode, float(edge), float(count), log_p
    return None


def _is_idle(recording: Recording, episode: str, commands: Sequence[str]) -> bool:
    """Whether none of these commands moves in an episode."""
    e = recording.episodes[episode]
    moved = [np.ptp(e.ctrl[:, e.ctrl_names.index(c)]) > 0 for c in commands]
    return bool(moved) and not any(moved)


def _list_live(context: Context) -> Iterator[tuple[str, str, Floats, Floats]]:
    """The column of each signal and episode that changes most often."""

    def count_changes(values: Floats) -> Floats:
        return (np.diff(values, axis=0) != 0).sum(axis=0)

    return context.list_columns(READ, MIN_HELD_SAMPLES, count_changes)


def _measure_repeats(context: Context) -> dict[str, float | None]:
    """How often a reading of a live column is that of the sample before, by signal.

    Of a column that never changes it is that of the other signals of its kind, and
    None where there is no other.
    """
    counts, kinds = dict[str, Floats](), dict[str, str]()
    for episode, name, _, values in _list_live(context):
        kinds[name] = context.recording.episodes[episode].signals[name].kind
        same = np.diff(values) == 0
        # the longest run is what is tested, and counts for no probability
        longest = max(r.length for r in _list_runs(values)) - 1
        add = np.array([max(same.sum() - longest, 0), same.size - longest], float)
        counts[name] = counts.get(name, np.zeros(2)) + add
    out: dict[str, float | None] = {}
    for name, own in counts.items():
        used = [own]
        if own[1] < MIN_HELD_SAMPLES:
            every = counts.items()
            used = [c for n, c in every if kinds[n] == kinds[name] and n != name]
        repeated, total = np.sum(used, axis=0) if used else (0.0, 0.0)
        out[name] = (repeated + 1) / (total + 2) if total else None
    return out
