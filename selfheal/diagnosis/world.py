"""Simulation against recording: takes hypotheses, gives what the sensors would say."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from mujoco import MjData

from ..recording.data import Floats
from .logs import Log
from .memory import Memory
from .plant import Workshop, parts
from .rollout import Hypotheses, center_damping, simulated
from .scene import Channel
from .sense import Sensors, hidden
from .starts import States
from .terms import Term, does
from .windows import Windows

WARM = 0.3  # [s] before a window in which a gear's inside settles; chosen
ALIKE = 1e-6  # of a step, by which times that are the same may differ
# of a step, as much as one cannot say when in it a command acts; chosen: half a step of
# whoever simulates in quarters, a servo's bus is no better
LATE = 0.125
ROOM = 6e7  # numbers kept of one batch, copies too; chosen: 480 MB


@dataclass(frozen=True, eq=False)
class World:
    """A robot's model and its recordings.

    Attributes:
        workshop: makes compiled models.
        signals: the channels compared.
        logs: episodes on a grid of `step` s.
        step: of the simulation [s].
        touches: whether anything touches, as the given model moves.
        memory: keeps what is worked out of it.
        counted: (1) windows simulated so far.
        held: of windows, what does not change with a hypothesis.
    """

    workshop: Workshop
    signals: tuple[Channel, ...]
    logs: tuple[Log, ...]
    step: float
    touches: bool = False
    memory: Memory = field(default_factory=Memory)
    counted: np.ndarray = field(default_factory=lambda: np.zeros(1, int))
    held: WeakKeyDictionary = field(default_factory=WeakKeyDictionary)

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
        if not any(t.onset for t in terms):
            return self._in_batches(terms, values, windows, kick, centered)
        there = self._there(terms, windows)
        of_each = np.repeat(np.arange(len(terms)), [len(t.parameters) for t in terms])
        told = np.empty((len(values), *windows.readings.shape))
        for kind in np.unique(there, axis=0):
            chosen = np.flatnonzero((there == kind).all(axis=1))
            told[:, windows.rows(chosen)] = self._in_batches(
                [t for t, is_there in zip(terms, kind, strict=True) if is_there],
                values[:, kind[of_each]], self.taken(windows, chosen),
                None if kick is None else kick[:, chosen], centered,
            )  # fmt: skip
        return told

    def _there(self, terms: Sequence[Term], windows: Windows) -> np.ndarray:
        """(W, T) whether each term holds in most of each window."""
        there = np.ones((len(windows), len(terms)), bool)
        for i, log in enumerate(self.logs):
            rows = np.flatnonzero(windows.log == i)
            middle = windows.start[rows] + windows.steps[rows] / 2
            times = log.start + middle * self.step
            for k, term in enumerate(terms):
                if term.onset and log.number == term.onset.number:
                    there[rows, k] = times > term.onset.time
                elif term.onset:
                    there[rows, k] = log.number > term.onset.number
        return there

    def taken(self, windows: Windows, chosen: np.ndarray) -> Windows:
        """Some windows, the same ones each time: what is held of them is found."""
        kept = self.held.setdefault(windows, {})
        key = np.asarray(chosen).tobytes()
        if key not in kept:
            kept[key] = windows.take(chosen)
        return kept[key]

    def _in_batches(self, terms, values: Floats, windows, kick, centered) -> Floats:
        """The same of terms that hold all the time, as many at once as there is room.

        Values (n, P).
        """
        size = len(windows) * (int(windows.steps.max()) + 2) * self._width
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

    @cached_property
    def halved(self) -> "World":
        """The same, simulated in steps of half the size."""
        logs = tuple(log.halved for log in self.logs)
        return self._new(step=self.step / 2, logs=logs)

    @cached_property
    def later(self) -> "World":
        """The same, where all commands act `LATE` of a step later."""
        return self._new(logs=tuple(log.later(LATE) for log in self.logs))

    def hearing(self, signals: tuple[Channel, ...]) -> "World":
        """The same, whose noise is known otherwise: states are read otherwise."""
        return replace(self, signals=signals, held=WeakKeyDictionary())

    def _new(self, **changes) -> "World":
        """Changed, and with nothing worked out of it yet."""
        return replace(self, memory=Memory(), held=WeakKeyDictionary(), **changes)

    @cached_property
    def _width(self) -> int:
        """Numbers kept of one step: what is recorded, its copy, and the signals."""
        model = self.workshop.given
        sensors, data = Sensors(self.workshop.plant(()), self.signals), MjData(model)
        kept = {"qpos", "qvel", *sensors.needs}
        return sensors.width + 2 * sum(np.size(getattr(data, f)) for f in kept)

    def _simulate(self, terms, values, windows, kick, centered) -> Floats:
        plant = self.workshop.plant(terms, leaping=centered)
        self.counted[0] += len(values) * len(windows)
        shares = parts(terms, values)
        models = plant.variants(terms, values)
        for model in models:
            model.opt.timestep = self.step
        mean, centered = centered, centered and plant.leaps
        if centered:
            for model in models:
                center_damping(model, self.step)
        reads = self.readings_of(terms, shares, len(values))
        those = Hypotheses(plant, models, terms, values, shares, reads, centered)
        start = self._start(those, windows).begin(models, kick)
        if any("suffix" in place for t in terms for place in t.places):
            self._warm_up(those, windows, start)
        sensors = Sensors(plant, self.signals, terms)
        commands = self._commands(those, windows, centered, mean)
        told = simulated(
            those, windows, start, commands, sensors, self._looked_at(windows, reads),
            step=self.step,
        )  # fmt: skip
        told = told.reshape(len(values), len(windows), *told.shape[1:])
        return self._sample(told, those, windows, commands.reshape(*told.shape[:3], -1))

    def _start(self, those: Hypotheses, windows: Windows) -> States:
        return States(
            self, those.plant, those.terms, those.values, windows, those.reads
        )

    def _warm_up(self, those: Hypotheses, windows: Windows, start) -> None:
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
        told = simulated(
            those, before, self._start(those, before).begin(those.models, None),
            self._commands(those, before, those.centered, those.centered),
            Sensors(plant, hidden(plant, places)), np.zeros(0, int), step=self.step,
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
        """Of each signal that terms change: bias (n, width), gain, delay, step (n)."""
        reads: dict[str, dict[str, Floats]] = {}
        for term, part in zip(terms, shares, strict=True):
            if does(term.effect, "measure"):
                for place in term.places:
                    said = term.effect.measure(place, part)
                    reads.setdefault(place["signal"], {}).update(said)
        return reads

    def _looked_at(self, windows: Windows, reads) -> np.ndarray:
        """Steps of windows beside which a sample lies, of any hypothesis."""
        delays = [said["delay"] for said in reads.values() if "delay" in said]
        late = np.unique(np.concatenate([np.zeros(1), *delays])) / self.step
        low = np.floor(np.unique(windows.at) - late[:, None] + ALIKE).astype(int)
        last = int(windows.steps.max()) + 1
        return np.unique(np.clip([low, low + 1], 0, last))

    def _commands(
        self, those: Hypotheses, windows: Windows, centered: bool, mean: bool
    ) -> Floats:
        """Commands (n W, K, nu) of each step, as they reach the actuators."""
        terms = those.terms
        if not any(does(t.effect, "command") for t in terms):
            kept = self.held.setdefault(windows, {})
            if centered not in kept:
                kept[centered] = self._reaching((), (), windows, centered, mean)[0]
            return np.tile(kept[centered], (len(those.models), 1, 1))
        out = self._reaching(terms, those.shares, windows, centered, mean)
        return out.reshape(-1, *out.shape[2:])

    def _reaching(self, terms, shares, windows: Windows, centered, mean) -> Floats:
        """Commands (1 or n, W, K, nu)."""
        n = len(shares[0]) if terms else 1
        steps = np.arange(int(windows.steps.max()) + 2)
        out = np.empty((n, len(windows), len(steps), self.workshop.given.nu))
        for i in np.unique(windows.log):
            rows = np.flatnonzero(windows.log == i)
            log = self.logs[i].until(int(windows.start[rows].max()) + len(steps) + 1)
            grid = self.command(terms, shares, log, centered, mean)
            at = np.minimum(windows.start[rows][:, None] + steps, grid.shape[1] - 1)
            out[:, rows] = grid[:, at]
        return out

    def command(self, terms, shares, log: Log, centered: bool, mean: bool) -> Floats:
        """Commands (1 or n, G, nu) of an episode, as they reach the actuators.

        Centered in time as a leapfrog has them, or not; and, of what changes within a
        step, its mean or, as MuJoCo has it, what it was when the step began.
        """
        ctrl = (log.centered if centered else log.ctrl)[None]
        for term, part in zip(terms, shares, strict=True):
            if does(term.effect, "command"):
                for place in term.places:
                    ctrl = term.effect.command(ctrl, self.step, place, part)
                    if mean and term.effect.of_before:
                        a = place["actuator"]
                        after = np.append(ctrl[:, 1:, a], ctrl[:, -1:, a], axis=1)
                        middle = (ctrl[:, :, a] + after) / 2
                        there = part[:, :1] > 0
                        ctrl[:, :, a] = np.where(there, middle, ctrl[:, :, a])
        return ctrl

    def _sample(self, told, those: Hypotheses, windows: Windows, used) -> Floats:
        """Signals (n, M, C) at the samples' times, as the sensors would say them.

        Of true ones (n, W, K, C) and the commands `used` (n, W, K, nu).
        """
        out = np.empty((len(told), len(windows.at), told.shape[-1]))
        for c in self.signals:
            said = those.reads.get(c.name, {})
            delay = said.get("delay", np.zeros(1))[:, None] / self.step
            at = windows.at[None] - delay
            value = _between(told[..., c.columns], windows, at)
            if c.kind == "body_orientation" and "delay" in said:
                value /= np.linalg.norm(value, axis=-1, keepdims=True)
            if c.kind == "joint_torque":
                self._of_now(value[..., 0], c, those, windows, at, used)
            gain = said.get("gain", np.ones(1))[:, None, None]
            bias = said.get("bias", np.zeros((1, 1)))[:, None]
            value = gain * value + bias
            if "step" in said:
                step = np.maximum(said["step"], 1e-12)[:, None, None]
                value = step * np.round(value / step)
            out[:, :, c.columns] = value
        return out

    def _of_now(self, told: Floats, c: Channel, those, windows, at, used) -> None:
        """Let torques (n, M) be of the commands that hold when they are read.

        A step has the mean of what is sent in it, or half a step earlier.
        """
        model = those.models[0]
        a = model.actuator(c.target).id
        if model.actuator_dyntype[a] or model.actuator_delay[a]:
            return
        changed = [t for t in those.terms if does(t.effect, "command")]
        if any(place["actuator"] == a for t in changed for place in t.places):
            now = self._commands(those, windows, False, False).reshape(used.shape)
            sent = _between(now[..., [a]], windows, at)[..., 0]
        else:
            sent = self._sent(windows, at, a)
        apart = sent - _between(used[..., [a]], windows, at)[..., 0]
        for i, own in enumerate(those.models):
            gear = float(own.actuator_gear[a, 0])
            told[i] += gear * own.actuator_gainprm[a, 0] * apart[i]
            if own.actuator_forcelimited[a]:
                low, high = np.sort(gear * own.actuator_forcerange[a])
                told[i] = np.clip(told[i], low, high)

    def _sent(self, windows: Windows, at: Floats, a: int) -> Floats:
        """Command (1 or n, M) of an actuator that holds at times `at`."""
        out = np.empty(at.shape)
        for i, log in enumerate(self.logs):
            rows = np.flatnonzero(windows.log[windows.window] == i)
            when = windows.start[windows.window[rows]] + at[:, rows] + ALIKE
            k = np.searchsorted(log.at, when, side="right") - 1
            out[:, rows] = log.sent[np.maximum(k, 0), a]
        return out


def _between(grid: Floats, windows: Windows, at: Floats) -> Floats:
    """Values (n, M, c) at times `at` (n, M) of what (n, W, K, c) has at each step."""
    low = np.clip(np.floor(at).astype(int), 0, grid.shape[2] - 2)
    share = (at - low)[..., None]
    rows = np.arange(len(grid))[:, None]
    before, after = (grid[rows, windows.window[None], low + i] for i in (0, 1))
    return before + share * (after - before)
