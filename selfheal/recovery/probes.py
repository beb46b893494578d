"""Probes: actions that a robot in doubt may take, and what each hypothesis predicts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.body import Floats, concatenate_bodies
from ..engine.plant import Plant, list_motions
from ..engine.statics import Statics
from ..engine.walk import (
    PERIOD,
    SAMPLE,
    Channels,
    compute_channels,
    list_channels,
    read_by_gain,
    simulate_walks,
)
from ..gait.synthesis import Gait
from ..robot.actions import SWING, list_actions_2006

_HOLD_TIME = 2.5  # [s] of a held pose; chosen: the slowest servo is there after 1.1 s
_WIDE_SWING = np.radians(50.0)  # a second swing beside paper A's 30 degrees; chosen
_SPEED_DEVIATION = 0.12  # of the motors' speed: up to a fifth off the rated one
_EARLY_TIME = 0.3  # [s] when joints are on their way; chosen
_REST_TIME = 0.3  # [s] over which a pose at rest is read
_WALK_TIME = 6.0  # [s] of a walk as a probe, the last half of which is read
NUDGE = 2.0  # [deg] by which a joint's zero is moved to see what it does
EDGE_SLOPE = 2.0  # [deg/deg] a reading that moves more stands on an edge: no slope
# How far a right prediction is off: of tilts at rest, as was found of the readings of
# 2006 [deg]; of the rest on development seeds of hidden robots: at rest [deg], [mm],
# touch; on the way [deg]; of a walk [deg], [mm], touch, speed [mm/s].
TILT_SCALE = 2.0
REST_SCALES = {"tilt": TILT_SCALE, "clearance": 4.0, "angle": 1.5, "touch": 0.4}
_EARLY_SCALE = 2.5
_WALK_SCALES = REST_SCALES | {"clearance": 5.0, "touch": 0.1, "speed": 15.0}
DRIFT = 1.5  # [deg] of each joint's zero: servos miss by 1.2 on average (papers.md 1.1)


@dataclass(frozen=True)
class Probe:
    """One action.

    Attributes:
        description: it in words.
        commands: (T, P) [rad] every `PERIOD`.
        target: (P) pose that is held [rad], None for a walk.
    """

    description: str
    commands: Floats
    target: Floats | None


def list_probes(gait: Gait, joints: Sequence[str]) -> list[Probe]:
    """The actions: paper A's 36 poses, the same with a wider swing, a walk."""
    poses = list_actions_2006(len(joints))
    steps = round(_HOLD_TIME / PERIOD)
    found = []
    for swing in (SWING, _WIDE_SWING):
        for pose in poses:
            down = ", ".join(j for j, a in zip(joints, pose, strict=True) if a < 0)
            target = pose * (swing / SWING)
            angle = np.degrees(swing)
            says = f"hold {down} at -{angle:.0f} deg, the others at +{angle:.0f}"
            found.append(Probe(says, np.tile(target, (steps, 1)), target))
    walk = gait.commands(len(joints), _WALK_TIME)
    return [*found, Probe("walk a few steps of the old gait", walk, None)]


def classify_channels(names: Sequence[str]) -> list[str]:
    """What each channel is: a key of `REST_SCALES`."""
    known = {"clearance": "clearance", "x": "speed", "y": "speed"}
    known |= {n: "tilt" for n in names if n.startswith("tilt")}
    return [known.get(n, "touch" if n.endswith("_touch") else "angle") for n in names]


def find_residual_scale(probe: Probe, names: Sequence[str]) -> Floats:
    """(M) how far right predictions of `values` are off."""
    kinds = classify_channels(names)
    if probe.target is None:
        still = [_WALK_SCALES[k] for k in kinds[:-2]]
        return np.array([*still, *still, _WALK_SCALES["speed"], _WALK_SCALES["speed"]])
    early = [_EARLY_SCALE for k in kinds if k == "angle"]
    return np.array([*early, *(REST_SCALES[k] for k in kinds[:-2])])


