"""Faults of the set-up: takes a recording, finds in what its model is another robot."""

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..logs.model_facts import format_servo
from ..recording import NO_ACTUATORS, Recording, find_joint
from ..recording.data import Floats
from .balance import TorqueBalance
from .fault import Fault, ModelCorrection, format_columns
from .joint_faults import MAX_LEFT
from .joints import follows_command
from .pairs import FAR_BETTER, UNIT_RATIO, correlation_p_value, relate
from .states import Mend, States, correct_base, free_joint_type

if TYPE_CHECKING:
    import mujoco

SEARCHED_LAG = 0.6  # [s] of a joint behind its goal; chosen: as of a servo's command
# of the energy that a motion turns over, what drives it gives; chosen: half of it is
# given by motors that lift and lower, nothing by friction
GIVEN_SHARE = 0.25
MAX_POSES = 200  # in which contacts are sought; chosen: tens of milliseconds
MOVED = 0.1  # [rad or m] of a joint between two bodies; chosen: parts a touch
INDEPENDENT_SECONDS = 0.1  # from one independent row to the next; chosen
COUNTED = "counted, not estimated"
FOLLOWED = "correlation of the joint with its command, Fisher's z"


def find_setup_faults(recording: Recording, balance: TorqueBalance) -> list[Fault]:
    """What a model has other than the robot that was recorded.

    Args:
        recording: of the robot.
        balance: of its torques by the model.
    """
    model, states = balance.given, balance.states
    return [
        *_find_free_bases(recording, model, states.bases),
        *_find_motors_sent_goals(recording, balance),
        *_find_permanent_contacts(recording, model, states),
    ]


def _find_free_bases(
    recording: Recording, model: "mujoco.MjModel", read: Collection[int]
) -> Iterator[Fault]:
    """Floating bodies with joints that nothing reads and nothing in the model carries.

    Args:
        recording: of the robot.
        model: of it.
        read: numbers of the free joints whose pose is read.
    """
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    if (solid & (model.body_weldid[model.geom_bodyid] == 0)).any():
        return
    for j in np.flatnonzero(model.jnt_type == free_joint_type()):
        base = model.jnt_bodyid[j]
        if j not in read and (model.body_rootid[model.jnt_bodyid] == base).sum() > 1:
            name = _name_body(model, base)
            yield Fault(
                "free_base", tuple(recording.episodes), (), name,
                f"body {name!r} has a free joint and no ground below it, and no signal "
                "tells its pose: in the model it falls",
                0.0, COUNTED,
                correct_base(model, name),
            )  # fmt: skip


def find_missing_actuators(
    recording: Recording, balance: TorqueBalance, mend: Mend
) -> Iterator[Fault]:
    """A model without actuators of a robot that something drives.

    The energy of what nothing drives only decreases, whatever the friction.

    Args:
        recording: of the robot.
        balance: of its torques.
        mend: of the columns, by which the log is right otherwise.
    """
    if balance.given.nactuator or balance.reason:
        return
    parts = balance.compute_torques(mend, balance.rows)
    given = np.maximum((parts["all"] * parts["v"]).sum(axis=1), 0).sum()
    turned = np.abs(parts["hold"] * parts["v"]) + np.abs(parts["own"] * parts["v"])
    share = float(given / max(turned.sum(), 1e-12))
    if share > GIVEN_SHARE:
        yield Fault(
            "no_actuator", tuple(recording.episodes), (), "",
            "the model has no actuators, but something drives the robot: it gives "
            f"{share:.0%} of the energy that the motion turns over",
            0.0, COUNTED, (NO_ACTUATORS,),
        )  # fmt: skip


