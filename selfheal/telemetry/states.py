"""States from columns: takes how they are to be read, gives positions and rates."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording, list_controls
from ..recording.data import Floats
from .joints import JointColumns, list_signals
from .series import Series

if TYPE_CHECKING:
    import mujoco

MAX_ROWS = 600  # that kinematics is evaluated in; chosen: tens of milliseconds
W_X_Y_Z = (0, 1, 2, 3)
X_Y_Z_W = (3, 0, 1, 2)  # places of w, x, y, z in a quaternion that ends in w


@dataclass(frozen=True)
class ColumnMap:
    """How columns are read otherwise than the log says.

    Attributes:
        positions: by joint: the joint whose column is its own, and a factor [1].
        commands: by name of a command's column: the same of it [1].
        order: by body: places of w, x, y, z in its quaternion.
    """

    positions: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    commands: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    order: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def __or__(self, other: "ColumnMap") -> "ColumnMap":
        """This map and another one, of other columns."""
        return ColumnMap(
            {**self.positions, **other.positions},
            {**self.commands, **other.commands},
            {**self.order, **other.order},
        )


class States:
    """The states of a robot, as far as a recording has them.

    Attributes:
        bases: names of the bodies with free joints whose pose is read, by the joint.
        poses: signals of place and turn of each of these bodies, by its name.
        reason: why the states are not known; "" where they are.
    """

    def __init__(
        self,
        recording: Recording,
        model: "mujoco.MjModel",
        joints: Mapping[str, JointColumns],
        series: Series,
    ) -> None:
        """Find the columns."""
        self.model, self.joints, self.series = model, joints, series
        self.bases, self.poses = dict[int, str](), dict[str, tuple[str, str]]()
        signals = list_signals(recording)
        for j in list_free_joints(model):
            body = model.body(model.jnt_bodyid[j]).name
            place = signals.get(("body_position", body))
            turn = signals.get(("body_orientation", body))
            if place and turn:
                self.bases[j], self.poses[body] = body, (place, turn)
        self.reason = self._explain_unknown()

    def _explain_unknown(self) -> str:
        import mujoco

        m = self.model
        if not m.nv:
            return "nothing of the model moves"
        if (m.jnt_type == mujoco.mjtJoint.mjJNT_BALL).any():
            return "the model has a ball joint, which no signal reads"
        for base in set(list_free_joints(m)) - set(self.bases):
            name = m.body(m.jnt_bodyid[base]).name
            advice = " ".join(correct_base(m, name))
            said = f"the pose of {name!r}, which has a free joint, is not read"
            return f"{said}: {advice}"
        if lost := [j.name for j in self.joints.values() if not j.position]:
            return f"the position of joint {lost[0]!r} is not read"
        return ""

    def find_known(self) -> np.ndarray:
        """(N) whether all positions, rates and accelerations are known in a row."""
        known = np.full(len(self.series.episode), not self.reason)
        if self.reason:
            return known
        names = [j.position for j in self.joints.values()]
        names += [n for pose in self.poses.values() for n in pose]
        for name in names:
            known &= np.isfinite(self.series.signals[name][:, :, 2]).all(axis=1)
        return known

    def choose_rows(self, known: np.ndarray | bool) -> np.ndarray:
        """Rows (n), evenly out of those where all and what else is needed is known."""
        return thin(np.flatnonzero(known & self.find_known()), MAX_ROWS)

    def compute(
        self, column_map: ColumnMap, rows: np.ndarray
    ) -> tuple[Floats, Floats, Floats]:
        """Positions (n, nq), velocities (n, nv), accelerations (n, nv)."""
        m = self.model
        q = np.tile(m.qpos0, (len(rows), 1))
        v, a = np.zeros((len(rows), m.nv)), np.zeros((len(rows), m.nv))
        for j in self.joints.values():
            source, factor = column_map.positions.get(j.name, (j.name, 1.0))
            column = self.series.signals[self.joints[source].position][rows, 0] * factor
            at, to = m.jnt_qposadr[j.number], m.jnt_dofadr[j.number]
            q[:, at], v[:, to], a[:, to] = column.T
        for base, body in self.bases.items():
            at, to = m.jnt_qposadr[base], m.jnt_dofadr[base]
            place, turn = (self.series.signals[n][rows] for n in self.poses[body])
            three, later = slice(to, to + 3), slice(to + 3, to + 6)
            q[:, at : at + 3], v[:, three], a[:, three] = np.moveaxis(place, 2, 0)
            turn = turn[:, list(column_map.order.get(body, W_X_Y_Z))]
            q[:, at + 3 : at + 7], v[:, later], a[:, later] = compute_rates(turn)
        return q, v, a

    def compute_commands(self, column_map: ColumnMap, rows: np.ndarray) -> Floats:
        """Commands (n, nu, 3): values, slopes [1/s], curvatures [1/s^2]."""
        names = [control.full_name for control in list_controls(self.model)]
        out = np.zeros((len(rows), len(names), 3))
        for k, name in enumerate(names):
            source, factor = column_map.commands.get(name, (name, 1.0))
            out[:, k] = self.series.ctrl[source][rows] * factor
        return out

    def list_positions(self, qpos: Floats) -> Floats:
        """Hinges and slides (n, nv) of qpos (n, nq), 0 for free joints [rad or m]."""
        m, out = self.model, np.zeros((len(qpos), self.model.nv))
        for j in self.joints.values():
            out[:, m.jnt_dofadr[j.number]] = qpos[:, m.jnt_qposadr[j.number]]
        return out


def thin(rows: np.ndarray, most: int) -> np.ndarray:
    """Rows (n), evenly chosen so that they are `most` at most."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).astype(int)]


def compute_rates(turns: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit quaternions (n, 4), rates and accelerations (n, 3) in the body's frame.

    With q' = q w / 2, w = 2 conj(q) q'; the rest of its derivative has no vector part.
    `turns` (n, 4, 3) are the quaternion, its slope and curvature.
    """
    size = np.linalg.norm(turns[..., 0], axis=1)[:, None, None]
    q, dq, ddq = np.moveaxis(turns / np.maximum(size, 1e-9), 2, 0)
    return q, 2 * _conjugate_product(q, dq), 2 * _conjugate_product(q, ddq)


def _conjugate_product(a: Floats, b: Floats) -> Floats:
    """Vector part (n, 3) of conj(a) b, for quaternions (n, 4)."""
    return a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])


def list_free_joints(model: "mujoco.MjModel") -> list[int]:
    """Numbers of the free joints."""
    import mujoco

    return np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).tolist()


def correct_base(model: "mujoco.MjModel", body: str) -> tuple[str, str]:
    """What to do about a body with a free joint whose pose nothing reads."""
    drives = "" if model.nu else "--kp KP "
    return (
        f"leave out the free joint of {body}, if the robot is suspended or bolted down "
        f"(selfheal model prepare ROBOT.xml {drives}--weld-base --out m.xml),",
        'or log its pose: [[signals]] kind = "body_position" and "body_orientation", '
        f'targets = ["{body}"]',
    )


def name_body(model: "mujoco.MjModel", body: int) -> str:
    """Name of a body by its number, or words for one without."""
    return model.body(body).name or f"number {body}, which has no name"
