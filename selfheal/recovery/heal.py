"""Heal: a robot that breaks while it walks in; a run that grows by one phase out.

Phases: gait, whole (it walks), alarm (it breaks and notices), ask-N (an action each),
verdict, healed (a new gait), walked, known (for the report: with the truth known).
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

from ..body.body import Bodies, Floats
from .phased import grown
from .phases import Phases, Progress, Robots
from .record import HealRun, HealSettings, gait_of


def heal(
    robots: Robots,
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
    work = Phases(robots, models, weights, settings, progress)
    ended = partial(_result, robot=robots.whole.name)
    return grown(run or HealRun(settings), work.next, ended)


def _result(run: HealRun, robot: str) -> dict[str, Any]:
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
        "actions": len(run.asked),
        "distance": rounded,
        "predicted": {
            "intact": round(gait_of(p["gait"]).predicted, 4),
            "healed": round(gait_of(p["healed"]).predicted, 4),
        },
        "seconds": round(run.seconds, 1),
        "run": settings.run,
    }
