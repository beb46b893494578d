"""Repeated readings: takes raw columns, finds those that hold each reading for a time.

A quantized column repeats a reading where it moves slowly. Between two jumps in one
direction it moves fast: there a step of nothing is no likelier than one of a quantum.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...recording import Recording
from ...recording.data import Floats
from ..context import READ, Context
from ..fault import Fault, format_columns

MIN_JUMPS = 12  # between which readings repeat; chosen: half a second of motion
JUMP = 5.0  # quanta of a step that is a jump; chosen: quantization steps by one or two
LONGEST = 0.5  # [s] that a reading is held; chosen: longer is `frozen`
# share of the readings between jumps that are held; and of the holds that last as long
# as usual, to one sample; chosen: a joint that sticks and slips holds as it pleases
HELD_SHARE, REGULAR_SHARE = 0.8, 0.8
# probability at most of a step of nothing, among those of a quantum to each side and
# none; chosen: a third, and some for a column that comes to rest
NOTHING = 0.5
MAX_P_VALUE = 1e-6  # times the number of columns; chosen: one log in a million
BASIS = (
    "binomial test: between jumps of one direction, a step of nothing is no likelier "
    "than a step of a quantum; times the number of columns"
)


class _Hold(NamedTuple):
    """How a column of an episode repeats its readings: for how long each lasts.

    Between jumps, so many steps are nothing, and others are not.
    """

    samples: int
    seconds: float
    nothing: int
    other: int


def find(context: Context) -> Iterator[Fault]:
    """Signals that hold each reading for several samples, while others go on."""
    servos = [j for j in context.joints.values() if j.servo]
    goals = {n: j.servo.command for j in servos for n in j.columns if j.servo}
    columns = context.list_columns(
        (*READ, "joint_torque"), MIN_JUMPS, lambda values: np.std(values, axis=0)
    )
    held: dict[str, list[tuple[str, _Hold]]] = {}
    count = 0
    for episode, name, time, values in columns:
        count += 1
        hold = _measure_hold(time, values)
        if hold and not _follows(context.recording, episode, goals.get(name), hold):
            held.setdefault(name, []).append((episode, hold))
    yield from _report(context.recording, held, count)


def _measure_hold(time: Floats, values: Floats) -> _Hold | None:
    """How a column (T), all of it known, holds its readings; None: it does not."""
    steps = np.diff(values)
    moving = np.abs(steps[steps != 0])
    if moving.size < MIN_JUMPS:
        return None
    quantum = float(moving.min())
    # rounding of numbers is no quantum
    quantum = max(quantum, 1e-9 * float(np.abs(values).max()))
    jumps = np.flatnonzero(np.abs(steps) > JUMP * quantum)
    if jumps.size < MIN_JUMPS:
        return None
    lengths = np.diff(jumps)
    usual = float(np.median(np.diff(time)))
    same = np.sign(steps[jumps[1:]]) == np.sign(steps[jumps[:-1]])
    same &= lengths * usual < LONGEST
    lengths, first = lengths[same], jumps[:-1][same]
    if lengths.size < MIN_JUMPS:
        return None
    total = np.concatenate([[0], np.cumsum(steps != 0)])
    still = total[first + lengths] - total[first + 1] == 0
    holds = lengths[still & (lengths > 1)]
    if holds.size < max(MIN_JUMPS, HELD_SHARE * lengths.size):
        return None
    samples = int(np.median(holds))
    if np.mean(np.abs(holds - samples) <= 1) < REGULAR_SHARE:
        return None
    nothing = int((holds - 1).sum())
    other = int((lengths - 1).sum()) - nothing
    return _Hold(samples, samples * usual, nothing, other)


def _follows(recording: Recording, episode: str, goal: str | None, hold: _Hold) -> bool:
    """Whether a column is held as long as its servo's goal: then it may just follow."""
    if goal is None:
        return False
    e = recording.episodes[episode]
    changes = np.flatnonzero(np.diff(e.ctrl[:, e.ctrl_names.index(goal)]))
    usual = float(np.median(np.diff(changes))) if changes.size > 1 else 0.0
    return usual > 1 and abs(usual - hold.samples) <= 1


def _report(
    recording: Recording, held: Mapping[str, Sequence[tuple[str, _Hold]]], count: int
) -> Iterator[Fault]:
    """Faults of the signals that are held alike, of so many columns."""
    from scipy.stats import binom

    alike, p_values = dict[int, list[str]](), dict[str, float]()
    for name, cases in held.items():
        nothing = sum(h.nothing for _, h in cases)
        total = nothing + sum(h.other for _, h in cases)
        p = float(binom.sf(nothing - 1, total, NOTHING)) * count
        if p < MAX_P_VALUE:
            p_values[name] = max(p, 1e-300)
            samples = int(np.median([h.samples for _, h in cases]))
            alike.setdefault(samples, []).append(name)
    for samples, names in alike.items():
        cases = [case for name in names for case in held[name]]
        seconds = float(np.median([h.seconds for _, h in cases]))
        target = recording.episodes[cases[0][0]].signals[names[0]].target
        said = format_columns(names)
        seen = (
            f"{said} hold{'s' * (len(names) == 1)} each reading for {samples} samples, "
            f"{1e3 * seconds:.3g} ms, while the joint or body moves"
        )
        advice = f"leave repeated cells of {said} empty in the log, or the columns out"
        ids, p = dict.fromkeys(k for k, _ in cases), max(p_values[n] for n in names)
        where = tuple(ids), tuple(names), target
        yield Fault("stale", *where, seen, p, BASIS, (advice,))