def _find_motors_sent_goals(
    recording: Recording, balance: TorqueBalance
) -> Iterator[Fault]:
    """Motors whose commands explain the positions far better than the torques.

    A torque that holds a joint against its weight moves as the joint does, too; but
    then it balances the motion.
    """
    model, series = balance.given, balance.series
    lags = range(round(SEARCHED_LAG / series.step) + 1)
    left = {} if balance.reason else _list_unbalanced(balance)
    for a in range(model.nactuator):
        joint = balance.states.joints.get(_name_joint(model, find_joint(model, a)))
        if not joint or not joint.position or not _is_motor(model, a):
            continue
        (command,) = joint.commands if len(joint.commands) == 1 else ("",)
        if not command:
            continue
        goal = series.ctrl[command][:, 0]
        position = series.signals[joint.position][:, 0, 0]
        relation = relate(goal, position, series.episode, lags)
        is_goal = relation.is_same and 1 / UNIT_RATIO < relation.ratio < UNIT_RATIO
        unexplained = left.get(joint.name, MAX_LEFT)  # at least, where it is not known
        if not is_goal or 1 - relation.r**2 > FAR_BETTER * unexplained:
            continue
        independent = INDEPENDENT_SECONDS / series.step
        yield Fault(
            "actuator_type", tuple(recording.episodes), (command,), joint.name,
            f"the command of {format_columns([command])} is a goal of the position: "
            f"joint {joint.name!r} follows it (correlation {relation.r:.3f}), and the "
            "model's actuator is a motor, which takes a torque",
            correlation_p_value(relation.r, relation.rows, independent), FOLLOWED,
            (ModelCorrection(format_servo(model, command)),
             "in the motor's place, with the drive's gains for KP and KV, as selfheal "
             "model prepare ROBOT.xml --kp KP --kv KV --out m.xml writes it; or log "
             "the torques as commands"),
        )  # fmt: skip


def _list_unbalanced(balance: TorqueBalance) -> Mapping[str, float]:
    """Share of the torques of each joint that the log as it is does not explain."""
    model, found = balance.given, balance.evaluate(Mend())
    share = dict(zip(balance.dofs.tolist(), found.unexplained.tolist(), strict=True))
    joints = balance.states.joints.values()
    return {
        j.name: share[dof]
        for j in joints
        if (dof := int(model.jnt_dofadr[j.number])) in share
    }


def _is_motor(model: "mujoco.MjModel", actuator: int) -> bool:
    """Whether an actuator's force is its command times a gain, but for a lag."""
    import mujoco

    fixed = model.actuator_gaintype[actuator] == int(mujoco.mjtGain.mjGAIN_FIXED)
    plain = model.actuator_biastype[actuator] == int(mujoco.mjtBias.mjBIAS_NONE)
    return bool(fixed and plain and follows_command(model, actuator))


def _find_permanent_contacts(
    recording: Recording, model: "mujoco.MjModel", states: States
) -> Iterator[Fault]:
    """Bodies of one chain of joints that touch in every pose, however these move.

    MuJoCo lets a body pass its parent, but not where the parent is fixed to the world.
    """
    read = {n: j for n, j in states.joints.items() if j.position}
    columns = {n: states.series.signals[j.position][:, 0, 0] for n, j in read.items()}
    known = np.ones(len(states.series.episode), bool)
    for column in columns.values():
        known &= np.isfinite(column)
    rows = np.flatnonzero(known)
    if not columns or not len(rows):
        return
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, MAX_POSES).astype(int))]
    poses = np.tile(model.qpos0, (len(rows), 1))
    for name, joint in read.items():
        poses[:, model.jnt_qposadr[joint.number]] = columns[name][rows]
    moved = {j.number for n, j in read.items() if np.ptp(columns[n][rows]) > MOVED}
    for pair in sorted(_touch_always(model, poses)):
        between = _list_joints_between(model, *pair)
        if moved & between and between <= {j.number for j in read.values()}:
            one, other = (_name_body(model, b) for b in pair)
            yield Fault(
                "permanent_contact", tuple(recording.episodes), (), other,
                f"in the model bodies {one!r} and {other!r} touch in every pose of the "
                "log: if the real ones do not, their friction and push are wrong",
                0.0, COUNTED,
                (ModelCorrection(f'<exclude body1="{one}" body2="{other}"/>'),),
            )  # fmt: skip


def _touch_always(model: "mujoco.MjModel", poses: Floats) -> set[tuple[int, int]]:
    """Numbers of the bodies that penetrate each other in all of some poses (n, nq).

    Grounds do not count: what rolls on one touches it always.
    """
    import mujoco

    data, found = mujoco.MjData(model), None
    grounds = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        geoms = data.contact.geom[data.contact.dist < 0]
        geoms = geoms[~np.isin(model.geom_type[geoms], grounds).any(axis=1)]
        pairs = {(int(a), int(b)) for a, b in np.sort(model.geom_bodyid[geoms], axis=1)}
        found = pairs if found is None else found & pairs
        if not found:
            break
    return found or set()


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


def _name_joint(model: "mujoco.MjModel", joint: int) -> str:
    return model.joint(joint).name if joint >= 0 else ""


def _name_body(model: "mujoco.MjModel", body: int) -> str:
    return model.body(body).name or f"number {body}, which has no name"
