"""Where a batch begins: takes hypotheses and windows, gives what is simulated from."""

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np

from ...recording.data import Floats
from ..data.state_estimate import estimate_initial_state
from ..effects.base import Term
from .model_variants import ModelVariant, split_values

INTEGRATOR, FILTERS = 1, (2, 3)  # mjtDyn: integrator; filter, filterexact
FIRST = 0.5  # [s] of an episode, that tell what a servo bears; chosen


class InitialStates:
    """Initial states of a batch."""

    def __init__(
        self, simulator, variant: ModelVariant, terms, values, segments, reads
    ) -> None:
        """`reads`: of a signal, by hypothesis: bias (n, width), gain, delay (n)."""
        self.world, self.plant, self.windows = simulator, variant, segments
        self.terms, self.values, self.reads = terms, values, reads

    def compute(self, models, initial_state_offset: Floats | None):
        """Position (N, nq), velocity (N, nv), activation (N, na), sums by actuator."""
        n, w = len(self.values), len(self.windows)
        qpos, qvel = self._nominal_states(n)
        if initial_state_offset is not None:
            qpos, qvel = _add_offset(
                self.world.compiler.nominal, qpos, qvel, initial_state_offset
            )
        model = self.plant.model
        q, v = np.zeros((n, w, model.nq)), np.zeros((n, w, model.nv))
        q[:] = model.qpos0
        q[..., self.plant.qpos], v[..., self.plant.dof] = qpos, qvel
        for term, part in zip(
            self.terms, split_values(self.terms, self.values), strict=True
        ):
            for place in term.places:
                if "suffix" in place:
                    self._settle_second_joint(
                        models, term, self.plant.map_place(place), part, q, v
                    )
        return (
            q.reshape(n * w, -1), v.reshape(n * w, -1), self._compute_activation(n),
            self._integral_errors(models), self._fill_history(n),
        )  # fmt: skip

    def _nominal_states(self, n: int) -> tuple[Floats, Floats]:
        """State (n, W, ...) in the given model's coordinates."""
        simulator, segments = self.world, self.windows
        given = simulator.compiler.nominal
        kept = simulator.cache.setdefault(segments, {})
        if self.reads:
            qpos, qvel = self._estimate_states(n)
        else:
            if "start" not in kept:
                kept["start"] = self._estimate_states(1)
            qpos, qvel = kept["start"]
        shape = (n, len(segments))
        return (
            np.broadcast_to(qpos, (*shape, given.nq)).copy(),
            np.broadcast_to(qvel, (*shape, given.nv)).copy(),
        )

    def _estimate_states(self, n: int) -> tuple[Floats, Floats]:
        """State (n, W, ...) as each hypothesis reads it."""
        simulator, segments = self.world, self.windows
        given = simulator.compiler.nominal
        states: list[dict[str, Mapping[str, Any]]] = [{} for _ in range(n)]
        for name, said in self.reads.items():
            for i, one in enumerate(states):
                one[name] = {k: v[i].tolist() for k, v in said.items() if k != "step"}
        qpos = np.empty((n, len(segments), given.nq))
        qvel = np.empty((n, len(segments), given.nv))
        same: dict[str, int] = {}  # most hypotheses read alike
        for i, one in enumerate(states):
            if (known := same.setdefault(repr(one), i)) != i:
                qpos[i], qvel[i] = qpos[known], qvel[known]
                continue
            for episode in np.unique(segments.episode):
                rows = np.flatnonzero(segments.episode == episode)
                q, v, _ = estimate_initial_state(
                    simulator, int(episode), segments.first_step[rows], one
                )
                qpos[i, rows], qvel[i, rows] = q, v
        return qpos, qvel

    def _settle_second_joint(self, models, term: Term, place, values, q, v) -> None:
        """Let a gap or a spring yield to the load that it bears at the start."""
        import mujoco

        episode, start = self.windows.episode, self.windows.first_step
        given = [self.world.episodes[i].qpos0 is not None for i in episode]
        free = np.flatnonzero(~np.array(given) | (start > 0))  # else it starts at 0
        for i, model in enumerate(models):
            data = mujoco.MjData(model)
            for k in free:
                data.qpos[:], data.qvel[:] = q[i, k], v[i, k]
                mujoco.mj_forward(model, data)
                load = -float(data.qfrc_bias[place["dof"]])
                extra = term.effect.compute_deflection(values[i], load)
                q[i, k, place["extra_qpos"]] = extra
                if place["side"] == "link":
                    q[i, k, place["qpos"]] -= extra

    def _compute_activation(self, n: int) -> Floats | None:
        """Activations (N, na): what filters and integrators of commands have come to.

        An integrator begins at 0 with an episode whose initial state is given, as in
        MuJoCo; else where its actuator then is.
        """
        model, simulator, segments = self.plant.model, self.world, self.windows
        if not model.na:
            return None
        out = np.zeros((len(segments), model.na))
        for i in np.unique(segments.episode):
            rows, episode = np.flatnonzero(segments.episode == i), simulator.episodes[i]
            begin = np.zeros(model.nu)
            if episode.qpos0 is None and (model.actuator_dyntype == INTEGRATOR).any():
                begin = _actuator_lengths(simulator, int(i))
            past = filter_commands(model, episode.ctrl, simulator.timestep, begin)
            out[rows] = past[np.minimum(segments.first_step[rows], len(past) - 1)]
        return np.tile(out, (n, 1))

    def _fill_history(self, n: int) -> Floats | None:
        """Buffers (N, nhistory) of actuators that the model delays: the past command.

        Before an episode's first sample that one was given (contract section 2).
        """
        import mujoco

        model, simulator, segments = self.plant.model, self.world, self.windows
        if not model.nhistory:
            return None
        out = np.empty((len(segments), model.nhistory))
        for w in range(len(segments)):
            data = mujoco.MjData(model)
            ctrl = simulator.episodes[int(segments.episode[w])].ctrl
            for a in range(model.nu):
                size = int(model.actuator_history[a, 0])
                if size:
                    past = int(segments.first_step[w]) + np.arange(-size, 0)
                    values = ctrl[np.clip(past, 0, len(ctrl) - 1), a]
                    mujoco.mj_initCtrlHistory(model, data, a, None, values[:, None])
            out[w] = data.history
        return np.tile(out, (n, 1))

    def _integral_errors(self, models) -> Mapping[int, Floats]:
        """Of each integrating servo: the summed error (N) [rad s] at the start."""
        out = {}
        for term, part in zip(
            self.terms, split_values(self.terms, self.values), strict=True
        ):
            for place in term.places:
                if term.effect.name == "integral_action":
                    most = term.effect.max_integral(part)
                    own = zip(models, part[:, 0], most, strict=True)
                    each = [self._integral_error(place, *one) for one in own]
                    out[place["actuator"]] = np.concatenate(each)
        return out

    def _integral_error(self, place, model, gain: float, most: float) -> Floats:
        """Summed error (W) of a servo where windows begin, never beyond `most`.

        With an episode it begins at 0 or, where it had settled before, with what the
        robot's motion in the first moments asks for beside the servo.
        """
        simulator, segments = self.world, self.windows
        kept = simulator.cache.setdefault(segments, {})
        errors = kept.setdefault(("errors", place["actuator"]), {})
        total = np.zeros(len(segments))
        settled = place.get("begins") == "settled" and gain > 0
        for episode in np.unique(segments.episode[(segments.first_step > 0) | settled]):
            rows = np.flatnonzero(segments.episode == episode)
            if episode not in errors:
                errors[episode] = _servo_errors(
                    simulator, simulator.episodes[episode], place
                ).tolist()
            begin = 0.0
            if settled:
                at = _first_steps(simulator, episode)
                asked = self._required_torque(
                    model, episode, at, self.plant.map_place(place)["dof"]
                )
                begin = asked / gain - np.cumsum(errors[episode][: 1 + at[-1]]).mean()
                begin = min(max(begin, -most), most)
            past = _accumulate_clipped(errors[episode], begin, -most, most)
            total[rows] = past[np.minimum(segments.first_step[rows], len(past) - 1)]
        return total

    def _required_torque(self, model, episode: int, at: np.ndarray, dof: int) -> float:
        """Mean torque [N m] that an episode's steps `at` ask beside the servos."""
        import mujoco

        simulator, variant = self.world, self.plant
        kept = simulator.cache.setdefault(self.windows, {})
        if ("first", episode) not in kept:
            qpos, qvel, _ = estimate_initial_state(simulator, episode, at, {})
            rest = len(at) == 1
            qacc = (
                0 * qvel if rest else np.gradient(qvel, at * simulator.timestep, axis=0)
            )
            kept["first", episode] = qpos, qvel, qacc
        data, asked = mujoco.MjData(model), []
        for k, qpos, qvel, qacc in zip(at, *kept["first", episode], strict=True):
            data.qpos[variant.qpos], data.qvel[variant.dof] = qpos, qvel
            data.qacc[variant.dof] = qacc
            data.ctrl[:] = simulator.episodes[episode].ctrl[k]
            mujoco.mj_inverse(model, data)
            mujoco.mj_fwdActuation(model, data)
            asked.append(data.qfrc_inverse[dof] - data.qfrc_actuator[dof])
        return float(np.mean(asked))


