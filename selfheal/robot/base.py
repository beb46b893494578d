"""What a robot is to this program."""

from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from ..body.body import Anatomy, Bodies, Floats
from ..body.legged import LeggedRobot
from ..damage.kinds import Damage
from ..errors import InputError
from ..recording import Recording

if TYPE_CHECKING:
    from ..engine.reflex import Rollouts


class Robot(Protocol):
    """Something that acts and returns its readings.

    Attributes:
        name: by which it was opened.
        anatomy: what it knows of its parts.
        actions: (A, P) joint targets that it offers [rad].
        truth: its real body (batch of one) for reports, None if nobody knows it.
    """

    name: str
    anatomy: Anatomy
    actions: Floats
    truth: Bodies | None

    def act(self, action: int) -> Recording:
        """Go from all joints at zero to one action's targets, hold, read the sensors.

        Returns:
            A recording of one episode with the signal `vertical` (3), and where the
            robot has them `clearance` and `<joint>_position`; readings at rest stand
            at the last sample. Asked again, the same action gives the same recording.
        """
        ...


class Mover(Robot, Protocol):
    """A robot that can also follow commands over time."""

    def move(self, commands: Floats, *, trial: int = 0) -> Recording:
        """Follow joint commands from rest at zero on the spot, and sense meanwhile.

        Args:
            commands: (T, P) [rad], each held for `engine.walk.PERIOD`.
            trial: number of this trial; noise is another in each.

        Returns:
            A recording of one episode with a sample every `engine.walk.SAMPLE` of
            `vertical`, `clearance`, `<joint>_position`, `<foot>_touch`,
            `torso_position` and `torso_orientation` (as a camera above sees them).
        """
        ...


class Walker(Mover, Protocol):
    """A robot that can also be damaged on purpose."""

    def struck(self, damage: tuple[Damage, ...], onset: float = 0.0) -> "Walker":
        """This robot with one damage more that sets in at `onset` [s] into each move.

        A robot that was struck already keeps what happened to it before.
        """
        ...


class DrivenRobot(Protocol):
    """A legged robot that knows its body, and runs under neural controllers."""

    @property
    def legged(self) -> LeggedRobot:
        """Its body as it was built."""
        ...

    def run_trials(self, weights: Floats) -> "Rollouts":
        """Run from rest under controllers (N, synapses), one after the other.

        Returns:
            What it sensed and how far it came; the path is for reports, nobody who
            recovers the robot may look at it.
        """
        ...

    def struck(self, damage: tuple[Damage, ...]) -> "DrivenRobot":
        """This robot after a damage."""
        ...


def require_walker(robot: Robot) -> Walker:
    """The robot, if it can walk.

    Raises:
        InputError: it only answers with readings, or is built so that it cannot.
    """
    from ..engine.plant import check_can_walk

    if not hasattr(robot, "struck"):
        raise InputError(
            f"robot {robot.name!r} cannot walk: it answers from a recording"
        )
    check_can_walk(robot.anatomy)
    return cast(Walker, robot)


def require_mover(robot: Robot) -> Mover:
    """The robot, if it can follow commands over time.

    Raises:
        InputError: it only takes poses.
    """
    if not hasattr(robot, "move"):
        raise InputError(
            f"robot {robot.name!r} takes poses, and follows no commands over time; "
            "would fit: a driver with follow(), or a recording of moves, by 'selfheal "
            "diagnose best.xml MOVES.h5'"
        )
    return cast(Mover, robot)


def refuse_arguments(name: str, argument: str, recordings: Path | None) -> None:
    """Refuse an argument or a recording that this robot has no use for.

    Args:
        argument: what stood after the colon of its name.
        recordings: file of readings, or None.

    Raises:
        InputError: one of them was given.
    """
    if argument:
        raise InputError(f"robot {name!r} takes no argument, so not {argument!r}")
    if recordings is not None:
        raise InputError(f"robot {name!r} is simulated: it answers from no recording")
