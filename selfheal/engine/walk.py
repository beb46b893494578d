"""Walking: plants and commands in, what the robot does and senses over time out.

Native MuJoCo. MJX walks the same articulated body at 16,700 steps/s on a core, native
MuJoCo at 65,000 (docs/results/heal.md), so there is no second engine here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import BELLY_SENSOR, Anatomy, Floats, RowBatch
from ..body.changes import compute_direction, tilt_gravity
from ..body.damage import list_sensors
from ..machine import count_cores
from .channels import MAX_CLEARANCE, TOUCH_HEIGHT
from .plant import Plant, compute_set_points

if TYPE_CHECKING:
    import mujoco

PERIOD = 0.01  # [s] between commands; chosen: one step of the search's simulation
SAMPLE = 0.05  # [s] between readings; chosen
_STEPS_PER_SAMPLE = round(SAMPLE / PERIOD)
_MOST_AT_ONCE = 64  # simulations in memory at once; chosen
FASTEST = 50.0  # [rad/s or m/s] what moves faster has diverged; chosen


@dataclass(frozen=True)
class Walks(RowBatch):
    """N walks, sampled every `SAMPLE` seconds, S samples without the start.

    Attributes:
        position: (N, S, 3) of the torso [m].
        orientation: (N, S, 4) of the torso, quaternion w x y z.
        up: (N, S, 3) against gravity, in the torso's frame.
        angles: (N, S, P) [rad].
        tips: (N, S, F) lowest point of each foot above the ground [m].
        energy: (N) positive work of all motors [J]: sum of max(torque x speed, 0) dt.
        failed: (N) True where the simulation diverged; the rest is NaN there.
        state: (N, nstate) at the end, and
        set_point: (N, P) [rad], to go on from.
    """

    position: Floats
    orientation: Floats
    up: Floats
    angles: Floats
    tips: Floats
    energy: Floats
    failed: np.ndarray
    state: Floats
    set_point: Floats


def simulate_walks(
    plants: Sequence[Plant],
    commands: Floats,
    start: tuple[Floats, Floats] | None = None,
) -> Walks:
    """Walk plants of one attachment tree.

    Args:
        plants: N of one time step; the same object is compiled once.
        commands: (N, T, P) [rad], each held for `PERIOD`; T a multiple of
            SAMPLE / PERIOD.
        start: `state` (N, nstate) and `set_point` (N, P) to go on from; None = at rest,
            all joints zero.
    """
    models = {key: _compile_plant(p) for key, p in {id(p): p for p in plants}.items()}
    parts = []
    for first in range(0, len(plants), _MOST_AT_ONCE):
        rows = slice(first, first + _MOST_AT_ONCE)
        begin = None if start is None else (start[0][rows], start[1][rows])
        chosen = [models[id(p)] for p in plants[rows]]
        parts.append(_simulate_chunk(list(plants[rows]), chosen, commands[rows], begin))
    names = [f.name for f in fields(Walks)]
    return Walks(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))


def _compile_plant(plant: Plant) -> "mujoco.MjModel":
    """A plant's model."""
    import mujoco

    from ..body.mjcf import build_walking_spec
    from ..mujoco_files import silence_mujoco

    silence_mujoco()
    jammed = ~np.isnan(plant.jam)
    torque = np.where(jammed, 100.0, plant.torque)  # a jam gives way to nothing
    model = build_walking_spec(plant.body, plant.physics, torque, plant.slope).compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    model.opt.ls_iterations = 10  # enough for contacts with a plane; chosen
    return model


def _start_at_rest(model: "mujoco.MjModel", count: int) -> tuple[Floats, Floats]:
    """State and set points at rest."""
    import mujoco

    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, mujoco.MjData(model), state, kind)
    return np.tile(state, (count, 1)), np.zeros((count, model.nu))


def _simulate_chunk(
    plants: list[Plant],
    models: "list[mujoco.MjModel]",
    commands: Floats,
    start: tuple[Floats, Floats] | None,
) -> Walks:
    """Some of the walks."""
    import mujoco
    from mujoco import rollout

    state, before = _start_at_rest(models[0], len(plants)) if start is None else start
    points = compute_set_points(plants, commands, PERIOD, before)
    steps = round(PERIOD / models[0].opt.timestep)
    threads = min(count_cores(), len(plants))
    data = [mujoco.MjData(models[0]) for _ in range(threads)]
    with np.errstate(all="ignore"):
        states, sensors = rollout.rollout(
            models, data, state, np.repeat(points, steps, axis=1)
        )
        return _sample_walks(plants, models[0], (states, sensors), points)


