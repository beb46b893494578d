"""The hidden robot: takes a given model and edits, gives what it does and feels.

It is simulated with plain `mj_step` at a finer step and with another integrator than
the model as given has; what MuJoCo does not do is a command shaper or a force here.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np

from benchmarks.sealed.mjcf import Robot

SETTLE = 1.0  # [s] under the first command before time 0; chosen: all come to rest
WILD = 1e4  # [rad/s or m/s] a velocity beyond it is a simulation that failed


class UnfitDraw(Exception):
    """A draw that makes no case: it diverges, or the effect does not show."""


class CommandShaper(Protocol):
    """What happens to one command on its way; keeps its state from step to step."""

    def __call__(self, command: float, first: bool) -> float:
        """The command of this step; `first` where there was none before."""


class Force(Protocol):
    """A force, or a changed coefficient, of every step."""

    def __call__(self, model: Any, data: Any, time: float) -> None:
        """Add to data.qfrc_applied, or write into the model; time < 0: settling."""


@dataclass(frozen=True)
class SensorModel:
    """reading = round to step (gain x true(t - delay) + bias)."""

    gain: float = 1.0
    bias: float = 0.0
    delay: float = 0.0
    step: float = 0.0


@dataclass
class HiddenRobot:
    """A hidden robot in the making.

    Attributes:
        robot: whose model it starts from.
        spec: its mechanics; every body states its inertia.
        shapers: by actuator, in order.
        forces: makers of forces, called with the compiled model.
        readings: by signal name.
        plays: by joint: the joint that sits between motor and link.
        pinned: [rad] joints that do not move, by name.
        motor_side: True where joint positions are the motor's.
    """

    robot: Robot
    spec: Any
    shapers: dict[str, list[Callable[[float], CommandShaper]]] = field(
        default_factory=dict
    )
    forces: list[Callable[[Any], Force]] = field(default_factory=list)
    readings: dict[str, SensorModel] = field(default_factory=dict)
    plays: dict[str, str] = field(default_factory=dict)
    pinned: dict[str, float] = field(default_factory=dict)
    motor_side: bool = False


@dataclass(frozen=True)
class MotionPlan:
    """What the robot is told in one episode.

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
        force: (T, nu) [N m or N] of the actuators.
    """

    rows: np.ndarray
    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    late: Mapping[int, np.ndarray]
    force: np.ndarray


def make_hidden_robot(robot: Robot, *, rk4: bool = False) -> HiddenRobot:
    """The hidden robot before any edit: the model as given, simulated finer."""
    spec = mujoco.MjSpec.from_string(robot.xml)
    model = spec.compile()
    for body in spec.bodies[1:]:
        _state_inertia(body, model.body(body.name))
    spec.option.timestep = robot.fine
    kinds = mujoco.mjtIntegrator
    spec.option.integrator = kinds.mjINT_RK4 if rk4 else kinds.mjINT_IMPLICIT
    return HiddenRobot(robot, spec)


def _state_inertia(body: Any, compiled: Any) -> None:
    if compiled.mass[0] == 0:
        return
    body.explicitinertial = True
    body.mass = compiled.mass[0]
    body.ipos, body.iquat = compiled.ipos, compiled.iquat
    body.inertia = compiled.inertia


@dataclass(frozen=True)
class Nuisance:
    """A value that the model states and a user would grant to be wrong.

    Attributes:
        kind: mass, inertia, length, damping, armature, frictionloss, kp, kv, friction.
        name: of the body, joint or actuator; "" for all contacts.
        bound: largest relative error that a refit may correct.
    """

    kind: str
    name: str
    bound: float


def list_nuisances(robot: Robot) -> list[Nuisance]:
    """Every stated, nonzero value, with the contract's bound on its error."""
    spec = mujoco.MjSpec.from_string(robot.xml)
    found = []
    bodies = [*robot.links, *([robot.free] if robot.free else [])]
    for name in dict.fromkeys(bodies):
        found += [Nuisance("mass", name, 0.15), Nuisance("inertia", name, 0.15)]
        found += [Nuisance("length", name, 0.03)]
    for name in robot.joints:
        joint = spec.joint(name)
        values = {
            "damping": joint.damping[0],
            "armature": joint.armature,
            "frictionloss": joint.frictionloss,
        }
        found += [Nuisance(k, name, 0.3) for k, v in values.items() if v]
    if robot.drive == "servo":
        found += [Nuisance(k, a, 0.3) for a in robot.actuators for k in ("kp", "kv")]
    if robot.contact:
        found.append(Nuisance("friction", "", 0.3))
    return found


