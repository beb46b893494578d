"""Motion of an unread base: takes an IMU and joint positions, gives poses and speeds.

A walking robot's gyroscope and accelerometer tell its tilt. Its feet tell the rest: its
lowest points are on the ground, and what is on the ground stands still. That is leg
odometry (Bloesch et al. 2012, Robotics: Science and Systems). Where on a level ground
it is, and where it heads for, change nothing, and are 0 where an episode begins.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...recording.data import Floats
from .robot_summary import Channel

if TYPE_CHECKING:
    from mujoco import MjModel
    from scipy.spatial.transform import Rotation

GYROSCOPE, ACCELEROMETER = 3, 1  # mjtSensor
TILT_SECONDS = 1.0  # [s] of a tilt's estimate; chosen: a gyroscope hardly drifts
# [rad], [m], [m/s] standard errors of these estimates; chosen: what walking leaves
TILT_STD, HEIGHT_STD, SPEED_STD = 0.01, 0.002, 0.05
PLACE_STD = 1e-6  # [m or rad] of place and heading; chosen: they change nothing
MIN_SAMPLES = 3  # of which a slope can be had; chosen: the fewest
ORIENTATION_ITERATIONS = 2  # velocities change orientations by little; chosen
DEPTH_MOMENTS, MAX_DEPTH = (
    9,
    0.05,
)  # of depths of contacts, [m]; chosen
STANCE_HEIGHT = 0.01  # [m] above the lowest point of what stands; chosen: tilt's error
# of its weight, what carries a robot that touches the ground at least; chosen
MIN_SUPPORT_SHARE = 0.5
SUPPORT_SECONDS = 0.1  # [s] over which that is averaged; chosen: impacts are shorter
GROUND_MARGIN = 100.0  # [m] in which distances from the ground are found; chosen: any
MAX_SLOPE = 1e-3  # [rad] of a level ground; chosen: below the tilt's error


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Motion of a floating base at the T samples of an episode.

    Attributes:
        joint: number of the free joint.
        qpos: (T, 7) position [m] and quaternion; NaN where nothing carries the robot.
        qvel: (T, 6) velocity [m/s] and, in the base's frame, angular velocity [rad/s].
        std: (12) standard errors of position, turn and their rates.
    """

    joint: int
    qpos: Floats
    qvel: Floats
    std: Floats

    def fill_in(
        self, model: "MjModel", rows: Floats, qpos: Floats, qvel: Floats, std: Floats
    ) -> None:
        """Fill in what no sensor read of W states, in place.

        Args:
            rows: (W) sample of each, with fractions.
            qpos: (W, nq); NaN where nothing was read.
            qvel: (W, nv) likewise.
            std: (W, 2 nv) standard errors likewise.
        """
        q, v = int(model.jnt_qposadr[self.joint]), int(model.jnt_dofadr[self.joint])
        samples = np.arange(len(self.qpos))
        for states, first, known in (qpos, q, self.qpos), (qvel, v, self.qvel):
            for k, values in enumerate(known.T, first):
                estimate = np.interp(rows, samples, values)
                column = states[:, k]
                states[:, k] = np.where(np.isfinite(column), column, estimate)
        turn = qpos[:, q + 3 : q + 7]
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        for first, errors in (v, self.std[:6]), (model.nv + v, self.std[6:]):
            part = std[:, first : first + 6]
            part[:] = np.where(np.isfinite(part), part, errors)


