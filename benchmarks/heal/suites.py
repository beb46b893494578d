"""Suites of `gait`, `watch` and `heal` on fresh seeds, and on readings of 2006."""

import time
from functools import cache, partial
from itertools import islice
from typing import Any

import numpy as np

from benchmarks.suites import KeyedRuns
from benchmarks.writer import INTACT
from selfheal.body.body import length_error
from selfheal.engine.plant import damaged, rated
from selfheal.engine.walk import channels_of, into_frame, sensed
from selfheal.gait.believed import believed
from selfheal.gait.pattern import pattern
from selfheal.gait.synthesis import Gait, forward, synthesize, walk
from selfheal.recording import read
from selfheal.recovery.heal import heal
from selfheal.recovery.monitor import baseline, watch
from selfheal.recovery.phases import LEARNED, WATCHED, damage_of, robots_of
from selfheal.recovery.record import HealRun, HealSettings, gait_of
from selfheal.recovery.replayed import Tables, name_damage, tables
from selfheal.recovery.senses import felt_over_time, orientation, position
from selfheal.robot.accidents import BODY_KINDS, WORLD_KINDS, draw
from selfheal.robot.actions import published
from selfheal.robot.base import open_robot, walker
from selfheal.robot.replay import replay
from selfheal.selfmodel.loop import identify
from selfheal.selfmodel.run import Settings

FIRST = 5000
ROBOTS = 2  # hidden robots of `heals`, each identified once


def list_real_runs(count: int) -> KeyedRuns:
    """Runs that name the damage of the robot of 2006, by chosen or random actions."""
    for seed in range(FIRST, FIRST + count):
        for chosen in (True, False):
            yield f"{seed} {chosen}", partial(_name_real_damage, seed, chosen)


def _name_real_damage(seed: int, chosen: bool) -> dict[str, Any]:
    known, rng = _read_tables(), np.random.default_rng(seed)
    parts = published().anatomy.parts
    steps = []
    for _, belief in islice(name_damage(known, rng, chosen=chosen), 10):
        names = [d.name for d in known.damages]
        of = {
            p: sum(b for b, n in zip(belief, names, strict=True) if n == p)
            for p in parts
        }
        steps.append({k: round(float(v), 4) for k, v in of.items()})
    return {"chosen": chosen, "steps": steps}


@cache
def _read_tables() -> Tables:
    robots: list[Any] = [
        replay("starfish-2006", read(INTACT.with_name(f"{name}.h5")), published())
        for name in ("intact", "damaged")
    ]
    return tables(robots[0], robots[1], published())


def list_gait_runs(count: int) -> KeyedRuns:
    """Runs that synthesize a gait and walk it on three hidden robots."""
    for seed in range(FIRST, FIRST + count):
        for name in ("waves", "poses") if seed < FIRST + count // 3 else ("waves",):
            yield f"{seed} {name}", partial(_walk_gait, seed, name)
    yield "random", _walk_random_gaits


def _walk_gait(seed: int, name: str) -> dict[str, Any]:
    heading = 0.0 if seed % 3 else float(np.random.default_rng(seed).uniform(-3, 3))
    start = time.perf_counter()
    gait = synthesize([rated(published())], name=name, heading=heading, seed=seed)
    spent = time.perf_counter() - start
    walked = []
    for robot in range(3):
        hidden = walker(open_robot("starfish", seed=10 * seed + robot))
        path = position(hidden.move(gait.commands(8)))
        walked.append([float(v) for v in forward(path[-1], heading)])
    return {"gait": name, "heading": heading, "predicted": gait.predicted,
            "walked": walked, "seconds": spent,
            "failed": gait.failed, "simulations": gait.simulations}  # fmt: skip


def _walk_random_gaits() -> dict[str, Any]:
    """End of 30 random gaits of paper A's kind, and of waves, on hidden robots [m]."""
    found: dict[str, Any] = {}
    for name in ("poses", "waves"):
        rng, ends = np.random.default_rng(FIRST), []
        size = pattern(name).size(8)
        for k in range(30):
            # paper A's poses are uniform in +-70 degrees
            genes = (
                rng.uniform(-1, 1, size)
                if name == "poses"
                else rng.normal(0, 0.4, size)
            )
            gait = Gait(name, genes, 0.0, 0.0, 0.0, 0.0, 0, 0)
            robot = walker(open_robot("starfish", seed=FIRST + k))
            ends.append(position(robot.move(gait.commands(8)))[-1, :2].tolist())
        found[name] = ends
    return found


def _prepare_robot(robot: int) -> tuple[Any, Any, Any]:
    """A hidden robot, its self-models and their weights."""
    seed = FIRST + robot
    hidden = walker(open_robot("starfish", seed=seed))
    *_, run = identify(hidden, Settings("starfish", seed=seed))
    models, weights = believed(run)
    return hidden, models, weights


_PREPARED: dict[int, Any] = {}


def list_heal_runs(count: int) -> KeyedRuns:
    """Runs of whole heals after random body damages, each kind as often."""
    for k in range(count):
        yield f"{FIRST + k}", partial(_heal_damage, k, BODY_KINDS, whole=True)


def list_verdict_runs(count: int) -> KeyedRuns:
    """Runs of more random body damages: alarm and verdict, no new gait."""
    for k in range(100, 100 + count):
        yield f"{FIRST + k}", partial(_heal_damage, k, BODY_KINDS, whole=False)


