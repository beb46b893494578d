"""Turned sensor boards: predicted and read vectors in, the board's orientation out.

The rotation that is nearest between two sets of vectors is Wahba's problem (Wahba
1965), which Kabsch's method solves.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..recording.data import Floats
from .fault import Fault, ModelCorrection, format_columns
from .relations import DEPENDENT_ROWS, MIN_ROWS, f_test
from .series import Series

if TYPE_CHECKING:
    import mujoco
    from scipy.spatial.transform import Rotation

# of a board that is turned; chosen: glued on by eye. A rotation is known where its
# standard deviation is as small
MIN_DEGREES = 5.0
# share of the mean square that a rotation may leave, and of what is left without it;
# chosen: as of the other readings of bodies
MAX_LEFT, FAR_BETTER = 0.15, 0.25
REWEIGHTED = 3  # times that sensors are weighted anew; the third changes nothing
SITE_SENSORS = ("ACCELEROMETER", "GYRO", "VELOCIMETER")
BASIS = (
    "F test of the squared errors as the model has it and turned, a tenth of the rows "
    "counted"
)


class Turn(NamedTuple):
    """How a board is turned against the site that the model has for it.

    The rotation leads from the site's frame to the board's: read = R predicted. So many
    rows were compared; `given` and `left` are mean squares of the errors without it and
    with it, over that of the vectors [1].
    """

    rotation: "Rotation"
    rows: int
    given: float
    left: float


def find_turned(
    model: "mujoco.MjModel",
    series: Series,
    sensors: Mapping[str, str],
    expected: dict[str, Floats],
) -> Iterator[Fault]:
    """Boards that are turned against their sites.

    Args:
        expected: (N, d) what the positions give, by signal; that of boards which are
            turned is turned, too.
    """
    import mujoco

    boards = dict[int, list[str]]()
    for name, sensor in sensors.items():
        s = model.sensor(sensor)
        if mujoco.mjtSensor(s.type[0]).name[7:] in SITE_SENSORS:
            boards.setdefault(int(s.objid[0]), []).append(name)
    for site, names in boards.items():
        turn = find_turn([(expected[n], series.signals[n][:, :, 0]) for n in names])
        if turn is None:
            continue
        expected |= {n: turn.rotation.apply(expected[n]) for n in names}
        vector = turn.rotation.inv().as_rotvec(degrees=True)
        degrees = float(np.linalg.norm(vector))
        axis = " ".join(f"{x:.3g}" for x in np.round(vector / degrees, 3) + 0.0)
        target = model.site(site).name
        seen = (
            f"{format_columns(names)}: the board is turned by {degrees:.3g} degrees "
            f"about ({axis}) of the model's site {target!r}: so turned they miss what "
            f"the positions give by {100 * turn.left:.2g} % of its mean square, as the "
            f"model has it by {100 * turn.given:.2g} %"
        )
        count = turn.rows / DEPENDENT_ROWS
        test = f_test(turn.given, turn.left, count, count), BASIS
        where = series.episodes, tuple(names), target
        correction = ModelCorrection(_format_site(model, site, turn.rotation))
        yield Fault("sensor_frame", *where, seen, *test, (correction,))


def find_turn(pairs: Sequence[tuple[Floats, Floats]]) -> Turn | None:
    """The rotation that explains what the sensors of a board read.

    Args:
        pairs: (n, 3) predicted and (n, 3) read vectors of each sensor, in any unit.

    Returns:
        None where no rotation explains more than none, or these vectors leave it open.
    """
    from scipy.spatial.transform import Rotation

    known = [_normalize(*pair) for pair in pairs]
    known = [(a, b) for a, b in known if len(a) >= MIN_ROWS]
    if not known:
        return None
    predicted, read = (np.concatenate(part) for part in zip(*known, strict=True))
    if np.linalg.matrix_rank(predicted.T @ predicted, tol=1e-9 * len(predicted)) < 2:
        return None
    errors = np.ones(len(known))
    for _ in range(REWEIGHTED):  # each sensor counts by how well it is predicted
        weights = np.repeat(1 / errors, [len(a) for a, _ in known])
        found, _, spread = Rotation.align_vectors(
            read, predicted, weights=weights, return_sensitivity=True
        )
        errors = np.array([max(_measure_error(found, *p), 1e-12) for p in known])
    turns = Rotation.create_group("O")
    near = turns[int(np.argmin((turns * found.inv()).magnitude()))]
    # `spread` is the covariance of the rotation, of rows whose mean weight is 1
    variance = np.linalg.eigvalsh(spread)[-1] / weights.mean() * DEPENDENT_ROWS
    error = np.rad2deg(np.sqrt(variance))
    if not error < MIN_DEGREES:
        return None
    is_square = bool(np.rad2deg((near * found.inv()).magnitude()) < MIN_DEGREES)
    chosen = near if is_square else found
    given, left = (
        float(np.average([_measure_error(r, *p) for p in known], weights=1 / errors))
        for r in (Rotation.identity(), chosen)
    )
    degrees = float(np.rad2deg(chosen.magnitude()))
    if degrees < MIN_DEGREES or left > min(MAX_LEFT, FAR_BETTER * given):
        return None
    return Turn(chosen, max(len(a) for a, _ in known), given, left)


def _normalize(predicted: Floats, read: Floats) -> tuple[Floats, Floats]:
    """Rows that both have, (n, 3) each, of which the mean square is 1."""
    both = np.isfinite(predicted).all(axis=1) & np.isfinite(read).all(axis=1)
    squares = [(x[both] ** 2).sum(axis=1) for x in (predicted, read)]
    sizes = [float(np.sqrt(x.mean())) if both.any() else 0.0 for x in squares]
    if min(sizes) < 1e-9:
        return np.empty((0, 3)), np.empty((0, 3))
    return predicted[both] / sizes[0], read[both] / sizes[1]


def _measure_error(rotation: "Rotation", predicted: Floats, read: Floats) -> float:
    return float(np.mean(((rotation.apply(predicted) - read) ** 2).sum(axis=1)))


def _format_site(model: "mujoco.MjModel", site: int, turn: "Rotation") -> str:
    """MJCF of a site that is turned as its board is."""
    from scipy.spatial.transform import Rotation

    given = Rotation.from_quat(model.site_quat[site], scalar_first=True)
    quat = (given * turn.inv()).as_quat(canonical=True, scalar_first=True)
    numbers = " ".join(f"{x:.6g}" for x in np.round(quat, 6) + 0.0)
    return f'<site name="{model.site(site).name}" quat="{numbers}"/>'
