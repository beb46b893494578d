"""A hidden robot, a run that found its body, and searches that take a second."""

from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np

from selfheal.body.body import Anatomy
from selfheal.body.genome import Genomes, encode_tree
from selfheal.damage.kinds import Damage
from selfheal.damage.words import parse_damages
from selfheal.gait import synthesis
from selfheal.gait.synthesis import Effort, Gait
from selfheal.recording import Recording
from selfheal.recovery import phases, plausible_plants, walk_trial
from selfheal.recovery.hypotheses import list_damages
from selfheal.report import heal as heal_page
from selfheal.report import hours as hours_page
from selfheal.robot.actions import load_published_body
from selfheal.robot.base import Walker, require_walker
from selfheal.robot.open_robot import open_robot
from selfheal.robot.rest_readings import read_rest_channels
from selfheal.selfmodel.run import Cycle, Run, Settings, save_run

BODY = load_published_body()
SEED = 7
# a gait that `selfheal gait` found
GENES = np.array(
    [
        *(-1.791, -1.191, -1.888, -1.475, -0.121, -1.526, 0.175, -0.645),
        *(0.810, 0.060, 0.956, -0.209, 0.488, 0.332, 0.038, -0.095),
        *(-1.332, 1.390, 0.477, -1.344, -0.198, 1.971, -1.161, -0.901),
        2.712,
    ]
)
PLACEMENT = np.array([0.125, 0.375, 0.625, 0.875, *4 * [0.375]])


def shorten(patch: Callable[[object, str, object], None]) -> None:
    """Make searches short, by `setattr` or one that undoes.

    They start from a gait that walks; hypotheses are few; pages have no film.
    """
    short = Effort(((1, 2, 2.0),), drawn=2, step=0.02, step_again=0.02)
    for module, name in (
        (phases, "ONE_GAIT"),
        (phases, "THREE_GAITS"),
        (walk_trial, "ONE_GAIT"),
    ):
        patch(module, name, short)
    real = synthesis.draw_first_genes
    patch(synthesis, "draw_first_genes", lambda search: 0 * real(search) + GENES)
    patch(plausible_plants, "KEPT", 1)
    patch(phases, "list_damages", list_few_damages)
    for page in (heal_page, hours_page):
        patch(page, "make_film", lambda *args, **more: "")


def list_few_damages(
    anatomy: Anatomy, angles: np.ndarray, gone: Collection[str] = ()
) -> list[Damage]:
    """Those that may have happened, at few values and on slopes of one direction."""
    kept = {
        "part_scale": (0.1, 0.5),
        "joint_jam": (0.0, *angles),
        "weak_motor": (0.3,),
        "weak_sensor": (0.3,),
        "ground_friction": (0.3,),
    }
    return [
        damage
        for damage in list_damages(anatomy, angles, gone)
        if damage.value in kept.get(damage.kind, (damage.value,))
        and damage.azimuth == 0.0
    ]


def robot() -> Walker:
    """The hidden robot."""
    return require_walker(open_robot("starfish", seed=SEED))


def identified(folder: Path, placement: np.ndarray = PLACEMENT) -> tuple[Path, Run]:
    """The file of a run that ended with the right body, or one hung a bit askew."""
    hidden = robot()
    genomes = encode_tree(BODY.anatomy, BODY.parent, placement)
    cycles = tuple(
        Cycle(
            a,
            "",
            read_rest_channels(hidden.act(a), hidden.anatomy),
            genomes,
            np.zeros((1, 36, 3)),
            np.zeros(1),
            np.ones(8),
            0.0,
            0.0,
            0,
            0.0,
        )
        for a in (0, 9, 20, 30)
    )
    run = Run(
        Settings("starfish", seed=SEED),
        BODY.anatomy,
        hidden.actions,
        cycles,
        BODY,
        result=make_result(genomes),
    )
    save_run(run, folder / "run.h5")
    return folder / "run.h5", run


def make_result(genomes: Genomes) -> dict[str, object]:
    """What `identify` says of the first of some bodies."""
    return {
        "format": "selfheal-identify",
        "version": 1,
        "robot": "starfish",
        "method": "default",
        "seed": SEED,
        "parent": genomes.parent[0].tolist(),
        "sureness": [1.0] * genomes.parent.shape[1],
        "length": genomes.length[0].tolist(),
        "tilt_error": 0.0,
        "actions": [],
        "simulations": {},
    }


def record_walks() -> tuple[Recording, Recording]:
    """Recordings of 40 s of walking: whole, and breaking after 25 s."""
    gait = Gait("waves", GENES, 0.0, 0.0, 0.0, 0.0, 0, 0)
    hidden, commands = robot(), gait.commands(8, 40.0)
    breaking = hidden.struck(parse_damages("left_lower:0.4", BODY.anatomy), 25.0)
    return hidden.move(commands), breaking.move(commands)
