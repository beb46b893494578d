"""The hidden robot's own physics: drives stepped in Python around MuJoCo's bodies.

MuJoCo is told of bodies, rotors and, anew at every step, of the largest friction that
each joint could have now. Torques, delay, lag and what the friction depends on are
computed here, by no code of selfheal.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.drives.robots import Robot, write_mjcf
from benchmarks.drives.truth import Drive, Truth

STEP = 0.0005  # [s] of the hidden robot; chosen: a quarter of a model's usual one
Command = Callable[[int, Any], np.ndarray]


@dataclass(frozen=True)
class Rollout:
    """What a hidden robot did.

    Attributes:
        time: (T) [s] of each sample.
        ctrl: (T, nu) commands as sent.
        qpos: (T, n) [rad or m], qvel: (T, n) [rad/s or m/s] of the model's joints.
        torque: (T, nu) [N m or N] that the actuators gave.
        whole: (T, m) [rad or m] of all joints, a mount's included.
    """

    time: np.ndarray
    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    torque: np.ndarray
    whole: np.ndarray


class Plant:
    """A hidden robot that can be stepped."""

    def __init__(self, robot: Robot, truth: Truth) -> None:
        real = replace(robot, links=truth.links, integrator="implicitfast")
        text = write_mjcf(real, actuated=False, timestep=STEP, mount=truth.mount)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.robot, self.truth, model = robot, truth, self.model
        self._at = np.array([model.joint(name).dofadr[0] for name in robot.joints])
        # coordinates that the given model has as well
        self._own = np.arange(model.nv)[1 if truth.mount else 0 :]
        columns = [[*asdict(drive).values()] for drive in truth.drives]
        self._drive = Drive(*np.array(columns).T)
        model.dof_damping[self._at] = self._drive.viscous
        model.dof_armature[self._at] = self._drive.armature
        # how firmly dry friction holds follows from the inertia with the rotors
        mujoco.mj_setConst(model, mujoco.MjData(model))
        self._kp = np.array([link.kp for link in robot.links])
        self._kv = np.array([link.kv for link in robot.links])
        limits = np.array([link.limit for link in truth.links])
        self._limit = np.where(limits > 0, limits, np.inf)
        goals = np.array([link.goals or (-np.inf, np.inf) for link in truth.links])
        self._lowest, self._highest = goals.T
        with np.errstate(divide="ignore"):
            self._follow = 1 - np.exp(-STEP / self._drive.lag)
        self._weightless = mujoco.MjModel.from_xml_string(
            write_mjcf(robot, actuated=False)
        )
        self._there = mujoco.MjData(self._weightless)

    def _ask_torque(self, held: np.ndarray, speed: np.ndarray, data: Any) -> np.ndarray:
        """Torques (n) [N m or N] of the drives.

        Args:
            held: (n) command that they follow, after their lag.
            speed: (n) [rad/s or m/s] of the goal.
            data: state.
        """
        drive, style = self._drive, self.robot.style
        if style == "none":
            return np.zeros(len(self._at))
        held = np.minimum(np.maximum(held, self._lowest), self._highest)
        if style == "motor":
            asked = held
        else:
            off = held - data.qpos[self._at]
            off = np.sign(off) * np.maximum(np.abs(off) - drive.dead_band, 0)
            slow = data.qvel[self._at] - drive.feed_forward * speed
            asked = self._kp * off - self._kv * slow
        asked = np.minimum(np.maximum(asked, -self._limit), self._limit)
        if self.truth.compensates:
            asked = asked + self.compute_weights(data.qpos)
        return asked

    def compute_weights(self, qpos: np.ndarray) -> np.ndarray:
        """Torques (n) [N m or N] that hold the given model at positions [rad or m]."""
        self._there.qpos[:] = qpos[self._own]
        mujoco.mj_forward(self._weightless, self._there)
        at = [self._weightless.joint(j).dofadr[0] for j in self.robot.joints]
        return self._there.qfrc_bias[at]

    def _set_friction(self, torque: np.ndarray, data: Any) -> None:
        drive, at = self._drive, self._at
        passed = 0.5 * np.abs(torque + data.qfrc_bias[at])  # mean of motor and load
        slow = np.exp(-((data.qvel[at] / drive.slip_speed) ** 2))
        self.model.dof_frictionloss[at] = (
            drive.coulomb + drive.load * passed + drive.stiction * slow
        )

    def _start(self, qpos: np.ndarray, qvel: np.ndarray) -> Any:
        """State at the given model's positions and velocities; a mount has given way.

        Args:
            qpos: (n) [rad or m].
            qvel: (n) [rad/s or m/s].
        """
        data = mujoco.MjData(self.model)
        data.qpos[self._own], data.qvel[self._own] = qpos, qvel
        self.model.dof_frictionloss[:] = 0
        mujoco.mj_forward(self.model, data)
        if self.truth.mount:
            data.qpos[0] = -data.qfrc_bias[0] / self.truth.mount[0]
            mujoco.mj_forward(self.model, data)
        return data

    def run(
        self,
        times: np.ndarray,
        commands: np.ndarray | Command,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> Rollout:
        """Simulate from a state at the first of the times.

        Args:
            times: (T) [s] at which is commanded and measured.
            commands: (T, nu), or a function of the sample's number and the state.
            qpos: (n) [rad or m] of the given model at times[0].
            qvel: (n) [rad/s or m/s] of the given model at times[0].
        """
        data, start = self._start(qpos, qvel), float(times[0])
        sent = _Line(times, commands, self.truth.delay)
        held, speed = sent.read(start - 1.0, data)
        torque, rows, k = self._ask_torque(held, speed, data), [], 0
        followed = np.array([held, speed])
        for i in range(int((times[-1] - start) / STEP) + 2):
            now = start + i * STEP
            while k < len(times) and times[k] < now + STEP - 1e-9:
                sent.send(k, data)
                there = data.qpos + data.qvel * (times[k] - now)
                rows.append((there, data.qvel.copy(), torque))
                k += 1
            if k == len(times):
                break
            sent_now = np.array(sent.read(now + STEP / 2, data))
            share = self._follow[: sent_now.shape[1]]
            followed = followed + share * (sent_now - followed)
            torque = self._ask_torque(followed[0], followed[1], data)
            data.qfrc_applied[self._at] = self._drive.gain * torque
            self._set_friction(torque, data)
            mujoco.mj_step(self.model, data)
        qpos, qvel, torque = (np.array(column) for column in zip(*rows, strict=True))
        return Rollout(
            times, sent.ctrl, qpos[:, self._own], qvel[:, self._own],
            torque[:, : len(self.robot.actuators)], qpos,
        )  # fmt: skip

    def compute_poses(self, run: Rollout) -> np.ndarray:
        """Positions and quaternions (T, n, 7) [m and 1] of the links in a rollout."""
        data, found = mujoco.MjData(self.model), []
        bodies = [self.model.body(f"b_{name}").id for name in self.robot.joints]
        for row in run.whole:
            data.qpos[:] = row
            mujoco.mj_kinematics(self.model, data)
            found.append(np.hstack([data.xpos[bodies], data.xquat[bodies]]))
        return np.array(found)


class _Line:
    """Commands on their way: a table, which may be ahead, or asked for as time goes."""

    def __init__(
        self, times: np.ndarray, commands: np.ndarray | Command, delay: float
    ) -> None:
        self.times, self.delay, self.count = times, delay, 0
        self.ask = None if isinstance(commands, np.ndarray) else commands
        self.rows = [] if self.ask else list(np.asarray(commands, float))
        self.due = times + delay

    @property
    def ctrl(self) -> np.ndarray:
        """(T, nu) all commands."""
        return np.array(self.rows)

    def send(self, k: int, data: Any) -> None:
        """Ask for the command of sample `k`, if it is not known."""
        if self.ask and k == len(self.rows):
            self.rows.append(np.asarray(self.ask(k, data), float))

    def read(self, now: float, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """Command (n) that has arrived at `now` [s], and its speed, by differences."""
        if not self.rows:
            self.send(0, data)
        while self.count < len(self.rows) and self.due[self.count] < now:
            self.count += 1
        last = max(self.count - 1, 0)
        before = max(last - 1, 0)
        period = self.times[last] - self.times[before]
        change = self.rows[last] - self.rows[before]
        return self.rows[last], change / period if period else 0.0 * change