def estimate_base_motion(
    model: "MjModel",
    channels: Sequence[Channel],
    readings: Floats,
    qpos: Floats,
    qvel: Floats,
    time: Floats,
) -> BaseMotion | None:
    """Estimate how the one floating base moved whose position no sensor reads.

    Args:
        readings: (T, C) of all channels.
        qpos: (T, nq) as read; NaN where nothing was.
        qvel: (T, nv) likewise.
        time: (T) [s].

    Returns:
        None, where a joint beside the base was not read, or the base's position was;
        where the ground is not level; or without an IMU and an orientation.
    """
    joints = np.flatnonzero(model.jnt_type == 0)  # mjtJoint: free
    if len(joints) != 1 or len(time) < MIN_SAMPLES or not _is_ground_level(model):
        return None
    joint = int(joints[0])
    q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    place, turn = slice(q, q + 3), slice(q + 3, q + 7)
    is_read = np.array(np.isfinite(qpos).all(axis=0))
    if is_read[place].any() or not np.delete(is_read, np.r_[q : q + 7]).all():
        return None
    (rate, rate_noise), (force, _) = (
        _read_in_base(model, joint, kind, channels, readings, time)
        for kind in (GYROSCOPE, ACCELEROMETER)
    )
    if np.isfinite(qvel[:, v + 3 : v + 6]).all():
        rate = qvel[:, v + 3 : v + 6]
    odometry = _LegOdometry(model, joint)
    if rate is None or not odometry.can_stand:
        return None
    qpos, qvel = qpos.copy(), np.nan_to_num(qvel)
    qpos[:, place], qvel[:, v + 3 : v + 6] = 0.0, rate
    if is_read[turn].all():
        odometry.apply(qpos, qvel)
    elif force is None:
        return None
    else:
        turned, velocity = integrate_turns(rate, time), np.zeros_like(rate)
        for _ in range(ORIENTATION_ITERATIONS):
            orientation = find_orientation(turned, force, velocity, time)
            qpos[:, turn] = orientation.as_quat(scalar_first=True)
            odometry.apply(qpos, qvel)
            velocity = orientation.inv().apply(qvel[:, v : v + 3])
    if force is not None:
        qpos[~_is_carried(model, force, time), q] = np.nan
    pose = [PLACE_STD, PLACE_STD, HEIGHT_STD, TILT_STD, TILT_STD, PLACE_STD]
    std = np.r_[pose, np.full(3, SPEED_STD), rate_noise]
    return BaseMotion(joint, qpos[:, q : q + 7], qvel[:, v : v + 6], std)


def _is_carried(model: "MjModel", force: Floats, time: Floats) -> np.ndarray:
    """(T) whether the ground carries a robot, by specific forces (T, 3) [m/s^2]."""
    from scipy.ndimage import uniform_filter1d

    samples = max(1, round(SUPPORT_SECONDS / np.median(np.diff(time))))
    measured = uniform_filter1d(np.linalg.norm(force, axis=1), samples)
    weight = np.linalg.norm(model.opt.gravity)
    return np.array(measured > MIN_SUPPORT_SHARE * weight)


