"""Measurement of motion: takes recordings, gives their MeasuredMotion."""

import numpy as np

from ..data.segments import Segments
from ..simulation.simulator import Simulator
from .motion import MOMENTS_PER_WINDOW, MeasuredMotion
from .quartics import choose_half_width

# [s] and samples of a window, the longer of which counts: a robot's motion has a
# bandwidth of some hertz, and a polynomial needs its samples
WINDOW_SECONDS, MIN_WINDOW_SAMPLES = 0.1, 12
# [s] of a window in which a servo's own motion, of some hertz, still shows
MAX_WINDOW_SECONDS = 0.15


def _find_prime(least: float) -> int:
    """The smallest prime that is no less, or 1.

    Moments so many steps apart lie at all phases of a command that is held for a whole
    number of steps: it counts by its mean.
    """
    n = max(1, int(np.ceil(least)))
    while any(n % k == 0 for k in range(2, int(n**0.5) + 1)):
        n += 1
    return n


def _list_read_joints(simulator: Simulator) -> tuple[int, ...]:
    """Ids of the hinges and slides whose positions are read."""
    model = simulator.compiler.nominal
    read = {c.target for c in simulator.channels if c.kind == "joint_position"}
    slide, hinge = 2, 3  # of mjtJoint
    return tuple(
        j
        for j in range(model.njnt)
        if model.jnt_type[j] in (slide, hinge) and model.joint(j).name in read
    )


def is_measured(simulator: Simulator) -> bool:
    """Whether all joints are hinges and slides that are read, and nothing touches.

    And whether that is so often that windows are hardly longer than motion asks for. A
    robot without joints has no balance of torques.
    """
    count = simulator.compiler.nominal.njnt
    is_read = len(_list_read_joints(simulator)) == count
    is_fast = _choose_window(simulator) <= MAX_WINDOW_SECONDS
    return bool(count and is_read and is_fast and not simulator.has_contact)


def _choose_window(simulator: Simulator) -> float:
    """Length of a window [s]."""
    steps = [np.diff(e.sample_steps) for e in simulator.episodes]
    gap = float(np.median(np.concatenate(steps))) * simulator.timestep
    return max(WINDOW_SECONDS, MIN_WINDOW_SAMPLES * gap)


def measure_motion(simulator: Simulator, rng: np.random.Generator) -> MeasuredMotion:
    """States and accelerations of all hinges and slides that are read.

    Args:
        simulator: of the recordings, with the model's own step.
    """
    joints, step = _list_read_joints(simulator), simulator.timestep
    window = _choose_window(simulator)
    apart = _find_prime(window / MOMENTS_PER_WINDOW / step)
    firsts = [np.arange(0, int(e.sample_steps[-1]), apart) for e in simulator.episodes]
    count, windows = 0, [np.zeros((0, MOMENTS_PER_WINDOW), int)]
    for first in firsts:
        last = len(first) - MOMENTS_PER_WINDOW + 1
        starts = count + np.arange(0, last, MOMENTS_PER_WINDOW // 2)
        windows.append(starts[:, None] + np.arange(MOMENTS_PER_WINDOW))
        count += len(first)
    width = sum(c.width for c in simulator.channels)
    episode = np.repeat(np.arange(len(firsts)), [len(f) for f in firsts])
    none = np.zeros(0, int), np.zeros(0), np.zeros((0, width))
    moments = Segments(episode, np.concatenate(firsts), np.full(count, apart), *none)
    hann = np.hanning(MOMENTS_PER_WINDOW + 2)[1:-1]
    widths = _choose_widths(simulator, window)
    unknown = np.zeros(0)  # noise, until there are windows
    motion = MeasuredMotion(
        simulator,
        joints,
        moments,
        widths,
        np.concatenate(windows),
        hann / hann.sum(),
        unknown,
        unknown,
    )
    read_all = motion.read({})
    at_moments = read_all.offset, read_all.acceleration
    known = np.asarray(np.isfinite(np.hstack(at_moments)).all(axis=1))
    rows = np.flatnonzero(known[motion.windows].all(axis=1))
    motion = motion.select(rows)
    if not len(rows):
        return motion
    return motion.with_noise(rng)


def _choose_widths(simulator: Simulator, window: float) -> dict[str, int]:
    """Half width [samples] of the polynomials of each joint's signals, by name."""
    out = {}
    longest = max(simulator.episodes, key=lambda e: len(e.sample_steps))
    time = longest.sample_steps * simulator.timestep
    for c in simulator.channels:
        if c.kind in ("joint_position", "joint_velocity"):
            order = 2 if c.kind == "joint_position" else 1
            readings = longest.readings[:, c.first_column]
            noise = float(c.noise[0])
            out[c.name] = choose_half_width(time, readings, noise, order, window)
    return out
