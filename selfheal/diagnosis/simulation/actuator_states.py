"""States of actuators: takes past commands and readings, gives what they came to."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate

import mujoco
import numpy as np

from ...recording import find_controls
from ...recording.actuator_laws import find_goal
from ...recording.data import Floats
from ..data.episodes import SampledEpisode
from ..data.segments import Segments
from ..effects.commands import CommandGrid, delay_column, limit_rate_of_column
from ..effects.controller.servo import SETTLED, IntegralAction, IntegratorPlace
from ..effects.places import ActuatorPlace, actuator_place
from .batch import Hypotheses
from .commands import transform_commands
from .model_variants import ModelVariant
from .system import RecordedSystem

# mjtDyn: integrator; filter, filterexact; pid
DYN_INTEGRATOR, DYN_FILTERS, DYN_PID = 1, (2, 3), 6
MIN_TIME_CONSTANT = 1e-9  # [s] of a filter; chosen: against division by 0
# [s] of an episode whose motion tells the load that a servo's integral bears, and how
# many moments of it are looked at; chosen: a robot that had settled is about at rest
SETTLED_SECONDS, SETTLED_MOMENTS = 0.5, 25


def compute_activations(
    system: RecordedSystem, hypotheses: Hypotheses, segments: Segments
) -> Floats | None:
    """Activations to which filters and integrators of commands have come.

    An integrator begins at 0 with an episode whose initial state is given, as in
    MuJoCo; elsewhere it begins where its actuator then is.

    Returns:
        (N, na), N = n W, all segments of a hypothesis in a row; None where no actuator
        has an activation.
    """
    model, n = hypotheses.variant.model, len(hypotheses.models)
    if not model.na:
        return None
    integrates = (model.actuator_dyntype == DYN_INTEGRATOR).any()
    out = np.zeros((n, len(segments), model.na))
    for i in np.unique(segments.episode):
        rows = np.flatnonzero(segments.episode == i)
        episode = system.episodes[i]
        begin = np.zeros(model.nactuator)
        if episode.qpos0 is None and integrates:
            begin = _actuator_lengths(system, int(i))
        past = filter_commands(model, episode.ctrl, system.timestep, begin)
        at = np.minimum(segments.first_step[rows], len(past) - 1)
        out[:, rows] = past[at]
        for first, states in _follow_pids(system, hypotheses, episode).items():
            columns = first + np.arange(states.shape[-1])
            out[:, rows[:, None], columns] = states[:, at]
    return out.reshape(-1, model.na)


def fill_histories(
    system: RecordedSystem, model: mujoco.MjModel, segments: Segments
) -> Floats | None:
    """Buffers of the past commands to actuators with a delay.

    Before an episode's first sample, its first command was given (contract, section
    2).

    Args:
        model: a variant of the given model, compiled.

    Returns:
        (W, nhistory); None where no actuator has a delay.
    """
    if not model.nhistory:
        return None
    out = np.empty((len(segments), model.nhistory))
    for w in range(len(segments)):
        data = mujoco.MjData(model)
        ctrl = system.episodes[int(segments.episode[w])].ctrl
        for a in range(model.nactuator):
            size = int(model.actuator_history[a, 0])
            if size:
                past = int(segments.first_step[w]) + np.arange(-size, 0)
                sent = ctrl[np.clip(past, 0, len(ctrl) - 1)][:, find_controls(model, a)]
                values = np.ascontiguousarray(sent)
                mujoco.mj_initCtrlHistory(model, data, a, None, values)
        out[w] = data.history
    return out


def integrate_servo_errors(
    system: RecordedSystem,
    hypotheses: Hypotheses,
    segments: Segments,
) -> dict[int, Floats]:
    """Integrate the errors of servos with an integral up to where segments begin.

    Returns:
        (N) [rad s] by actuator, N = n W, all segments of a hypothesis in a row.
    """
    errors = {}
    for term, values in zip(hypotheses.terms, hypotheses.term_values, strict=True):
        for place in term.places:
            if isinstance(place, IntegratorPlace):
                bounds = IntegralAction.max_integral(values)
                servo = _IntegratingServo(system, hypotheses.variant, place)
                each = zip(hypotheses.models, values[:, 0], bounds, strict=True)
                errors[place.actuator] = np.concatenate(
                    [servo.integrate(segments, *hypothesis) for hypothesis in each]
                )
    return errors


@dataclass(frozen=True)
class _IntegratingServo:
    """A servo that integrates its error, at a place in the given model."""

    system: RecordedSystem
    variant: ModelVariant
    place: IntegratorPlace

    def integrate(
        self, segments: Segments, model: mujoco.MjModel, gain: float, bound: float
    ) -> Floats:
        """Integrated error where segments begin, under one hypothesis.

        It begins at 0 with an episode. Where the servo had settled before, it begins
        with what the first motion needs beside the servo's other torque.

        Args:
            gain: of the integral [N m/(rad s)].
            bound: largest integrated error [rad s], either way.

        Returns:
            (W) [rad s].
        """
        system, place = self.system, self.place
        total = np.zeros(len(segments))
        is_settled = place.begins == SETTLED and gain > 0
        integrated = segments.episode[(segments.first_step > 0) | is_settled]
        for episode in np.unique(integrated):
            rows = np.flatnonzero(segments.episode == episode)
            added = self.system.cache.load_or_compute(
                segments,
                ("servo errors", place.actuator, episode),
                partial(_servo_errors, system, system.episodes[episode], place),
            )
            begin = 0.0
            if is_settled:
                at = _first_steps(system, episode)
                torque = self._required_torque(segments, model, episode, at)
                begin = torque / gain - np.cumsum(added[: 1 + at[-1]]).mean()
                begin = min(max(begin, -bound), bound)
            past = _accumulate_clipped(added, begin, -bound, bound)
            total[rows] = past[np.minimum(segments.first_step[rows], len(past) - 1)]
        return total

    def _required_torque(
        self, segments: Segments, model: mujoco.MjModel, episode: int, at: np.ndarray
    ) -> float:
        """Mean torque that a motion needs beside what the actuators give.

        That is tau = M(q) qacc + c(q, qvel) - tau_actuator, by MuJoCo's inverse
        dynamics.

        Args:
            segments: to which the cached motion belongs.
            at: (K) steps of its grid.

        Returns:
            Its mean over the K steps [N m or N].
        """
        variant = self.variant
        dof = self.place.renumber(variant).dof
        motion = self.system.cache.load_or_compute(
            segments,
            ("first motion", episode),
            partial(_estimate_motion, self.system, episode, at),
        )
        data, torques = mujoco.MjData(model), []
        for k, qpos, qvel, qacc in zip(at, *motion, strict=True):
            data.qpos[variant.qpos], data.qvel[variant.dof] = qpos, qvel
            data.qacc[variant.dof] = qacc
            data.ctrl[:] = self.system.episodes[episode].ctrl[k]
            mujoco.mj_inverse(model, data)
            mujoco.mj_fwdActuation(model, data)
            torques.append(data.qfrc_inverse[dof] - data.qfrc_actuator[dof])
        return float(np.mean(torques))


def _estimate_motion(
    system: RecordedSystem, episode: int, at: np.ndarray
) -> tuple[Floats, Floats, Floats]:
    """Position (K, nq), velocity and acceleration (K, nv) at steps `at` (K)."""
    state = system.complete_state(episode, at)
    qpos, qvel = state.qpos, state.qvel
    if len(at) == 1:
        return qpos, qvel, 0 * qvel
    return qpos, qvel, np.gradient(qvel, at * system.timestep, axis=0)


def _actuator_lengths(system: RecordedSystem, episode: int) -> Floats:
    """Lengths (nactuator) of the actuators where an episode begins [rad or m]."""
    model = system.compiler.nominal
    data = mujoco.MjData(model)
    data.qpos[:] = system.complete_state(episode, np.zeros(1)).qpos[0]
    mujoco.mj_fwdPosition(model, data)
    return np.array(data.actuator_length[model.actuator_outadr])


def filter_commands(
    model: mujoco.MjModel, ctrl: Floats, step: float, begin: Floats
) -> Floats:
    """Activations along a grid of commands, by MuJoCo's first-order dynamics.

    A filter follows w[k+1] = u[k] + (w[k] - u[k]) exp(-h / tau), an integrator
    w[k+1] = w[k] + h u[k] within its range (MuJoCo, actuation model).

    Args:
        ctrl: (G, nu) commands of each step.
        step: of the grid [s].
        begin: (nactuator) with which integrators begin.

    Returns:
        (G, na).
    """
    out = np.zeros((len(ctrl), model.na))
    for a in range(model.nactuator):
        first = int(model.actuator_actadr[a])
        dynamics = model.actuator_dyntype[a]
        has_one = model.actuator_ctrlnum[a] == 1  # not an integrated orientation
        if first < 0 or not has_one or dynamics not in (DYN_INTEGRATOR, *DYN_FILTERS):
            continue
        u = ctrl[:, model.actuator_ctrladr[a]]
        if dynamics == DYN_INTEGRATOR:
            low, high = -np.inf, np.inf
            if model.actuator_actlimited[a]:
                low, high = model.actuator_actrange[a]
            added = (u[:-1] * step).tolist()
            out[:, first] = _accumulate_clipped(added, float(begin[a]), low, high)
            continue
        time_constant = max(float(model.actuator_dynprm[a, 0]), MIN_TIME_CONSTANT)
        decay = np.exp(-step / time_constant)
        activation = u[0]
        for k in range(len(ctrl)):
            out[k, first] = activation
            activation = u[k] + (activation - u[k]) * decay
    return out


def _follow_pids(
    system: RecordedSystem, hypotheses: Hypotheses, episode: SampledEpisode
) -> dict[int, Floats]:
    """States of each <pid> with any, by the address of its first one.

    A state is its goal where that is slow, or its summed error. The goal begins with
    the first command. The sum begins at 0, and stays there where the joint is not read.

    Returns:
        (1 or n, G, states) of each.
    """
    model, step, found = hypotheses.models[0], system.timestep, {}
    for a in np.flatnonzero(model.actuator_dyntype == DYN_PID).tolist():
        states = []
        ctrl = transform_commands(
            hypotheses.terms, hypotheses.term_values, episode, CommandGrid(step)
        )
        late = np.array([[model.actuator_delay[a] / step]])
        goal = delay_column(ctrl[..., find_goal(model, a)], late)
        most, rate = model.actuator_dynprm[a, :2]  # imax, slewmax; 0: none
        if rate > 0:
            goal = limit_rate_of_column(goal, np.full(len(goal), rate * step))
            states.append(np.concatenate([goal[:, :1], goal[:, :-1]], axis=1))
        if model.actuator_gainprm[a, 0]:
            place = actuator_place(system.compiler.nominal, a)
            error = goal - place.gear * _read_joint(system, episode, place)
            bound = most if most > 0 else np.inf
            added = (_add_up(each[:-1], step) for each in error)
            sums = [_accumulate_clipped(x, 0.0, -bound, bound) for x in added]
            states.append(np.array(sums))
        found[int(model.actuator_actadr[a])] = np.stack(states, axis=-1)
    return found


def _accumulate_clipped(
    added: Sequence[float], begin: float, low: float, high: float
) -> Floats:
    """Sums (G + 1) of what is added (G), each clipped to its bounds before the next."""
    sums = accumulate(added, lambda s, x: min(max(s + x, low), high), initial=begin)
    return np.fromiter(sums, float)


def _first_steps(system: RecordedSystem, episode: int) -> np.ndarray:
    """Steps of the grid in an episode's first moments; the first, if it is given."""
    sampled = system.episodes[episode]
    last = min(SETTLED_SECONDS / system.timestep, len(sampled.ctrl) - 1)
    last = last * (sampled.qpos0 is None)
    return np.unique(np.linspace(0, last, SETTLED_MOMENTS).astype(int))


def _servo_errors(
    system: RecordedSystem, episode: SampledEpisode, place: ActuatorPlace
) -> list[float]:
    """What each step (G) adds to a servo's integrated error [rad s].

    That is h (command - position), with the position as it was read.
    """
    read = _read_joint(system, episode, place)
    return _add_up(episode.ctrl[:, place.goal] - read, system.timestep)


def _add_up(error: Floats, step: float) -> list[float]:
    """What an error (G) adds to its integral in each step; nothing where it is NaN."""
    return (np.where(np.isfinite(error), error, 0.0) * step).tolist()


def _read_joint(
    system: RecordedSystem, episode: SampledEpisode, place: ActuatorPlace
) -> Floats:
    """Position (G) of an actuator's joint as it was read; NaN where it was not."""
    grid = np.arange(len(episode.ctrl), dtype=float)
    model = system.compiler.nominal
    joint = [j for j in range(model.njnt) if model.jnt_qposadr[j] == place.qpos]
    read = [("joint_position", model.joint(j).name) for j in joint]
    for c in system.channels:
        if (c.kind, c.target) in read:
            return episode.interpolate(grid, system.timestep)[0][:, c.first_column]
    return np.full(len(grid), np.nan)
