"""What a recording says of joints: by encoders, or by a camera that sees the links."""

from typing import Any

import mujoco
import numpy as np

from selfheal.recording import Episode, Recording

POSITION, SPEED, POSE = "joint_position", "joint_velocity", "body_orientation"


class JointReader:
    """Reads joints, and completes the coordinates that nothing reads.

    Attributes:
        model: as given.
        joints: names of those that are read, in the model's order.
        columns: (n) of `qpos` that they are.
        by_camera: whether they are read by the orientations of bodies.
    """

    def __init__(self, model: Any, recording: Recording) -> None:
        self.model = model
        episode = next(iter(recording.episodes.values()))
        kinds = {(s.kind, s.target) for s in episode.signals.values()}
        names = [model.joint(j).name for j in range(model.njnt)]
        self.by_camera = not any(kind == POSITION for kind, _ in kinds)
        if not self.by_camera:
            names = [name for name in names if (POSITION, name) in kinds]
        self.joints = tuple(names)
        self.columns = np.array([model.joint(name).qposadr[0] for name in names])

    def read_positions(self, episode: Episode) -> np.ndarray:
        """Readings (T, n) [rad or m] of the joints' positions."""
        if not self.by_camera:
            return self._read(episode, POSITION)
        return np.stack([self._read_turn(episode, name) for name in self.joints], 1)

    def read_speeds(self, episode: Episode) -> np.ndarray:
        """Readings (T, n) [rad/s or m/s], NaN where a joint has none."""
        return self._read(episode, SPEED)

    def _read(self, episode: Episode, kind: str) -> np.ndarray:
        found = np.full((len(episode.time), len(self.joints)), np.nan)
        for signal in episode.signals.values():
            if signal.kind == kind:
                found[:, self.joints.index(signal.target)] = signal.values
        return found

    def _read_turn(self, episode: Episode, joint: str) -> np.ndarray:
        """Angle (T) [rad] of a hinge, from the orientations of its body and parent."""
        model = self.model
        number = model.joint(joint).id
        body = model.jnt_bodyid[number]
        turns = {s.target: s.values for s in episode.signals.values()
                 if s.kind == POSE}  # fmt: skip
        own = turns[model.body(body).name]
        parent = turns.get(model.body(model.body_parentid[body]).name)
        between, back = np.zeros(4), np.zeros(4)
        angles = []
        for k, quat in enumerate(own):
            if parent is None:
                between[:] = quat
            else:
                mujoco.mju_negQuat(back, parent[k])
                mujoco.mju_mulQuat(between, back, quat)
            mujoco.mju_negQuat(back, model.body_quat[body])
            turned = np.zeros(4)
            mujoco.mju_mulQuat(turned, back, between)
            along = turned[1:] @ model.jnt_axis[number]
            angles.append(2 * np.arctan2(along, turned[0]))
        return np.unwrap(angles)

    def complete_state(
        self, position: np.ndarray, speed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """All coordinates, those that nothing reads as equality constraints have them.

        Args:
            position: (n) [rad or m] of the joints read.
            speed: (n) [rad/s or m/s] of the joints read.

        Returns:
            (nq) [rad or m] and (nv) [rad/s or m/s].
        """
        model, data = self.model, mujoco.MjData(self.model)
        read = np.array([model.joint(name).dofadr[0] for name in self.joints])
        rest = np.setdiff1d(np.arange(model.nv), read)
        data.qpos[:] = model.qpos0
        data.qpos[self.columns], data.qvel[read] = position, speed
        if len(rest) and model.neq:
            for _ in range(20):  # Newton's steps
                rows, gap = self._read_constraints(data)
                data.qpos[rest] -= np.linalg.pinv(rows[:, rest]) @ gap
            rows, _ = self._read_constraints(data)
            data.qvel[rest] = -np.linalg.pinv(rows[:, rest]) @ rows[:, read] @ speed
        return data.qpos.copy(), data.qvel.copy()

    def _read_constraints(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """Jacobian (E, nv) and errors (E) of the equality constraints."""
        mujoco.mj_forward(self.model, data)
        equal = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        rows = data.efc_J
        if mujoco.mj_isSparse(self.model):
            dense = np.zeros((data.nefc, self.model.nv))
            mujoco.mju_sparse2dense(
                dense, rows, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
            )
            rows = dense
        rows = np.reshape(rows, (-1, self.model.nv))[: data.nefc]
        return rows[equal], data.efc_pos[: data.nefc][equal]
