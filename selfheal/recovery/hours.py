"""Hours of walking: a robot that breaks again and again in; heal after heal out.

Each heal begins as the last one ended: with its gait, and with a self-model to which
what was believed has happened. Its phases are those of `heal`, numbered by heal; there
is a phase first (for the report: the whole robot's gait) in place of known.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..body.body import Bodies, Floats
from ..damage.apply import Strike
from ..damage.kinds import INTACT, Damage
from ..errors import InputError
from ..gait.pattern import SECONDS
from ..gait.synthesis import measure_distance
from ..robot.base import Walker
from .heal import check_same_body
from .phased_run import Document, Phase, Progress, ignore_progress, run_phases
from .phases import (
    LEARNING_TIME,
    ROWS,
    WATCHING_TIME,
    HealPhases,
    Past,
    RobotStates,
    read_damage,
)
from .record import HealRun, HealSettings, read_gait

_PER_MINUTE = 60 / SECONDS  # of the way in a walk: [m/min]
_TRIALS = 10_000  # numbers of trials that each heal has for itself; chosen
# [s] before the first damage and after each: to learn how it walks, and a walk in which
# that is watched. What comes while it learns it would take for how it walks.
PAUSE = LEARNING_TIME + WATCHING_TIME
_MOST_HOURS = 100.0  # a file then holds some 1000 heals; chosen


def check_hours(hours: float) -> None:
    """Refuse hours [h] in which nothing can be learned and watched, or too many.

    Raises:
        InputError: says what would fit.
    """
    seconds = PAUSE + WATCHING_TIME
    least = seconds / 3600
    if not least <= hours <= _MOST_HOURS:
        raise InputError(
            f"{hours:g} hours; would fit: {np.ceil(1000 * least) / 1000:g} "
            f"({seconds:.0f} s, to learn how the robot walks, to watch one walk, and "
            f"one in which it may break) to {_MOST_HOURS:g}"
        )


def heal_for_hours(
    robot: Walker,
    models: Bodies,
    weights: Floats,
    settings: HealSettings,
    *,
    run: HealRun | None = None,
    progress: Progress = ignore_progress,
) -> Iterator[HealRun]:
    """Walk for hours and heal after each alarm; a yield a phase, result at the end.

    Args:
        models: rival self-models of the whole robot (K), best first.
        weights: (K) how likely each is.
        run: one to go on with, made by the same robot and settings; None = start.
        progress: called with the phase, what is done, and the share of the hours
            that is over.
    """
    run = run or HealRun(settings)
    for heal in run.heals:
        check_same_body(heal, models)
    work = _Hours(robot, models, weights, settings, progress)
    return run_phases(run, work.run_next, partial(_summarize_hours, robot=robot.name))


class _Hours:
    """Heals one after the other, of one robot."""

    def __init__(
        self,
        robot: Walker,
        models: Bodies,
        weights: Floats,
        settings: HealSettings,
        progress: Progress,
    ) -> None:
        """See `heal_for_hours` for the arguments."""
        self.robot, self.models, self.weights = robot, models, weights
        self.settings, self.progress = settings, progress
        self.key: tuple[int, bool] | None = None
        self.work: HealPhases | None = None

    def run_next(self, run: HealRun) -> tuple[str, Phase] | None:
        """The name of the next phase and what came of it; None at the end."""
        heals = run.heals
        if "first" in heals[-1].phases:
            gait = {"gait": heals[-1].phases["healed"]}
            heals.append(replace(heals[-1], phases=gait))
        alarm = heals[-1].phases.get("alarm", {"alarm": True})["alarm"]
        start = compute_start(heals)
        walks = count_walks(self.settings, start)
        if not alarm or not walks:
            return None
        key = len(heals), alarm is not True
        if self.work is None or key != self.key:
            self.key, self.work = key, self._prepare_heal(heals, start, walks)
        made = self.work.run_next(heals[-1])
        assert made is not None  # the phase first is the last
        return run.name_phase(made[0], len(heals)), made[1]

    def _prepare_heal(
        self, heals: Sequence[HealRun], start: float, walks: int
    ) -> HealPhases:
        """The last heal, of a robot to which has happened what had until then."""
        watch = start + LEARNING_TIME
        alarm = heals[-1].phases.get("alarm", {}).get("alarm")
        times = watch + WATCHING_TIME * np.arange(walks)
        states = RobotStates(
            self._strike_robot(start),
            [self._strike_robot(time) for time in times.tolist()],
            self._strike_robot(watch, alarm["time"] if alarm else watch),
        )
        first = heals[0].phases.get("gait")
        past = Past(
            list_believed(heals[:-1]),
            watch,
            _TRIALS * (len(heals) - 1),
            read_gait(first) if first else None,
        )
        report = partial(self._tell, start)
        return HealPhases(
            states, self.models, self.weights, heals[-1].settings, report, past
        )

    def _strike_robot(self, time: float, until: float = np.inf) -> Walker:
        """The robot as it is at a time [s], and breaks after it, until another [s]."""
        robot = self.robot
        for strike in self.settings.strikes:
            if strike.time <= until:
                later = max(0.0, strike.time - time) * (until == np.inf)
                robot = robot.struck((strike.damage,), later)
        return robot

    def _tell(self, start: float, phase: str, what: str, share: float) -> None:
        """Show what is done, and how much of the hours is over."""
        whole = 3600 * self.settings.hours
        walked = share * (whole - start) if phase == "alarm" else 0.0
        self.progress(phase, what, (start + walked) / whole)


def compute_start(heals: Sequence[HealRun]) -> float:
    """When the last heal begins: at the alarm of the one before [s]."""
    return float(heals[-2].phases["alarm"]["alarm"]["time"]) if len(heals) > 1 else 0.0


def count_walks(settings: HealSettings, start: float) -> int:
    """Whole walks that can be watched in a heal that begins at a time [s]."""
    left = 3600 * settings.hours - start - LEARNING_TIME
    return max(0, int(left / WATCHING_TIME + 1e-9))


def list_believed(heals: Sequence[HealRun]) -> list[Damage]:
    """What heals found, without those that found nothing."""
    found = [read_damage(heal.phases["verdict"]["believed"][0]) for heal in heals]
    return [damage for damage in found if damage.kind != "none"]


def _summarize_hours(run: HealRun, robot: str) -> Document:
    """What `heal --hours --json` prints."""
    walks = list_walks(run)
    start, seconds, _ = walks[-1]
    # the first walk is a whole robot's
    whole = walks[0][2] / walks[0][1] * (start + seconds)
    distance = sum(length for _, _, length in walks)
    events = list_events(run, start + seconds)
    return {
        "format": "selfheal-heal-hours",
        "version": 1,
        "robot": robot,
        "seed": run.settings.seed,
        "hours": round((start + seconds) / 3600, 4),
        "intact": round(_measure_intact(run), 3),
        "distance": round(distance, 3),
        "kept": round(distance / whole, 4),
        "kept_first": round(_share_first(run, start + seconds), 4),
        "events": events,
        "false_alarms": sum(event["damage"] is None for event in events),
        "seconds": round(run.seconds, 1),
        "run": run.settings.run,
    }


def _measure_intact(run: HealRun) -> float:
    """Speed of the whole robot [m/min]."""
    return _PER_MINUTE * float(run.heals[0].phases["whole"]["distance"])


def list_walks(run: HealRun) -> list[tuple[float, float, float]]:
    """Start [s], duration [s] and distance [m] of each walk, in order."""
    heals, heading = run.heals, run.settings.heading
    walks: list[tuple[float, float, float]] = []
    for k, heal in enumerate(heals):
        start = compute_start(heals[: k + 1])
        whole = _measure_distance(heal.phases["whole"], heading)
        walks.append((start, LEARNING_TIME, whole))
        start += LEARNING_TIME
        for each in heal.phases["alarm"]["ways"]:
            walks.append((start, WATCHING_TIME, each))
            start += WATCHING_TIME
        if alarm := heal.phases["alarm"]["alarm"]:  # the last walk ended with it
            start, _, length = walks.pop()
            walks.append((start, alarm["time"] - start, length))
    return walks


def list_first_speeds(run: HealRun) -> list[tuple[float, float]]:
    """Since when [s] the first gait has which speed [m/min], of a walk each alarm."""
    ended = [heal.phases for heal in run.heals if "first" in heal.phases]
    walked = [(0.0, run.heals[0].phases["whole"])]
    walked += [(phases["alarm"]["alarm"]["time"], phases["first"]) for phases in ended]
    return [
        (since, _PER_MINUTE * _measure_distance(walk, run.settings.heading, ROWS))
        for since, walk in walked
    ]


def _measure_distance(walk: Phase, heading: float, rows: int | None = None) -> float:
    """Distance [m] in the first rows; see `gait.synthesis.measure_distance`."""
    path = walk["position"][:rows], walk["orientation"][:rows]
    return measure_distance(*path, heading)


def _share_first(run: HealRun, end: float) -> float:
    """Share of the whole robot's way until a time [s] that the first gait keeps."""
    times, speeds = np.array(list_first_speeds(run)).T
    return float(np.diff([*times, end]) @ speeds / (end * speeds[0]))


