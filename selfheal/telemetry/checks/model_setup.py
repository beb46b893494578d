"""Faults of the set-up: what a model has other than the robot that was recorded."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...logs.model_facts import format_servo
from ...recording import find_joint
from ..balance import BALANCED
from ..contacts import find_touching_bodies
from ..context import Context
from ..fault import Fault, ModelCorrection, format_columns
from ..joints import follows_command
from ..relations import FAR_BETTER, UNIT_RATIO, correlation_p_value, relate
from ..states import ColumnMap, correct_base, list_free_joints, name_body, thin

if TYPE_CHECKING:
    import mujoco

SEARCHED_LAG = 0.6  # [s] of a joint behind its goal; chosen: as of a servo's command
MAX_POSES = 200  # in which contacts are sought; chosen: tens of milliseconds
MOVED = 0.1  # [rad or m] of a joint between two bodies; chosen: parts a touch
INDEPENDENT_SECONDS = 0.1  # from one independent row to the next; chosen
FOLLOWED = "correlation of the joint with its command, Fisher's z"


def find(context: Context) -> Iterator[Fault]:
    """Free bases, motors that are sent goals, and bodies that always touch."""
    yield from _find_free_bases(context)
    for actuator in range(context.model.nactuator):
        yield from _check_motor(context, actuator)
    yield from _find_permanent_contacts(context)


def _find_free_bases(context: Context) -> Iterator[Fault]:
    """Bodies with joints that nothing reads and nothing in the model carries."""
    model = context.model
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    if (solid & (model.body_weldid[model.geom_bodyid] == 0)).any():
        return
    for j in list_free_joints(model):
        base = model.jnt_bodyid[j]
        joints = (model.body_rootid[model.jnt_bodyid] == base).sum()
        if j not in context.states.bases and joints > 1:
            name = name_body(model, base)
            seen = (
                f"body {name!r} has a free joint and no ground below it, and no signal "
                "reads its pose: in the model it falls"
            )
            said = context.episodes, (), name, seen
            yield Fault("free_base", *said, corrections=correct_base(model, name))


def _check_motor(context: Context, actuator: int) -> Iterator[Fault]:
    """A motor whose command explains the position far better than the torque.

    A torque that holds a joint against its weight moves as the joint does, too; but
    then it balances the motion.
    """
    model, series = context.model, context.series
    number = find_joint(model, actuator)
    joint = context.joints.get(model.joint(number).name) if number >= 0 else None
    if not joint or not joint.position or not _is_motor(model, actuator):
        return
    if len(joint.commands) != 1:
        return
    (command,) = joint.commands
    sent, read = series.ctrl[command], series.signals[joint.position][:, 0]
    lags = range(series.count_rows(SEARCHED_LAG) + 1)
    relation = relate(sent[:, 0], read[:, 0], series.episode, lags)
    is_goal = relation.is_same and 1 / UNIT_RATIO < relation.ratio < UNIT_RATIO
    unexplained = context.balance.measure_share(ColumnMap(), joint.name)
    if unexplained is None:
        unexplained = BALANCED  # at least
    if not is_goal or 1 - relation.r**2 > FAR_BETTER * unexplained:
        return
    seen = (
        f"the command of {format_columns([command])} is a goal of the position: "
        f"joint {joint.name!r} follows it (correlation {relation.r:.3f}), and the "
        "model's actuator is a motor, which takes a torque"
    )
    p = correlation_p_value(relation, INDEPENDENT_SECONDS / series.step)
    advice = (
        "in the motor's place, with the drive's gains for KP and KV, as selfheal "
        "model prepare ROBOT.xml --kp KP --kv KV --out m.xml writes it; or log "
        "the torques as commands"
    )
    corrections = ModelCorrection(format_servo(model, command)), advice
    where = context.episodes, (command,), joint.name
    yield Fault("actuator_type", *where, seen, p, FOLLOWED, corrections)


def _is_motor(model: "mujoco.MjModel", actuator: int) -> bool:
    """Whether an actuator's force is its command times a gain, but for a lag."""
    import mujoco

    fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    unbiased = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    return bool(fixed and unbiased and follows_command(model, actuator))


def _find_permanent_contacts(context: Context) -> Iterator[Fault]:
    """Bodies of one chain of joints that touch in every pose, however these move.

    MuJoCo lets a body pass its parent, but not where the parent is fixed to the world.
    Grounds do not count: what rolls on one touches it always.
    """
    import mujoco

    model, series = context.model, context.series
    read = {n: j for n, j in context.joints.items() if j.position}
    columns = {n: series.signals[j.position][:, 0, 0] for n, j in read.items()}
    if not columns:
        return
    known = np.isfinite([*columns.values()]).all(axis=0)
    if not known.any():
        return
    rows = thin(np.flatnonzero(known), MAX_POSES)
    poses = np.tile(model.qpos0, (len(rows), 1))
    for name, joint in read.items():
        poses[:, model.jnt_qposadr[joint.number]] = columns[name][rows]
    grounds = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    moved = {j.number for n, j in read.items() if np.ptp(columns[n][rows]) > MOVED}
    for pair in sorted(find_touching_bodies(model, poses, grounds)):
        between = _list_joints_between(model, *pair)
        if moved & between and between <= {j.number for j in read.values()}:
            one, other = (name_body(model, b) for b in pair)
            seen = (
                f"in the model bodies {one!r} and {other!r} touch in every pose of the "
                "log: if the real ones do not, their friction and push are wrong"
            )
            apart = ModelCorrection(f'<exclude body1="{one}" body2="{other}"/>')
            said = context.episodes, (), other, seen
            yield Fault("permanent_contact", *said, corrections=(apart,))


def _list_joints_between(model: "mujoco.MjModel", one: int, other: int) -> set[int]:
    """Joints between two bodies of which one carries the other; none: neither does."""
    for carried, carrier in ((other, one), (one, other)):
        body, joints = int(model.body_weldid[carried]), set[int]()
        while body:
            first = int(model.body_jntadr[body])
            joints |= set(range(first, first + int(model.body_jntnum[body])))
            body = int(model.body_weldid[model.body_parentid[body]])
            if body == model.body_weldid[carrier]:
                return joints
    return set()