def _sample_walks(
    plants: list[Plant],
    model: "mujoco.MjModel",
    simulated: tuple[Floats, Floats],
    points: Floats,
) -> Walks:
    """What was simulated, states and sensors (N, steps, ...), sampled."""
    states, sensors = simulated
    names, steps = plants[0].body.anatomy.joints, states.shape[1] // points.shape[1]
    p, every = len(names), _STEPS_PER_SAMPLE * steps
    last = states[:, -1].copy()
    seen, tips = states[:, every - 1 :: every], sensors[:, every - 1 :: every]
    q, v = seen[..., 1 : 8 + p], seen[..., 8 + p : 14 + 2 * p]
    # the state lists joints along the tree, all else here lists them as the parts
    at = np.array([model.joint(name).qposadr[0] for name in names])
    failed = ~np.isfinite(seen).all(axis=(1, 2)) | (
        np.nan_to_num(np.abs(v), nan=np.inf).max(axis=(1, 2)) > FASTEST
    )
    # work between samples, from the servo's law
    fine = states[:, steps - 1 :: steps]
    angle, rate = fine[..., 1 + at], fine[..., 7 + p + at]
    gain = np.array([[[x.physics.kp]] for x in plants])
    drag = np.array([[[x.physics.kv]] for x in plants])
    limit = np.stack([x.torque for x in plants])[:, None]
    torque = np.clip(gain * (points - angle) - drag * rate, -limit, limit)
    energy = np.maximum(torque * rate, 0).sum(axis=(1, 2)) * PERIOD
    anatomy = plants[0].body.anatomy
    feet = np.asarray(anatomy.feet, int) - 1
    thick = np.stack([x.body.thickness[0, feet] for x in plants])
    height = tips.reshape(*tips.shape[:2], len(feet), 3)[..., 2]
    up = np.stack([_compute_up(x.slope) for x in plants])[:, None]
    out = Walks(
        position=q[..., :3].copy(),
        orientation=q[..., 3:7].copy(),
        up=rotate_into_frame(q[..., 3:7], np.broadcast_to(up, q[..., :3].shape)),
        angles=q[..., at],
        tips=height - (anatomy.radius[feet] * thick)[:, None],
        energy=energy,
        failed=failed,
        state=last,
        set_point=points[:, -1].copy(),
    )
    for values in (out.position, out.orientation, out.up, out.angles, out.tips):
        values[failed] = np.nan
    return out


def _compute_up(slope: Floats) -> Floats:
    """(3) the direction against gravity in the ground's frame."""
    tilt, azimuth = slope
    downhill = np.array([*compute_direction(azimuth), 0.0])
    return -tilt_gravity(np.array([0.0, 0.0, -1.0]), tilt, downhill)


def rotate_into_frame(quat: Floats, vector: Floats) -> Floats:
    """(..., 3) world vectors (..., 3) in the frame that a quaternion (..., 4) turns."""
    w, u = quat[..., :1], -quat[..., 1:]
    twice = 2 * np.cross(u, vector)
    return vector + w * twice + np.cross(u, twice)


@dataclass(frozen=True)
class Channels:
    """Names and sources of what is compared between prediction and sensing.

    Attributes:
        names: (C) of the channels.
        sensors: (C) the signal that each comes from.
    """

    names: tuple[str, ...]
    sensors: tuple[str, ...]


def list_channels(anatomy: Anatomy) -> Channels:
    """Two tilts, clearance, joint angles, touches, position."""
    vertical, *others = list_sensors(anatomy)
    names = ("tilt left/right", "tilt forward/back", *others, "x", "y")
    place = ["torso_position", "torso_position"]
    return Channels(names, (vertical, vertical, *others, *place))


def compute_channels(walks: Walks, plants: Sequence[Plant]) -> Floats:
    """(N, S, C) the channels of walks: [deg], [mm], touch 0 or 1; as sensors read."""
    anatomy = plants[0].body.anatomy
    x, y = np.clip(walks.up[..., 0], -1, 1), np.clip(walks.up[..., 1], -1, 1)
    belly = anatomy.torso_half[2]
    out = np.concatenate(
        [
            -np.degrees(np.arcsin(y))[..., None],
            np.degrees(np.arcsin(x))[..., None],
            1000 * compute_clearance(walks, belly)[..., None],
            np.degrees(walks.angles),
            (walks.tips < TOUCH_HEIGHT).astype(float),
            1000 * walks.position[..., :2],
        ],
        axis=2,
    )
    sensors = list_channels(anatomy).sensors
    for row, plant in enumerate(plants):
        out[row] = read_by_gain(out[row], sensors, plant)
    out[walks.failed] = np.nan
    return out


def read_by_gain(true: Floats, sensors: Sequence[str], plant: Plant) -> Floats:
    """What the sensors of a plant read in place of what is true.

    Args:
        true: (..., M) values in the units of channels [deg, mm or 1].
        sensors: (M) that each value comes from.

    Returns:
        (..., M) values.
    """
    read, below = true.copy(), 1000 * BELLY_SENSOR
    for k, sensor in enumerate(sensors):
        gain, was = plant.gain.get(sensor, 1.0), true[..., k]
        if gain == 1.0:
            continue
        if sensor == "vertical":
            read[..., k] = np.degrees(np.arcsin(gain * np.sin(np.radians(was))))
        elif sensor == "clearance":
            read[..., k] = np.maximum(gain * (was + below) - below, 0)
        else:
            read[..., k] = gain * was
    return read


def compute_clearance(walks: Walks, belly: float) -> Floats:
    """(N, S) belly to floor along the torso's z [m], at most `MAX_CLEARANCE`."""
    level = np.array([0.0, 0, 1])
    level = np.broadcast_to(level, walks.up.shape)
    z = rotate_into_frame(walks.orientation, level)[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = walks.position[..., 2] / z - belly
    return np.where(z > 0.05, np.clip(gap, 0, MAX_CLEARANCE), MAX_CLEARANCE)
