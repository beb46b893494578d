"""How a hidden robot walks: commands in, a noisy recording out; physics of its own."""

from dataclasses import replace

import numpy as np

from ..body.body import BELLY_SENSOR, Bodies, Floats
from ..body.mjcf import Physics
from ..damage.apply import Strike, apply_damages
from ..engine.channels import TOUCH_HEIGHT
from ..engine.plant import Plant, build_rated_plant
from ..engine.walk import PERIOD, SAMPLE, Walks, compute_clearance, simulate_walks
from ..recording import Episode, Recording, Signal
from .read_channels import list_signals_over_time

# Chosen. Rated limits are missed by up to 20 %; hobby servos answer a pulse of 20 ms
# late by one to three, and have about a degree of play.
_RATED_DEVIATION, _DELAYS, _PLAY = 0.2, (0.02, 0.04, 0.06), np.radians((0.3, 1.5))
_STIFF, _DRAG = (30.0, 60.0), (0.4, 0.9)
_WOBBLE = np.radians(0.7)  # of every servo, other in each trial, drifting in a second
_UP, _GAP, _ANGLE, _PLACE = 0.005, 0.0005, np.radians(0.3), 0.002  # sensor noise


def draw_hidden_plant(
    physics: Physics, body: Bodies, offset: Floats, rng: np.random.Generator
) -> Plant:
    """The plant behind a simulated robot: off the rated one by up to a fifth.

    Args:
        offset: (P) of each joint's zero [rad].
    """
    rated = build_rated_plant(body)
    off = rng.uniform(1 - _RATED_DEVIATION, 1 + _RATED_DEVIATION, 2)
    ends = rng.uniform(1 - _RATED_DEVIATION, 1 + _RATED_DEVIATION, 2)
    return replace(
        rated,
        physics=replace(
            physics,
            timestep=0.002,
            kp=float(rng.uniform(*_STIFF)),
            kv=float(rng.uniform(*_DRAG)),
        ),
        torque=rated.torque * off[0],
        speed=rated.speed * off[1],
        low=rated.low * ends[0],
        high=rated.high * ends[1],
        delay=float(rng.choice(_DELAYS)),
        backlash=float(rng.uniform(*_PLAY)),
        offset=offset,
    )


def simulate_move(
    plant: Plant,
    commands: Floats,
    strikes: tuple[Strike, ...],
    rng: np.random.Generator,
    name: str,
) -> Recording:
    """The recording of a move of a robot that may break in it; see `base.Walker.move`.

    Args:
        plant: behind the robot before any damage.
        commands: (T, P) joint commands [rad].
        strikes: what happens in the move, in order of time.
    """
    sent = commands + _draw_wobble(commands.shape, rng)
    every = round(SAMPLE / PERIOD)
    pieces: list[tuple[Plant, Walks]] = []
    start, begun, now = None, 0, plant
    for strike in (*strikes, None):
        due = round(strike.time / SAMPLE) * every if strike else len(sent)
        part = sent[begun : min(due, len(sent))]
        if len(part):
            walks = simulate_walks([now], part[None], start)
            start = (walks.state, walks.set_point)
            pieces.append((now, walks))
            begun += len(part)
        if strike:
            now = apply_damages(now, strike.damage)
    signals = [_make_signals(one, walks[0], rng) for one, walks in pieces]
    joined = {
        key: replace(signal, values=np.concatenate([s[key].values for s in signals]))
        for key, signal in signals[0].items()
    }
    count = len(commands) // every
    servos = tuple(f"{j}_servo" for j in plant.body.anatomy.joints)
    # a command stands at the sample from which it is held
    after_sample = np.minimum(np.arange(1, count + 1) * every, len(commands) - 1)
    episode = Episode(
        SAMPLE * np.arange(1.0, count + 1), commands[after_sample], servos, joined
    )
    return Recording({"move": episode}, name, "simulated")


def _draw_wobble(shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """(T, P) [rad] what the servos add of their own, smooth over a second."""
    knots = rng.normal(0, _WOBBLE, (round(shape[0] * PERIOD) + 2, shape[1]))
    at = np.arange(shape[0]) * PERIOD
    columns = [np.interp(at, np.arange(len(knots)), k) for k in knots.T]
    return np.stack(columns, axis=1)


def _make_signals(
    plant: Plant, walk: Walks, rng: np.random.Generator
) -> dict[str, Signal]:
    """The noisy signals of one piece (S) of a walk."""
    anatomy, kinds = plant.body.anatomy, list_signals_over_time(plant.body.anatomy)
    gap = compute_clearance(walk, anatomy.torso_half[2])
    up = _add_noise(walk.up, _UP, rng)
    values = {
        "vertical": up / np.linalg.norm(up, axis=-1, keepdims=True),
        "clearance": np.maximum(_add_noise(gap, _GAP, rng), 0) + BELLY_SENSOR,
    }
    for joint, angle in zip(anatomy.joints, walk.angles.T, strict=True):
        values[f"{joint}_position"] = _add_noise(angle, _ANGLE, rng)
    for foot, tip in zip(anatomy.feet, walk.tips.T, strict=True):
        values[f"{anatomy.parts[foot - 1]}_touch"] = (tip < TOUCH_HEIGHT).astype(float)
    for sensor, gain in plant.gain.items():
        values[sensor] = gain * values[sensor]
    values["torso_position"] = _add_noise(walk.position, _PLACE, rng)
    values["torso_orientation"] = walk.orientation
    touch = {name: ("sensor", name, "1") for name in values}
    return {name: Signal(v, *(touch | kinds)[name]) for name, v in values.items()}


def _add_noise(values: Floats, size: float, rng: np.random.Generator) -> Floats:
    """Values with noise of a standard deviation."""
    return values + rng.normal(0, size, values.shape)
