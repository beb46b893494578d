"""Where windows begin: the robot's state, from what was read around that time."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np

from ..recording.data import Floats
from .parabolas import nearest, neighbors, of_slow_noise
from .plant import Plant, parts
from .scene import Channel
from .terms import Term

JOLT = 3.0  # times the neighbors' scatter, a state's error at a jolt; chosen
HIDDEN = 2.0  # times the noise, a state's error by a jolt and not by noise; chosen
INTEGRATOR, FILTERS = 1, (2, 3)  # mjtDyn: integrator; filter, filterexact
GIVEN = 1e-6  # a stated state is as good as exact [rad, m, and their rates]


def estimate(
    model, signals: tuple[Channel, ...], log, at: Floats, step: float, reads
) -> tuple[Floats, Floats, Floats]:
    """State at times `at` (W) [steps] of one episode.

    Args:
        model: the given one.
        signals: channels.
        log: of the episode.
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
    told = _Told(signals, log, at, step, reads)
    for j in range(model.njnt):
        q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        name = model.joint(j).name
        if model.jnt_type[j] in (2, 3):
            value, slope, s, r = told("joint_position", name)
            rate, _, t, _ = told("joint_velocity", name)
            qpos[:, q], std[:, v] = value[:, 0], s[:, 0]
            qvel[:, v], std[:, model.nv + v] = _both(slope, r, rate, t)
        elif model.jnt_type[j] == 0:
            body = model.body(model.jnt_bodyid[j]).name
            rates = slice(model.nv + v, model.nv + v + 6)
            _free(told, body, qpos[:, q : q + 7], qvel[:, v : v + 6],
                  std[:, v : v + 6], std[:, rates])  # fmt: skip
        elif (frame := _frame(model, j)) is not None:
            body = model.body(model.jnt_bodyid[j]).name
            rates = slice(model.nv + v, model.nv + v + 3)
            _turned(told, body, qpos[:, q : q + 4], qvel[:, v : v + 3],
                    std[:, v : v + 3], std[:, rates])  # fmt: skip
            qpos[:, q : q + 4] = _since(frame, qpos[:, q : q + 4])
    return qpos, qvel, std


def _frame(model, joint: int) -> Floats | None:
    """Orientation (4) that a ball joint turns from, if nothing moves that."""
    import mujoco

    body = int(model.jnt_bodyid[joint])
    if model.body_jntnum[body] > 1 or model.body_weldid[model.body_parentid[body]]:
        return None
    frame = model.body_quat[body].copy()
    while body := int(model.body_parentid[body]):
        mujoco.mju_mulQuat(frame, model.body_quat[body], frame.copy())
    return frame


def _since(frame: Floats, unit: Floats) -> Floats:
    """Rotations (W, 4) from a frame (4) to orientations (W, 4)."""
    return np.hstack([unit @ frame[:, None], _body_rate(frame[None], unit)])


