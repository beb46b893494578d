"""Simulation of recordings: takes hypotheses, gives what the sensors would read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from mujoco import MjData

from ...recording.data import Floats
from ..data.robot_summary import Channel
from ..data.segments import Segments
from ..effects.base import Term
from ..effects.commands import CommandGrid
from ..effects.places import SignalPlace
from ..effects.protocols import SensorMap
from .batch import Hypotheses, center_damping
from .cache import SimulationCache, SimulationCounter
from .checkpoint import Arrays, Checkpoint
from .commands import compute_commands
from .initial_states import InitialStates
from .model_variants import split_values
from .rollout import simulate_batch
from .sampling import find_sampled_steps, sample_signals
from .sensors import SensorReader
from .system import RecordedSystem
from .warm_up import warm_up_added_joints

# [steps] as much as one cannot say when in a step a command acts; chosen: half a step
# of whoever simulates in quarters, a servo's bus is no better
COMMAND_LATENESS = 0.125
# numbers that a batch keeps, copies too: 160 MB; chosen: more takes as long for each
MAX_BATCH_NUMBERS = 2e7


@dataclass(frozen=True, eq=False)
class Simulator(RecordedSystem):
    """Simulates a recorded system; the objects that it holds beside that are shared.

    Simulators made from one another share the counter, and the checkpoint or the cache
    where these hold for both.

    Attributes:
        centered: whether commands, initial velocities and velocities read lie in time
            as a leapfrog has them, rather than as a user of MuJoCo would.
        checkpoint: keeps the results of fits on disk.
        counter: of the segments simulated.
    """

    centered: bool = False
    checkpoint: Checkpoint = field(default_factory=Checkpoint, compare=False)
    counter: SimulationCounter = field(default_factory=SimulationCounter, compare=False)

    def simulate(
        self,
        terms: Sequence[Term],
        values: Floats,
        segments: Segments,
        *,
        initial_state_offset: Floats | None = None,
    ) -> Floats:
        """Predict what the sensors would read.

        MuJoCo's one-stage integrators (semi-implicit Euler) compute

            v[k+1] = v[k] + h a(q[k], v[k]),   q[k+1] = q[k] + h v[k+1],

        so that from q and v of one time all motion comes half a step early. A leapfrog
        takes the same steps, with v[k] half a step before q[k]. It is exact to second
        order but for forces that depend on v (Hairer, Lubich, Wanner 2003, section
        1.1). That is near enough to replace the RK4 of a single joint, too, which takes
        four times as long.

        Args:
            values: (n, P) of all terms' parameters, a row a hypothesis.
            initial_state_offset: (n, W, 2 nv) added to the initial states, positions
                and then velocities in the given model's degrees of freedom [rad or m,
                and per s].

        Returns:
            (n, M, C) readings [each channel's unit]; NaN after a hypothesis diverged.
        """
        values, offset = np.atleast_2d(values), initial_state_offset
        is_active = self.find_active_terms(terms, segments)
        of_value = np.repeat(is_active, [len(t.parameters) for t in terms], axis=1)
        predicted = np.empty((len(values), *segments.readings.shape))
        for active in np.unique(is_active, axis=0):
            chosen = np.flatnonzero((is_active == active).all(axis=1))
            acting = [t for t, acts in zip(terms, active, strict=True) if acts]
            own = values[:, of_value[chosen[0]]]
            part, rows = segments, np.arange(len(segments.readings))
            if len(chosen) < len(segments):
                part = self.select_segments(segments, chosen)
                rows = segments.find_sample_rows(chosen)
            for some in self._split(len(values), part):
                predicted[some, rows] = self._simulate_batch(
                    acting,
                    own[some],
                    part,
                    None if offset is None else offset[some][:, chosen],
                )
        return predicted

    def find_active_terms(
        self, terms: Sequence[Term], segments: Segments
    ) -> np.ndarray:
        """(W, T) whether each term holds in most of each segment."""
        is_active = np.ones((len(segments), len(terms)), bool)
        for i, episode in enumerate(self.episodes):
            rows = np.flatnonzero(segments.episode == i)
            middle = segments.first_step[rows] + segments.lengths[rows] / 2
            times = episode.start + middle * self.timestep
            for k, term in enumerate(terms):
                if term.onset and episode.number == term.onset.number:
                    is_active[rows, k] = times > term.onset.time
                elif term.onset:
                    is_active[rows, k] = episode.number > term.onset.number
        return is_active

    def select_segments(self, segments: Segments, chosen: np.ndarray) -> Segments:
        """Select segments `chosen` (w); the same object again while it is cached."""
        key = "selection", np.asarray(chosen).tobytes()
        return self.cache.load_or_compute(
            segments, key, lambda: segments.select(chosen)
        )

    def _split(self, count: int, segments: Segments) -> list[slice]:
        """Split some hypotheses into as many at once as memory holds."""
        steps = len(segments) * (int(segments.lengths.max()) + 2)
        size = max(1, int(MAX_BATCH_NUMBERS / (steps * self._numbers_per_step)))
        return [slice(i, i + size) for i in range(0, count, size)]

    @cached_property
    def _numbers_per_step(self) -> int:
        """Numbers kept of a step: the fields recorded, their copy, and the signals."""
        sensors = SensorReader(self.compiler.compile_variant(()), self.channels)
        data = MjData(self.compiler.nominal)
        kept = {"qpos", "qvel", *sensors.needs}
        return sensors.width + 2 * sum(np.size(getattr(data, f)) for f in kept)

    def _simulate_batch(
        self,
        terms: Sequence[Term],
        values: Floats,
        segments: Segments,
        initial_state_offset: Floats | None,
    ) -> Floats:
        """Simulate terms without an onset at once; arguments as of `simulate`."""
        self.counter.add(len(values) * len(segments))
        hypotheses = self.build_hypotheses(terms, values, self.centered)
        initial = InitialStates(self, hypotheses, segments).compute(
            initial_state_offset
        )
        warm_up_added_joints(self, hypotheses, segments, initial)
        commands = compute_commands(self, hypotheses, segments, hypotheses.grid)
        predicted = simulate_batch(
            hypotheses,
            segments,
            initial,
            commands,
            SensorReader(hypotheses.variant, self.channels, terms),
            find_sampled_steps(
                segments, hypotheses.reading_changes, step=self.timestep
            ),
        )
        predicted = predicted.reshape(len(values), len(segments), *predicted.shape[1:])
        return sample_signals(
            self,
            predicted,
            hypotheses,
            segments,
            commands.reshape(*predicted.shape[:3], -1),
        )

    def build_hypotheses(
        self, terms: Sequence[Term], values: Floats, centered: bool
    ) -> Hypotheses:
        """Build the models of n hypotheses.

        Args:
            values: (n, P) of all terms' parameters, a row a hypothesis.
            centered: as `Simulator` has it.
        """
        variant = (
            self.compiler.compile_leapfrog(terms, touching=self.has_contact)
            if centered
            else self.compiler.compile_variant(terms)
        )
        term_values = split_values(terms, values)
        models = variant.build_models(terms, values)
        for model in models:
            model.opt.timestep = self.timestep
        leaps = centered and variant.is_single_stage
        grid = CommandGrid(self.timestep, is_centered=leaps, is_mean=centered)
        if leaps:
            for model in models:
                center_damping(model, self.timestep, variant.inverse_inertias)
        changes = collect_reading_changes(terms, term_values, self.channels)
        return Hypotheses(variant, models, terms, term_values, changes, grid)

    def load_or_compute(self, compute: Callable[[], Arrays]) -> Arrays:
        """Give the arrays of a computation, from the checkpoint if they are there.

        The counter then counts what they took to compute, so that a diagnosis that goes
        on where it was killed counts as many simulations as one that was not.

        Args:
            compute: a `functools.partial` of a function and all that it depends on.
        """
        begin = self.counter.count

        def compute_and_count() -> Arrays:
            return *compute(), np.array(self.counter.count - begin)

        *arrays, simulated = self.checkpoint.load_or_compute(compute, compute_and_count)
        self.counter.count = begin + int(simulated)
        return tuple(arrays)

    @cached_property
    def leapfrog(self) -> "Simulator":
        """This simulator whose steps are a leapfrog's (`simulate`)."""
        return replace(self, centered=True)

    @cached_property
    def with_half_step(self) -> "Simulator":
        """This simulator with steps of half the size, and without a checkpoint."""
        return replace(self._with_finer_steps(2), checkpoint=Checkpoint())

    @cached_property
    def native(self) -> "Simulator":
        """This simulator with the given model's own steps."""
        if self.coarsening == 1:
            return self
        return replace(self._with_finer_steps(self.coarsening), coarsening=1)

    def coarsen(self, count: int) -> "Simulator":
        """This simulator of the given model's steps with so many of them in one."""
        return replace(self._with_finer_steps(1 / count), coarsening=count)

    def _with_finer_steps(self, factor: float) -> "Simulator":
        """This simulator with so many times as many steps, and an empty cache."""
        episodes = tuple(e.with_finer_steps(factor) for e in self.episodes)
        return replace(
            self,
            timestep=self.timestep / factor,
            episodes=episodes,
            cache=SimulationCache(),
        )

    @cached_property
    def with_late_commands(self) -> "Simulator":
        """This simulator with commands that act later, and without a checkpoint."""
        episodes = tuple(
            episode.with_late_commands(COMMAND_LATENESS) for episode in self.episodes
        )
        return replace(
            self,
            episodes=episodes,
            checkpoint=Checkpoint(),
            cache=SimulationCache(),
        )

    def with_channels(self, channels: tuple[Channel, ...]) -> "Simulator":
        """This simulator with channels of other noise: other initial states follow."""
        return replace(self, channels=channels, cache=SimulationCache())


def collect_reading_changes(
    terms: Sequence[Term],
    term_values: Sequence[Floats],
    channels: Sequence[Channel],
) -> dict[str, dict[str, Floats]]:
    """Collect how terms change the readings of n hypotheses.

    Args:
        term_values: (n, p) of each term.
        channels: that are read; a place without a signal is of all of its kind.

    Returns:
        By signal and what changes: "bias" (n, width) [unit], "gain" (n) [1], "delay"
        (n) [s], "step" (n) [unit].
    """
    changes: dict[str, dict[str, Floats]] = {}
    for term, values in zip(terms, term_values, strict=True):
        if isinstance(term.effect, SensorMap):
            for place in term.places:
                assert isinstance(place, SignalPlace)  # by `SensorMap`
                change = term.effect.transform_reading(place, values)
                of_kind = [c.name for c in channels if c.kind == place.kind]
                for name in [place.signal] if place.signal else of_kind:
                    changes.setdefault(name, {}).update(change)
    return changes
