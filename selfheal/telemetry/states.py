"""States from columns: takes a mend of the columns, gives positions and their rates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording
from ..recording.data import Floats
from .joints import JointColumns
from .series import Series

if TYPE_CHECKING:
    import mujoco

IDENTITY = (0, 1, 2, 3)
X_Y_Z_W = (3, 0, 1, 2)  # places of w, x, y, z in a quaternion that ends in w


@dataclass(frozen=True)
class Mend:
    """How columns are read otherwise than the log says.

    Attributes:
        positions: by joint: the joint whose column is its own, and a factor [1].
        commands: by name of a command's column: the same of it [1].
        order: by body: places of w, x, y, z in its quaternion.
    """

    positions: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    commands: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    order: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def then(self, other: "Mend") -> "Mend":
        """This mend and another one, of other columns."""
        return Mend(
            {**self.positions, **other.positions},
            {**self.commands, **other.commands},
            {**self.order, **other.order},
        )


class States:
    """The states of a robot, as far as a recording tells them.

    Attributes:
        reason: why they are not known; "" where they are.
        model: of the robot.
        joints: by name.
        series: of the recording.
        bases: signals of place and turn of each free joint's body, by its number.
    """

    def __init__(
        self,
        recording: Recording,
        model: "mujoco.MjModel",
        joints: Sequence[JointColumns],
        series: Series,
    ) -> None:
        """Find the columns.

        Args:
            recording: of the robot.
            model: of it.
            joints: with their columns.
            series: of the recording.
        """
        self.model, self.series = model, series
        self.joints = {j.name: j for j in joints}
        self.bases = _find_bases(recording, model)
        self.reason = self._explain_unknown()

    def _explain_unknown(self) -> str:
        import mujoco

        m = self.model
        ball = int(mujoco.mjtJoint.mjJNT_BALL)
        if not m.nv:
            return "nothing of the model moves"
        if (m.jnt_type == ball).any():
            return "the model has a ball joint, which no signal reads"
        free = np.flatnonzero(m.jnt_type == free_joint_type())
        for base in set(free.tolist()) - set(self.bases):
            name = m.body(m.jnt_bodyid[base]).name
            said = " ".join(correct_base(m, name))
            return f"the pose of {name!r}, which has a free joint, is not read: {said}"
        if lost := [j.name for j in self.joints.values() if not j.position]:
            return f"the position of joint {lost[0]!r} is not read"
        return ""

    def find_known(self) -> np.ndarray:
        """(N) whether all positions, rates and accelerations are known in a row."""
        known = np.full(len(self.series.episode), not self.reason)
        if self.reason:
            return known
        read = [self.series.signals[j.position] for j in self.joints.values()]
        read += [self.series.signals[n] for pose in self.bases.values() for n in pose]
        for columns in read:
            known &= np.isfinite(columns[:, :, 2]).all(axis=1)
        return known

    def compute(self, mend: Mend, rows: np.ndarray) -> tuple[Floats, Floats, Floats]:
        """Positions (n, nq), velocities (n, nv), accelerations (n, nv)."""
        m = self.model
        q = np.tile(m.qpos0, (len(rows), 1))
        v, a = np.zeros((len(rows), m.nv)), np.zeros((len(rows), m.nv))
        for j in self.joints.values():
            source, factor = mend.positions.get(j.name, (j.name, 1.0))
            column = self.series.signals[self.joints[source].position][rows, 0] * factor
            q[:, m.jnt_qposadr[j.number]] = column[:, 0]
            v[:, m.jnt_dofadr[j.number]] = column[:, 1]
            a[:, m.jnt_dofadr[j.number]] = column[:, 2]
        for base, (place, turn) in self.bases.items():
            at, to = m.jnt_qposadr[base], m.jnt_dofadr[base]
            body = m.body(m.jnt_bodyid[base]).name
            order = list(mend.order.get(body, IDENTITY))
            p = self.series.signals[place][rows]
            q[:, at : at + 3], v[:, to : to + 3] = p[..., 0], p[..., 1]
            a[:, to : to + 3] = p[..., 2]
            turns = self.series.signals[turn][rows][:, order]
            unit, rate, change = spin(turns)
            q[:, at + 3 : at + 7] = unit
            v[:, to + 3 : to + 6], a[:, to + 3 : to + 6] = rate, change
        return q, v, a


def q_of_dofs(model: "mujoco.MjModel", qpos: Floats) -> Floats:
    """Positions (n, nv) of hinges and slides, 0 for free joints."""
    out = np.zeros((len(qpos), model.nv))
    for j in range(model.njnt):
        if model.jnt_type[j] != free_joint_type():
            out[:, model.jnt_dofadr[j]] = qpos[:, model.jnt_qposadr[j]]
    return out


def spin(turns: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit quaternions (n, 4), rates and accelerations (n, 3) in the body's frame.

    With q' = q w / 2, w = 2 conj(q) q'; the rest of its derivative has no vector part.

    Args:
        turns: (n, 4, 3) quaternion, slope and curvature.
    """
    size = np.linalg.norm(turns[..., 0], axis=1)[:, None, None]
    q, dq, ddq = np.moveaxis(turns / np.maximum(size, 1e-9), 2, 0)
    return q, 2 * _conjugate_product(q, dq), 2 * _conjugate_product(q, ddq)


def _conjugate_product(a: Floats, b: Floats) -> Floats:
    """Vector part (n, 3) of conj(a) b, for quaternions (n, 4)."""
    return a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])


def _find_bases(
    recording: Recording, model: "mujoco.MjModel"
) -> dict[int, tuple[str, str]]:
    """Free joints by number, with the signals of their body's place and turn."""
    kinds: dict[tuple[str, str], str] = {}
    for episode in recording.episodes.values():
        for name, signal in episode.signals.items():
            kinds.setdefault((signal.kind, signal.target), name)
    found = {}
    for j in range(model.njnt):
        if model.jnt_type[j] == free_joint_type():
            body = model.body(model.jnt_bodyid[j]).name
            pose = [kinds.get((k, body)) for k in ("body_position", "body_orientation")]
            if pose[0] and pose[1]:
                found[j] = (pose[0], pose[1])
    return found


def correct_base(model: "mujoco.MjModel", body: str) -> tuple[str, str]:
    """What to do about a body with a free joint whose pose nothing reads."""
    drives = "" if model.nu else "--kp KP "
    return (
        f"leave out the free joint of {body}, if the robot hangs or is bolted down "
        f"(selfheal model prepare ROBOT.xml {drives}--weld-base --out m.xml),",
        'or log its pose: [[signals]] kind = "body_position" and "body_orientation", '
        f'targets = ["{body}"]',
    )


def free_joint_type() -> int:
    """MuJoCo's number of a free joint."""
    import mujoco

    return int(mujoco.mjtJoint.mjJNT_FREE)
