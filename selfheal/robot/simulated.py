"""Hidden simulated robots: a body and physics that are hidden from the self-model."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, count_centers_in_torso
from ..body.genome import build_bodies, draw_genomes
from ..damage.apply import Strike
from ..damage.kinds import Damage
from ..engine.channels import list_channels, parse_sensor
from ..engine.readings import Readings
from ..errors import InputError
from ..recording import Recording
from .actions import list_actions_2006, load_published_body
from .base import refuse_arguments
from .rest_readings import make_rest_episode, revert_channels

if TYPE_CHECKING:
    from ..body.mjcf import Physics

# Size of errors seen in the 2006 data (papers.md 1.1): servos miss by 1.2 degrees on
# average, half of it (chosen) the same in every action; tilts are read to 0.1 to 0.5
# degrees, clearance in steps of 0.25 mm.
_SERVO_OFFSET, _SERVO_NOISE = np.radians(1.0), np.radians(1.0)
_TILT_NOISE, _TILT_STEP = np.radians(0.2), np.radians(0.1)
_CLEARANCE_NOISE, _CLEARANCE_STEP = 0.0005, 0.00025  # [m]


@dataclass(frozen=True)
class SimulatedRobot:
    """An articulated MuJoCo body behind noisy servos and sensors; see `base.Robot`.

    Attributes:
        seed: of its noise and of its hidden physics.
        strikes: what happens to it in each move, and when [s]; at 0 it has happened.
        offers: (A, P) joint targets that it offers [rad]; None = those of 2006.
    """

    name: str
    truth: Bodies
    seed: int
    strikes: tuple[Strike, ...] = ()
    offers: Floats | None = None

    @property
    def anatomy(self) -> Anatomy:
        """What the robot knows of its parts."""
        return self.truth.anatomy

    @property
    def actions(self) -> Floats:
        """(A, P) joint targets [rad]: one or two joints down, the others up."""
        if self.offers is not None:
            return self.offers
        return list_actions_2006(self.anatomy.size)

    def act(self, action: int) -> Recording:
        """Move, hold, read the sensors at rest."""
        from ..engine.mujoco import HOLD, RAMP

        rng = np.random.default_rng([self.seed, 1, action])
        target, rest = self.actions[action], self._simulate_rest(action, rng)
        known, read = list_channels(self.anatomy), dict[str, Floats]()
        tilt = rest.tilt[0] + rng.normal(0, _TILT_NOISE, 2)
        tilt = np.round(tilt / _TILT_STEP) * _TILT_STEP
        clearance = rest.clearance[0] + rng.normal(0, _CLEARANCE_NOISE)
        clearance = max(np.round(clearance / _CLEARANCE_STEP) * _CLEARANCE_STEP, 0)
        place = 0
        for sensor in self.anatomy.sensors:
            width = parse_sensor(sensor, self.anatomy.parts)[0].width
            rows = slice(place, place + width)
            place += width
            if sensor == "tilt":
                own = np.degrees(tilt)
            elif sensor == "clearance":
                own = np.array([1000 * clearance])
            else:
                own = rest.channels[0, rows] + rng.normal(0, known.noise[rows])
            read[sensor] = revert_channels(sensor, own)
        time = np.array([0.0, RAMP, RAMP + HOLD])
        episode = make_rest_episode(self.anatomy, time, target, read, rest.angles[0])
        return Recording({f"action_{action:03d}": episode}, self.name, "simulated")

    def read_touch(self, action: int) -> Floats:
        """(F) 1 where a foot touches the floor in the pose that `act` reads, else 0.

        Apart from the recording: a body's MJCF has no such sensor.
        """
        rng = np.random.default_rng([self.seed, 1, action])
        return self._simulate_rest(action, rng).touch[0]

    def _simulate_rest(self, action: int, rng: np.random.Generator) -> Readings:
        """The true readings (1) at rest, servo errors drawn first from `rng`."""
        from ..engine.mujoco import MuJoCo

        physics, body, offset = self._draw_hidden_physics()
        noise = rng.normal(0, _SERVO_NOISE, offset.shape)
        reached = self.actions[action] + offset + noise
        return MuJoCo(physics).simulate(body, reached[None])

    def move(self, commands: Floats, *, trial: int = 0) -> Recording:
        """Follow commands (T, P) [rad] over time; see `base.Walker`."""
        from .simulated_walk import draw_hidden_plant, simulate_move

        physics, body, offset = self._draw_hidden_physics()
        rng = np.random.default_rng([self.seed, 4])
        hidden = draw_hidden_plant(physics, body, offset, rng)
        noise = np.random.default_rng([self.seed, 5, trial])
        return simulate_move(hidden, commands, self.strikes, noise, self.name)

    def struck(
        self, damage: tuple[Damage, ...], onset: float = 0.0
    ) -> "SimulatedRobot":
        """This robot with one damage more, at `onset` [s]; see `base.Walker`."""
        new = tuple(Strike(onset, each) for each in damage)
        strikes = sorted((*self.strikes, *new), key=lambda strike: strike.time)
        return replace(self, strikes=tuple(strikes))

    def _draw_hidden_physics(self) -> "tuple[Physics, Bodies, Floats]":
        """Physics, body and servo offsets (P) that differ from the self-model's."""
        from ..body.mjcf import Physics

        rng = np.random.default_rng([self.seed, 0])
        physics = Physics(
            timestep=0.001,
            friction=rng.uniform(0.5, 1.2),
            kp=rng.uniform(80, 160),
            kv=rng.uniform(1.5, 3),
            damping=rng.uniform(0.01, 0.05),
            armature=rng.uniform(0.001, 0.003),
            density=rng.uniform(0.9, 1.1),
        )
        mass = self.truth.mass * rng.normal(1, 0.05, self.truth.mass.shape)
        body = replace(self.truth, mass=mass)
        return physics, body, rng.normal(0, _SERVO_OFFSET, self.anatomy.size)


def starfish(argument: str, seed: int, recordings: Path | None) -> SimulatedRobot:
    """A simulated starfish; its body, servo errors and physics are hidden.

    Args:
        seed: of its noise and of its hidden physics.
        recordings: must be None.
    """
    refuse_arguments("starfish", argument, recordings)
    return SimulatedRobot("starfish", load_published_body(), seed)


def tree(argument: str, seed: int, recordings: Path | None) -> SimulatedRobot:
    """A simulated random tree of the starfish's parts; tree:7 is the one of seed 7.

    Args:
        argument: seed of the tree in digits; empty takes `seed`.
        seed: of its noise and of its hidden physics.
        recordings: must be None.
    """
    refuse_arguments("tree", "", recordings)
    if argument and not argument.isdecimal():
        raise InputError(
            f"robot 'tree' takes a whole number, as tree:7; not {argument!r}"
        )
    rng = np.random.default_rng([int(argument or seed), 2])
    anatomy = load_published_body().anatomy
    while True:
        body = build_bodies(anatomy, draw_genomes(anatomy, 1, rng, True))
        if not count_centers_in_torso(body)[0]:
            return SimulatedRobot(f"tree:{argument or seed}", body, seed)
