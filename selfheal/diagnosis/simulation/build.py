"""From files to something that can be simulated and asked where effects could be."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...recording import Episode, Recording, whole_of
from ...recording.data import Floats
from ..data.episodes import build_channels, sample_episode
from ..data.robot_summary import (
    Actuator,
    RobotSummary,
    summarize_bodies,
    summarize_joints,
)
from ..data.segments import cut_segments
from ..data.state_estimate import estimate_initial_state, estimate_state
from .model_variants import ModelCompiler
from .simulator import Simulator


def build_simulator(
    compiler: ModelCompiler,
    recordings: Sequence[Recording],
    whole: Sequence[Recording] = (),
) -> Simulator:
    """Recordings that fit a model, against it; parts of the `whole` ones, if given."""
    model = compiler.nominal
    signals = build_channels(recordings)
    step = float(model.opt.timestep)
    several = len(recordings) > 1
    names = [(r.file, name) for r in whole or recordings for name in r.episodes]
    logs = []
    for r in recordings:
        for name, e in r.episodes.items():
            own = sample_episode(
                f"{r.file}:{name}" if several else name,
                reorder_commands(e, model),
                signals,
                step,
            )
            at = (r.file, name), (r.file, whole_of(name))
            number = names.index(at[0] if at[0] in names else at[1])
            logs.append(replace(own, number=number))
    return Simulator(compiler, signals, tuple(logs), step)


def reorder_commands(episode: Episode, model) -> Episode:
    """The episode with its commands in the model's order."""
    names = [model.actuator(a).name for a in range(model.nu)]
    order = [episode.ctrl_names.index(name) for name in names]
    return replace(episode, ctrl=episode.ctrl[:, order], ctrl_names=tuple(names))


def summarize_robot(simulator: Simulator) -> RobotSummary:
    """What the robot and its recordings are like."""
    model = simulator.compiler.nominal
    states = StateReconstruction(simulator)
    motion = _MotionStatistics(simulator, states)
    measured = {
        j for j in range(model.njnt) if states.is_measured[model.jnt_qposadr[j]]
    }
    joints = summarize_joints(model, motion.torque, motion, measured)
    return RobotSummary(
        model,
        simulator.timestep,
        simulator.channels,
        joints,
        summarize_actuators(simulator, states, joints),
        summarize_bodies(model),
        motion.touches,
        cut_segments(simulator.episodes, None).is_single_readings,
    )


class StateReconstruction:
    """The robot's state at some times: as read or, where nothing tells, as simulated.

    Attributes:
        is_read: (nq) whether readings tell a position most of the time.
    """

    def __init__(self, simulator: Simulator) -> None:
        model = simulator.compiler.nominal
        predicted = [np.full((1, model.nq), np.nan)]
        for episode in simulator.episodes:
            at = np.linspace(0, episode.sample_steps[-1], 9)[1:-1]
            predicted.append(
                estimate_state(
                    model, simulator.channels, episode, at, simulator.timestep, {}
                )[0]
            )
        self.world = simulator
        self.is_measured = np.isfinite(np.vstack(predicted)).mean(axis=0) >= 0.5
        by_dof = [model.jnt_qposadr[j] for j in model.dof_jntid]
        self._moves = self.is_measured[by_dof]
        self._paths: dict[int, Floats] = {}

    def __call__(self, episode: int, at: np.ndarray) -> tuple[Floats, Floats]:
        """Positions (W, nq) and velocities (W, nv) at times `at` (W) [steps]."""
        qpos, qvel, _ = estimate_initial_state(self.world, episode, at, {})
        if not self.is_measured.all():
            path = self._simulate_path(episode)[
                np.minimum(at, len(self._simulate_path(episode)) - 1)
            ]
            nq = qpos.shape[1]
            qpos = np.where(self.is_measured, qpos, path[:, :nq])
            qvel = np.where(self._moves, qvel, path[:, nq:])
        return qpos, qvel

    def _simulate_path(self, episode: int) -> Floats:
        """Positions and velocities (G, nq + nv) of the given model, open loop."""
        if episode not in self._paths:
            import mujoco
            from mujoco import rollout

            model = self.world.compiler.nominal
            data = mujoco.MjData(model)
            first = estimate_initial_state(self.world, episode, np.zeros(1, int), {})
            data.qpos[:], data.qvel[:] = first[0][0], first[1][0]
            kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
            state = np.empty(mujoco.mj_stateSize(model, kind))
            mujoco.mj_getState(model, data, state, kind)
            control = self.world.episodes[episode].ctrl[None]
            seen = rollout.rollout(model, data, state[None], control)[0][0]
            seen = np.vstack([state, seen])[:-1, 1 : 1 + model.nq + model.nv]
            self._paths[episode] = np.nan_to_num(seen)
        return self._paths[episode]


