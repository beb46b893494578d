"""The telemetry check: a recording and its model in, the faults of the log out."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING

from ..recording import Recording, reorder_commands
from .context import Context
from .fault import Fault
from .registry import EPISODES, KINDS, MOTION, READINGS, SETUP, Check

if TYPE_CHECKING:
    import mujoco

# [s] over which samples are smoothed; chosen: beyond, a joint's speed is not seen
MAX_KERNEL = 2.0
_WRONG = ("sign", "unit", "exchange")  # of columns, in whose torques nothing balances


@dataclass(frozen=True)
class Telemetry:
    """What a check found, and what it could not look at.

    Attributes:
        faults: of the log, or of the model's ranges.
        unchecked: sentences that say what was not checked, and why.
    """

    faults: tuple[Fault, ...]
    unchecked: tuple[str, ...]


def check_telemetry(recording: Recording, model: "mujoco.MjModel") -> list[Fault]:
    """Faults of a log that no physics explains, and of the ranges of its model."""
    return list(examine_telemetry(recording, model).faults)


def examine_telemetry(recording: Recording, model: "mujoco.MjModel") -> Telemetry:
    """Faults of a log, and what could not be looked at."""
    recording, unchecked = _drop_ambiguous(recording)
    episodes = {k: reorder_commands(e, model) for k, e in recording.episodes.items()}
    context = Context(replace(recording, episodes=episodes), model)
    _run(READINGS, context)
    frozen = {c for f in context.faults if f.kind == "frozen" for c in f.columns}
    motion = _examine_motion(Context(context.recording, model, frozen))
    return Telemetry((*context.faults, *motion.faults), (*unchecked, *motion.unchecked))


def _run(checks: Iterable[Check], context: Context) -> None:
    """Have a context know what some checks find; no fault of frozen columns."""
    for check in checks:
        module = import_module(f"{__package__}.checks.{check.name}")
        found = [*module.find(context)]  # it may take faults back
        context.faults += [f for f in found if not context.frozen & {*f.columns}]


def _examine_motion(context: Context) -> Telemetry:
    """Faults of the motion; an episode that does not fit is reported, and left out."""
    if context.series.kernel > MAX_KERNEL:
        seconds = context.series.kernel
        reason = f"motion: samples are seen through {seconds:.3g} s, too coarsely"
        return Telemetry((), (reason,))
    _run(SETUP, context)
    if any(KINDS[f.kind] for f in context.faults):  # forces say nothing then
        _run(MOTION[:1], context)
        return Telemetry(tuple(context.faults), ())
    for check in EPISODES:
        known = len(context.faults)
        _run([check], context)
        if found := context.faults[known:]:
            return _examine_rest(context, found, by_torques=check is EPISODES[-1])
    _run(MOTION, context)
    reason = context.balance.reason
    unchecked = (f"the balance of torques: {reason}",) if reason else ()
    return Telemetry(tuple(context.faults), unchecked)


def _examine_rest(
    context: Context, found: Sequence[Fault], *, by_torques: bool
) -> Telemetry:
    """Faults of episodes, and those of the motion in all others.

    Columns that are wrong in all others leave the balance of torques, by which
    episodes are found, no meaning: then they are the faults of all.
    """
    left_out = {k for f in found for k in f.episodes}
    every = context.recording.episodes
    rest = {k: e for k, e in every.items() if k not in left_out}
    recording = replace(context.recording, episodes=rest)
    others = _examine_motion(Context(recording, context.model, context.frozen))
    if by_torques and any(f.is_decisive and f.kind in _WRONG for f in others.faults):
        found = ()
        widened = tuple(
            replace(f, episodes=tuple(every)) if {*f.episodes} == {*rest} else f
            for f in others.faults
        )
        others = replace(others, faults=widened)
    return replace(others, faults=(*found, *others.faults))


def _drop_ambiguous(recording: Recording) -> tuple[Recording, list[str]]:
    """The signals that mean the same in every episode, and a reason for each other."""
    meanings = dict[str, set[tuple[str, str, tuple[int, ...]]]]()
    for episode in recording.episodes.values():
        for name, s in episode.signals.items():
            meaning = s.kind, s.target, s.values.shape[1:]
            meanings.setdefault(name, set()).add(meaning)
    dropped = [name for name, found in meanings.items() if len(found) > 1]
    if not dropped:
        return recording, []
    episodes = {
        key: replace(
            e, signals={n: s for n, s in e.signals.items() if n not in dropped}
        )
        for key, e in recording.episodes.items()
    }
    return replace(recording, episodes=episodes), [
        f"signal {name!r}: it is something else in another episode" for name in dropped
    ]
