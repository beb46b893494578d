"""The telemetry check: a recording and its model in, the faults of the log out."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..recording import Recording, reorder_commands
from .bodies import BodyCheck
from .columns import find_held
from .fault import Fault
from .joint_faults import JointCheck
from .joints import list_joints
from .ranges import find_beyond
from .rollouts import Rollouts
from .series import build_series
from .stale import find_stale
from .states import X_Y_Z_W, Mend
from .timing import find_time_faults
from .torques import find_torque_faults

if TYPE_CHECKING:
    import mujoco

# [s] over which samples are smoothed; chosen: beyond, a joint's speed is not seen
MAX_KERNEL = 2.0


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
    joints = list_joints(recording, model)
    commands = {column: j.commands for j in joints for column in j.columns}
    goals = {column: j.servo.command for j in joints if j.servo for column in j.columns}
    faults = [
        *find_time_faults(recording),
        *find_held(recording, commands),
        *find_stale(recording, goals),
    ]
    held = {c for f in faults if f.kind == "frozen" for c in f.columns}
    series = build_series(recording)
    if series.kernel > MAX_KERNEL:
        reason = f"motion: samples are seen through {series.kernel:.3g} s, too coarsely"
        return Telemetry(tuple(faults), (*unchecked, reason))
    check = JointCheck(recording, model, joints, series)
    rollouts = Rollouts(model, check.balance.states)
    about_joints = check.find_faults()
    about_joints += check.search()
    bodies = BodyCheck(recording, model, series, check.balance, rollouts, check.mend)
    orders = bodies.find_orders()
    check.mend = check.mend.then(Mend(order={f.target: X_Y_Z_W for f in orders}))
    about_joints += check.search_rollouts(rollouts)
    about_joints = [f for f in about_joints if not held & set(f.columns)]
    bodies.mend = check.mend
    faults += about_joints + orders + bodies.find_rates({f.target for f in orders})
    faults += find_torque_faults(
        recording, model, joints, series, check.balance, check.mend
    )
    odd = {c for f in about_joints for c in f.columns if f.kind != "delay"}
    faults += [
        f for f in find_beyond(recording, model, joints) if not odd & set(f.columns)
    ]
    if check.balance.reason:
        unchecked.append(f"the balance of torques: {check.balance.reason}")
    return Telemetry(tuple(faults), tuple(unchecked))


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
