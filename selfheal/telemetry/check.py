"""The telemetry check: a recording and its model in, the faults of the log out."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..recording import Recording, reorder_commands
from .aborted import find_unpowered
from .bodies import BodyCheck
from .fault import KINDS, Fault
from .joint_faults import BASES, JointCheck
from .joints import list_joints
from .odd import find_odd
from .ranges import find_beyond
from .raw.columns import find_held
from .raw.common_unit import find_common_unit
from .raw.stale import find_stale
from .raw.timing import find_time_faults
from .raw.zero_rows import find_zeros
from .rollouts import Rollouts
from .series import build_series
from .setup import find_missing_actuators, find_setup_faults
from .states import X_Y_Z_W, Mend
from .torques import find_torque_faults

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
    recording = replace(recording, episodes=episodes)
    zeros, recording = find_zeros(recording)
    joints = list_joints(recording, model)
    units, recording = find_common_unit(recording, joints)
    commands = {column: j.commands for j in joints for column in j.columns}
    goals = {column: j.servo.command for j in joints if j.servo for column in j.columns}
    faults = [
        *zeros,
        *units,
        *find_time_faults(recording),
        *find_held(recording, commands),
        *find_stale(recording, goals),
    ]
    held = {c for f in faults if f.kind == "frozen" for c in f.columns}
    motion = _examine_motion(recording, model, held)
    return Telemetry((*faults, *motion.faults), (*unchecked, *motion.unchecked))


def _examine_motion(
    recording: Recording, model: "mujoco.MjModel", held: Collection[str]
) -> Telemetry:
    """Faults of what a log tells of the motion; an odd episode is told, and left out.

    Args:
        recording: of the robot.
        model: of it.
        held: columns that are frozen, of which nothing else is told.
    """
    joints, series = list_joints(recording, model), build_series(recording)
    if series.kernel > MAX_KERNEL:
        reason = f"motion: samples are seen through {series.kernel:.3g} s, too coarsely"
        return Telemetry((), (reason,))
    check = JointCheck(recording, model, joints, series)
    rollouts = Rollouts(model, check.balance.states)
    setup = find_setup_faults(recording, check.balance)
    if any(KINDS[f.kind] for f in setup):  # forces tell nothing then
        return Telemetry((*setup, *check.find_faults()), ())
    odd = [f for f in check.odd if not {*held} & {*f.columns}]
    by_torques = not odd
    if not held and not check.is_late:
        odd = odd or find_unpowered(check.balance)
        odd = odd or find_odd(series, check.balance, rollouts)
    if odd:
        left_out = {k for f in odd for k in f.episodes}
        rest = {k: e for k, e in recording.episodes.items() if k not in left_out}
        others = _examine_motion(replace(recording, episodes=rest), model, held)
        if by_torques and (wrong := _widen_faults(others.faults, rest, recording)):
            return Telemetry(wrong, others.unchecked)
        return Telemetry((*odd, *others.faults), others.unchecked)
    faults = setup + _find_faults(recording, check, rollouts, held)
    # of a robot that something unknown drives, its torques tell nothing of columns
    told = [f for f in faults if f.basis != BASES["torque"]]
    if not check.is_late and not any(f.is_decisive for f in told):
        missing = [*find_missing_actuators(recording, check.balance, check.mend)]
        faults = [*told, *missing] if missing else faults
    reason = check.balance.reason
    said = (f"the balance of torques: {reason}",) if reason else ()
    return Telemetry(tuple(faults), said)


def _widen_faults(
    faults: Sequence[Fault], rest: Collection[str], recording: Recording
) -> tuple[Fault, ...]:
    """Faults of all but the odd episodes, as faults of all of them.

    Columns that are wrong everywhere leave the balance of torques, by which episodes
    are called odd, no meaning. Empty if no column is wrong.

    Args:
        faults: of the rest.
        rest: names of the other episodes.
        recording: whole.
    """
    if not any(f.is_decisive and f.kind in _WRONG for f in faults):
        return ()
    every = tuple(recording.episodes)
    return tuple(
        replace(f, episodes=every) if {*f.episodes} == {*rest} else f for f in faults
    )


def _find_faults(
    recording: Recording, check: JointCheck, rollouts: Rollouts, held: Collection[str]
) -> list[Fault]:
    """Faults of columns that kinematics, torques and simulations contradict.

    Args:
        recording: of the robot.
        check: of its joints.
        rollouts: from its states.
        held: columns that are frozen.
    """
    model, joints = check.balance.given, list(check.joints.values())
    series, balance = check.series, check.balance
    about_joints = check.find_faults()
    about_joints += check.search()
    bodies = BodyCheck(recording, model, series, balance, rollouts, check.mend)
    orders = bodies.find_orders()
    check.mend = check.mend.then(Mend(order={f.target: X_Y_Z_W for f in orders}))
    about_joints += check.search_rollouts(rollouts)
    about_joints = [f for f in about_joints if not {*held} & {*f.columns}]
    bodies.mend = check.mend
    faults = about_joints + orders + bodies.find_rates({f.target for f in orders})
    faults += find_torque_faults(recording, model, joints, series, balance, check.mend)
    odd = {c for f in about_joints for c in f.columns if f.kind != "delay"}
    beyond = find_beyond(recording, model, joints)
    return faults + [f for f in beyond if not odd & {*f.columns}]


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
