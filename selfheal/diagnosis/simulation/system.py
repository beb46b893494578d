"""What is simulated: a model and the recordings that it is compared with."""

from dataclasses import dataclass, field

import numpy as np

from ...recording.data import Floats
from ..data.episodes import SampledEpisode
from ..data.robot_summary import Channel
from ..data.settling import place_unread_joints
from ..data.state_estimate import GIVEN_STATE_STD, ReadingChanges, estimate_state
from .cache import SimulationCache
from .model_variants import ModelCompiler


@dataclass(frozen=True, eq=False)
class CompletedState:
    """States at W steps of an episode: as given, as read, or as they follow.

    Attributes:
        qpos: (W, nq) [rad or m].
        qvel: (W, nv) [rad/s or m/s].
        std: (W, 2 nv) standard deviations, of positions and then velocities.
        response: (W, nv, nv) how positions move with each: those that loops place, with
            the others. None: each alone.
        is_known: (W, nq) whether a position was given or read, or follows from others.
    """

    qpos: Floats
    qvel: Floats
    std: Floats
    response: Floats | None
    is_known: np.ndarray


@dataclass(frozen=True, eq=False)
class RecordedSystem:
    """A robot's model, and its recordings on the simulation's grid of times.

    Attributes:
        compiler: of the given model and its variants.
        channels: the signals that are compared.
        episodes: the recordings; in steps of `timestep`.
        timestep: of the simulation [s].
        coarsening: steps of the given model in one of the simulation.
        has_contact: whether anything touches something as the robot moves.
        cache: keeps what no hypothesis changes.
    """

    compiler: ModelCompiler
    channels: tuple[Channel, ...]
    episodes: tuple[SampledEpisode, ...]
    timestep: float
    has_contact: bool = False
    coarsening: int = 1
    cache: SimulationCache = field(default_factory=SimulationCache, compare=False)

    def complete_state(
        self,
        episode: int,
        steps: np.ndarray,
        reading_changes: ReadingChanges | None = None,
    ) -> CompletedState:
        """Estimate the state at steps of an episode: as given, as read, or at rest.

        What was neither given nor read is where a closed loop puts it. Elsewhere it is
        the model's qpos0, or where an episode begins, where the joint comes to rest.

        Args:
            steps: (W) of its grid.
            reading_changes: as `estimate_state` has them; None: none.
        """
        sampled, model = self.episodes[episode], self.compiler.nominal
        at = np.asarray(steps, float)
        qpos, qvel, std = estimate_state(
            model, self.channels, sampled, at, self.timestep, reading_changes or {}
        )
        is_first = at == 0
        if sampled.qpos0 is not None:
            qpos[is_first] = sampled.qpos0
            std[is_first, : model.nv] = GIVEN_STATE_STD
        if sampled.qvel0 is not None:
            qvel[is_first] = sampled.qvel0
            std[is_first, model.nv :] = GIVEN_STATE_STD
        if sampled.base:
            rows = np.interp(
                at, sampled.sample_steps, np.arange(len(sampled.sample_steps))
            )
            sampled.base.fill_in(model, rows, qpos, qvel, std)
        is_known, response = np.isfinite(qpos), None
        if not is_known.all():
            first_ctrl = sampled.ctrl[0] if len(sampled.ctrl) else np.zeros(model.nu)
            qpos, qvel, response, is_known = place_unread_joints(
                model, qpos, qvel, is_first, first_ctrl
            )
        qvel = np.where(np.isfinite(qvel), qvel, 0.0)
        std = np.where(np.isfinite(std), std, GIVEN_STATE_STD)
        return CompletedState(qpos, qvel, std, response, is_known)