def list_events(run: HealRun, end: float) -> list[Document]:
    """The damages until an end [s] and all alarms, in order; see `HoursEvent`.

    An alarm is for the last damage before it, or false if an earlier one was.
    """
    heals, left = run.heals, [s for s in run.settings.strikes if s.time < end]
    events, before = [], _measure_intact(run)
    for heal in heals:
        if not heal.phases["alarm"]["alarm"]:
            break
        due = [s for s in left if s.time <= heal.phases["alarm"]["alarm"]["time"]]
        left = left[len(due) :]
        events += [_describe_event(strike) for strike in due[:-1]]
        events.append(_describe_event(due[-1] if due else None, heal, before))
        before = events[-1]["healed"]
    return events + [_describe_event(strike) for strike in left]


def _describe_event(
    strike: Strike | None, heal: HealRun | None = None, before: float | None = None
) -> Document:
    """A row of the result, as `HoursEvent` has it.

    Args:
        strike: None of a false alarm.
        heal: after it; None where nothing was noticed.
        before: speed until then [m/min].
    """
    true = strike.damage if strike else INTACT
    event: Document = {
        "time": strike.time if strike else 0.0,
        "damage": true.document if strike else None,
        **dict.fromkeys(("alarm", "delay", "believed")),
        "right": False,
        "actions": 0,
        "before": before,
        **dict.fromkeys(("damaged", "healed", "first")),
    }
    if heal is None:
        return event
    alarm, best = heal.phases["alarm"]["alarm"], heal.phases["verdict"]["believed"][0]
    ways = {**heal.phases["walked"], "first": heal.phases["first"]["distance"]}
    return event | {
        "time": strike.time if strike else alarm["time"],
        "alarm": {key: alarm[key] for key in ("time", "sensor", "p_value")},
        "delay": round(alarm["time"] - strike.time, 3) if strike else None,
        "believed": best,
        "right": read_damage(best).place == true.place,
        "actions": len(heal.actions),
        **{key: _PER_MINUTE * ways[key] for key in ("damaged", "healed", "first")},
    }
