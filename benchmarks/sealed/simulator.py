"""Simulates a hidden robot: takes motion plans, gives what it does and measures."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from benchmarks.sealed.hidden_robot import HiddenRobot, UnfitDraw

SETTLE = 1.0  # [s] under the first command before time 0; chosen: all come to rest
WILD = 1e4  # [rad/s or m/s] a velocity beyond it is a simulation that failed


@dataclass(frozen=True)
class MotionPlan:
    """The commands of one episode.

    Attributes:
        motion: label.
        rows: (T) fine step of each sample.
        hold: samples that a command stands.
        reference: (T, joints of `Robot.actuators`) [rad or m] goal positions.
        qpos: (nq) start, or None: at rest where the first goal is.
        qvel: (nv) start.
    """

    motion: str
    rows: np.ndarray
    hold: int
    reference: np.ndarray
    qpos: np.ndarray | None = None
    qvel: np.ndarray | None = None


@dataclass(frozen=True)
class Rollout:
    """What the robot did.

    Attributes:
        rows: (T) fine step of each sample.
        ctrl: (T, nu) commands as sent.
        qpos: (T, nq), qvel: (T, nv) in the given model's coordinates.
        late: by delay in fine steps: qpos as it was that much earlier.
        force: (T, nout) [N m or N] of the actuators.
    """

    rows: np.ndarray
    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    late: Mapping[int, np.ndarray]
    force: np.ndarray


@dataclass(frozen=True)
class _CoordinateMap:
    """Where the given model's coordinates lie in the hidden robot's."""

    qpos: np.ndarray
    qvel: np.ndarray
    qplay: np.ndarray  # (nq, hidden nq): what plays add
    vplay: np.ndarray


def _map_coordinates(truth: HiddenRobot, given: Any, model: Any) -> _CoordinateMap:
    qpos, qvel = np.zeros(given.nq, int), np.zeros(given.nv, int)
    qplay, vplay = np.zeros((given.nq, model.nq)), np.zeros((given.nv, model.nv))
    for j in range(given.njnt):
        given_joint, hidden_joint = (
            given.joint(j),
            model.joint(given.joint(j).name or j),
        )
        nq, nv = (7, 6) if given_joint.type[0] == mujoco.mjtJoint.mjJNT_FREE else (1, 1)
        q, v = given_joint.qposadr[0], given_joint.dofadr[0]
        qpos[q : q + nq] = hidden_joint.qposadr[0] + np.arange(nq)
        qvel[v : v + nv] = hidden_joint.dofadr[0] + np.arange(nv)
        if given_joint.name in truth.plays and not truth.motor_side:
            play = model.joint(truth.plays[given_joint.name])
            qplay[q, play.qposadr[0]] = vplay[v, play.dofadr[0]] = 1.0
    return _CoordinateMap(qpos, qvel, qplay, vplay)


class Simulator:
    """One hidden robot, compiled, ready to run plans."""

    def __init__(self, truth: HiddenRobot) -> None:
        self.truth, self.robot = truth, truth.robot
        self.given = mujoco.MjModel.from_xml_string(truth.robot.xml)
        self.compiled = self._compile(truth)
        self.view = _map_coordinates(truth, self.given, self.compiled)
        delays = {round(r.delay / self.robot.fine) for r in truth.readings.values()}
        self.delays = sorted(delays - {0})

    @staticmethod
    def _compile(truth: HiddenRobot) -> Any:
        try:
            return truth.spec.compile()
        except ValueError as error:
            raise UnfitDraw(str(error)) from error

    def run(self, plan: MotionPlan) -> Rollout:
        """Play one episode.

        Raises:
            Unfit: the simulation diverged.
        """
        self._begin(plan)
        marks = [np.maximum(plan.rows - d, 0) for d in (0, *self.delays)]
        stops = np.unique(np.concatenate(marks))
        sample = {int(row): i for i, row in enumerate(plan.rows)}
        rows, given = len(plan.rows), self.given
        ctrl, force = np.zeros((rows, given.nu)), np.zeros((rows, given.nout))
        states = []
        for stop, follow in zip(stops, [*stops[1:], stops[-1] + 1], strict=True):
            i = sample.get(int(stop))
            if i is not None:
                if i % plan.hold == 0:
                    self.command = self._command(plan.reference[i])
                ctrl[i] = self.command
            states.append(self._state())
            self._advance(int(follow - stop), int(stop), force, i)
        return self._collect(plan, stops, states, ctrl, force)

    def _collect(self, plan, stops, states, ctrl, force) -> Rollout:
        qpos = np.array([q for q, _ in states])
        qvel = np.array([v for _, v in states])
        if not np.isfinite(qpos).all() or np.abs(qvel).max(initial=0) > WILD:
            raise UnfitDraw(f"{self.robot.name} diverges in {plan.motion}")

        def pick(delay: int) -> np.ndarray:
            return np.searchsorted(stops, np.maximum(plan.rows - delay, 0))

        late = {d: qpos[pick(d)] for d in self.delays}
        now = pick(0)
        return Rollout(plan.rows, ctrl, qpos[now], qvel[now], late, force)

    def _state(self) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity in the given model's coordinates."""
        v, d = self.view, self.data
        return d.qpos[v.qpos] + v.qplay @ d.qpos, d.qvel[v.qvel] + v.vplay @ d.qvel

    def _begin(self, plan: MotionPlan) -> None:
        """Put the robot where the episode starts; settle if it is driven."""
        self.model = copy.copy(self.compiled)  # forces write into it
        self.data = mujoco.MjData(self.model)
        self.forces = [make(self.model) for make in self.truth.forces]
        h = self.robot.fine
        chains = self.truth.shapers
        self.chains = [[m(h) for m in chains.get(a, [])] for a in self.robot.actuators]
        self.stepwise = bool(self.forces) or any(self.chains)
        self.first = True
        if plan.qpos is not None and plan.qvel is not None:
            self.data.qpos[self.view.qpos] = plan.qpos
            self.data.qvel[self.view.qvel] = plan.qvel
        for joint, goal in zip(
            self.robot.actuators.values(), plan.reference[0], strict=True
        ):
            self.data.joint(joint).qpos[0] = goal
        for joint, angle in self.truth.pinned.items():
            self.data.joint(joint).qpos[0] = angle
        self._settle(plan)
        self.data.time = 0.0

    def _settle(self, plan: MotionPlan) -> None:
        if self.robot.drive == "none":
            self.command = np.zeros(0)
            return
        h = self.robot.fine
        block, total = round(0.01 / h), round(SETTLE / h)
        for done in range(0, total, block):
            if done == 0 or self.robot.drive == "torque":
                self.command = self._command(plan.reference[0])
            self._advance(block, done - total)

    def _command(self, goal: np.ndarray) -> np.ndarray:
        """What is sent: the goal itself, or the torque of a feedback."""
        if self.robot.drive == "servo":
            return goal.copy()
        sent = []
        for joint, aim in zip(self.robot.actuators.values(), goal, strict=True):
            stiff, damp = self.robot.gains[joint]
            state = self.data.joint(joint)
            sent.append(stiff * (aim - state.qpos[0]) - damp * state.qvel[0])
        return np.array(sent)

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
                value = shaper(value, self.first)
            data.ctrl[a] = value
        self.first = False
        if self.forces:
            data.qfrc_applied[:] = 0.0
            for push in self.forces:
                push(self.model, data, row * self.robot.fine)
        mujoco.mj_step(self.model, data)


def simulate_plans(truth: HiddenRobot, plans: Sequence[MotionPlan]) -> list[Rollout]:
    """Simulate every plan with one hidden robot."""
    simulator = Simulator(truth)
    return [simulator.run(plan) for plan in plans]
