"""Simulation against recording: takes hypotheses, gives what the sensors would say."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from ..recording.data import Floats
from .logs import Log
from .plant import Plant, Workshop, parts
from .scene import Channel
from .sense import Sensors, hidden
from .state import States
from .terms import Moment, Term, does
from .windows import Windows

VELOCITIES = ("joint_velocity", "body_linear_velocity", "body_angular_velocity")
WARM = 0.1  # [s] before a window in which a gear's inside settles; chosen
ROOM = 3e7  # numbers kept of one batch; chosen: 240 MB


@dataclass(frozen=True, eq=False)
class World:
    """A robot's model and its recordings.

    Attributes:
        workshop: makes compiled models.
        signals: the channels compared.
        logs: episodes on a grid of `step` s.
        step: of the simulation [s].
        counted: (1) windows simulated so far.
    """

    workshop: Workshop
    signals: tuple[Channel, ...]
    logs: tuple[Log, ...]
    step: float
    counted: np.ndarray = field(default_factory=lambda: np.zeros(1, int))
    _held: WeakKeyDictionary = field(default_factory=WeakKeyDictionary)

    def simulate(
        self,
        terms: Sequence[Term],
        values: Floats,
        windows: Windows,
        *,
        kick: Floats | None = None,
        centered: bool = False,
    ) -> Floats:
        """What the sensors would say.

        MuJoCo's one-stage integrators compute a velocity from the forces at the
        beginning of a step and a position from that velocity: started from both at one
        time, all motion comes half a step early. Read as a leapfrog, velocities half a
        step before positions and forces between two of them, the same steps are exact
        to second order but for what velocities do to each other (Hairer, Lubich,
        Wanner 2003, section 1.1): near enough to do also for the RK4 of one joint,
        which takes four times as long.

        Args:
            terms: what is true beyond the given model.
            values: (n, P) of all terms' parameters, of n hypotheses.
            windows: W pieces with M samples.
            kick: (n, W, 2 nv) added to the initial state, positions and then
                velocities in the given model's degrees of freedom.
            centered: whether commands, initial and sensed velocities are placed in time
                as a leapfrog has them, rather than as MuJoCo's user would.

        Returns:
            (n, M, C); NaN after a hypothesis diverged.
        """
        values = np.atleast_2d(values)
        width = max(1, sum(c.width for c in self.signals))
        size = len(windows) * (int(windows.steps.max()) + 2) * width
        count = max(1, int(ROOM / size))
        pieces = [
            self._simulate(
                terms, values[i : i + count], windows,
                None if kick is None else kick[i : i + count],
                centered,
            )
            for i in range(0, len(values), count)
        ]  # fmt: skip
        return np.concatenate(pieces)

    def _simulate(self, terms, values, windows, kick, centered) -> Floats:
        plant = self.workshop.plant(terms, leaping=centered)
        self.counted[0] += len(values) * len(windows)
        shares = parts(terms, values)
        models = [plant.variant(terms, v) for v in values]
        centered = centered and plant.leaps
        if centered:
            for model in models:
                _center_damping(model, self.step)
        reads = self.readings_of(terms, shares, len(values))
        those = _Hypotheses(plant, models, terms, values, shares, reads, centered)
        start = self._start(those, windows).begin(models, kick)
        if any("suffix" in place for t in terms for place in t.places):
            self._warm_up(those, windows, start)
        sensors = Sensors(plant, self.signals, terms)
        commands = self._commands(those, windows, centered)
        told = self._run(those, windows, start, commands, sensors)
        if centered:
            self._of_now(told, those, windows, commands)
        return self._sample(told, windows, reads, len(values), centered)

    def _start(self, those: "_Hypotheses", windows: Windows) -> States:
        return States(
            self, those.plant, those.terms, those.values, windows, those.reads
        )

    def _run(
        self, those: "_Hypotheses", windows: Windows, start, commands, sensors
    ) -> Floats:
        """True signals (N, K, C) from a start."""
        if any(does(t.effect, "act") for t in those.terms):
            return self._stepped(those, start, commands, windows, sensors)
        return _rolled(
            those.plant, those.models, start, commands, sensors, those.centered
        )

    def _of_now(
        self, told: Floats, those: "_Hypotheses", windows: Windows, early: Floats
    ) -> None:
        """Let torques told be those of the command of now, not of the half step ago."""
        torques = [c for c in self.signals if c.kind == "joint_torque"]
        if not torques:
            return
        w = len(windows)
        apart = self._commands(those, windows, False) - early
        for c in torques:
            a = those.plant.model.actuator(c.target).id
            for i, model in enumerate(those.models):
                if model.actuator_dyntype[a] == 0:
                    gear = float(model.actuator_gear[a, 0])
                    low, high = np.sort(gear * model.actuator_forcerange[a])
                    rows = slice(i * w, (i + 1) * w)
                    push = gear * model.actuator_gainprm[a, 0]
                    torque = told[rows, :, c.first]
                    torque += push * apart[rows, :, a]
                    if model.actuator_forcelimited[a]:
                        torque[:] = np.clip(torque, low, high)

    def _warm_up(self, those: "_Hypotheses", windows: Windows, start) -> None:
        """Let what no sensor reads, inside a gear, come from the time just before."""
        steps = max(1, round(WARM / self.step))
        rows = np.flatnonzero(windows.start >= steps)
        if not len(rows):
            return
        plant, n = those.plant, len(those.models)
        before = Windows(
            windows.log[rows], windows.start[rows] - steps, np.full(len(rows), steps),
            np.zeros(0, int), np.zeros(0), np.zeros((0, 0)),
        )  # fmt: skip
        places = [
            plant.place(p) for t in those.terms for p in t.places if "suffix" in p
        ]
        told = self._run(
            those, before, self._start(those, before).begin(those.models, None),
            self._commands(those, before, those.centered),
            Sensors(plant, hidden(plant, places)),
        )[:, steps].reshape(n, len(rows), len(places), 2)  # fmt: skip
        q, v = (x.reshape(n, len(windows), -1)[:, rows] for x in start[:2])
        for i, place in enumerate(places):
            known = np.isfinite(told[:, :, i]).all(axis=-1)
            for x, now, extra, own in (
                (q, told[:, :, i, 0], "extra_qpos", "qpos"),
                (v, told[:, :, i, 1], "extra_dof", "dof"),
            ):
                moved = np.where(known, now - x[..., place[extra]], 0.0)
                x[..., place[extra]] += moved
                if place["side"] == "link":
                    x[..., place[own]] -= moved
        for x, new in ((start[0], q), (start[1], v)):
            x.reshape(n, len(windows), -1)[:, rows] = new

    def readings_of(self, terms, shares, n: int) -> dict[str, dict[str, Floats]]:
        """Of each signal that a term changes: bias, gain, delay, step (n)."""
        reads: dict[str, dict[str, Floats]] = {}
        for term, part in zip(terms, shares, strict=True):
            if does(term.effect, "measure"):
                for place in term.places:
                    said = term.effect.measure(place, part)
                    reads.setdefault(place["signal"], {}).update(said)
        return reads

    def _commands(
        self, those: "_Hypotheses", windows: Windows, centered: bool
    ) -> Floats:
        """Commands (n W, K, nu) of each step, as they reach the actuators."""
        terms = those.terms
        if not any(does(t.effect, "command") for t in terms):
            kept = self._held.setdefault(windows, {})
            if centered not in kept:
                kept[centered] = self._reaching((), (), windows, centered)[0]
            return np.tile(kept[centered], (len(those.models), 1, 1))
        out = self._reaching(terms, those.shares, windows, centered)
        return out.reshape(-1, *out.shape[2:])

    def _reaching(self, terms, shares, windows: Windows, centered) -> Floats:
        """Commands (1 or n, W, K, nu)."""
        n = len(shares[0]) if terms else 1
        steps = np.arange(int(windows.steps.max()) + 2)
        out = np.empty((n, len(windows), len(steps), self.workshop.given.nu))
        for i in np.unique(windows.log):
            rows = np.flatnonzero(windows.log == i)
            grid = self.command(terms, shares, self.logs[i], centered)
            at = np.minimum(windows.start[rows][:, None] + steps, grid.shape[1] - 1)
            out[:, rows] = grid[:, at]
        return out

    def command(self, terms, shares, log: Log, centered: bool) -> Floats:
        """Commands (1 or n, G, nu) of an episode, as they reach the actuators."""
        ctrl = (log.centered if centered else log.ctrl)[None]
        for term, part in zip(terms, shares, strict=True):
            if does(term.effect, "command"):
                for place in term.places:
                    ctrl = term.effect.command(ctrl, self.step, place, part)
                    if centered and term.effect.of_before:
                        a = place["actuator"]
                        after = np.append(ctrl[:, 1:, a], ctrl[:, -1:, a], axis=1)
                        middle = (ctrl[:, :, a] + after) / 2
                        there = part[:, :1] > 0
                        ctrl[:, :, a] = np.where(there, middle, ctrl[:, :, a])
        return ctrl

    def _stepped(
        self, those: "_Hypotheses", start, commands, windows, sensors
    ) -> Floats:
        """True signals (N, K, C), where effects act at every step."""
        plant, models = those.plant, those.models
        n, w = len(models), len(windows)
        acts = [
            (t.effect, plant.place(place), np.repeat(part, w, axis=0))
            for t, part in zip(those.terms, those.shares, strict=True)
            if does(t.effect, "act")
            for place in t.places
        ]
        begin = np.tile(windows.start * self.step, n)
        # a thread a group: threads that wait for each other at every step are slow
        groups = np.array_split(np.arange(n * w), len(os.sched_getaffinity(0)))
        groups = [g for g in groups if len(g)]

        def run(rows: np.ndarray) -> Floats:
            batch = _batch(plant, models, w, rows, start, 1)
            return _step_by_step(
                batch, plant, [(e, p, v[rows]) for e, p, v in acts],
                {a: s[rows] for a, s in start[3].items()}, commands[rows],
                begin[rows], sensors, self.step,
                (rows, start) if those.centered else None,
            )  # fmt: skip

        with ThreadPoolExecutor(len(groups)) as pool:
            return np.concatenate(list(pool.map(run, groups)))

    def _sample(self, told: Floats, windows: Windows, reads, n: int, centered):
        """Signals (n, M, C) at the samples' times, as the sensors would say them."""
        told = told.reshape(n, len(windows), *told.shape[1:])
        out = np.empty((n, len(windows.at), told.shape[-1]))
        for c in self.signals:
            said = reads.get(c.name, {})
            delay = said.get("delay", np.zeros(1))[:, None] / self.step
            early = 0.5 if centered and c.kind in VELOCITIES else 0.0
            at = windows.at[None] - delay + early
            low = np.clip(np.floor(at).astype(int), 0, told.shape[2] - 2)
            share = (at - low)[..., None]
            rows = np.arange(n)[:, None]
            before, after = (
                told[rows, windows.window[None], low + i, c.columns] for i in (0, 1)
            )
            value = before + share * (after - before)
            gain = said.get("gain", np.ones(1))[:, None, None]
            bias = said.get("bias", np.zeros(1))[:, None, None]
            value = gain * value + bias
            if "step" in said:
                step = np.maximum(said["step"], 1e-12)[:, None, None]
                value = step * np.round(value / step)
            out[:, :, c.columns] = value
        return out


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """What n simulations of each window take to be true.

    Attributes:
        plant: with the joints that the terms add.
        models: (n) compiled.
        terms: of all.
        values: (n, P).
        shares: the same, by term.
        reads: of a signal: bias, gain, delay, step (n).
        centered: as `World.simulate` has it.
    """

    plant: Plant
    models: Sequence["mujoco.MjModel"]
    terms: Sequence[Term]
    values: Floats
    shares: Sequence[Floats]
    reads: Mapping[str, Mapping[str, Floats]]
    centered: bool


