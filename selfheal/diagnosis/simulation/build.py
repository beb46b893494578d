"""Simulators: takes a model and recordings, gives a simulator and a robot's summary."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from mujoco import rollout

from ...recording import (
    Episode,
    Recording,
    find_controls,
    find_output,
    reorder_commands,
    strip_window,
)
from ...recording.actuator_laws import find_goal, get_servo_gains, list_control_gains
from ...recording.data import Floats
from ..data.base_motion import BaseMotion, estimate_base_motion
from ..data.episodes import SampledEpisode, build_channels, sample_episode
from ..data.robot_summary import (
    MIN_SPEED,
    Actuator,
    Channel,
    Joint,
    MovingBody,
    RobotSummary,
    summarize_bodies,
    summarize_joints,
)
from ..data.segments import cut_segments
from ..data.state_estimate import estimate_state
from .model_variants import ModelCompiler
from .simulator import Simulator

MEASURED_MOMENTS = 7  # of an episode, at which a state is measured or not; chosen
MEASURED_SHARE = 0.5  # of these, in which a state has to be measured; chosen: most
MOTION_MOMENTS = 600  # of all episodes, over which motion is averaged; chosen
COMMAND_MOMENTS = 300  # of an episode, over which commands are averaged; chosen
# [rad/s^2 or m/s^2] of a joint's inertia, whose torque is added to the typical one;
# chosen: not zero for a joint without load or gravity
MIN_TYPICAL_ACCELERATION = 1e-3
RANGE_QUANTILES = (0.005, 0.995)  # of positions, for a range; chosen: no outlier
# of a robot's motion, its last part, and of the positions there, for their range;
# chosen: what changed stays so, but for a jolt
LATE_SHARE, LATE_QUANTILES = 0.25, (0.05, 0.95)
PEAK_QUANTILE = 0.99  # of speeds and forces, for the largest; chosen: no outlier
RATE_QUANTILE = 0.95  # of a command's rates, for the largest; chosen: no outlier
SERVO_GAIN_TOLERANCE = 1e-6  # between a servo's gain and its bias [1]; chosen: rounding
MIN_FORCE = 1e-9  # [N m or N] of an actuator that was never used; chosen: not zero


def build_simulator(
    compiler: ModelCompiler,
    recordings: Sequence[Recording],
    whole: Sequence[Recording] = (),
    fitted: Sequence[Channel] = (),
) -> Simulator:
    """Build the simulator of recordings that fit a model.

    Args:
        whole: recordings of which these are parts, in whose order episodes are
            numbered; none: these themselves.
        fitted: channels of the data that are fitted, whose columns these have, too,
            whatever is read here; none: every signal that is read has one.
    """
    model = compiler.nominal
    channels = build_channels(recordings)
    if fitted:
        read = {c.name: c for c in channels}
        channels = tuple(
            replace(read.get(c.name, c), first_column=c.first_column) for c in fitted
        )
    has_files = len(recordings) > 1
    names = [(r.file, name) for r in whole or recordings for name in r.episodes]
    episodes = []
    for r in recordings:
        for name, e in r.episodes.items():
            id_ = f"{r.file}:{name}" if has_files else name
            sampled = sample_with_base(id_, e, channels, model)
            part, of_whole = (r.file, name), (r.file, strip_window(name))
            number = names.index(part if part in names else of_whole)
            episodes.append(replace(sampled, number=number))
    return Simulator(compiler, channels, tuple(episodes), float(model.opt.timestep))


def sample_with_base(
    name: str, episode: Episode, channels: tuple[Channel, ...], model: mujoco.MjModel
) -> SampledEpisode:
    """Put an episode on the grid of a model's steps, with the motion of its base.

    Args:
        episode: of a recording that fits the model.
        channels: of which its readings are taken.
    """
    step = float(model.opt.timestep)
    sampled = sample_episode(name, reorder_commands(episode, model), channels, step)
    return replace(sampled, base=_estimate_base_motion(model, channels, sampled, step))


def _estimate_base_motion(
    model: mujoco.MjModel,
    channels: tuple[Channel, ...],
    episode: SampledEpisode,
    step: float,
) -> BaseMotion | None:
    """Estimate the motion of a floating base that no sensor of poses reads.

    Args:
        step: of the simulation [s].
    """
    if not (model.jnt_type == 0).any():  # mjtJoint: free
        return None
    at = episode.sample_steps
    qpos, qvel, _ = estimate_state(model, channels, episode, at, step, {})
    return estimate_base_motion(
        model, channels, episode.readings, qpos, qvel, at * step
    )


def summarize_robot(simulator: Simulator) -> RobotSummary:
    """Summarize the robot, and how its recordings use it."""
    model = simulator.compiler.nominal
    states = StateReconstruction(simulator)
    motion = _MotionStatistics(simulator, states)
    measured = {
        j for j in range(model.njnt) if states.is_measured[model.jnt_qposadr[j]]
    }
    joints = summarize_joints(model, motion.torque, motion, measured)
    bodies = tuple(
        body
        for body in summarize_bodies(model)
        if motion.has_contact or _shows(body, model, simulator.channels)
    )
    return RobotSummary(
        model,
        simulator.timestep,
        simulator.channels,
        joints,
        summarize_actuators(simulator, states, joints),
        bodies,
        motion.has_contact,
        cut_segments(simulator.episodes, None).is_single_readings,
    )


def _shows(
    body: MovingBody, model: mujoco.MjModel, channels: Sequence[Channel]
) -> bool:
    """Whether a body that touches nothing has mass, a site, or readings of its own."""
    read = {c.target for c in channels if c.kind.startswith("body")}
    return bool(
        body.subtree_mass or (model.site_bodyid == body.id).any() or body.name in read
    )


class StateReconstruction:
    """The robot's state: as measured or, where nothing measures it, as simulated.

    Attributes:
        is_measured: (nq) whether readings give a position most of the time.
        is_known: (nq) whether they do, or a closed loop does from others.
    """

    def __init__(self, simulator: Simulator) -> None:
        model = simulator.compiler.nominal
        positions = [np.full((1, model.nq), np.nan)]
        known = [np.zeros((1, model.nq), bool)]
        for i, episode in enumerate(simulator.episodes):
            at = spread_moments(episode.sample_steps[-1])
            known.append(simulator.complete_state(i, at).is_known)
            positions.append(
                estimate_state(
                    model, simulator.channels, episode, at, simulator.timestep, {}
                )[0]
            )
        share = np.isfinite(np.vstack(positions)).mean(axis=0)
        self.is_measured = share >= MEASURED_SHARE
        self.is_known = np.vstack(known).mean(axis=0) >= MEASURED_SHARE
        qpos_of_dof = [model.jnt_qposadr[j] for j in model.dof_jntid]
        self._simulator = simulator
        self._is_rate_known = self.is_known[qpos_of_dof]
        self._simulated: dict[int, Floats] = {}

    def __call__(self, episode: int, at: np.ndarray) -> tuple[Floats, Floats]:
        """Positions (W, nq) and velocities (W, nv) at times `at` (W) [steps]."""
        state = self._simulator.complete_state(episode, at)
        qpos, qvel = state.qpos, state.qvel
        if not self.is_known.all():
            path = self._simulate_path(episode)
            path = path[np.minimum(at, len(path) - 1)]
            nq = qpos.shape[1]
            qpos = np.where(self.is_known, qpos, path[:, :nq])
            qvel = np.where(self._is_rate_known, qvel, path[:, nq:])
        return qpos, qvel

    def _simulate_path(self, episode: int) -> Floats:
        """Positions and velocities (G, nq + nv) of the given model, open loop."""
        if episode not in self._simulated:
            simulator = self._simulator
            model = simulator.compiler.nominal
            data = mujoco.MjData(model)
            first = simulator.complete_state(episode, np.zeros(1, int))
            data.qpos[:], data.qvel[:] = first.qpos[0], first.qvel[0]
            kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
            state = np.empty(mujoco.mj_stateSize(model, kind))
            mujoco.mj_getState(model, data, state, kind)
            control = simulator.episodes[episode].ctrl[None]
            path = rollout.rollout(model, data, state[None], control)[0][0]
            path = np.vstack([state, path])[:-1, 1 : 1 + model.nq + model.nv]
            self._simulated[episode] = np.nan_to_num(path)
        return self._simulated[episode]


def spread_moments(last: float) -> Floats:
    """Times (MEASURED_MOMENTS) [steps], evenly between an episode's first and last."""
    return np.linspace(0, last, MEASURED_MOMENTS + 2)[1:-1]