def _add_offset(model, qpos: Floats, qvel: Floats, initial_state_offset: Floats):
    """States (n, W, ...) moved by (n, W, 2 nv)."""
    import mujoco

    qpos = qpos.copy()
    plain = np.ones(model.nq, bool)
    for j in range(model.njnt):
        if model.jnt_type[j] in (0, 1):
            a = int(model.jnt_qposadr[j]) + (3 if model.jnt_type[j] == 0 else 0)
            plain[a : a + 4] = False
    if plain.all():
        qpos += initial_state_offset[..., : model.nv]
    else:
        for i, w in np.argwhere(initial_state_offset[..., : model.nv].any(axis=-1)):
            mujoco.mj_integratePos(
                model, qpos[i, w], initial_state_offset[i, w, : model.nv], 1.0
            )
    return qpos, qvel + initial_state_offset[..., model.nv :]


def _actuator_lengths(simulator, episode: int) -> Floats:
    """Lengths (nu) of the actuators where an episode begins."""
    import mujoco

    model = simulator.compiler.nominal
    data = mujoco.MjData(model)
    data.qpos[:] = estimate_initial_state(simulator, episode, np.zeros(1), {})[0][0]
    mujoco.mj_fwdPosition(model, data)
    return np.array(data.actuator_length)


def filter_commands(model, ctrl: Floats, step: float, begin: Floats) -> Floats:
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
            out[:, first] = _accumulate_clipped(added, float(begin[a]), low, high)
            continue
        keep = np.exp(-step / max(float(model.actuator_dynprm[a, 0]), 1e-9))
        now = ctrl[0, a]
        for k in range(len(ctrl)):
            out[k, first] = now
            now = ctrl[k, a] + (now - ctrl[k, a]) * keep
    return out


