"""Commands on their way to an actuator: takes arrays of them, gives changed ones."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ...body.changes import limit_rate
from ...recording.data import Floats

# share of a time step below which a delay is how recordings are made: who records a
# simulation, or a control loop, reads what was computed a moment ago; chosen
STALE_STEPS = 0.5
# steps of a simulation by which a command may act early or late; chosen: an integrator
# of first order moves it by half a step
SAME_INSTANT_STEPS = 1.5
MAX_LOOK_AHEAD = 0.3  # [s] by which commands may come early; chosen: no clock is so off


@dataclass(frozen=True)
class CommandGrid:
    """The times at which commands are given.

    Attributes:
        step: from one to the next [s].
        is_centered: whether a command counts from half a step before to half a step
            after its step, as a leapfrog has it.
        is_mean: whether a command that changes within a step counts by its mean in the
            step, rather than by what it was when the step began.
    """

    step: float
    is_centered: bool = False
    is_mean: bool = False


def change_columns(
    ctrl: Floats, controls: Iterable[int], change: Callable[[Floats], Floats]
) -> Floats:
    """Commands in which those of some controls are changed.

    Args:
        ctrl: (1 or N, G, nu) of all controls, on a grid.
        change: makes new ones (N, G) of those (1 or N, G) of one control.

    Returns:
        (N, G, nu)
    """
    for control in controls:
        column = change(ctrl[..., control])
        ctrl = np.broadcast_to(ctrl, (len(column), *ctrl.shape[1:])).copy()
        ctrl[..., control] = column
    return ctrl


def delay_column(u: Floats, steps: Floats) -> Floats:
    """Commands u (1 or N, G) that come `steps` (N, 1) [steps] of the grid later.

    Between grid points the command is interpolated linearly.
    """
    grid = np.arange(u.shape[1])
    at = grid - steps
    low = np.floor(at).astype(int)
    share = at - low
    last = u.shape[1] - 1
    rows = np.arange(len(u))[:, None]
    before, after = (u[rows, np.clip(low + i, 0, last)] for i in (0, 1))
    return (1 - share) * before + share * after


def delay_commands(ctrl: Floats, controls: Iterable[int], steps: Floats) -> Floats:
    """Commands of which those of some controls come late.

    Args:
        ctrl: (1 or N, G, nu) of all controls, on a grid.
        steps: (N, 1) by how many of the grid's steps.

    Returns:
        (N, G, nu)
    """
    return change_columns(ctrl, controls, lambda u: delay_column(u, steps))


def filter_column(u: Floats, keep: Floats) -> Floats:
    """Commands u (1 or N, G) behind a first-order filter; exactly u where keep is 0.

    Args:
        u: (1 or N, G) on a grid.
        keep: (N) share of the distance to the command that is left after a step,
            exp(-step / timeconst).
    """
    from scipy.signal import lfilter

    commands = np.broadcast_to(u, (len(keep), u.shape[1]))
    out = np.empty(commands.shape)
    for row, sent, share in zip(out, commands, keep, strict=True):
        # the torque of a step comes from the state at its beginning
        row[:] = lfilter([0.0, 1 - share], [1.0, -share], sent, zi=sent[:1])[0]
    return np.where(keep[:, None] == 0, u, out)


def limit_rate_of_column(u: Floats, most: Floats) -> Floats:
    """Commands u (1 or N, G) that change by at most `most` (N) from step to step."""
    goals = u.T.copy()
    start = np.broadcast_to(goals[0], len(most)).astype(float)
    return limit_rate(goals, most, start).T
