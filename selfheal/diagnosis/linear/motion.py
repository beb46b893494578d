"""Measured motion: what was read of joints at many moments, and its noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import Channel
from ..data.segments import Segments
from ..effects.base import Term
from ..simulation.batch import BatchState
from ..simulation.initial_states import InitialStates
from ..simulation.simulator import Simulator
from .quartics import Quartics, fit_quartics
from .weak_form import average_derivatives

NOISE_WINDOWS = 1000  # of which noise is drawn: its variance is known within 5 %
ROUNDING_SHARE = 1e-9  # of variances, which keeps their logarithms finite
CHI_SQUARE_MEDIAN = 0.4549  # of one degree of freedom
MAX_KNOWN = 200  # derivatives of signals at some delay, kept at once
MAX_READINGS = 16  # of all signals, kept at once
MOMENTS_PER_WINDOW = 8  # so that a command held for a sample counts by its mean

# value, slope and curvature, and their variances by noise
Derivatives = tuple[Floats, Floats]


@dataclass(frozen=True, eq=False)
class Readings:
    """What joints did at W moments, as some hypothesis takes their signals.

    Attributes:
        offset: (W, 2 nv) from the states that a simulation begins at to those of the
            polynomials [rad or m, and per s].
        position: (W, J) [rad or m].
        velocity: (W, J) [rad/s or m/s].
        acceleration: (W, J) [rad/s^2 or m/s^2].
        missed: (R, J, 3) by how much means of position, velocity and acceleration of a
            window are larger than those of its moments.
        gain: (W, J) [1] from an acceleration to what is read of it.
        mismatch: (R, K) mean velocity read less mean slope of the positions, as it is
            read [rad/s or m/s].
    """

    offset: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    missed: Floats
    gain: Floats
    mismatch: Floats


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """What was read of W moments, in R windows of them.

    Attributes:
        simulator: of the recordings.
        joints: (J) whose positions are read, by id.
        moments: W segments that begin there.
        half_widths: of each signal's polynomials [samples].
        windows: (R, k) moments of each window.
        weights: (k) of the moments in a window, 1 in sum.
        noise: (J, 3, 3) covariance of the noise of a window's mean position, velocity
            and acceleration.
        speed_noise: (J) standard deviation of the noise of a moment's velocity [rad/s
            or m/s].
    """

    simulator: Simulator
    joints: tuple[int, ...]
    moments: Segments
    half_widths: Mapping[str, int]
    windows: np.ndarray
    weights: Floats
    noise: Floats
    speed_noise: Floats
    _quartics: dict[tuple[str, int], Quartics] = field(default_factory=dict)
    _known: dict[tuple, Derivatives] = field(default_factory=dict)
    _readings: dict[str, Readings] = field(default_factory=dict)
    _parts: dict[bytes, "MeasuredMotion"] = field(default_factory=dict)
    _doubts: dict[str, Floats] = field(default_factory=dict)

    @cached_property
    def dofs(self) -> np.ndarray:
        """(J) indices of the joints' velocities."""
        model = self.simulator.compiler.nominal
        return np.array([model.jnt_dofadr[j] for j in self.joints], int)

    @cached_property
    def width(self) -> int:
        """Errors of a window: J torques and K velocities."""
        return len(self.joints) + self.read({}).mismatch.shape[1]

    @cached_property
    def follows(self) -> np.ndarray:
        """(R) whether a window follows the one before it in the same episode."""
        episode = self.moments.episode[self.windows[:, 0]]
        return np.append(False, episode[1:] == episode[:-1])

    def select(self, rows: np.ndarray) -> "MeasuredMotion":
        """The motion in windows `rows` (r); the same object again for the same rows."""
        key = rows.tobytes()
        if key not in self._parts:
            used, windows = np.unique(self.windows[rows], return_inverse=True)
            self._parts[key] = replace(
                self,
                moments=self.moments.select(used),
                windows=windows.reshape(len(rows), -1),
                _known={},
                _readings={},
                _parts={},
            )
        return self._parts[key]

    def find_active_terms(self, terms: Sequence[Term]) -> np.ndarray:
        """(R, T) whether each term holds in most of each window."""
        middles = self.windows[:, MOMENTS_PER_WINDOW // 2]
        return self.simulator.find_active_terms(terms, self.moments.select(middles))

    def average(self, values: Floats) -> Floats:
        """(..., R, J) means over the windows of values (..., W, J) at the moments."""
        return np.einsum("...rkj,k->...rj", values[..., self.windows, :], self.weights)

    def with_noise(self, rng: np.random.Generator) -> "MeasuredMotion":
        """The motion that knows its noise.

        By more noise of the readings' size, which `rng` draws, of a number of windows.
        """
        draws = -(-NOISE_WINDOWS // len(self.windows))
        each = [self._draw_noise(rng) for _ in range(draws)]
        changes = np.concatenate([c for c, _ in each])
        out = np.einsum("rjk,rjl->jkl", changes, changes) / len(changes)
        size = np.einsum("jkk->jk", out).mean(axis=0)
        out += ROUNDING_SHARE * np.diag(size + np.finfo(float).tiny)
        speeds = np.concatenate([speed for _, speed in each])
        return replace(self, noise=out, speed_noise=np.sqrt((speeds**2).mean(axis=0)))

    def _draw_noise(self, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Changes by more noise.

        Returns:
            (R, J, 3) of a window's mean position, velocity and acceleration, and (W, J)
            of a moment's velocity.
        """
        simulator = self.simulator
        size = np.concatenate([c.noise for c in simulator.channels])
        episodes = tuple(
            replace(e, readings=e.readings + size * rng.normal(size=e.readings.shape))
            for e in simulator.episodes
        )
        noisy = replace(
            self,
            simulator=replace(simulator, episodes=episodes),
            _quartics={},
            _known={},
            _readings={},
            _parts={},
        )
        ours, theirs = self.read({}), noisy.read({})
        moved = [
            getattr(theirs, name) - getattr(ours, name)
            for name in ("position", "velocity", "acceleration")
        ]
        change = np.stack([self.average(x) for x in moved], axis=-1)
        return change + theirs.missed - ours.missed, moved[1]

    @cached_property
    def given(self) -> BatchState:
        """States (W) that a simulation of the given model begins at."""
        simulator, moments = self.simulator, self.moments
        hypotheses = simulator.build_hypotheses([], np.zeros((1, 0)), centered=False)
        states = InitialStates(simulator, hypotheses, moments)
        found, variant = states.compute(None), hypotheses.variant
        qpos, qvel = found.qpos[:, variant.qpos], found.qvel[:, variant.dof]
        return replace(found, qpos=qpos, qvel=qvel)

    def read(self, changes: Mapping[str, Mapping[str, float]]) -> Readings:
        """What joints did if their signals are changed.

        Args:
            changes: by signal, its "gain" [1], "bias" [unit] and "delay" [s].
        """
        key = repr(changes)  # most hypotheses change readings alike
        if key not in self._readings:
            if len(self._readings) >= MAX_READINGS:
                self._readings.clear()
            self._readings[key] = _read_joints(self, changes)
        return self._readings[key]


def _differentiate(
    motion: MeasuredMotion, channel: Channel, delay: float
) -> Derivatives:
    """Derivatives (3, W) of a signal at moments, [s] later, and variances (3, W)."""
    moments, step = motion.moments, motion.simulator.timestep
    out, variance = np.empty((2, 3, len(moments)))
    for i in np.unique(moments.episode):
        key = channel.name, int(i)
        if key not in motion._quartics:
            episode = motion.simulator.episodes[i]
            motion._quartics[key] = fit_quartics(
                episode.sample_steps * step,
                episode.readings[:, channel.first_column],
                motion.half_widths[channel.name],
            )
        rows = np.flatnonzero(moments.episode == i)
        times = moments.first_step[rows] * step
        out[:, rows], variance[:, rows] = motion._quartics[key].differentiate(
            times, delay
        )
    return out, variance * float(channel.noise[0]) ** 2


def _average(motion: MeasuredMotion, channel: Channel, delay: float) -> Derivatives:
    """Means (3, R) of a signal's derivatives in windows, [s] later, and variances."""
    moments, step = motion.moments, motion.simulator.timestep
    ends = moments.first_step[motion.windows[:, [0, -1]]] * step
    centers = ends.mean(axis=1) + delay
    count = MOMENTS_PER_WINDOW
    half = float(np.diff(ends).max(initial=step)) * (count + 1) / (count - 1) / 2
    episodes = moments.episode[motion.windows[:, 0]]
    mean, variance = np.empty((2, 3, len(centers)))
    for i in np.unique(episodes):
        rows, episode = np.flatnonzero(episodes == i), motion.simulator.episodes[i]
        mean[:, rows], variance[:, rows] = average_derivatives(
            episode.sample_steps * step,
            episode.readings[:, channel.first_column],
            centers[rows],
            half,
        )
    return mean, variance * float(channel.noise[0]) ** 2


def _read_joints(
    motion: MeasuredMotion, changes: Mapping[str, Mapping[str, float]]
) -> Readings:
    """What joints did at the moments, as `MeasuredMotion.read` has it."""
    simulator, moments = motion.simulator, motion.moments
    model = simulator.compiler.nominal
    signals = {(c.kind, c.target): c for c in simulator.channels}
    state = motion.given
    offset = np.zeros((len(moments), 2 * model.nv))
    positions, velocities, acceleration = (
        np.full((len(moments), len(motion.joints)), np.nan) for _ in range(3)
    )
    means = np.zeros((3, len(motion.windows), len(motion.joints)))
    gain, mismatch = np.ones_like(acceleration), []
    for k, j in enumerate(motion.joints):
        name = model.joint(j).name
        position = signals["joint_position", name]
        change = changes.get(position.name, {})
        (q, v, a), variance = _undo(motion, _differentiate, position, change)
        gain[:, k] = scale = change.get("gain", 1.0)
        mean, spread = _undo(motion, _average, position, change)
        if velocity := signals.get(("joint_velocity", name)):
            change = changes.get(velocity.name, {})
            (speed, slope, _), other = _undo(motion, _differentiate, velocity, change)
            own = change.get("gain", 1.0)
            (fast, turn, _), faith = _undo(motion, _average, velocity, change)
            # beside the noise of both, of which the velocity's alone is as it is read
            size = (faith[0] + spread[1]) / (faith[0] + (own / scale) ** 2 * spread[1])
            mismatch.append(own * (fast - mean[1]) * np.sqrt(size))
            if velocity.name not in motion._doubts:
                motion._doubts[velocity.name] = _measure_doubt(
                    (speed - v, variance[1] + other[0]),
                    (slope - a, variance[2] + other[1]),
                    (fast - mean[1], spread[1] + faith[0]),
                    (turn - mean[2], spread[2] + faith[1]),
                )
            doubt = motion._doubts[velocity.name]
            other, faith = other[:2] + doubt[:2, None], faith[:2] + doubt[2:, None]
            v = _combine(v, variance[1], speed, other[0])
            a = _combine(a, variance[2], slope, other[1])
            mean[1] = _combine(mean[1], spread[1], fast, faith[0])
            mean[2] = _combine(mean[2], spread[2], turn, faith[1])
            gain[:, k] = 1 / _combine(1 / scale, variance[2], 1 / own, other[1])
        means[..., k] = mean
        positions[:, k], velocities[:, k], acceleration[:, k] = q, v, a
        dof = int(model.jnt_dofadr[j])
        offset[:, dof] = q - state.qpos[:, model.jnt_qposadr[j]]
        offset[:, model.nv + dof] = v - state.qvel[:, dof]
    at_moments = motion.average(np.stack([positions, velocities, acceleration]))
    count = len(motion.windows)
    return Readings(
        offset,
        positions,
        velocities,
        acceleration,
        np.moveaxis(means - at_moments, 0, -1),
        gain,
        np.stack(mismatch, axis=1) if mismatch else np.zeros((count, 0)),
    )


def _measure_doubt(*each: tuple[Floats, Floats]) -> Floats:
    """Variances of what a sensor of velocity says beside its noise, by positions.

    It may be late, or filtered: then positions tell the motion.

    Args:
        each: differences, and their variances by noise.
    """
    found = [np.nanmedian(x**2) / CHI_SQUARE_MEDIAN - np.nanmedian(v) for x, v in each]
    return np.maximum(found, 0.0)


def _undo(
    motion: MeasuredMotion,
    compute: Callable[[MeasuredMotion, Channel, float], Derivatives],
    channel: Channel,
    change: Mapping[str, float],
) -> Derivatives:
    """Derivatives (3, n) of what a signal was of, and their variances (3, n).

    Most hypotheses leave most signals as they are: what was computed is kept.
    """
    key = compute, channel.name, change.get("delay", 0.0)
    if key not in motion._known:
        if len(motion._known) >= MAX_KNOWN:
            motion._known.clear()
        motion._known[key] = compute(motion, channel, key[-1])
    found, variance = motion._known[key]
    bias = np.array([np.ravel(change.get("bias", 0.0))[0], 0.0, 0.0])
    return (found - bias[:, None]) / change.get("gain", 1.0), variance


def _combine(
    x: Floats | float, x_var: Floats, y: Floats | float, y_var: Floats
) -> Floats:
    """Mean (W) of two estimates (W) by their inverse variances (W)."""
    mean = (x / x_var + y / y_var) / (1 / x_var + 1 / y_var)
    return np.where(np.isfinite(mean), mean, np.where(np.isfinite(x), x, y))