def extract_values(probe: Probe, sensed: Floats, names: Sequence[str]) -> Floats:
    """What counts of the channels of a probe, measured or predicted.

    Of a pose the joint angles on the way and all but the place at rest; of a walk's
    second half means, spreads and the velocity.

    Args:
        sensed: (..., S, C) channels.

    Returns:
        (..., M) values.
    """
    if probe.target is None:
        half = sensed[..., sensed.shape[-2] // 2 :, :]
        way = half[..., -1, -2:] - half[..., 0, -2:]
        speed = way / (SAMPLE * (half.shape[-2] - 1))
        still = half[..., :-2]
        parts = [still.mean(axis=-2), still.std(axis=-2), speed]
        return np.concatenate(parts, axis=-1)
    angle = [k for k, kind in enumerate(classify_channels(names)) if kind == "angle"]
    early = sensed[..., round(_EARLY_TIME / SAMPLE) - 1, :][..., angle]
    rest = sensed[..., -round(_REST_TIME / SAMPLE) :, :-2].mean(axis=-2)
    return np.concatenate([early, rest], axis=-1)


def predict_values(plants: Sequence[Plant], probe: Probe, bias: Floats) -> Floats:
    """(H, M) values of a probe on plants, by MuJoCo; NaN where it failed.

    Args:
        bias: (M) by which the whole robot was off what is predicted of it.
    """
    channels = list_channels(plants[0].body.anatomy)
    moving, rows = list_motions(plants)
    commands = np.repeat(probe.commands[None], len(moving), axis=0)
    seen = compute_channels(simulate_walks(moving, commands)[rows], plants)
    gain = _list_gains(plants, _list_sources(probe, channels))
    return extract_values(probe, seen, channels.names) + bias * gain


def _list_gains(plants: Sequence[Plant], sensors: Sequence[str]) -> Floats:
    """(H, M) the factor [1] on what each sensor (M) of each plant reads."""
    return np.array([[p.gain.get(s, 1.0) for s in sensors] for p in plants])


def _list_sources(probe: Probe, channels: Channels) -> list[str]:
    """(M) the sensor that each of a probe's values comes from."""
    sensors = list(channels.sensors)
    if probe.target is None:
        return [*sensors[:-2], *sensors]
    kinds = zip(classify_channels(channels.names), sensors, strict=True)
    return [*(s for kind, s in kinds if kind == "angle"), *sensors[:-2]]


def _simulate_at_rest(
    plants: Sequence[Plant], targets: Floats
) -> tuple[Floats, Floats]:
    """(H, 3) tilts [deg], clearance [mm], (H, F) touch by `statics`, level ground."""
    body = concatenate_bodies(*(p.body for p in plants))
    jam = np.stack([p.jam for p in plants])
    rest = Statics().simulate(body, np.where(np.isnan(jam), targets, jam))
    three = np.column_stack([np.degrees(rest.tilt), 1000 * rest.clearance])
    return three, rest.touch


def approximate_values(plants: Sequence[Plant], probe: Probe) -> Floats:
    """(H, M) values of a held pose by `statics`: quick, and enough to choose by."""
    assert probe.target is not None
    names = list_channels(plants[0].body.anatomy)
    targets = np.tile(probe.target, (len(plants), 1))
    three, touch = _simulate_at_rest(plants, targets)
    tilt, azimuth = np.stack([p.slope for p in plants]).T
    # a level torso on a slope: its tilt is the slope's
    three[:, 0] += np.degrees(tilt) * np.sin(azimuth)
    three[:, 1] -= np.degrees(tilt) * np.cos(azimuth)
    jam = np.stack([p.jam for p in plants])
    angles = np.where(np.isnan(jam), targets, jam)
    reach = np.stack([p.speed for p in plants]) * _EARLY_TIME
    early = np.where(np.isnan(jam), np.clip(targets, -reach, reach), jam)
    rest = np.column_stack([three, np.degrees(angles), touch])
    out = np.column_stack([np.degrees(early), rest])
    sensors = _list_sources(probe, names)
    for row, plant in enumerate(plants):
        out[row] = read_by_gain(out[row], sensors, plant)
    return out


def compute_slopes(plants: Sequence[Plant], probe: Probe) -> Floats:
    """(H, M, P + 1) change of a probe's values with each joint's zero [1/deg].

    The last column is the speed that all motors share, as much as `DRIFT` degrees of a
    zero are likely. Of walks all are 0.
    """
    names = list_channels(plants[0].body.anatomy).names
    joints, size = plants[0].body.anatomy.size, len(find_residual_scale(probe, names))
    out = np.zeros((len(plants), size, joints + 1))
    if probe.target is None:
        return out
    jam = np.isnan(np.stack([p.jam for p in plants]))
    for j in range(joints):
        nudge = np.radians(NUDGE) * np.eye(joints)[j]
        high, low = (
            _simulate_at_rest(
                plants, np.tile(probe.target + s * nudge, (len(plants), 1))
            )[0]
            for s in (1, -1)
        )
        rate = (high - low) / (2 * NUDGE)
        rate[(np.abs(rate[:, :2]) > EDGE_SLOPE).any(axis=1)] = 0.0
        out[:, joints : joints + 3, j] = rate
        gain = _list_gains(plants, [f"{plants[0].body.anatomy.joints[j]}_position"])
        out[:, j, j] = out[:, joints + 3 + j, j] = jam[:, j] * gain[:, 0]
    early = approximate_values(plants, probe)[:, :joints]
    out[:, :joints, joints] = early * np.isnan(np.stack([p.jam for p in plants]))
    out[:, :joints, joints] *= _SPEED_DEVIATION / DRIFT
    gain = _list_gains(plants, ("vertical", "vertical", "clearance"))
    out[:, joints : joints + 3] *= gain[..., None]
    return out