def _accumulate_clipped(
    added: Sequence[float], begin: float, low: float, high: float
) -> Floats:
    """Sums (G + 1) of what is added (G), none of which leaves its bounds."""
    sums = accumulate(added, lambda s, x: min(max(s + x, low), high), initial=begin)
    return np.fromiter(sums, float)


def _first_steps(simulator, episode: int) -> np.ndarray:
    """Steps of the grid in an episode's first moments; the first, if it is given."""
    own = simulator.episodes[episode]
    end = min(FIRST / simulator.timestep, len(own.ctrl) - 1) * (own.qpos0 is None)
    return np.unique(np.linspace(0, end, 25).astype(int))


def _servo_errors(simulator, episode, place) -> Floats:
    """What each step (G) of the grid adds to a servo's sum, as sent and read."""
    grid = np.arange(len(episode.ctrl), dtype=float)
    model = simulator.compiler.nominal
    joint = next(j for j in range(model.njnt) if model.jnt_qposadr[j] == place["qpos"])
    name = model.joint(joint).name
    c = next(
        c for c in simulator.channels if (c.kind, c.target) == ("joint_position", name)
    )
    value, _ = episode.interpolate(grid, simulator.timestep)
    error = episode.ctrl[:, place["actuator"]] - value[:, c.first_column]
    return np.where(np.isfinite(error), error, 0.0) * simulator.timestep
