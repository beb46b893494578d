"""Heal: a robot that breaks while it walks in; a run that grows by one phase out.

Phases: gait, whole (it walks), alarm (it breaks and notices), ask-N (an action each),
verdict, healed (a new gait), walked, known (for the report: with the truth known).
"""

from collections.abc import Iterator
from functools import partial

from ..body.body import Anatomy, Bodies, Floats
from ..damage.words import explain_misfit, list_targets
from ..engine.walk import list_channels
from ..errors import RunFileError
from ..gait.pattern import find_pattern
from .phased_run import Document, Progress, ignore_progress, run_phases
from .phases import HealPhases, Past, RobotStates, read_damage
from .probes import find_residual_scale, list_probes
from .record import HealRun, HealSettings, read_gait


def heal_robot(
    robots: RobotStates,
    models: Bodies,
    weights: Floats,
    settings: HealSettings,
    *,
    run: HealRun | None = None,
    progress: Progress = ignore_progress,
) -> Iterator[HealRun]:
    """Walk, notice the damage, find it, walk again; a yield a phase, result at the end.

    Args:
        models: rival self-models of the whole robot (K), best first.
        weights: (K) how likely each is.
        run: one to go on with, made by the same robots and settings; None = start.
        progress: called with the phase, what is done, and how much of it.
    """
    run = run or HealRun(settings)
    check_same_body(run, models)
    work = HealPhases(robots, models, weights, settings, progress, Past())
    ended = partial(_summarize_run, robot=robots.intact.name)
    return run_phases(run, work.run_next, ended)


def check_same_body(run: HealRun, models: Bodies) -> None:
    """Refuse a heal that was begun with another body, or whose numbers do not fit it.

    Raises:
        RunFileError: says what does not fit.
    """
    for wrong in _list_misfits(run, models.anatomy):
        raise RunFileError(f"the heal does not fit the body of its run: {wrong}")


def _list_misfits(run: HealRun, anatomy: Anatomy) -> Iterator[str]:
    """What of a heal does not fit a body; each stands on what came before it."""
    believed = [b for p in run.phases.values() for b in p.get("believed", ())]
    for damage in (*run.settings.damage, *map(read_damage, believed)):
        if wrong := explain_misfit(damage, list_targets(anatomy)):
            yield f"a damage is of {wrong}"
    sizes = {"angles": anatomy.size, "felt": len(list_channels(anatomy).names)}
    for name, phase in run.phases.items():
        for key, values in phase.items():
            width = sizes.get(key.rpartition("_")[2])
            if width is not None and values.shape[-1] != width:
                found = values.shape[-1]
                yield f"{key} of {name} has {found} columns; would fit: {width}"
        if phase.get("gait"):
            kept = read_gait(phase)
            count = find_pattern(kept.pattern).count_genes(anatomy.size)
            found = len(kept.genes)
            if found != count:
                yield f"the gait of {name} has {found} genes; would fit: {count}"
    if run.actions:
        yield from _list_action_misfits(run, anatomy)


def _list_action_misfits(run: HealRun, anatomy: Anatomy) -> Iterator[str]:
    """What of its actions does not fit the probes that the body has."""
    names = list_channels(anatomy).names
    probes = list_probes(read_gait(run.phases["gait"]), anatomy.joints)
    for k, taken in enumerate(run.actions, 1):
        probe, found = taken["probe"], taken["values"].shape
        if probe >= len(probes):
            fits = f"0 to {len(probes) - 1}"
            yield f"the probe of action {k} is {probe}; would fit: {fits}"
        count = len(find_residual_scale(probes[probe], names))
        if found != (count,):
            yield f"action {k} has {taken['values'].size} values; would fit: {count}"


def _summarize_run(run: HealRun, robot: str) -> Document:
    """What `heal --json` prints (contract section 3)."""
    p, settings = run.phases, run.settings
    alarm = p["alarm"]["alarm"]
    shown_alarm = alarm and {key: alarm[key] for key in ("time", "sensor", "p_value")}
    believed = p["verdict"]["believed"]
    shown = [{k: v for k, v in b.items() if k != "azimuth"} for b in believed]
    distance = {
        "intact": p["whole"]["distance"],
        "damaged": p["walked"]["damaged"],
        "healed": p["walked"]["healed"],
        "best_known": p["known"]["distance"],
    }
    rounded = {k: None if v is None else round(v, 4) for k, v in distance.items()}
    return {
        "format": "selfheal-heal",
        "version": 1,
        "robot": robot,
        "seed": settings.seed,
        "damage": [d.document for d in settings.damage],
        "alarm": shown_alarm,
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
