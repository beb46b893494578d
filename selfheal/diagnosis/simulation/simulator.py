"""Simulation against recording: takes hypotheses, gives what the sensors would say."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from mujoco import MjData

from ...recording.data import Floats
from ..data.episodes import SampledEpisode
from ..data.robot_summary import Channel
from ..data.segments import Segments
from ..effects.base import Term, implements
from .checkpoint import Checkpoint
from .initial_states import InitialStates
from .model_variants import ModelCompiler, split_values
from .rollout import Hypotheses, center_damping, simulate_batch
from .sensors import SensorReader, make_second_joint_channels

WARM = 0.3  # [s] before a window in which a gear's inside settles; chosen
ALIKE = 1e-6  # of a step, by which times that are the same may differ
# of a step, as much as one cannot say when in it a command acts; chosen: half a step of
# whoever simulates in quarters, a servo's bus is no better
LATE = 0.125
ROOM = 6e7  # numbers kept of one batch, copies too; chosen: 480 MB


@dataclass(frozen=True, eq=False)
class Simulator:
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

    compiler: ModelCompiler
    channels: tuple[Channel, ...]
    episodes: tuple[SampledEpisode, ...]
    timestep: float
    has_contact: bool = False
    checkpoint: Checkpoint = field(default_factory=Checkpoint)
    simulated_count: np.ndarray = field(default_factory=lambda: np.zeros(1, int))
    cache: WeakKeyDictionary = field(default_factory=WeakKeyDictionary)

    def simulate(
        self,
        terms: Sequence[Term],
        values: Floats,
        segments: Segments,
        *,
        initial_state_offset: Floats | None = None,
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
            segments: W pieces with M samples.
            initial_state_offset: (n, W, 2 nv) added to the initial state, positions and
                then velocities in the given model's degrees of freedom.
            centered: whether commands, initial and sensed velocities are placed in time
                as a leapfrog has them, rather than as MuJoCo's user would.

        Returns:
            (n, M, C); NaN after a hypothesis diverged.
        """
        values = np.atleast_2d(values)
        if not any(t.onset for t in terms):
            return self._simulate_in_batches(
                terms, values, segments, initial_state_offset, centered
            )
        there = self._find_active_terms(terms, segments)
        of_each = np.repeat(np.arange(len(terms)), [len(t.parameters) for t in terms])
        predicted = np.empty((len(values), *segments.readings.shape))
        for kind in np.unique(there, axis=0):
            chosen = np.flatnonzero((there == kind).all(axis=1))
            predicted[:, segments.find_sample_rows(chosen)] = self._simulate_in_batches(
                [t for t, is_there in zip(terms, kind, strict=True) if is_there],
                values[:, kind[of_each]],
                self.select_segments(segments, chosen),
                None
                if initial_state_offset is None
                else initial_state_offset[:, chosen],
                centered,
            )
        return predicted

    def _find_active_terms(
        self, terms: Sequence[Term], segments: Segments
    ) -> np.ndarray:
        """(W, T) whether each term holds in most of each window."""
        there = np.ones((len(segments), len(terms)), bool)
        for i, episode in enumerate(self.episodes):
            rows = np.flatnonzero(segments.episode == i)
            middle = segments.first_step[rows] + segments.lengths[rows] / 2
            times = episode.start + middle * self.timestep
            for k, term in enumerate(terms):
                if term.onset and episode.number == term.onset.number:
                    there[rows, k] = times > term.onset.time
                elif term.onset:
                    there[rows, k] = episode.number > term.onset.number
        return there

    def select_segments(self, segments: Segments, chosen: np.ndarray) -> Segments:
        """Some windows, the same ones each time: what is held of them is found."""
        kept = self.cache.setdefault(segments, {})
        key = np.asarray(chosen).tobytes()
        if key not in kept:
            kept[key] = segments.select(chosen)
        return kept[key]

    def _simulate_in_batches(
        self, terms, values: Floats, segments, initial_state_offset, centered
    ) -> Floats:
        """The same of terms that hold all the time, as many at once as there is room.

        Values (n, P).
        """
        size = (
            len(segments) * (int(segments.lengths.max()) + 2) * self._numbers_per_step
        )
        count = max(1, int(ROOM / size))
        pieces = [
            self._simulate(
                terms,
                values[i : i + count],
                segments,
                None
                if initial_state_offset is None
                else initial_state_offset[i : i + count],
                centered,
            )
            for i in range(0, len(values), count)
        ]
        return np.concatenate(pieces)

    @cached_property
    def with_half_step(self) -> "Simulator":
        """The same, simulated in steps of half the size."""
        logs = tuple(episode.with_half_step for episode in self.episodes)
        return self._with_changes(timestep=self.timestep / 2, episodes=logs)

    @cached_property
    def with_late_commands(self) -> "Simulator":
        """The same, where all commands act `LATE` of a step later."""
        return self._with_changes(
            episodes=tuple(
                episode.with_late_commands(LATE) for episode in self.episodes
            )
        )

    def with_channels(self, signals: tuple[Channel, ...]) -> "Simulator":
        """The same, whose noise is known otherwise: states are read otherwise."""
        return replace(self, channels=signals, cache=WeakKeyDictionary())

    def _with_changes(self, **changes) -> "Simulator":
        """Changed, and with nothing worked out of it yet."""
        return replace(
            self, checkpoint=Checkpoint(), cache=WeakKeyDictionary(), **changes
        )

    @cached_property
    def _numbers_per_step(self) -> int:
        """Numbers kept of one step: what is recorded, its copy, and the signals."""
        model = self.compiler.nominal
        sensors, data = (
            SensorReader(self.compiler.compile_variant(()), self.channels),
            MjData(model),
        )
        kept = {"qpos", "qvel", *sensors.needs}
        return sensors.width + 2 * sum(np.size(getattr(data, f)) for f in kept)

    def _simulate(
        self, terms, values, segments, initial_state_offset, centered
    ) -> Floats:
        variant = self.compiler.compile_variant(terms, leaping=centered)
        self.simulated_count[0] += len(values) * len(segments)
        shares = split_values(terms, values)
        models = variant.build_models(terms, values)
        for model in models:
            model.opt.timestep = self.timestep
        mean, centered = centered, centered and variant.is_single_stage
        if centered:
            for model in models:
                center_damping(model, self.timestep)
        reads = self.collect_reading_changes(terms, shares, len(values))
        hypotheses = Hypotheses(variant, models, terms, values, shares, reads, centered)
        start = self._make_initial_states(hypotheses, segments).compute(
            models, initial_state_offset
        )
        if any("suffix" in place for t in terms for place in t.places):
            self._warm_up(hypotheses, segments, start)
        sensors = SensorReader(variant, self.channels, terms)
        commands = self._compute_commands(hypotheses, segments, centered, mean)
        predicted = simulate_batch(
            hypotheses,
            segments,
            start,
            commands,
            sensors,
            self._find_sampled_steps(segments, reads),
            step=self.timestep,
        )
        predicted = predicted.reshape(len(values), len(segments), *predicted.shape[1:])
        return self._sample_signals(
            predicted, hypotheses, segments, commands.reshape(*predicted.shape[:3], -1)
        )

    def _make_initial_states(
        self, hypotheses: Hypotheses, segments: Segments
    ) -> InitialStates:
        return InitialStates(
            self,
            hypotheses.variant,
            hypotheses.terms,
            hypotheses.values,
            segments,
            hypotheses.reading_changes,
        )

    def _warm_up(self, hypotheses: Hypotheses, segments: Segments, start) -> None:
        """Let what no sensor reads, inside a gear, come from the time just before."""
        steps = max(1, round(WARM / self.timestep))
        rows = np.flatnonzero(segments.first_step >= steps)
        if not len(rows):
            return
        variant, n = hypotheses.variant, len(hypotheses.models)
        before = Segments(
            segments.episode[rows],
            segments.first_step[rows] - steps,
            np.full(len(rows), steps),
            np.zeros(0, int),
            np.zeros(0),
            np.zeros((0, 0)),
        )
        places = [
            variant.map_place(p)
            for t in hypotheses.terms
            for p in t.places
            if "suffix" in p
        ]
        predicted = simulate_batch(
            hypotheses,
            before,
            self._make_initial_states(hypotheses, before).compute(
                hypotheses.models, None
            ),
            self._compute_commands(
                hypotheses, before, hypotheses.centered, hypotheses.centered
            ),
            SensorReader(variant, make_second_joint_channels(variant, places)),
            np.zeros(0, int),
            step=self.timestep,
        )[:, steps].reshape(n, len(rows), len(places), 2)
        q, v = (x.reshape(n, len(segments), -1)[:, rows] for x in start[:2])
        for i, place in enumerate(places):
            known = np.isfinite(predicted[:, :, i]).all(axis=-1)
            for x, now, extra, own in (
                (q, predicted[:, :, i, 0], "extra_qpos", "qpos"),
                (v, predicted[:, :, i, 1], "extra_dof", "dof"),
            ):
                moved = np.where(known, now - x[..., place[extra]], 0.0)
                x[..., place[extra]] += moved
                if place["side"] == "link":
                    x[..., place[own]] -= moved
        for x, new in ((start[0], q), (start[1], v)):
            x.reshape(n, len(segments), -1)[:, rows] = new

    def collect_reading_changes(
        self, terms, shares, n: int
    ) -> dict[str, dict[str, Floats]]:
        """Of each signal that terms change: bias (n, width), gain, delay, step (n)."""
        reads: dict[str, dict[str, Floats]] = {}
        for term, part in zip(terms, shares, strict=True):
            if implements(term.effect, "transform_reading"):
                for place in term.places:
                    said = term.effect.transform_reading(place, part)
                    reads.setdefault(place["signal"], {}).update(said)
        return reads

    def _find_sampled_steps(self, segments: Segments, reads) -> np.ndarray:
        """Steps of windows beside which a sample lies, of any hypothesis."""
        delays = [said["delay"] for said in reads.values() if "delay" in said]
        late = np.unique(np.concatenate([np.zeros(1), *delays])) / self.timestep
        low = np.floor(np.unique(segments.sample_steps) - late[:, None] + ALIKE).astype(
            int
        )
        last = int(segments.lengths.max()) + 1
        return np.unique(np.clip([low, low + 1], 0, last))

    def _compute_commands(
        self, hypotheses: Hypotheses, segments: Segments, centered: bool, mean: bool
    ) -> Floats:
        """Commands (n W, K, nu) of each step, as they reach the actuators."""
        terms = hypotheses.terms
        if not any(implements(t.effect, "transform_command") for t in terms):
            kept = self.cache.setdefault(segments, {})
            if centered not in kept:
                kept[centered] = self._transform_segments(
                    (), (), segments, centered, mean
                )[0]
            return np.tile(kept[centered], (len(hypotheses.models), 1, 1))
        out = self._transform_segments(
            terms, hypotheses.term_values, segments, centered, mean
        )
        return out.reshape(-1, *out.shape[2:])

    def _transform_segments(
        self, terms, shares, segments: Segments, centered, mean
    ) -> Floats:
        """Commands (1 or n, W, K, nu)."""
        n = len(shares[0]) if terms else 1
        steps = np.arange(int(segments.lengths.max()) + 2)
        out = np.empty((n, len(segments), len(steps), self.compiler.nominal.nu))
        for i in np.unique(segments.episode):
            rows = np.flatnonzero(segments.episode == i)
            episode = self.episodes[i].truncate(
                int(segments.first_step[rows].max()) + len(steps) + 1
            )
            grid = self.transform_commands(terms, shares, episode, centered, mean)
            at = np.minimum(
                segments.first_step[rows][:, None] + steps, grid.shape[1] - 1
            )
            out[:, rows] = grid[:, at]
        return out

    def transform_commands(
        self, terms, shares, episode: SampledEpisode, centered: bool, mean: bool
    ) -> Floats:
        """Commands (1 or n, G, nu) of an episode, as they reach the actuators.

        Centered in time as a leapfrog has them, or not; and, of what changes within a
        step, its mean or, as MuJoCo has it, what it was when the step began.
        """
        ctrl = (episode.ctrl_centered if centered else episode.ctrl)[None]
        for term, part in zip(terms, shares, strict=True):
            if implements(term.effect, "transform_command"):
                for place in term.places:
                    ctrl = term.effect.transform_command(
                        ctrl, self.timestep, place, part
                    )
                    if mean and term.effect.holds_previous_command:
                        a = place["actuator"]
                        after = np.append(ctrl[:, 1:, a], ctrl[:, -1:, a], axis=1)
                        middle = (ctrl[:, :, a] + after) / 2
                        there = part[:, :1] > 0
                        ctrl[:, :, a] = np.where(there, middle, ctrl[:, :, a])
        return ctrl

    def _sample_signals(
        self, predicted, hypotheses: Hypotheses, segments: Segments, used
    ) -> Floats:
        """Signals (n, M, C) at the samples' times, as the sensors would say them.

        Of true ones (n, W, K, C) and the commands `used` (n, W, K, nu).
        """
        out = np.empty(
            (len(predicted), len(segments.sample_steps), predicted.shape[-1])
        )
        for c in self.channels:
            said = hypotheses.reading_changes.get(c.name, {})
            delay = said.get("delay", np.zeros(1))[:, None] / self.timestep
            at = segments.sample_steps[None] - delay
            value = _interpolate(predicted[..., c.columns], segments, at)
            if c.kind == "body_orientation" and "delay" in said:
                value /= np.linalg.norm(value, axis=-1, keepdims=True)
            if c.kind == "joint_torque":
                self._correct_torques(value[..., 0], c, hypotheses, segments, at, used)
            gain = said.get("gain", np.ones(1))[:, None, None]
            bias = said.get("bias", np.zeros((1, 1)))[:, None]
            value = gain * value + bias
            if "step" in said:
                step = np.maximum(said["step"], 1e-12)[:, None, None]
                value = step * np.round(value / step)
            out[:, :, c.columns] = value
        return out

    def _correct_torques(
        self, predicted: Floats, c: Channel, hypotheses, segments, at, used
    ) -> None:
        """Let torques (n, M) be of the commands that hold when they are read.

        A step has the mean of what is sent in it, or half a step earlier.
        """
        model = hypotheses.models[0]
        a = model.actuator(c.target).id
        if model.actuator_dyntype[a] or model.actuator_delay[a]:
            return
        changed = [
            t for t in hypotheses.terms if implements(t.effect, "transform_command")
        ]
        if any(place["actuator"] == a for t in changed for place in t.places):
            now = self._compute_commands(hypotheses, segments, False, False).reshape(
                used.shape
            )
            sent = _interpolate(now[..., [a]], segments, at)[..., 0]
        else:
            sent = self._find_sent_command(segments, at, a)
        apart = sent - _interpolate(used[..., [a]], segments, at)[..., 0]
        for i, own in enumerate(hypotheses.models):
            gear = float(own.actuator_gear[a, 0])
            predicted[i] += gear * own.actuator_gainprm[a, 0] * apart[i]
            if own.actuator_forcelimited[a]:
                low, high = np.sort(gear * own.actuator_forcerange[a])
                predicted[i] = np.clip(predicted[i], low, high)

    def _find_sent_command(self, segments: Segments, at: Floats, a: int) -> Floats:
        """Command (1 or n, M) of an actuator that holds at times `at`."""
        out = np.empty(at.shape)
        for i, episode in enumerate(self.episodes):
            rows = np.flatnonzero(segments.episode[segments.segment_of_sample] == i)
            when = (
                segments.first_step[segments.segment_of_sample[rows]]
                + at[:, rows]
                + ALIKE
            )
            k = np.searchsorted(episode.sample_steps, when, side="right") - 1
            out[:, rows] = episode.sent_ctrl[np.maximum(k, 0), a]
        return out


def _interpolate(grid: Floats, segments: Segments, at: Floats) -> Floats:
    """Values (n, M, c) at times `at` (n, M) of what (n, W, K, c) has at each step."""
    low = np.clip(np.floor(at).astype(int), 0, grid.shape[2] - 2)
    share = (at - low)[..., None]
    rows = np.arange(len(grid))[:, None]
    before, after = (
        grid[rows, segments.segment_of_sample[None], low + i] for i in (0, 1)
    )
    return before + share * (after - before)
