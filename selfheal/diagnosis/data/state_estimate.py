"""The robot's state: takes what was read around some time, gives it and its error."""

from functools import cached_property

import numpy as np

from ...recording.data import Floats
from .local_polynomial import ar1_error_factors, choose_half_width, find_nearest
from .robot_summary import Channel

JOLT = 3.0  # times the neighbors' scatter, a state's error at a jolt; chosen
HIDDEN = 2.0  # times the noise, a state's error by a jolt and not by noise; chosen
GIVEN = 1e-6  # a stated state is as good as exact [rad, m, and their rates]


def estimate_state(
    model, signals: tuple[Channel, ...], episode, at: Floats, step: float, reads
) -> tuple[Floats, Floats, Floats]:
    """State at times `at` (W) [steps] of one episode.

    Args:
        model: the given one.
        signals: channels.
        episode: of the episode.
        at: (W).
        step: [s].
        reads: of a signal: gain, delay, each a number, and bias, one a column.

    Returns:
        qpos (W, nq), qvel (W, nv); NaN where nothing tells. Its standard deviation
        (W, 2 nv), of positions and then velocities.
    """
    shape = (len(at),)
    qpos, qvel = (
        np.full((*shape, model.nq), np.nan),
        np.full((*shape, model.nv), np.nan),
    )
    std = np.full((*shape, 2 * model.nv), np.nan)
    predicted = _SignalLookup(signals, episode, at, step, reads)
    for j in range(model.njnt):
        q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        name = model.joint(j).name
        if model.jnt_type[j] in (2, 3):
            value, slope, s, r = predicted("joint_position", name)
            rate, _, t, _ = predicted("joint_velocity", name)
            qpos[:, q], std[:, v] = value[:, 0], s[:, 0]
            qvel[:, v], std[:, model.nv + v] = _combine_estimates(slope, r, rate, t)
        elif model.jnt_type[j] == 0:
            body = model.body(model.jnt_bodyid[j]).name
            rates = slice(model.nv + v, model.nv + v + 6)
            _fill_floating_body(predicted, body, qpos[:, q : q + 7], qvel[:, v : v + 6],
                  std[:, v : v + 6], std[:, rates])  # fmt: skip
        elif (frame := _parent_orientation(model, j)) is not None:
            body = model.body(model.jnt_bodyid[j]).name
            rates = slice(model.nv + v, model.nv + v + 3)
            _fill_orientation(predicted, body, qpos[:, q : q + 4], qvel[:, v : v + 3],
                    std[:, v : v + 3], std[:, rates])  # fmt: skip
            qpos[:, q : q + 4] = _relative_rotation(frame, qpos[:, q : q + 4])
    return qpos, qvel, std


def _parent_orientation(model, joint: int) -> Floats | None:
    """Orientation (4) that a ball joint turns from, if nothing moves that."""
    import mujoco

    body = int(model.jnt_bodyid[joint])
    if model.body_jntnum[body] > 1 or model.body_weldid[model.body_parentid[body]]:
        return None
    frame = model.body_quat[body].copy()
    while body := int(model.body_parentid[body]):
        mujoco.mju_mulQuat(frame, model.body_quat[body], frame.copy())
    return frame


def _relative_rotation(frame: Floats, unit: Floats) -> Floats:
    """Rotations (W, 4) from a frame (4) to orientations (W, 4)."""
    return np.hstack([unit @ frame[:, None], _body_rate(frame[None], unit)])


class _SignalLookup:
    """Values and slopes of signals at some times of an episode."""

    def __init__(self, signals, episode, at, step, reads) -> None:
        self.signals, self.log, self.at, self.step = signals, episode, at, step
        self.reads = reads
        self._smooth: dict[float, tuple[Floats, Floats]] = {}

    def __call__(self, kind: str, target: str):
        """Value, slope [1/s] and their standard deviations, each (W, width)."""
        for c in self.signals:
            if c.kind == kind and c.target == target:
                said = self.reads.get(c.name, {})
                late = said.get("delay", 0.0) / self.step
                if late not in self._smooth:
                    self._smooth[late] = self.log.interpolate(self.at + late, self.step)
                value, slope = self._smooth[late]
                gain = said.get("gain", 1.0)
                value, (s, r) = value[:, c.columns], self._standard_errors(c)
                if not late:
                    value, s = self._use_first_reading(c, value, s)
                value = (value - np.asarray(said.get("bias", 0.0))) / gain
                return value, slope[:, c.columns] / gain, s, r
        lost = np.full((len(self.at), 4), np.nan)
        return lost, lost, lost, lost

    def _use_first_reading(self, c: Channel, value: Floats, s: Floats):
        """Values and errors; an episode's first ones as read, if a jolt hides them."""
        first, noise = self.log.readings[0, c.columns], np.nan_to_num(c.noise)
        own = (self.at == 0)[:, None] & np.isfinite(first) & (s > HIDDEN * noise)
        return np.where(own, first, value), np.where(own, noise, s)

    @cached_property
    def _sample_distances(self) -> tuple[float, Floats, np.ndarray]:
        """Distance of samples [s]; time to an end (W, 1) [s]; nearest samples (W)."""
        times = self.log.sample_steps * self.step
        gap, _ = choose_half_width(times)
        inside = np.minimum(
            self.at * self.step - times[0], times[-1] - self.at * self.step
        )
        return gap, inside[:, None], find_nearest(self.log.sample_steps, self.at)

    def _standard_errors(self, c: Channel) -> tuple[Floats, Floats]:
        """Standard deviations of a parabola's value and slope, larger at an end."""
        gap, inside, rows = self._sample_distances
        own = self.log.polynomials
        scatter, sides, borrowed = (
            x[rows, c.columns] for x in (own.scatter, own.half_width, own.is_borrowed)
        )
        n = 2 * sides + 1
        noise = np.where(np.isfinite(c.noise), c.noise, 0.0)[None]
        near = np.clip(1 - inside / (sides * gap), 0, 1)  # 1 at an end
        near = np.where(borrowed | np.isnan(scatter), 1, near)
        # where no parabola fits, at a jolt, it tells the state less well
        jolt = np.nan_to_num(scatter) - 1.5 * np.nan_to_num(c.scatter)
        noise = noise + JOLT * np.maximum(jolt, 0)
        more = np.ones((2, *sides.shape))
        for m in np.unique(sides):
            slow = [ar1_error_factors(float(a), int(m))[:2] for a in c.ar1]
            more = np.where(sides == m, np.array(slow).T[:, None], more)
        value = noise * more[0] * np.sqrt(2.25 / n) * (1 + near)
        slope = noise * more[1] * np.sqrt(3.0 / n) / (sides * gap) * (1 + 3 * near)
        return value, slope


