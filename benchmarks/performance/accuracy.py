"""Accuracy of the engines: against the robot of 2006, and against `mujoco`.

Takes the intact readings of 2006 and random trees, gives its part of docs/results.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.performance.throughput import draw_candidates
from benchmarks.writer import INTACT, format_hits, make_parser, publish_page
from selfheal.body.mjcf import Physics
from selfheal.engine import make_engine
from selfheal.engine.mujoco import MuJoCo
from selfheal.engine.readings import Engine
from selfheal.engine.statics import Statics
from selfheal.robot.actions import load_published_body
from selfheal.robot.open_robot import open_robot
from selfheal.robot.rest_readings import read_rest_channels

SAME = 2.0  # [deg] poses this near, in the worse tilt, are the same (issue's figure)
LEFT_OUT = 0.05  # largest share of poses that may be left out (issue's figure)


def read_readings(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Joint targets (A, P) [rad] and measured channels (A, 3) of a recording."""
    robot = open_robot("starfish-2006", recordings=path)
    measured = [
        read_rest_channels(robot.act(k), robot.anatomy)
        for k in range(len(robot.actions))
    ]
    return robot.actions, np.array(measured)


def score_published_body(
    actions: np.ndarray, measured: np.ndarray
) -> dict[str, Mapping[str, float]]:
    """Errors by engine of the published body on the readings of 2006.

    Args:
        actions: (A, P) [rad].
        measured: (A, 3) channels, tilts [deg] and clearance [mm].
    """
    engines = {
        "mujoco": MuJoCo(),
        "statics": make_engine("statics"),
        "mjx": make_engine("mjx"),
        "mujoco, ramp 0.5 s, hold 1 s": MuJoCo(ramp=0.5, hold=1.0),
    }
    bodies = load_published_body()[np.zeros(len(actions), int)]
    seen = {k: e.simulate(bodies, actions).channels for k, e in engines.items()}
    found = dict[str, Mapping[str, float]]()
    for name, channels in seen.items():
        error = np.abs(channels - measured)
        gap = np.abs(channels - seen["mujoco"])[:, :2].max(axis=1)
        found[name] = {
            "tilt_error": float(error[:, :2].sum(axis=1).mean()),
            "clearance_error": float(np.nanmean(error[:, 2])),
            "mean_difference": float(gap.mean()),
            "largest_difference": float(gap.max()),
        }
    return found


def measure_agreement(count: int, seed: int) -> dict[str, object]:
    """How often engines agree with `mujoco` on random trees under random actions."""
    bodies, targets = draw_candidates(count, seed)

    def tilt(engine: Engine) -> np.ndarray:
        return np.degrees(engine.simulate(bodies, targets).tilt)

    reference = tilt(MuJoCo())
    others = [Physics(timestep=Physics().timestep / 2), Physics(friction=0.5)]
    gaps = [_compute_tilt_gap(tilt(MuJoCo(p)), reference) for p in others]
    own = np.max(gaps, axis=0)
    doubtful = np.argsort(-own, kind="stable")[: int(LEFT_OUT * count)]
    kept = np.setdiff1d(np.arange(count), doubtful[own[doubtful] > SAME])
    engines = {
        "statics": make_engine("statics"),
        "statics, 20 sub-steps": Statics(20),
        "mjx": make_engine("mjx"),
    }
    near = {
        name: _compute_tilt_gap(tilt(engine), reference) <= SAME
        for name, engine in engines.items()
    }
    return {
        "trees": count,
        "seed": seed,
        "unstable": format_hits(own > SAME),
        "left_out": count - len(kept),
        "agreement": {
            k: [format_hits(n), format_hits(n[kept])] for k, n in near.items()
        },
    }


def _compute_tilt_gap(tilt: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(N) the worse tilt's difference [deg], infinite where one diverged."""
    gap = np.abs(tilt - reference).max(axis=1)
    return np.where(np.isnan(gap), np.inf, gap)


def main() -> None:
    """Measure all parts of accuracy and publish them."""
    line = make_parser(__doc__ or "")
    line.add_argument("--trees", type=int, default=300, help="random trees")
    line.add_argument("--seed", type=int, default=20261121, help="of the trees")
    line.add_argument("--recordings", default=INTACT, help="intact.h5 of 2006")
    options = line.parse_args()
    figures: dict[str, object] = {
        "published": score_published_body(*read_readings(options.recordings)),
        **measure_agreement(options.trees, options.seed),
    }
    page = Path(__file__).with_name("accuracy.md")
    publish_page(options.root, "accuracy", page, figures)


if __name__ == "__main__":
    main()
