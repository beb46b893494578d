"""Excitation: a self-model in, short moves out that tell the dynamics of its joints.

A limb that touches the floor is moved by contacts, too, of which nobody knows the
friction, and which make predictions jump. So joints swing, if they can, in that part of
their range in which the torso lies still on the floor and carries all.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..body.body import Bodies, Floats, count_ancestors
from ..engine.support import measure_support
from ..engine.walk import PERIOD, SAMPLE

SECONDS = 5.0  # [s] of each multisine; chosen: as long as some steps of a gait
# [s] at rest before, and of the way to where it begins; chosen: a servo that turns by
# 30 degrees a second, half of a hobby servo's speed, is there
_REST, _APPROACH = 0.2, 1.0
# [Hz] of the fastest line; chosen: six samples a period, and swings of 15 degrees then
# pass the 60 degrees a second of a hobby servo in a third of the time
_TOP = 3.0
# of the range, in turn: what grows with amplitude, as limits do, differs from what
# does not, as delays do; chosen
_SCALES = (1.0, 0.5)
STILL = np.radians(3.0)  # tilt of a torso that lies still: changes weights by 5 %
_MOST_DEPTHS = 3  # joints farther out swing as those before them; chosen: 27 ways
_HELD = round(SAMPLE / PERIOD)  # rows of a command: a recording holds all of them


@dataclass(frozen=True)
class Excitation:
    """Moves that excite all joints.

    Attributes:
        commands: (K, T, P) of K moves [rad], a row each `engine.walk.PERIOD`.
        is_held: whether the torso lies still in them, as far as the self-model knows.
    """

    commands: Floats
    is_held: bool


def plan_excitation(
    body: Bodies, actions: Floats, count: int, seed: int = 0
) -> Excitation:
    """Moves that excite all joints, if possible without a limb on the floor.

    Args:
        body: that the robot is believed to have, a batch of one.
        actions: (A, P) joint targets that it can hold [rad]; moves stay among them.
    """
    low, high = actions.min(axis=0), actions.max(axis=0)
    waves = _draw_multisines(count, len(low), np.random.default_rng([seed, 50]))
    if body.anatomy.fixed:
        return Excitation(_place(waves, low, high), True)
    ways = []
    for bottom, top in _list_swings(body, low, high):
        touched, is_held = 0, True
        for commands in _place(waves, bottom, top)[:, ::_HELD]:
            more, tilt = measure_support(body, commands, SAMPLE)
            touched, is_held = touched + more, more == 0 and tilt < STILL
            if not is_held:
                break
        ways.append((is_held, -touched, float((top - bottom).sum()), bottom, top))
    is_held, _, _, bottom, top = max(ways, key=lambda way: way[:3])
    return Excitation(_place(waves, bottom, top), is_held)


def _draw_multisines(count: int, joints: int, rng: np.random.Generator) -> Floats:
    """(K, t, P) [1] random-phase multisines, within -1 and 1, a row each `SAMPLE`.

    All lines are as wide (Pintelon and Schoukens 2012, System Identification, 2.6).
    """
    time = np.arange(round(SECONDS / SAMPLE)) * SAMPLE
    lines = np.arange(1, round(_TOP * SECONDS) + 1) / SECONDS
    phase = rng.uniform(0, 2 * np.pi, (count, joints, len(lines)))
    angle = 2 * np.pi * lines * time[:, None, None] + phase[:, None]
    waves = np.cos(angle).sum(axis=-1)
    return waves / np.abs(waves).max(axis=1, keepdims=True)


def _list_swings(
    body: Bodies, low: Floats, high: Floats
) -> Iterator[tuple[Floats, Floats]]:
    """Ranges (P) and (P) [rad]: all of each joint's, or its lower or upper half.

    Joints as far from the torso swing alike.

    Args:
        low: (P) and
        high: (P) ends of what joints can hold [rad].
    """
    depth = np.minimum(count_ancestors(body.parent[0]), _MOST_DEPTHS - 1)
    for halves in product(((0.0, 1.0), (0.5, 1.0), (0.0, 0.5)), repeat=depth.max() + 1):
        share = np.array(halves)[depth]
        yield low + share[:, 0] * (high - low), low + share[:, 1] * (high - low)


def _place(waves: Floats, low: Floats, high: Floats) -> Floats:
    """(K, T, P) commands [rad]: rest at zero, the way to the swing, the swing.

    Args:
        waves: (K, t, P) within -1 and 1.
        low: (P) and
        high: (P) ends of the swing [rad].
    """
    scales = np.resize(_SCALES, len(waves))[:, None, None]
    swing = (low + high) / 2 + scales * waves * (high - low) / 2
    ramp = np.linspace(0, 1, round(_APPROACH / SAMPLE), endpoint=False)[:, None]
    rest = np.zeros((len(waves), round(_REST / SAMPLE), waves.shape[2]))
    rows = np.concatenate([rest, ramp * swing[:, :1], swing], axis=1)
    return np.repeat(rows, _HELD, axis=1)