def _combine_estimates(a: Floats, of_a: Floats, b: Floats, of_b: Floats):
    """Mean (W) of two columns (W, 1 or more), weighted by their errors, and its own.

    One that is NaN does not count.
    """
    values = np.stack([a[:, 0], b[:, 0]])
    weights = 1 / np.maximum(np.stack([of_a[:, 0], of_b[:, 0]]), GIVEN) ** 2
    weights = np.where(np.isfinite(values) & np.isfinite(weights), weights, 0.0)
    total = weights.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (np.nan_to_num(values) * weights).sum(axis=0) / total
        return mean, 1 / np.sqrt(total)


def _fill_floating_body(
    predicted: _SignalLookup, body: str, qpos, qvel, std_q, std_v
) -> None:
    """Fill in the state of a floating body."""
    place, rate, s, r = predicted("body_position", body)
    qpos[:, :3], qvel[:, :3] = place[:, :3], rate[:, :3]
    std_q[:, :3], std_v[:, :3] = s[:, :3], r[:, :3]
    linear, _, s, _ = predicted("body_linear_velocity", body)
    known = np.isfinite(linear[:, :3]).all(axis=1)
    qvel[known, :3], std_v[known, :3] = linear[known, :3], s[known, :3]
    _fill_orientation(
        predicted, body, qpos[:, 3:7], qvel[:, 3:6], std_q[:, 3:6], std_v[:, 3:6]
    )


def _fill_orientation(
    predicted: _SignalLookup, body: str, qpos, qvel, std_q, std_v
) -> None:
    """Fill in the orientation and the angular velocity of a body."""
    turn, slope, s, r = predicted("body_orientation", body)
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    unit = turn / length
    qpos[:] = unit
    qvel[:] = 2 * _body_rate(unit, slope / length)
    std_q[:], std_v[:] = 2 * s[:, 1:4], 2 * r[:, 1:4]
    angular, _, s, _ = predicted("body_angular_velocity", body)
    known = np.isfinite(angular[:, :3]).all(axis=1)
    qvel[known], std_v[known] = angular[known, :3], s[known, :3]


def _body_rate(unit: Floats, slope: Floats) -> Floats:
    """Vector part of conj(unit) slope, both (W, 4), or one of them (1, 4)."""
    w, x, y, z = (unit * [1, -1, -1, -1]).T
    a, b, c, d = slope.T
    return np.stack(
        [w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b,
         w * d + x * c - y * b + z * a], axis=1,
    )  # fmt: skip


def estimate_initial_state(
    simulator, log: int, start, reads
) -> tuple[Floats, Floats, Floats]:
    """State at grid points `start` (W) of an episode: as given, read, or at rest.

    Returns:
        qpos (W, nq), qvel (W, nv), standard deviation (W, 2 nv).
    """
    episode, model = simulator.episodes[log], simulator.compiler.nominal
    at = np.asarray(start, float)
    qpos, qvel, std = estimate_state(
        model, simulator.channels, episode, at, simulator.timestep, reads
    )
    first = at == 0
    if episode.qpos0 is not None:
        qpos[first] = episode.qpos0
        std[first, : model.nv] = GIVEN
    if episode.qvel0 is not None:
        qvel[first] = episode.qvel0
        std[first, model.nv :] = GIVEN
    qpos = np.where(np.isfinite(qpos), qpos, model.qpos0)
    qvel = np.where(np.isfinite(qvel), qvel, 0.0)
    return qpos, qvel, np.where(np.isfinite(std), std, GIVEN)
