"""An identification of made-up numbers, for its page."""

from dataclasses import replace

import numpy as np

from selfheal.body.body import Anatomy
from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.selfmodel.run import Cycle, Run, Settings
from tests.support.browser import HOSTILE
from tests.support.stick_robot import anatomy


def make_anatomy(parts: int) -> Anatomy:
    """A square torso and sticks, each second one with a box."""
    block = (np.arange(parts) % 2)[:, None]
    return replace(
        anatomy(parts),
        torso_half=np.array([0.04, 0.05, 0.03]),
        rim=np.array([0.06, 0.07, 0.0]),
        length=np.linspace(0.08, 0.12, parts),
        block_half=block * np.array([0.02, 0.015, 0.02]),
        block_center=0.02 * block[:, 0],
        block_mass=0.02 * block[:, 0],
    )


def make_run(
    *,
    parts: int = 3,
    cycles: int = 4,
    rivals: int = 5,
    truth: bool = True,
    seed: int = 0,
) -> Run:
    """A finished run with made up numbers."""
    rng = np.random.default_rng(seed)
    anatomy, count = make_anatomy(parts), max(cycles, 6)
    actions = np.where(rng.random((count, parts)) < 0.3, -0.5, 0.5)
    hidden = build_bodies(anatomy, draw_genomes(anatomy, 1, rng, False))
    run = Run(
        Settings("toy", cycles=max(cycles, 1)),
        anatomy,
        actions,
        truth=hidden if truth else None,
        counts={"statics": 1000, "choice": 20, "failed": 0},
        result={"format": "made up"},
    )
    for k in range(cycles):
        tables = rng.normal(0, 5, (rivals, count, 3))
        cycle = Cycle(
            action=k,
            why="made up",
            felt=tables[0, k] + rng.normal(0, 0.3, 3),
            genomes=draw_genomes(anatomy, rivals, rng, False),
            tables=tables,
            losses=np.sort(rng.uniform(0, 2, rivals)),
            sureness=rng.random(parts),
            tilt_error=float(rng.random()),
            disagreement=float(rng.random()),
            spent=250 * (k + 1),
            seconds=1.5 * (k + 1),
        )
        run = replace(run, cycles=(*run.cycles, cycle))
    return run


def change_last_cycle(run: Run, **changes: object) -> Run:
    """The run with another last cycle."""
    return replace(run, cycles=(*run.cycles[:-1], replace(run.cycles[-1], **changes)))


def make_hostile_run(**how: object) -> Run:
    """A run with names that try to break out of the page."""
    run = make_run(**how)
    names = [HOSTILE, "$\\frac{x$ --> \n\x07\u811a\ud800", *"abcdefghijklmnop"]
    names = tuple(names[: run.anatomy.size])
    anatomy = replace(run.anatomy, name=HOSTILE, parts=names, joints=names)
    settings = replace(run.settings, robot=HOSTILE, recordings=HOSTILE)
    cycles = tuple(replace(c, why=HOSTILE) for c in run.cycles)
    truth = None if run.truth is None else replace(run.truth, anatomy=anatomy)
    return replace(run, anatomy=anatomy, settings=settings, cycles=cycles, truth=truth)
