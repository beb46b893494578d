"""The hidden robot's own physics: drives stepped in Python around MuJoCo's bodies.

MuJoCo is told of bodies, rotors and, anew at every step, of the largest friction that
each joint could have now. Torques, delay, lag and what the friction depends on are
computed here, by no code of selfheal.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.drives.robots import Robot, write_mjcf
from benchmarks.drives.truth import Drive, Truth

STEP = 0.0005  # [s] of the hidden robot; chosen: a quarter of a model's usual one
Command = Callable[[int, float, Any], np.ndarray]


@dataclass(frozen=True)
class Rollout:
    """What a hidden robot did.

    Attributes:
        time: (T) [s] of each sample.
        ctrl: (T, n) commands as sent.
        qpos: (T, n) [rad or m], qvel: (T, n) [rad/s or m/s] of the joints.
        torque: (T, n) [N m or N] that the actuators gave.
    """

    time: np.ndarray
    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    torque: np.ndarray


class Plant:
    """A hidden robot that can be stepped."""

    def __init__(self, robot: Robot, truth: Truth) -> None:
        links = tuple(
            replace(link, mass=link.mass * factor)
            for link, factor in zip(robot.links, truth.masses, strict=True)
        )
        real = replace(robot, links=links, integrator="implicitfast")
        text = write_mjcf(real, actuated=False, timestep=STEP)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.robot, self.delay = robot, truth.delay
        columns = [[*asdict(drive).values()] for drive in truth.drives]
        self._drive = Drive(*np.array(columns).T)
        self.model.dof_damping[:] = self._drive.viscous
        self.model.dof_armature[:] = self._drive.armature
        self._kp = np.array([link.kp for link in robot.links])
        self._kv = np.array([link.kv for link in robot.links])
        limits = np.array([link.limit for link in robot.links])
        self._limit = np.where(limits > 0, limits, np.inf)
        with np.errstate(divide="ignore"):
            self._follow = 1 - np.exp(-STEP / self._drive.lag)

    def _ask_torque(self, held: np.ndarray, data: Any) -> np.ndarray:
        """Torques that the drives ask for, before their lag."""
        if self.robot.style == "motor":
            asked = held
        else:
            asked = self._kp * (held - data.qpos) - self._kv * data.qvel
        return np.clip(asked, -self._limit, self._limit)

    def _set_friction(self, torque: np.ndarray, data: Any) -> None:
        passed = 0.5 * np.abs(torque + data.qfrc_bias)  # mean of motor's and load's
        slow = np.exp(-((data.qvel / self._drive.slip_speed) ** 2))
        self.model.dof_frictionloss[:] = (
            self._drive.coulomb
            + self._drive.load * passed
            + self._drive.stiction * slow
        )

    def run(
        self, times: np.ndarray, command: Command, qpos: np.ndarray, qvel: np.ndarray
    ) -> Rollout:
        """Simulate from a state at the first of the times.

        Args:
            times: (T) [s] at which is commanded and measured.
            command: takes the sample's number, its time and the state, gives (n).
            qpos: (n) [rad or m] at times[0].
            qvel: (n) [rad/s or m/s] at times[0].
        """
        model, data = self.model, mujoco.MjData(self.model)
        data.qpos[:], data.qvel[:] = qpos, qvel
        model.dof_frictionloss[:] = 0
        mujoco.mj_forward(model, data)
        held = np.asarray(command(0, float(times[0]), data), float)
        torque = self._ask_torque(held, data)
        sent: deque[tuple[float, np.ndarray]] = deque()
        rows, k, start = [], 0, float(times[0])
        for i in range(int((times[-1] - start) / STEP) + 2):
            now = start + i * STEP
            while k < len(times) and times[k] < now + STEP - 1e-9:
                ctrl = np.asarray(command(k, float(times[k]), data), float)
                sent.append((times[k] + self.delay, ctrl))
                there = data.qpos + data.qvel * (times[k] - now)
                rows.append((ctrl, there, data.qvel.copy(), torque))
                k += 1
            if k == len(times):
                break
            while sent and sent[0][0] < now + STEP / 2:
                held = sent.popleft()[1]
            torque = torque + self._follow * (self._ask_torque(held, data) - torque)
            data.qfrc_applied[:] = torque
            self._set_friction(torque, data)
            mujoco.mj_step(model, data)
        columns = (np.array(column) for column in zip(*rows, strict=True))
        return Rollout(times, *columns)
