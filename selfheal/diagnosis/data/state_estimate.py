"""State estimates: takes readings around some times, gives states and their errors."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...recording.data import Floats
from .episodes import SampledEpisode
from .local_polynomial import ar1_error_factors, choose_half_width, find_nearest
from .robot_summary import Channel

if TYPE_CHECKING:
    from mujoco import MjModel

ReadingChanges = Mapping[str, Mapping[str, Any]]

# times the scatter beyond the usual one, the error of a state at a jolt; chosen: so
# that a fit may move a state that no parabola gives
JOLT_ERROR_FACTOR = 3.0
USUAL_SCATTER_RATIO = 1.5  # times a channel's scatter; chosen: less is no jolt
# times the noise, the error above which an episode's first reading is better than its
# parabola; chosen: noise alone never makes it so large
FIRST_READING_ERROR_RATIO = 2.0
GIVEN_STATE_STD = 1e-6  # [rad, m, and per s] of a given state; chosen: as good as exact
# n var(value) and n m^2 var(slope) of a parabola in the middle of n = 2 m + 1 samples
# [of the noise's variance]; least squares for large n (Savitzky, Golay 1964)
VALUE_VARIANCE, SLOPE_VARIANCE = 2.25, 3.0
# by what share of them these errors are larger at an end of the samples; chosen: about
# as least squares has it
VALUE_ERROR_GROWTH, SLOPE_ERROR_GROWTH = 1, 3


def estimate_state(
    model: "MjModel",
    channels: tuple[Channel, ...],
    episode: SampledEpisode,
    at: Floats,
    step: float,
    reading_changes: ReadingChanges,
) -> tuple[Floats, Floats, Floats]:
    """Estimate the state at times of an episode from the readings around them.

    A joint's position is the value of its local polynomial. Its velocity is the mean of
    the polynomial's slope and of what a velocity sensor reads, by inverse variances.

    Args:
        at: (W) times [steps].
        step: of the simulation [s].
        reading_changes: what a hypothesis says of sensors, by signal: "gain" [1] and
            "delay" [s], each a number, and "bias" (width) [unit].

    Returns:
        qpos (W, nq) and qvel (W, nv) [rad or m, and per s]; NaN where nothing was read.
        Their standard deviations (W, 2 nv), of positions and then velocities.
    """
    qpos = np.full((len(at), model.nq), np.nan)
    qvel = np.full((len(at), model.nv), np.nan)
    std = np.full((len(at), 2 * model.nv), np.nan)
    look_up = _SignalLookup(channels, episode, at, step, reading_changes)
    for j in range(model.njnt):
        q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        name = model.joint(j).name
        body = model.body(model.jnt_bodyid[j]).name
        if model.jnt_type[j] in (2, 3):  # mjtJoint: slide, hinge
            value, slope, value_std, slope_std = look_up("joint_position", name)
            rate, _, rate_std, _ = look_up("joint_velocity", name)
            qpos[:, q], std[:, v] = value[:, 0], value_std[:, 0]
            qvel[:, v], std[:, model.nv + v] = _combine_estimates(
                slope, slope_std, rate, rate_std
            )
            continue
        if model.jnt_type[j] == 0:  # mjtJoint: free
            found = _find_place(look_up, body)
            qpos[:, q : q + 3], qvel[:, v : v + 3] = found[:2]
            std[:, v : v + 3], std[:, model.nv + v : model.nv + v + 3] = found[2:]
            q, v, frame = q + 3, v + 3, None
        elif (frame := _parent_orientation(model, j)) is None:
            continue
        turn, turning, *errors = _find_orientation(look_up, body)
        turn = turn if frame is None else _relative_rotation(frame, turn)
        qpos[:, q : q + 4], qvel[:, v : v + 3] = turn, turning
        std[:, v : v + 3], std[:, model.nv + v : model.nv + v + 3] = errors
    return qpos, qvel, std


def _parent_orientation(model: "MjModel", joint: int) -> Floats | None:
    """Quaternion (4) of the frame that a ball joint turns from; None: it moves."""
    import mujoco

    body = int(model.jnt_bodyid[joint])
    if model.body_jntnum[body] > 1 or model.body_weldid[model.body_parentid[body]]:
        return None
    frame = model.body_quat[body].copy()
    while body := int(model.body_parentid[body]):
        mujoco.mju_mulQuat(frame, model.body_quat[body], frame.copy())
    return frame


def _relative_rotation(frame: Floats, unit: Floats) -> Floats:
    """Rotations (W, 4) from a frame (4) to orientations (W, 4), all quaternions."""
    return np.hstack([unit @ frame[:, None], _body_rate(frame[None], unit)])


class _SignalLookup:
    """Values and slopes of signals at W times of an episode."""

    def __init__(
        self,
        channels: Sequence[Channel],
        episode: SampledEpisode,
        at: Floats,
        step: float,
        reading_changes: ReadingChanges,
    ) -> None:
        """Arguments are those of `estimate_state`."""
        self.channels, self.episode = channels, episode
        self.at, self.step, self.reading_changes = at, step, reading_changes
        self._by_delay: dict[float, tuple[Floats, Floats]] = {}

    def __call__(self, kind: str, target: str) -> tuple[Floats, Floats, Floats, Floats]:
        """Value [unit], slope [unit/s] and their standard errors, each (W, width).

        All are NaN where no channel is of that kind and target.
        """
        for c in self.channels:
            if c.kind == kind and c.target == target:
                return self._estimate(c)
        unknown = np.full((len(self.at), 4), np.nan)
        return unknown, unknown, unknown, unknown

    def _estimate(self, c: Channel) -> tuple[Floats, Floats, Floats, Floats]:
        """Value, slope and their standard errors of a channel, each (W, width)."""
        change = self.reading_changes.get(c.name, {})
        delay = change.get("delay", 0.0) / self.step
        if delay not in self._by_delay:
            self._by_delay[delay] = self.episode.interpolate(self.at + delay, self.step)
        value, slope = (x[:, c.columns] for x in self._by_delay[delay])
        value_std, slope_std = self._standard_errors(c)
        if not delay:
            value, value_std = self._use_first_reading(c, value, value_std)
        gain = change.get("gain", 1.0)
        value = (value - np.asarray(change.get("bias", 0.0))) / gain
        return value, slope / gain, value_std, slope_std

    def _use_first_reading(
        self, c: Channel, value: Floats, std: Floats
    ) -> tuple[Floats, Floats]:
        """Use the reading at 0 for a value and its error (W, width) if it is better."""
        first, noise = self.episode.readings[0, c.columns], np.nan_to_num(c.noise)
        is_first = (self.at == 0)[:, None] & np.isfinite(first)
        is_better = is_first & (std > FIRST_READING_ERROR_RATIO * noise)
        return np.where(is_better, first, value), np.where(is_better, noise, std)

    @cached_property
    def _sample_distances(self) -> tuple[float, Floats, np.ndarray]:
        """Distance of samples [s]; time to an end (W, 1) [s]; nearest samples (W)."""
        times = self.episode.sample_steps * self.step
        gap, _ = choose_half_width(times)
        to_end = np.minimum(
            self.at * self.step - times[0], times[-1] - self.at * self.step
        )
        return gap, to_end[:, None], find_nearest(self.episode.sample_steps, self.at)

    def _standard_errors(self, c: Channel) -> tuple[Floats, Floats]:
        """Standard errors of a channel's value [unit] and slope [unit/s], (W, width).

        Of n = 2 m + 1 samples with distance h and noise s, in the middle of them,

            std(value) = s sqrt(2.25 / n),   std(slope) = s sqrt(3 / n) / (m h),

        times the factors of autocorrelated noise. They grow towards an episode's ends,
        and where no parabola fits, at a jolt.
        """
        gap, to_end, rows = self._sample_distances
        fit = self.episode.polynomials
        scatter, m, is_borrowed = (
            x[rows, c.columns] for x in (fit.scatter, fit.half_width, fit.is_borrowed)
        )
        n = 2 * m + 1
        noise = np.where(np.isfinite(c.noise), c.noise, 0.0)[None]
        nearness = np.clip(1 - to_end / (m * gap), 0, 1)  # 1 at an end
        nearness = np.where(is_borrowed | np.isnan(scatter), 1, nearness)
        usual_scatter = USUAL_SCATTER_RATIO * np.nan_to_num(c.scatter)
        jolt = np.nan_to_num(scatter) - usual_scatter
        noise = noise + JOLT_ERROR_FACTOR * np.maximum(jolt, 0)
        factors = np.ones((2, *m.shape))
        for width in np.unique(m):
            of_width = [ar1_error_factors(float(a), int(width))[:2] for a in c.ar1]
            factors = np.where(m == width, np.array(of_width).T[:, None], factors)
        value = noise * factors[0] * np.sqrt(VALUE_VARIANCE / n)
        slope = noise * factors[1] * np.sqrt(SLOPE_VARIANCE / n) / (m * gap)
        return (
            value * (1 + VALUE_ERROR_GROWTH * nearness),
            slope * (1 + SLOPE_ERROR_GROWTH * nearness),
        )


def _combine_estimates(
    a: Floats, a_std: Floats, b: Floats, b_std: Floats
) -> tuple[Floats, Floats]:
    """Combine two estimates by inverse-variance weights; NaN does not count.

    Args:
        a: (W, 1 or more), of which the first column counts, as of all arguments.
        a_std: standard errors of `a`.
        b_std: standard errors of `b`.

    Returns:
        Weighted mean (W) and its standard error (W); NaN and infinite where both are
        NaN.
    """
    values = np.stack([a[:, 0], b[:, 0]])
    std = np.maximum(np.stack([a_std[:, 0], b_std[:, 0]]), GIVEN_STATE_STD)
    weights = 1 / std**2
    weights = np.where(np.isfinite(values) & np.isfinite(weights), weights, 0.0)
    total = weights.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (np.nan_to_num(values) * weights).sum(axis=0) / total
        return mean, 1 / np.sqrt(total)


def _find_place(
    look_up: _SignalLookup, body: str
) -> tuple[Floats, Floats, Floats, Floats]:
    """Position (W, 3) and velocity of a body, and their standard errors."""
    position, rate, position_std, rate_std = look_up("body_position", body)
    linear, _, linear_std, _ = look_up("body_linear_velocity", body)
    is_read = np.isfinite(linear[:, :3]).all(axis=1, keepdims=True)
    return (
        position[:, :3],
        np.where(is_read, linear[:, :3], rate[:, :3]),
        position_std[:, :3],
        np.where(is_read, linear_std[:, :3], rate_std[:, :3]),
    )


def _find_orientation(
    look_up: _SignalLookup, body: str
) -> tuple[Floats, Floats, Floats, Floats]:
    """Quaternion (W, 4) and angular velocity (W, 3) of a body, and standard errors.

    In the body's frame the angular velocity is omega = 2 vec(conj(q) dq/dt).
    """
    value, slope, value_std, slope_std = look_up("body_orientation", body)
    norm = np.linalg.norm(value, axis=1, keepdims=True)
    unit = value / norm
    angular, _, angular_std, _ = look_up("body_angular_velocity", body)
    is_read = np.isfinite(angular[:, :3]).all(axis=1, keepdims=True)
    return (
        unit,
        np.where(is_read, angular[:, :3], 2 * _body_rate(unit, slope / norm)),
        2 * value_std[:, 1:4],
        np.where(is_read, angular_std[:, :3], 2 * slope_std[:, 1:4]),
    )


def _body_rate(unit: Floats, slope: Floats) -> Floats:
    """Vector part (W, 3) of conj(unit) slope, both (W, 4), or one of them (1, 4)."""
    w, x, y, z = (unit * [1, -1, -1, -1]).T
    a, b, c, d = slope.T
    first = w * b + x * a + y * d - z * c
    second = w * c - x * d + y * a + z * b
    return np.stack([first, second, w * d + x * c - y * b + z * a], axis=1)