class _MotionStatistics:
    """How the robot moved, at some hundred moments.

    Attributes:
        torque: (nv) typical, as weight and motion ask for it [N m or N].
        has_contact: whether anything touches something.
    """

    def __init__(self, simulator: Simulator, states_of: StateReconstruction) -> None:
        model = simulator.compiler.nominal
        self._model = model
        states, torques, has_contact = [], [], False
        data = mujoco.MjData(model)
        count = max(2, MOTION_MOMENTS // len(simulator.episodes))
        for i, episode in enumerate(simulator.episodes):
            at = np.linspace(0, episode.sample_steps[-1], count).astype(int)
            qpos, qvel = states_of(i, at)
            ctrl = episode.ctrl[np.minimum(at, len(episode.ctrl) - 1)]
            for q, v, u in zip(qpos, qvel, ctrl, strict=True):
                data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, u
                mujoco.mj_forward(model, data)
                torques.append(np.abs(data.qfrc_bias) + np.abs(data.qfrc_actuator) / 2)
                has_contact |= bool(data.ncon)
            states.append(np.hstack([qpos, qvel]))
        self._states = np.vstack(states)
        self.torque: Floats = np.sqrt(np.mean(np.square(torques), axis=0))
        self.torque += MIN_TYPICAL_ACCELERATION * model.dof_M0
        self.has_contact = has_contact or _may_rest_on_ground(model)

    def __call__(self, joint: int) -> tuple[float, ...]:
        """Speed (effective, largest), lowest and highest position, ever and late."""
        q = self._states[:, self._model.jnt_qposadr[joint]]
        v = self._states[:, self._model.nq + self._model.jnt_dofadr[joint]]
        late = q[-int(np.ceil(LATE_SHARE * len(q))) :]
        return (
            float(np.sqrt(np.mean(v**2))),
            float(np.quantile(np.abs(v), PEAK_QUANTILE)),
            *np.quantile(q, RANGE_QUANTILES).tolist(),
            *np.quantile(late, LATE_QUANTILES).tolist(),
        )


def _may_rest_on_ground(model: mujoco.MjModel) -> bool:
    """Whether a body floats and the world has a geom to touch."""
    is_fixed = model.body_weldid[model.geom_bodyid] == 0
    is_solid = (model.geom_contype | model.geom_conaffinity) > 0
    return bool((is_fixed & is_solid).any() and (model.jnt_type == 0).any())


def summarize_actuators(
    simulator: Simulator, states: StateReconstruction, joints: Sequence[Joint]
) -> tuple[Actuator, ...]:
    """Summarize the actuators, and how the recordings use them."""
    model, actuators = simulator.compiler.nominal, []
    by_id = {j.id: j for j in joints}
    for a in range(model.nactuator):
        at_joint = model.actuator_trntype[a] in (0, 1)  # mjtTrn: joint, jointinparent
        joint = by_id.get(int(model.actuator_trnid[a, 0])) if at_joint else None
        actuators.append(_summarize_actuator(simulator, states, a, joint))
    return tuple(actuators)


def _summarize_actuator(
    simulator: Simulator, states: StateReconstruction, a: int, joint: Joint | None
) -> Actuator:
    """Summarize an actuator, by MuJoCo's force = gain . ctrl + b0 + b1 l + b2 dl/dt.

    Args:
        joint: that it drives; None: no hinge or slide.
    """
    model = simulator.compiler.nominal
    gains, bias = list_control_gains(model, a), model.actuator_biasprm[a]
    goal, (kp, _) = find_goal(model, a), get_servo_gains(model, a)
    is_same_gain = abs(bias[1] + kp) < SERVO_GAIN_TOLERANCE * kp
    servo = bool(model.actuator_biastype[a] == 1 and goal >= 0 and is_same_gain)
    controls = find_controls(model, a)
    moving = controls if goal < 0 else (goal,)
    gear = abs(float(model.actuator_gear[find_output(model, a), 0]))
    max_force, rates, speeds = 0.0, [0.0], [np.zeros(0)]
    for i, episode in enumerate(simulator.episodes):
        last = int(episode.sample_steps[-1])
        at = np.arange(0, last, max(1, last // COMMAND_MOMENTS))
        length, velocity = _transmission_motion(model, a, joint, *states(i, at))
        u = episode.ctrl[np.minimum(at, len(episode.ctrl) - 1)][:, controls]
        force = (gains * u).sum(axis=1) + bias[0]
        force += bias[1] * length + bias[2] * velocity
        if len(force):
            max_force = max(max_force, float(np.quantile(np.abs(force), PEAK_QUANTILE)))
        if len(u) > 1:
            changes = np.abs(np.diff(episode.ctrl[:, moving], axis=0))
            rate = np.quantile(changes / simulator.timestep, RATE_QUANTILE, axis=0)
            rates += rate.tolist()
        speeds.append(velocity)
    velocities = np.concatenate(speeds)
    moved = float(np.sqrt(np.mean(velocities**2))) if len(velocities) else 0.0
    # of what is commanded per unit of length, where that is a position
    scale = float(-bias[1] / gains[controls.index(goal)]) if goal >= 0 else 1.0
    rates.append(2 * moved * scale if moved > 0 else 2.0)
    return Actuator(
        id=a,
        name=model.actuator(a).name,
        dof=-1 if joint is None else joint.dof,
        qpos=-1 if joint is None else joint.qpos,
        servo=servo,
        max_force=max(max_force * gear, MIN_FORCE),
        speed=max(moved / (gear or 1.0), MIN_SPEED),
        max_rate=max(rates),
        unit=_driven_unit(model, a) if joint is None else joint.unit,
        measured=joint is not None and joint.measured,
    )


def _transmission_motion(
    model: mujoco.MjModel, a: int, joint: Joint | None, qpos: Floats, qvel: Floats
) -> tuple[Floats, Floats]:
    """Lengths and velocities (W) of an actuator, by MuJoCo's actuator_length.

    Args:
        joint: that it drives; None: no hinge or slide.
        qpos: (W, nq).
        qvel: (W, nv).
    """
    output = find_output(model, a)
    if joint is not None:
        gear = model.actuator_gear[output, 0]
        return gear * qpos[:, joint.qpos], gear * qvel[:, joint.dof]
    data, found = mujoco.MjData(model), np.zeros((2, len(qpos)))
    for k, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found[:, k] = data.actuator_length[output], data.actuator_velocity[output]
    return found[0], found[1]


def _driven_unit(model: mujoco.MjModel, a: int) -> str:
    """Unit of what an actuator without a hinge or slide moves, "rad" or "m"."""
    if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_TENDON:
        tendon = int(model.actuator_trnid[a, 0])
        first = int(model.tendon_adr[tendon])
        if model.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT:  # a fixed tendon
            joint = int(model.wrap_objid[first])
            return "m" if model.jnt_type[joint] == 2 else "rad"
        return "m"
    gear = model.actuator_gear[find_output(model, a)]
    return "m" if gear[:3].any() else "rad"