def _center_damping(model, step: float) -> None:
    """Let damping act on the mean of a step's two velocities, by a change of inertia.

    (M + D h) dv = h (f - D v) takes the later one, M dv = h (f - D v) the earlier one,
    and (M + D h / 2) dv = h (f - D v) their mean.
    """
    motor = np.zeros(model.nv)
    for a in range(model.nu):
        if model.actuator_trntype[a] in (0, 1) and model.actuator_biastype[a] == 1:
            dof = model.jnt_dofadr[model.actuator_trnid[a, 0]]
            motor[dof] -= model.actuator_gear[a, 0] ** 2 * model.actuator_biasprm[a, 2]
    joint = np.array(model.dof_damping).reshape(model.nv, -1)[:, 0]
    explicit = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    if model.opt.integrator != int(mujoco.mjtIntegrator.mjINT_EULER):
        motor = -motor
        joint = -joint
    elif not model.opt.disableflags & explicit:
        joint = -joint
    change = step / 2 * (joint + motor)
    model.dof_armature += np.maximum(change, -0.5 * model.dof_M0)


def _batch(plant: Plant, models, w: int, rows, start, threads: int):
    """Simulations `rows` of n models by w windows, at their start."""
    from mujoco.batch import Batch

    batch = Batch(plant.model, len(rows), nthread=threads)
    for name in _numbers(plant.model):
        values = [_get(m, name) for m in models]
        usual = _get(plant.model, name)
        if any(not np.array_equal(v, usual) for v in values):
            batch.expand(name)[:] = np.stack(values)[rows // w]
    _place(batch, plant, rows, start)
    return batch


def _place(batch, plant: Plant, rows, start) -> None:
    """Let simulations be at their start."""
    batch.bind("qpos")[:], batch.bind("qvel")[:] = start[0][rows], start[1][rows]
    batch.bind("time")[:] = 0
    if plant.model.na:
        batch.bind("act")[:] = start[2][rows]
    if plant.model.nhistory:
        batch.bind("history")[:] = start[4][rows]


def _half_a_step_earlier(batch, plant: Plant, rows, start) -> Floats:
    """Let simulations that made one step start again, by velocities of before."""
    velocity = start[1][rows]
    velocity = velocity - (batch.bind("qvel") - velocity) / 2
    _place(batch, plant, rows, start)
    batch.bind("qvel")[:] = velocity
    return velocity


@cache
def _fields() -> tuple[str, ...]:
    """Fields that an edit of a compiled model may change."""
    from mujoco.batch import MODEL_FIELDS

    key = ("actuator_", "body_", "dof_", "geom_", "jnt_", "qpos", "site_", "opt.")
    return tuple(sorted(f for f in MODEL_FIELDS if f.startswith(key)))


def _numbers(model) -> list[str]:
    return [
        f for f in _fields() if np.size(_get(model, f)) and _get(model, f) is not None
    ]


def _get(model, name: str):
    if name.startswith("opt."):
        return np.array(getattr(model.opt, name[4:]))
    return getattr(model, name, None)


def _rolled(
    plant: Plant, models, start, commands: Floats, sensors, centered: bool
) -> Floats:
    """True signals (N, K, C), where MuJoCo alone does all the work."""
    size, steps = commands.shape[:2]
    threads = len(os.sched_getaffinity(0))
    rows = np.arange(size)
    batch = _batch(plant, models, size // len(models), rows, start, threads)
    fields = sorted({"qpos", "qvel", *sensors.needs})
    told = np.empty((size, steps, sensors.width))
    first_velocity = start[1]
    if centered:
        batch.rollout(1, commands[:, :1] if plant.model.nu else None, record=["qvel"])
        first_velocity = _half_a_step_earlier(batch, plant, rows, start)
    seen = batch.rollout(steps, commands if plant.model.nu else None, record=fields)
    # a step leaves position and velocity new, and all else as before it
    for name, first in (("qpos", start[0]), ("qvel", first_velocity)):
        seen[name] = np.concatenate([first[:, None], seen[name][:, :-1]], axis=1)
    flat = {k: v.reshape(size * steps, *v.shape[2:]) for k, v in seen.items()}
    sensors.of_state(flat, told.reshape(size * steps, -1))
    sensors.of_forward(flat, told.reshape(size * steps, -1))
    told[_diverged(batch)] = np.nan
    return told


def _diverged(batch) -> np.ndarray:
    """(N) whether MuJoCo warned that a simulation is no longer one."""
    bad = [
        int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{x}"))
        for x in ("QPOS", "QVEL", "QACC")
    ]
    return batch.warning[:, bad, 1].any(axis=1)


def _step_by_step(
    batch, plant: Plant, acts, sums, commands: Floats, begin, sensors, dt: float, again
) -> Floats:
    """True signals (N, K, C) of simulations in which effects act at every step."""
    bound = {name: batch.bind(name) for name in {"qpos", "qvel", *sensors.needs}}
    ctrl = batch.bind("ctrl") if plant.model.nu else None
    forces = _Forces(batch, acts, sums, dt)
    told = np.empty((len(commands), commands.shape[1], sensors.width))
    if again:
        if ctrl is not None:
            ctrl[:] = commands[:, 0]
        forces.step(bound["qpos"], bound["qvel"], ctrl, begin)
        batch.step()
        _half_a_step_earlier(batch, plant, *again)
        forces.sums = {a: s.copy() for a, s in sums.items()}
    for k in range(commands.shape[1]):
        if ctrl is not None:
            ctrl[:] = commands[:, k]
        sensors.of_state(bound, told[:, k])
        forces.step(bound["qpos"], bound["qvel"], ctrl, begin + k * dt)
        batch.step()
        sensors.of_forward(bound, told[:, k])
    told[_diverged(batch)] = np.nan
    return told


class _Forces:
    """What effects do at each step, written into a batch."""

    def __init__(self, batch, acts, sums: Mapping[int, Floats], step: float) -> None:
        self.acts = acts
        self.applied = batch.bind("qfrc_applied")
        self.torque = batch.bind("qfrc_actuator")
        self.loss = batch.expand("dof_frictionloss")
        self.usual_loss = self.loss.copy()
        self.limits: Floats | None = None
        self.sums = {a: s.copy() for a, s in sums.items()}
        self.dt = step
        if any(effect.limits_actuators for effect, _, _ in acts):
            limited = batch.expand("actuator_forcelimited")
            self.limits = batch.expand("actuator_forcerange")
            wide = np.where(limited[..., None] > 0, self.limits, [-np.inf, np.inf])
            self.usual_limits = np.clip(wide, -1e9, 1e9)
            limited[:] = 1

    def step(self, qpos, qvel, ctrl, time) -> None:
        """Let every effect act on the state of now."""
        self.applied[:] = 0
        self.loss[:] = self.usual_loss
        if self.limits is not None:
            self.limits[:] = self.usual_limits
        moment = Moment(
            time, qpos, qvel, ctrl, self.torque, self.applied, self.loss,
            self.limits, self.sums, self.dt,
        )  # fmt: skip
        for effect, place, values in self.acts:
            effect.act(moment, place, values)
