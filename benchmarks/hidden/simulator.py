"""Simulates a hidden robot: takes motion plans, gives what it does."""

import copy
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from benchmarks.hidden.truth import HiddenRobot, UnfitDraw

BLOCK = 0.01  # [s] that a command stands while the robot settles
WILD = 1e4  # [rad/s or m/s] a velocity beyond it is a simulation that failed
Command = Callable[[int, mujoco.MjData], np.ndarray]  # of a sample's number and MjData


@dataclass(frozen=True)
class MotionPlan:
    """The commands of one episode.

    Attributes:
        rows: (T) fine step of each sample.
        command: what is sent at a sample, which may depend on the state.
        qpos: (nq) start, in the given model's coordinates.
        qvel: (nv) start.
        hold: samples that a command stands.
        settle: [s] under the first command before time 0.
    """

    motion: str
    rows: np.ndarray
    command: Command
    qpos: np.ndarray
    qvel: np.ndarray
    hold: int = 1
    settle: float = 0.0


@dataclass(frozen=True)
class Rollout:
    """What the robot did.

    Attributes:
        rows: (T) fine step of each sample.
        ctrl: (T, nu) commands as sent.
        qpos: (T, nq), qvel: (T, nv) in the given model's coordinates.
        late: by delay in fine steps: qpos as it was that much earlier.
        force: (T, nout) [N m or N] of the actuators.
        whole: (T, nq + nv) state in the hidden model's coordinates.
    """

    rows: np.ndarray
    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    late: Mapping[int, np.ndarray]
    force: np.ndarray
    whole: np.ndarray


