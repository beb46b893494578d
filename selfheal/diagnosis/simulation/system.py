"""What is simulated: a model and the recordings that it is compared with."""

from dataclasses import dataclass

from ..data.episodes import SampledEpisode
from ..data.robot_summary import Channel
from .model_variants import ModelCompiler


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
    """

    compiler: ModelCompiler
    channels: tuple[Channel, ...]
    episodes: tuple[SampledEpisode, ...]
    timestep: float
    has_contact: bool = False
    coarsening: int = 1