class _Told:
    """Values and slopes of signals at some times of an episode."""

    def __init__(self, signals, log, at, step, reads) -> None:
        self.signals, self.log, self.at, self.step = signals, log, at, step
        self.reads = reads
        self._smooth: dict[float, tuple[Floats, Floats]] = {}

    def __call__(self, kind: str, target: str):
        """Value, slope [1/s] and their standard deviations, each (W, width)."""
        for c in self.signals:
            if c.kind == kind and c.target == target:
                said = self.reads.get(c.name, {})
                late = said.get("delay", 0.0) / self.step
                if late not in self._smooth:
                    self._smooth[late] = self.log.smooth(self.at + late, self.step)
                value, slope = self._smooth[late]
                gain = said.get("gain", 1.0)
                value, (s, r) = value[:, c.columns], self._std(c)
                if not late:
                    value, s = self._or_as_read(c, value, s)
                value = (value - np.asarray(said.get("bias", 0.0))) / gain
                return value, slope[:, c.columns] / gain, s, r
        lost = np.full((len(self.at), 4), np.nan)
        return lost, lost, lost, lost

    def _or_as_read(self, c: Channel, value: Floats, s: Floats):
        """Values and errors; an episode's first ones as read, if a jolt hides them."""
        first, noise = self.log.readings[0, c.columns], np.nan_to_num(c.noise)
        own = (self.at == 0)[:, None] & np.isfinite(first) & (s > HIDDEN * noise)
        return np.where(own, first, value), np.where(own, noise, s)

    @cached_property
    def _there(self) -> tuple[float, Floats, np.ndarray]:
        """Distance of samples [s]; time to an end (W, 1) [s]; nearest samples (W)."""
        times = self.log.at * self.step
        gap, _ = neighbors(times)
        inside = np.minimum(
            self.at * self.step - times[0], times[-1] - self.at * self.step
        )
        return gap, inside[:, None], nearest(self.log.at, self.at)

    def _std(self, c: Channel) -> tuple[Floats, Floats]:
        """Standard deviations of a parabola's value and slope, larger at an end."""
        gap, inside, rows = self._there
        own = self.log.near
        scatter, sides, borrowed = (
            x[rows, c.columns] for x in (own.scatter, own.sides, own.borrowed)
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
            slow = [of_slow_noise(float(a), int(m))[:2] for a in c.memory]
            more = np.where(sides == m, np.array(slow).T[:, None], more)
        value = noise * more[0] * np.sqrt(2.25 / n) * (1 + near)
        slope = noise * more[1] * np.sqrt(3.0 / n) / (sides * gap) * (1 + 3 * near)
        return value, slope


def _both(a: Floats, of_a: Floats, b: Floats, of_b: Floats):
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


def _free(told: _Told, body: str, qpos, qvel, std_q, std_v) -> None:
    """Fill in the state of a floating body."""
    place, rate, s, r = told("body_position", body)
    qpos[:, :3], qvel[:, :3] = place[:, :3], rate[:, :3]
    std_q[:, :3], std_v[:, :3] = s[:, :3], r[:, :3]
    linear, _, s, _ = told("body_linear_velocity", body)
    known = np.isfinite(linear[:, :3]).all(axis=1)
    qvel[known, :3], std_v[known, :3] = linear[known, :3], s[known, :3]
    _turned(told, body, qpos[:, 3:7], qvel[:, 3:6], std_q[:, 3:6], std_v[:, 3:6])


def _turned(told: _Told, body: str, qpos, qvel, std_q, std_v) -> None:
    """Fill in the orientation and the angular velocity of a body."""
    turn, slope, s, r = told("body_orientation", body)
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    unit = turn / length
    qpos[:] = unit
    qvel[:] = 2 * _body_rate(unit, slope / length)
    std_q[:], std_v[:] = 2 * s[:, 1:4], 2 * r[:, 1:4]
    angular, _, s, _ = told("body_angular_velocity", body)
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


class States:
    """Initial states of a batch."""

    def __init__(self, world, plant: Plant, terms, values, windows, reads) -> None:
        """`reads`: of a signal, by hypothesis: bias (n, width), gain, delay (n)."""
        self.world, self.plant, self.windows = world, plant, windows
        self.terms, self.values, self.reads = terms, values, reads

    def begin(self, models, kick: Floats | None):
        """Position (N, nq), velocity (N, nv), activation (N, na), sums by actuator."""
        n, w = len(self.values), len(self.windows)
        qpos, qvel = self._given(n)
        if kick is not None:
            qpos, qvel = _kicked(self.world.workshop.given, qpos, qvel, kick)
        model = self.plant.model
        q, v = np.zeros((n, w, model.nq)), np.zeros((n, w, model.nv))
        q[:] = model.qpos0
        q[..., self.plant.qpos], v[..., self.plant.dof] = qpos, qvel
        for term, part in zip(self.terms, parts(self.terms, self.values), strict=True):
            for place in term.places:
                if "suffix" in place:
                    self._settle(models, term, self.plant.place(place), part, q, v)
        return (
            q.reshape(n * w, -1), v.reshape(n * w, -1), self._activation(n),
            self._sums(n), self._history(n),
        )  # fmt: skip

    def _given(self, n: int) -> tuple[Floats, Floats]:
        """State (n, W, ...) in the given model's coordinates."""
        world, windows = self.world, self.windows
        given = world.workshop.given
        kept = world.held.setdefault(windows, {})
        if self.reads:
            qpos, qvel = self._read(n)
        else:
            if "start" not in kept:
                kept["start"] = self._read(1)
            qpos, qvel = kept["start"]
        shape = (n, len(windows))
        return (
            np.broadcast_to(qpos, (*shape, given.nq)).copy(),
            np.broadcast_to(qvel, (*shape, given.nv)).copy(),
        )

    def _read(self, n: int) -> tuple[Floats, Floats]:
        """State (n, W, ...) as each hypothesis reads it."""
        world, windows = self.world, self.windows
        given = world.workshop.given
        states: list[dict[str, Mapping[str, Any]]] = [{} for _ in range(n)]
        for name, said in self.reads.items():
            for i, one in enumerate(states):
                one[name] = {k: v[i].tolist() for k, v in said.items() if k != "step"}
        qpos = np.empty((n, len(windows), given.nq))
        qvel = np.empty((n, len(windows), given.nv))
        same: dict[str, int] = {}  # most hypotheses read alike
        for i, one in enumerate(states):
            if (known := same.setdefault(repr(one), i)) != i:
                qpos[i], qvel[i] = qpos[known], qvel[known]
                continue
            for log in np.unique(windows.log):
                rows = np.flatnonzero(windows.log == log)
                q, v, _ = start_of(world, int(log), windows.start[rows], one)
                qpos[i, rows], qvel[i, rows] = q, v
        return qpos, qvel

    def _settle(self, models, term: Term, place, values, q, v) -> None:
        """Let a gap or a spring yield to the load that it bears at the start."""
        import mujoco

        log, start = self.windows.log, self.windows.start
        given = [self.world.logs[i].qpos0 is not None for i in log]
        free = np.flatnonzero(~np.array(given) | (start > 0))  # else it starts at 0
        for i, model in enumerate(models):
            data = mujoco.MjData(model)
            for k in free:
                data.qpos[:], data.qvel[:] = q[i, k], v[i, k]
                mujoco.mj_forward(model, data)
                load = -float(data.qfrc_bias[place["dof"]])
                extra = term.effect.yields(values[i], load)
                q[i, k, place["extra_qpos"]] = extra
                if place["side"] == "link":
                    q[i, k, place["qpos"]] -= extra

    def _activation(self, n: int) -> Floats | None:
        """Activations (N, na): what filters and integrators of commands have come to.

        An integrator begins at 0 with an episode whose initial state is given, as in
        MuJoCo; else where its actuator then is.
        """
        model, world, windows = self.plant.model, self.world, self.windows
        if not model.na:
            return None
        out = np.zeros((len(windows), model.na))
        for i in np.unique(windows.log):
            rows, log = np.flatnonzero(windows.log == i), world.logs[i]
            begin = np.zeros(model.nu)
            if log.qpos0 is None and (model.actuator_dyntype == INTEGRATOR).any():
                begin = _lengths(world, int(i))
            past = filtered(model, log.ctrl, world.step, begin)
            out[rows] = past[np.minimum(windows.start[rows], len(past) - 1)]
        return np.tile(out, (n, 1))

    def _history(self, n: int) -> Floats | None:
        """Buffers (N, nhistory) of actuators that the model delays: the past command.

        Before an episode's first sample that one was given (contract section 2).
        """
        import mujoco

        model, world, windows = self.plant.model, self.world, self.windows
        if not model.nhistory:
            return None
        out = np.empty((len(windows), model.nhistory))
        for w in range(len(windows)):
            data = mujoco.MjData(model)
            ctrl = world.logs[int(windows.log[w])].ctrl
            for a in range(model.nu):
                size = int(model.actuator_history[a, 0])
                if size:
                    past = int(windows.start[w]) + np.arange(-size, 0)
                    values = ctrl[np.clip(past, 0, len(ctrl) - 1), a]
                    mujoco.mj_initCtrlHistory(model, data, a, None, values[:, None])
            out[w] = data.history
        return np.tile(out, (n, 1))

    def _sums(self, n: int) -> Mapping[int, Floats]:
        """Of each integrating servo: the summed error (N) [rad s] at the start."""
        out = {}
        for term, part in zip(self.terms, parts(self.terms, self.values), strict=True):
            for place in term.places:
                if term.effect.name == "integral_action":
                    each = [self._sum(place, m) for m in term.effect.fullest(part)]
                    out[place["actuator"]] = np.concatenate(each)
        return out

    def _sum(self, place, most: float) -> Floats:
        """Summed error (W) of a servo where windows begin, never beyond `most`."""
        world, windows = self.world, self.windows
        kept = world.held.setdefault(windows, {})
        errors = kept.setdefault(("errors", place["actuator"]), {})
        total = np.zeros(len(windows))
        for log in np.unique(windows.log[windows.start > 0]):
            rows = np.flatnonzero(windows.log == log)
            if log not in errors:
                errors[log] = _errors(world, world.logs[log], place).tolist()
            past = _summed(errors[log], 0.0, -most, most)
            total[rows] = past[np.minimum(windows.start[rows], len(past) - 1)]
        return total


def start_of(world, log: int, start, reads) -> tuple[Floats, Floats, Floats]:
    """State at grid points `start` (W) of an episode: as given, read, or at rest.

    Returns:
        qpos (W, nq), qvel (W, nv), standard deviation (W, 2 nv).
    """
    episode, model = world.logs[log], world.workshop.given
    at = np.asarray(start, float)
    qpos, qvel, std = estimate(model, world.signals, episode, at, world.step, reads)
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


def _kicked(model, qpos: Floats, qvel: Floats, kick: Floats):
    """States (n, W, ...) moved by (n, W, 2 nv)."""
    import mujoco

    qpos = qpos.copy()
    plain = np.ones(model.nq, bool)
    for j in range(model.njnt):
        if model.jnt_type[j] in (0, 1):
            a = int(model.jnt_qposadr[j]) + (3 if model.jnt_type[j] == 0 else 0)
            plain[a : a + 4] = False
    if plain.all():
        qpos += kick[..., : model.nv]
    else:
        for i, w in np.argwhere(kick[..., : model.nv].any(axis=-1)):
            mujoco.mj_integratePos(model, qpos[i, w], kick[i, w, : model.nv], 1.0)
    return qpos, qvel + kick[..., model.nv :]


def _lengths(world, log: int) -> Floats:
    """Lengths (nu) of the actuators where an episode begins."""
    import mujoco

    model = world.workshop.given
    data = mujoco.MjData(model)
    data.qpos[:] = start_of(world, log, np.zeros(1), {})[0][0]
    mujoco.mj_fwdPosition(model, data)
    return np.array(data.actuator_length)


def filtered(model, ctrl: Floats, step: float, begin: Floats) -> Floats:
    """Activations (G, na) along a grid of commands: first-order filters, integrators.

    `begin`: (nu) what integrators begin with.
    """
    out = np.zeros((len(ctrl), model.na))
    for a in range(model.nu):
        first = int(model.actuator_actadr[a])
        if first < 0 or model.actuator_dyntype[a] not in (INTEGRATOR, *FILTERS):
            continue
        if model.actuator_dyntype[a] == INTEGRATOR:
            low, high = -np.inf, np.inf
            if model.actuator_actlimited[a]:
                low, high = model.actuator_actrange[a]
            added = (ctrl[:-1, a] * step).tolist()
            out[:, first] = _summed(added, float(begin[a]), low, high)
            continue
        keep = np.exp(-step / max(float(model.actuator_dynprm[a, 0]), 1e-9))
        now = ctrl[0, a]
        for k in range(len(ctrl)):
            out[k, first] = now
            now = ctrl[k, a] + (now - ctrl[k, a]) * keep
    return out


def _summed(added: Sequence[float], begin: float, low: float, high: float) -> Floats:
    """Sums (G + 1) of what is added (G), none of which leaves its bounds."""
    sums = accumulate(added, lambda s, x: min(max(s + x, low), high), initial=begin)
    return np.fromiter(sums, float)


def _errors(world, log, place) -> Floats:
    """What each step (G) of the grid adds to a servo's sum, as sent and read."""
    grid = np.arange(len(log.ctrl), dtype=float)
    model = world.workshop.given
    joint = next(j for j in range(model.njnt) if model.jnt_qposadr[j] == place["qpos"])
    name = model.joint(joint).name
    c = next(c for c in world.signals if (c.kind, c.target) == ("joint_position", name))
    value, _ = log.smooth(grid, world.step)
    error = log.ctrl[:, place["actuator"]] - value[:, c.first]
    return np.where(np.isfinite(error), error, 0.0) * world.step