@dataclass(frozen=True)
class _CoordinateMap:
    """Where the given model's coordinates lie in the hidden robot's."""

    qpos: np.ndarray
    qvel: np.ndarray
    qplay: np.ndarray  # (nq, hidden nq): what plays add
    vplay: np.ndarray

    def read(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity in the given model's coordinates."""
        return qpos[self.qpos] + self.qplay @ qpos, qvel[self.qvel] + self.vplay @ qvel


def _map_coordinates(
    truth: HiddenRobot, given: Any, model: mujoco.MjModel
) -> _CoordinateMap:
    qpos, qvel = np.zeros(given.nq, int), np.zeros(given.nv, int)
    qplay, vplay = np.zeros((given.nq, model.nq)), np.zeros((given.nv, model.nv))
    for j in range(given.njnt):
        one = given.joint(j)
        other = model.joint(one.name or j)
        nq, nv = (7, 6) if one.type[0] == mujoco.mjtJoint.mjJNT_FREE else (1, 1)
        q, v = one.qposadr[0], one.dofadr[0]
        qpos[q : q + nq] = other.qposadr[0] + np.arange(nq)
        qvel[v : v + nv] = other.dofadr[0] + np.arange(nv)
        if one.name in truth.plays and not truth.motor_side:
            play = model.joint(truth.plays[one.name])
            qplay[q, play.qposadr[0]] = vplay[v, play.dofadr[0]] = 1.0
    return _CoordinateMap(qpos, qvel, qplay, vplay)


class Simulator:
    """One hidden robot, compiled, ready to run plans."""

    def __init__(self, truth: HiddenRobot) -> None:
        self.truth, self.robot = truth, truth.robot
        try:
            self.compiled = truth.spec.compile()
        except ValueError as error:
            raise UnfitDraw(str(error)) from error
        self.view = _map_coordinates(truth, self.robot.model, self.compiled)
        delays = {round(r.delay / self.robot.fine) for r in truth.readings.values()}
        self.delays = sorted(delays - {0})
        self.ahead = round(truth.ahead / self.robot.fine)

    def run(self, plan: MotionPlan) -> Rollout:
        """Play one episode.

        Raises:
            UnfitDraw: the simulation diverged.
        """
        self._begin(plan)
        rows, sent = plan.rows, defaultdict[int, list[int]](list)
        for i, row in enumerate(np.maximum(rows - self.ahead, 0)):
            sent[int(row)].append(i)
        marks = [np.maximum(rows - d, 0) for d in (0, *self.delays)]
        stops = np.unique(np.concatenate([*marks, list(sent), [0]]).astype(int))
        seen = {int(row): i for i, row in enumerate(rows)}
        ctrl = np.zeros((len(rows), self.compiled.nu))
        force, states = np.zeros((len(rows), self.robot.model.nout)), []
        for stop, follow in zip(stops, [*stops[1:], stops[-1] + 1], strict=True):
            for i in sent.get(int(stop), ()):
                if i % plan.hold == 0:
                    self._send(plan, i, int(rows[i] - rows[max(i - plan.hold, 0)]))
                ctrl[i] = self.command
            states.append(np.concatenate([self.data.qpos, self.data.qvel]))
            self._advance(int(follow - stop), int(stop), force, seen.get(int(stop)))
        return self._collect(plan, stops, np.array(states), ctrl, force)

    def _collect(self, plan, stops, states, ctrl, force) -> Rollout:
        nq, rows = self.compiled.nq, plan.rows
        if (
            not np.isfinite(states[:, :nq]).all()
            or np.abs(states[:, nq:]).max(initial=0) > WILD
        ):
            raise UnfitDraw(f"{self.robot.name} diverges in {plan.motion}")
        pairs = [self.view.read(state[:nq], state[nq:]) for state in states]
        qpos, qvel = (np.array(column) for column in zip(*pairs, strict=True))

        def pick(delay: int) -> np.ndarray:
            return np.searchsorted(stops, np.maximum(rows - delay, 0))

        late = {d: qpos[pick(d)] for d in self.delays}
        now = pick(0)
        return Rollout(rows, ctrl, qpos[now], qvel[now], late, force, states[now])

    def _begin(self, plan: MotionPlan) -> None:
        """Put the robot where the episode starts; settle if it is driven."""
        self.model = model = copy.copy(self.compiled)  # forces write into it
        self.data = data = mujoco.MjData(model)
        self.forces = [make(model) for make in self.truth.forces]
        h, chains = self.robot.fine, self.truth.shapers
        self.chains = [[m(h) for m in chains.get(a, [])] for a in self.robot.actuators]
        self.stepwise = bool(self.forces) or any(self.chains)
        self.first = True
        data.qpos[self.view.qpos], data.qvel[self.view.qvel] = plan.qpos, plan.qvel
        for joint, angle in self.truth.pinned.items():
            data.joint(joint).qpos[0] = angle
        for joint in self.truth.sprung:
            mujoco.mj_forward(model, data)
            weight = data.qfrc_bias[model.joint(joint).dofadr[0]]
            data.joint(joint).qpos[0] = -weight / model.joint(joint).stiffness[0]
        self.command = self.speed = np.zeros(model.nu)
        block, total = round(BLOCK / h), round(plan.settle / h)
        for done in range(0, total, block):
            self._send(plan, 0, 0)
            self._advance(block, done - total)
        data.time = 0.0

    def _send(self, plan: MotionPlan, sample: int, steps: int) -> None:
        """Send the command of a sample, that many fine steps after the one before."""
        new = np.asarray(plan.command(sample, self.data), float)
        self.speed = (new - self.command) / (steps * self.robot.fine or np.inf)
        self.command = new

    def _advance(self, steps: int, row: int, force=None, sample=None) -> None:
        """Simulate; the first step's actuator force is that of the sample."""
        model, data = self.model, self.data
        if force is not None and sample is not None and model.nactuator:
            self._step(row)
            force[sample] = data.actuator_force
            steps, row = steps - 1, row + 1
        if not self.stepwise:
            data.ctrl[:] = self.command
            if steps:
                mujoco.mj_step(model, data, steps)
            return
        for k in range(steps):
            self._step(row + k)

    def _step(self, row: int) -> None:
        data = self.data
        data.ctrl[:] = self.command
        for a, chain in enumerate(self.chains):
            value = float(self.command[a])
            for shaper in chain:
                value = shaper(value, float(self.speed[a]), self.first)
            data.ctrl[a] = value
        self.first = False
        if self.forces:
            data.qfrc_applied[:] = 0.0
            self.model.dof_frictionloss[:] = self.compiled.dof_frictionloss
            for push in self.forces:
                push(data, row * self.robot.fine)
        mujoco.mj_step(self.model, data)


def simulate_plans(truth: HiddenRobot, plans: Sequence[MotionPlan]) -> list[Rollout]:
    """Simulate every plan with one hidden robot."""
    simulator = Simulator(truth)
    return [simulator.run(plan) for plan in plans]