def _is_ground_level(model: "MjModel") -> bool:
    """Whether all that does not move is a plane at right angles to gravity and z."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    is_solid = (model.geom_contype | model.geom_conaffinity) > 0
    ground = np.flatnonzero((model.body_weldid[model.geom_bodyid] == 0) & is_solid)
    tilt = data.geom_xmat[ground].reshape(-1, 3, 3)[:, :2, 2]
    *across, down = model.opt.gravity
    if not len(ground) or (model.geom_type[ground] != 0).any() or down >= 0:  # mjtGeom
        return False
    return bool(np.abs([*tilt.ravel(), *np.divide(across, down)]).max() < MAX_SLOPE)


def _read_in_base(
    model: "MjModel",
    joint: int,
    kind: int,
    channels: Sequence[Channel],
    readings: Floats,
    time: Floats,
) -> tuple[Floats | None, Floats]:
    """Readings (T, 3) of an IMU's sensor in the base's frame, and their noise (3).

    What is missing lies between its neighbors: other signals may have other times.

    Args:
        readings: (T, C) of all of them.
        time: (T) [s].

    Returns:
        None and 0, where the base has none.
    """
    import mujoco

    data, base = mujoco.MjData(model), int(model.jnt_bodyid[joint])
    mujoco.mj_kinematics(model, data)
    for c in channels:
        if c.kind != "sensor" or model.sensor(c.target).type[0] != kind:
            continue
        site = int(model.sensor(c.target).objid[0])
        if model.body_weldid[model.site_bodyid[site]] == base:
            turn = data.xmat[base].reshape(3, 3).T @ data.site_xmat[site].reshape(3, 3)
            read = readings[:, c.columns]
            known = np.isfinite(read).all(axis=1)
            if known.sum() >= MIN_SAMPLES:
                values = [np.interp(time, time[known], x[known]) for x in read.T]
                noise = np.sqrt(turn**2 @ np.nan_to_num(c.noise) ** 2)
                return np.array(values).T @ turn.T, noise
    return None, np.zeros(3)


def integrate_turns(rate: Floats, time: Floats) -> "Rotation":
    """Rotations (T) from each moment's frame to the first one's.

    Args:
        rate: (T, 3) angular velocity in the moving frame [rad/s].
        time: (T) [s].
    """
    from scipy.spatial.transform import Rotation

    mean = (rate[1:] + rate[:-1]) / 2
    turned = [Rotation.identity()]
    for turn in Rotation.from_rotvec(mean * np.diff(time)[:, None]):
        turned.append(turned[-1] * turn)
    return Rotation.concatenate(turned)


def find_orientation(
    turned: "Rotation", force: Floats, velocity: Floats, time: Floats
) -> "Rotation":
    """Rotations (T) of an IMU from its turns, its specific force and its velocity.

    In the frame that the turns give, what force adds beyond the velocity is weight:

        integral of f dt - v = up g t + constant

    Its slope tells how far the frame has drifted from the vertical.

    Args:
        turned: rotations (T) of `integrate_turns`.
        force: (T, 3) specific force in the IMU's frame [m/s^2].
        velocity: (T, 3) likewise [m/s].
        time: (T) [s].
    """
    from scipy.integrate import cumulative_trapezoid
    from scipy.signal import savgol_filter
    from scipy.spatial.transform import Rotation

    gained = cumulative_trapezoid(turned.apply(force), time, axis=0, initial=0.0)
    samples = min(len(time), max(3, round(TILT_SECONDS / np.median(np.diff(time)))))
    up = savgol_filter(gained - turned.apply(velocity), samples, 1, deriv=1, axis=0)
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-300)
    # the shortest turn that makes it vertical
    axis = np.cross(up, [0.0, 0.0, 1.0])
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(size, up[:, 2:])
    return Rotation.from_rotvec(angle * axis / np.maximum(size, 1e-300)) * turned


class _LegOdometry:
    """Height and velocity of a base whose lowest points stand on the ground."""

    def __init__(self, model: "MjModel", joint: int) -> None:
        """`model`: compiled; `joint`: its floating base's."""
        import mujoco

        self._given, self._model = model, copy(model)
        is_ground = model.body_weldid[model.geom_bodyid] == 0
        self._model.geom_margin[is_ground] = GROUND_MARGIN
        self._data = mujoco.MjData(self._model)
        self._first = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])

    @property
    def can_stand(self) -> bool:
        """Whether any part of the robot touches the ground, and does not pass it."""
        return bool(len(self._reach_ground(self._given.qpos0)))

    def _reach_ground(self, qpos: Floats) -> np.ndarray:
        """Numbers of the distances to the ground, in a state with the base at 0."""
        import mujoco

        model, data = self._model, self._data
        data.qpos[:] = qpos
        data.qpos[self._first[0] + 2] = 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        bodies = model.geom_bodyid[data.contact.geom].reshape(-1, 2)
        return np.flatnonzero((model.body_weldid[bodies] == 0).any(axis=1))

    def apply(self, qpos: Floats, qvel: Floats) -> None:
        """Set the base's heights and velocities, in place.

        Args:
            qpos: (T, nq).
            qvel: (T, nv).
        """
        q, v = self._first
        for i in range(len(qpos)):
            qpos[i, q + 2], qvel[i, v : v + 3] = self._stand(qpos[i], qvel[i])
        some = np.linspace(0, len(qpos) - 1, DEPTH_MOMENTS).astype(int)
        qpos[:, q + 2] -= np.median([self._find_depth(qpos[i]) for i in some])

    def _stand(self, qpos: Floats, qvel: Floats) -> tuple[float, Floats]:
        """Height [m] and velocity (3) [m/s] of the base.

        Args:
            qpos: (nq) all else of the state.
            qvel: (nv) likewise.
        """
        import mujoco

        model, data, (_, v) = self._model, self._data, self._first
        near = self._reach_ground(qpos)
        contact, still = data.contact, qvel.copy()
        still[v : v + 3] = 0.0
        lowest = contact.dist[near].min()
        speeds, jacobian = [], np.empty((3, model.nv))
        for k in near[contact.dist[near] < lowest + STANCE_HEIGHT]:
            foot = int(model.geom_bodyid[contact.geom[k, 1]])  # a plane is first
            point = contact.pos[k] + contact.frame[k, :3] * contact.dist[k] / 2
            mujoco.mj_jac(model, data, jacobian, None, point, foot)
            speeds.append(jacobian @ still)
        return -float(lowest), -np.mean(speeds, axis=0)

    def _find_depth(self, qpos: Floats) -> float:
        """How deep soft contacts let the robot sink under its weight [m].

        `qpos`: (nq) in which its lowest point just touches the ground.
        """
        import mujoco
        from scipy.optimize import brentq

        data, (q, v) = self._data, self._first

        def find_force(depth: float) -> float:
            """Force that has to hold the robot at rest there [N]."""
            data.qpos[:], data.qvel[:], data.qacc[:] = qpos, 0.0, 0.0
            data.qpos[q + 2] -= depth
            mujoco.mj_inverse(self._given, data)
            return float(data.qfrc_inverse[v + 2])

        if find_force(0.0) <= 0 or find_force(MAX_DEPTH) >= 0:
            return 0.0
        return float(brentq(find_force, 0.0, MAX_DEPTH, xtol=1e-5))