def list_world_runs(count: int) -> KeyedRuns:
    """Runs of slopes and slippery ground: alarm and verdict, no new gait."""
    for k in range(count):
        yield f"{FIRST + k}", partial(_heal_damage, k, WORLD_KINDS, whole=False)


def _heal_damage(k: int, kinds: tuple[str, ...], whole: bool) -> dict[str, Any]:
    robot, seed = k % ROBOTS, FIRST + k
    if robot not in _PREPARED:
        _PREPARED[robot] = [*_prepare_robot(robot), {}]
    hidden, models, weights, phases = _PREPARED[robot]
    rng = np.random.default_rng([seed, 7])
    damage = draw(hidden.anatomy, rng, (kinds[k % len(kinds)],))
    onset = float(rng.uniform(8, 20))
    settings = HealSettings("", (damage,), onset, seed=FIRST + robot)
    begun = HealRun(settings, dict(phases))
    run, robots = begun, robots_of(hidden, settings)
    for run in heal(robots, models, weights, settings, run=begun):
        if len(run.phases) == 2:
            _PREPARED[robot][3] = dict(run.phases)
        if not whole and "verdict" in run.phases:
            break
    return _summarize_heal(run, damage, onset, hidden.truth, models, robots)


def _summarize_heal(run, damage, onset, truth, models, robots) -> dict[str, Any]:
    phases = run.phases
    alarm, gait = phases["alarm"]["alarm"], gait_of(phases["gait"])
    guess = phases["verdict"]["believed"][0]
    found = damage_of(guess)
    old = position(robots.broken.move(gait.commands(8), trial=200))[-1]
    said = damaged(rated(models[[0]]), found).body
    real = damaged(rated(truth), damage).body
    same = (found.kind, found.target) == (damage.kind, damage.target)
    return {
        "damage": damage.document, "found": guess, "right": same,
        "same_part": found.target == damage.target,
        "world": found.kind in WORLD_KINDS, "nothing": found.kind == "none",
        "actions": len(run.asked), "alarm": alarm,
        "delay": alarm and (alarm["time"] - onset) / gait.cycle,
        "intact": phases["whole"]["distance"], "damaged": float(old[0]),
        "healed": run.result["distance"]["healed"] if run.result else None,
        "best_known": run.result["distance"]["best_known"] if run.result else None,
        "predicted": run.result["predicted"] if run.result else None,
        "length_error": float(length_error(said, real)[0]),
        "part_error": float(100 * np.abs(said.length - real.length).max()),
        "seconds": run.seconds,
    }  # fmt: skip


def list_alarm_runs(count: int) -> KeyedRuns:
    """Runs that watch hidden robots walk, whole and breaking."""
    for k in range(count):
        yield f"{FIRST + k}", partial(_watch_walks, k)


def _watch_walks(k: int) -> dict[str, Any]:
    gait, rng = _synthesize_known_gaits()[k % 3], np.random.default_rng([FIRST + k, 8])
    hidden = walker(open_robot("starfish", seed=FIRST + 100 + k))
    plant, anatomy = rated(published()), hidden.anatomy
    predicted = sensed(walk([plant], gait, WATCHED), [plant])[0]
    channels = channels_of(anatomy)
    measured = felt_over_time(hidden.move(gait.commands(8, LEARNED)), anatomy)[1]
    known = baseline(measured, predicted[: len(measured)], gait.cycle, channels)

    def seen(robot: Any, trial: int) -> tuple[Any, bool]:
        """The alarm, and whether the robot ended on its back."""
        move = robot.move(gait.commands(8, WATCHED), trial=trial)
        measured = felt_over_time(move, anatomy)[1]
        fallen = bool(into_frame(orientation(move)[-1], np.array([0.0, 0, 1]))[2] < 0)
        return watch(measured, predicted, known, channels).alarm, fallen

    whole = [seen(hidden, trial) for trial in range(1, 9)]
    broken = []
    for trial, kinds in enumerate((BODY_KINDS, WORLD_KINDS), 20):
        damage = draw(anatomy, rng, (kinds[k % len(kinds)],))
        onset = float(rng.uniform(8, 20))
        alarm, _ = seen(hidden.struck((damage,), onset), trial)
        early = alarm is not None and alarm.time < onset
        late = None if early or alarm is None else (alarm.time - onset) / gait.cycle
        ends = [position(robot.move(gait.commands(8), trial=30))[-1, 0]
                for robot in (hidden, hidden.struck((damage,)))]  # fmt: skip
        broken.append({"damage": damage.document, "early": early, "delay": late,
                       "cost": float(1 - ends[1] / ends[0])})  # fmt: skip
    times = [alarm.time if alarm else WATCHED for alarm, _ in whole]
    return {"false": sum(alarm is not None for alarm, _ in whole),
            "fallen": sum(fell for alarm, fell in whole if alarm), "broken": broken,
            "seconds": float(sum(times) - 6.0 * len(times))}  # fmt: skip


def _synthesize_known_gaits() -> list[Gait]:
    """Gaits for `alarms`: short searches are enough for walks that are only watched."""
    if not _GAITS:
        for seed in range(3):
            _GAITS.append(synthesize([rated(published())], seed=FIRST + 200 + seed))
    return _GAITS


_GAITS: list[Gait] = []

SUITES = {
    "real": (list_real_runs, 60),
    "gaits": (list_gait_runs, 12),
    "alarms": (list_alarm_runs, 30),
    "heals": (list_heal_runs, 30),
    "verdicts": (list_verdict_runs, 30),
    "worlds": (list_world_runs, 20),
}