class _MotionStatistics:
    """How the robot moved, at some hundred moments."""

    def __init__(self, simulator: Simulator, states_of: StateReconstruction) -> None:
        import mujoco

        model = simulator.compiler.nominal
        self.model = model
        states, torques, touches = [], [], False
        data = mujoco.MjData(model)
        each = max(2, 600 // len(simulator.episodes))
        for i, episode in enumerate(simulator.episodes):
            at = np.linspace(0, episode.sample_steps[-1], each).astype(int)
            qpos, qvel = states_of(i, at)
            ctrl = episode.ctrl[np.minimum(at, len(episode.ctrl) - 1)]
            for q, v, u in zip(qpos, qvel, ctrl, strict=True):
                data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, u
                mujoco.mj_forward(model, data)
                torques.append(np.abs(data.qfrc_bias) + np.abs(data.qfrc_actuator) / 2)
                touches |= bool(data.ncon)
            states.append(np.hstack([qpos, qvel]))
        self.states = np.vstack(states)
        self.torque: Floats = np.sqrt(np.mean(np.square(torques), axis=0))
        self.torque += 1e-3 * model.dof_M0  # of a joint without load or gravity
        self.touches = touches or _may_rest_on_ground(model)

    def __call__(self, joint: int) -> tuple[float, float, float, float]:
        """Speed (rms), fastest, lowest and highest position of a joint."""
        q = self.states[:, self.model.jnt_qposadr[joint]]
        v = self.states[:, self.model.nq + self.model.jnt_dofadr[joint]]
        low, high = np.quantile(q, [0.005, 0.995])
        return (
            float(np.sqrt(np.mean(v**2))), float(np.quantile(np.abs(v), 0.99)),
            float(low), float(high),
        )  # fmt: skip


def _may_rest_on_ground(model) -> bool:
    """Whether something floats and the world has something to touch."""
    fixed = model.body_weldid[model.geom_bodyid] == 0
    solid = (model.geom_contype | model.geom_conaffinity) > 0
    return bool((fixed & solid).any() and (model.jnt_type == 0).any())


def summarize_actuators(
    simulator: Simulator, states: StateReconstruction, joints
) -> tuple[Actuator, ...]:
    """The actuators, and how the recordings use them."""
    model, found = simulator.compiler.nominal, []
    by_id = {j.id: j for j in joints}
    for a in range(model.nu):
        at_joint = model.actuator_trntype[a] in (0, 1)
        joint = by_id.get(int(model.actuator_trnid[a, 0])) if at_joint else None
        found.append(_summarize_actuator(simulator, states, a, joint))
    return tuple(found)


def _summarize_actuator(
    simulator: Simulator, states: StateReconstruction, a: int, joint
) -> Actuator:
    model = simulator.compiler.nominal
    gain, bias = model.actuator_gainprm[a], model.actuator_biasprm[a]
    servo = bool(
        joint is not None and model.actuator_biastype[a] == 1 and bias[1] < 0
        and abs(bias[1] + gain[0]) < 1e-6 * gain[0]
    )  # fmt: skip
    gear = abs(float(model.actuator_gear[a, 0]))
    most, rates = 0.0, []
    for i, episode in enumerate(simulator.episodes):
        at = np.arange(
            0,
            int(episode.sample_steps[-1]),
            max(1, int(episode.sample_steps[-1]) // 300),
        )
        qpos, qvel = states(i, at)
        u = episode.ctrl[np.minimum(at, len(episode.ctrl) - 1), a]
        force = gain[0] * u
        if joint is not None:
            force = (
                force
                + bias[0]
                + gear * (bias[1] * qpos[:, joint.qpos] + bias[2] * qvel[:, joint.dof])
            )
        if len(force):
            most = max(most, float(np.quantile(np.abs(force), 0.99)))
        if len(u) > 1:
            steps = np.abs(np.diff(episode.ctrl[:, a])) / simulator.timestep
            rates.append(float(np.quantile(steps, 0.95)))
    speed = joint.speed if joint is not None else 1.0
    return Actuator(
        a, model.actuator(a).name, -1 if joint is None else joint.dof,
        -1 if joint is None else joint.qpos, servo, max(most * gear, 1e-9),
        max([2 * speed, *rates]), "rad" if joint is None else joint.unit,
        joint is not None and joint.measured,
    )  # fmt: skip
