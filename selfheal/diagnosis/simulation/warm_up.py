"""Added joints: takes initial states, moves what no sensor reads to where it was."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.places import AddedJointPlace, SecondJointPlace
from .batch import BatchState, Hypotheses
from .commands import compute_commands
from .initial_states import InitialStates
from .rollout import simulate_batch
from .sensors import SensorReader, make_added_joint_channels
from .system import RecordedSystem

# [s] simulated before a segment, in which a gap or a spring inside a gear settles;
# chosen: several periods of any that shows at the link
ADDED_JOINT_WARM_UP = 0.3


def warm_up_added_joints(
    system: RecordedSystem,
    hypotheses: Hypotheses,
    segments: Segments,
    initial: BatchState,
) -> None:
    """Change initial states of added joints to what a simulation before them gives.

    The simulation begins `ADDED_JOINT_WARM_UP` before each segment that has so much of
    its episode before it. Where a sensor reads the sum of both joints, the first one
    moves the other way, so that the sum stays as it was read.

    Args:
        initial: states of the n W simulations; `qpos` and `qvel` are changed.
    """
    places = hypotheses.variant.list_added_joints(hypotheses.terms)
    steps = max(1, round(ADDED_JOINT_WARM_UP / system.timestep))
    rows = np.flatnonzero(segments.first_step >= steps)
    if not (len(rows) and places):
        return
    n = len(hypotheses.models)
    settled = _simulate_before(system, hypotheses, segments, rows, steps, places)
    q = initial.qpos.reshape(n, len(segments), -1)[:, rows]
    v = initial.qvel.reshape(n, len(segments), -1)[:, rows]
    for i, place in enumerate(places):
        is_known = np.isfinite(settled[:, :, i]).all(axis=-1)
        own: tuple[int | None, int | None] = None, None
        if isinstance(place, SecondJointPlace) and place.is_read_behind:
            own = place.qpos, place.dof
        for x, new, extra, first in (
            (q, settled[:, :, i, 0], place.added_qpos, own[0]),
            (v, settled[:, :, i, 1], place.added_dof, own[1]),
        ):
            change = np.where(is_known, new - x[..., extra], 0.0)
            x[..., extra] += change
            if first is not None:
                x[..., first] -= change
    initial.qpos.reshape(n, len(segments), -1)[:, rows] = q
    initial.qvel.reshape(n, len(segments), -1)[:, rows] = v


def _simulate_before(
    system: RecordedSystem,
    hypotheses: Hypotheses,
    segments: Segments,
    rows: np.ndarray,
    steps: int,
    places: Sequence[AddedJointPlace],
) -> Floats:
    """Position and velocity (n, w, P, 2) of P added joints where segments begin.

    Args:
        rows: (w) numbers of those to simulate up to.
        places: P of them, as the hypotheses' variant numbers them.
    """
    before = Segments(
        segments.episode[rows],
        segments.first_step[rows] - steps,
        np.full(len(rows), steps),
        np.zeros(0, int),
        np.zeros(0),
        np.zeros((0, 0)),
    )
    predicted = simulate_batch(
        hypotheses,
        before,
        InitialStates(system, hypotheses, before).compute(None),
        compute_commands(system, hypotheses, before, hypotheses.grid),
        SensorReader(hypotheses.variant, make_added_joint_channels(places)),
        np.zeros(0, int),
    )
    shape = len(hypotheses.models), len(rows), len(places), 2
    return predicted[:, steps].reshape(shape)
