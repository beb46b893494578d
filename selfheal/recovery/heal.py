"""Heal: a robot that breaks while it walks in; a run that grows by one phase out.

Phases: gait, whole (it walks), alarm (it breaks and notices), ask-N (an action each),
verdict, healed (a new gait), walked, known (for the report: with the truth known).
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

from ..body.body import Bodies, Floats
from .phased_run import run_phases
from .phases import HealPhases, Progress, RobotStates
from .record import HealRun, HealSettings, read_gait


def heal_robot(
    robots: RobotStates,
    models: Bodies,
    weights: Floats,
    settings: HealSettings,
    *,
    run: HealRun | None = None,
    progress: Progress = lambda phase, what, share: None,
) -> Iterator[HealRun]:
    """Walk, notice the damage, find it, walk again; a yield a phase, result at the end.

    Args:
        robots: act.
        models: rival self-models of the whole robot (K), best first.
        weights: (K) how likely each is.
        settings: what to do.
        run: one to go on with, made by the same robots and settings; None = start.
        progress: told the phase, what is done, and how much of it.
    """
    work = HealPhases(robots, models, weights, settings, progress)
    ended = partial(_summarize_run, robot=robots.intact.name)
    return run_phases(run or HealRun(settings), work.run_next, ended)


def _summarize_run(run: HealRun, robot: str) -> dict[str, Any]:
    """What `heal --json` prints (contract section 3)."""
    p, settings = run.phases, run.settings
    alarm = p["alarm"]["alarm"]
    told = alarm and {"time": round(alarm["time"], 3), "sensor": alarm["sensor"],
                      "p_value": alarm["p_value"]}  # fmt: skip
    shown = [{k: v for k, v in b.items() if k != "azimuth"}
             for b in p["verdict"]["believed"]]  # fmt: skip
    known = p["known"]["distance"]
    distance = {"intact": p["whole"]["distance"], "damaged": p["walked"]["damaged"],
                "healed": p["walked"]["healed"], "best_known": known}  # fmt: skip
    rounded = {k: None if v is None else round(v, 4) for k, v in distance.items()}
    return {
        "format": "selfheal-heal",
        "version": 1,
        "robot": robot,
        "seed": settings.seed,
        "damage": [d.document for d in settings.damage],
        "alarm": told,
        "hypotheses": shown,
        "actions": len(run.actions),
        "distance": rounded,
        "predicted": {
            "intact": round(read_gait(p["gait"]).predicted, 4),
            "healed": round(read_gait(p["healed"]).predicted, 4),
        },
        "seconds": round(run.seconds, 1),
        "run": settings.run,
    }