def scale_value(spec: Any, what: Nuisance, factor: float) -> None:
    """Multiply a value in the hidden robot's spec."""
    if what.kind == "friction":
        for geom in spec.geoms:
            geom.friction[0] *= factor
    elif what.kind in ("kp", "kv"):
        scale_gain(spec.actuator(what.name), what.kind, factor)
    elif what.kind == "mass":
        body = spec.body(what.name)
        body.mass *= factor
        body.inertia = body.inertia * factor
    elif what.kind == "inertia":
        spec.body(what.name).inertia = spec.body(what.name).inertia * factor
    elif what.kind == "length":
        stretch_body(spec.body(what.name), np.full(3, factor))
    elif what.kind == "damping":
        spec.joint(what.name).damping[0] *= factor
    else:
        joint = spec.joint(what.name)
        setattr(joint, what.kind, getattr(joint, what.kind) * factor)


def scale_gain(actuator: Any, kind: str, factor: float) -> None:
    """Multiply a position servo's kp or kv."""
    if kind == "kp":
        actuator.gainprm[0] *= factor
        actuator.biasprm[1] *= factor
    else:
        actuator.biasprm[2] *= factor


def stretch_body(body: Any, factors: np.ndarray) -> None:
    """Scale a body's geometry, center of mass and inertia along its axes; mass stays.

    Args:
        body: in the spec.
        factors: (3) along x, y, z of the body frame.
    """
    body.ipos = body.ipos * factors
    for child in body.bodies:
        child.pos = child.pos * factors
    for geom in body.geoms:
        geom.pos = geom.pos * factors
        if geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE:
            geom.size[1] *= factors[2]
        elif geom.type == mujoco.mjtGeom.mjGEOM_BOX:
            geom.size = geom.size * factors
    _stretch_inertia(body, factors)


def _stretch_inertia(body: Any, factors: np.ndarray) -> None:
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, body.iquat)
    turn = flat.reshape(3, 3)
    inertia = turn @ np.diag(body.inertia) @ turn.T
    spread = (np.trace(inertia) / 2 * np.eye(3) - inertia) * np.outer(factors, factors)
    values, axes = np.linalg.eigh(np.trace(spread) * np.eye(3) - spread)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    body.inertia, body.iquat = values, quat


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
        mine, theirs = given.joint(j), model.joint(given.joint(j).name or j)
        wide, thick = (7, 6) if mine.type[0] == mujoco.mjtJoint.mjJNT_FREE else (1, 1)
        q, v = mine.qposadr[0], mine.dofadr[0]
        qpos[q : q + wide] = theirs.qposadr[0] + np.arange(wide)
        qvel[v : v + thick] = theirs.dofadr[0] + np.arange(thick)
        if mine.name in truth.plays and not truth.motor_side:
            play = model.joint(truth.plays[mine.name])
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
        shape = (len(plan.rows), self.given.nu)
        ctrl, force, states = np.zeros(shape), np.zeros(shape), []
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
        self.fresh = True
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
        if force is not None and sample is not None and model.nu:
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
                value = shaper(value, self.fresh)
            data.ctrl[a] = value
        self.fresh = False
        if self.forces:
            data.qfrc_applied[:] = 0.0
            for push in self.forces:
                push(self.model, data, row * self.robot.fine)
        mujoco.mj_step(self.model, data)


def simulate_plans(truth: HiddenRobot, plans: Sequence[MotionPlan]) -> list[Rollout]:
    """Play every plan."""
    simulator = Simulator(truth)
    return [simulator.run(plan) for plan in plans]
