"""The phases of a heal: what is known so far in, the next phase out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..body.body import Bodies, Floats
from ..body.damage import INTACT, Damage
from ..engine.plant import Plant, damaged, rated
from ..engine.walk import SAMPLE, channels_of, sensed, simulate
from ..gait.pattern import SECONDS
from ..gait.synthesis import Gait, forward, judge, synthesize
from ..recording import Recording
from ..robot.base import Walker
from .hypotheses import catalogue
from .likely import likely
from .monitor import baseline, watch
from .phased import Phase
from .probes import probes
from .record import HealRun, HealSettings, gait_document, gait_of
from .reidentify import Doubt, Told
from .senses import felt_over_time, orientation, position

LEARNED = 30.0  # [s] of walking whole from which the monitor learns; chosen
WATCHED = 40.0  # [s] of each walk that is watched; chosen
_SHIFTS = 3  # such walks until it is given up that something is wrong
_KEPT, _LIKELY = 4, 0.05  # hypotheses that the new gait has to suit; chosen
_SHOWN = 6  # hypotheses in the result
_STILL = ("none", "sensor_dead")  # kinds after which the old gait is as good as ever

Progress = Callable[[str, str, float], None]


@dataclass(frozen=True)
class Robots:
    """The robot in its three lives.

    Attributes:
        whole: as built.
        breaking: breaks in the middle of each move.
        broken: broken from the start.
    """

    whole: Walker
    breaking: Walker
    broken: Walker


def robots_of(robot: Walker, settings: HealSettings) -> Robots:
    """The robot before, while and after the damage of some settings."""
    damage = settings.damage
    return Robots(robot, robot.struck(damage, settings.onset), robot.struck(damage))


class Phases:
    """One heal in progress: what its file does not hold."""

    def __init__(
        self,
        robots: Robots,
        models: Bodies,
        weights: Floats,
        settings: HealSettings,
        progress: Progress,
    ) -> None:
        """See `heal.heal` for the arguments."""
        self.robots, self.settings, self.progress = robots, settings, progress
        self.plants = [rated(models[[k]]) for k in range(len(models))]
        self.weights = weights
        self.anatomy = models.anatomy
        self.channels = channels_of(self.anatomy)
        self.doubt: Doubt | None = None

    def next(self, run: HealRun) -> tuple[str, Phase] | None:
        """The name of the next phase and what came of it; None at the end."""
        done = run.phases
        first = {"gait": self._gait, "whole": self._whole, "alarm": self._alarm}
        for name, phase in first.items():
            if name not in done:
                return name, phase(done)
        if "verdict" not in done:
            doubt = self._doubt(run)
            if done["alarm"]["alarm"] and not doubt.done:
                name, asked = f"ask-{len(doubt.told) + 1:02d}", self._ask(doubt)
                if asked:
                    return name, asked
            return "verdict", self._verdict(run, doubt)
        last = {"healed": self._healed, "walked": self._walked, "known": self._known}
        for name, phase in last.items():
            if name not in done:
                return name, phase(done)
        return None

    def _synthesize(
        self,
        name: str,
        plants: Sequence[Plant],
        weights: Sequence[float] | Floats,
        seed: int,
        start: Gait | None = None,
    ) -> Gait:
        """A gait, with progress."""
        return synthesize(
            plants, weights=weights, name=self.settings.gait,
            heading=self.settings.heading, seed=seed, start=start,
            progress=lambda what, share: self.progress(name, what, share),
        )  # fmt: skip

    def _gait(self, done: Mapping[str, Phase]) -> Phase:
        """A gait for the whole robot."""
        gait = self._synthesize("gait", self.plants, self.weights, self.settings.seed)
        return {"gait": gait_document(gait)}

    def _move(self, robot: Walker, gait: Gait, seconds: float, trial: int) -> Recording:
        """A gait on the robot: its recording."""
        return robot.move(gait.commands(self.anatomy.size, seconds), trial=trial)

    def _path(self, recording: Recording) -> dict[str, Floats]:
        """Where the torso was: position (S, 3) [m], orientation (S, 4), and joints."""
        channels = felt_over_time(recording, self.anatomy)[1]
        angles = channels[:, 3 : 3 + self.anatomy.size]
        return {"position": position(recording), "orientation": orientation(recording),
                "angles": np.radians(angles)}  # fmt: skip

    def _distance(self, path: Floats) -> float:
        """Way along the heading after `SECONDS` [m]."""
        last = path[round(SECONDS / SAMPLE) - 1]
        return float(forward(last, self.settings.heading)[0])

    def _whole(self, done: Mapping[str, Phase]) -> Phase:
        """It walks, and the monitor learns how it walks while whole."""
        gait = gait_of(done["gait"])
        self.progress("whole", "walking", 0.0)
        walked = self._move(self.robots.whole, gait, LEARNED, 0)
        path = self._path(walked)
        return {**path, "distance": self._distance(path["position"]),
                "felt": felt_over_time(walked, self.anatomy)[1]}  # fmt: skip

    def _predicted(self, gait: Gait, seconds: float) -> Floats:
        """(S, C) channels that the self-model predicts of a gait."""
        commands = gait.commands(self.anatomy.size, seconds)[None]
        return sensed(simulate(self.plants[:1], commands), self.plants[:1])[0]

    def _alarm(self, done: Mapping[str, Phase]) -> Phase:
        """It walks on, breaks at some time, and notices."""
        gait = gait_of(done["gait"])
        predicted = self._predicted(gait, WATCHED)
        felt = done["whole"]["felt"]
        known = baseline(felt, predicted[: len(felt)], gait.cycle, self.channels)
        for shift in range(_SHIFTS):
            self.progress("alarm", "walking and watching", shift / _SHIFTS)
            robot = self.robots.broken if shift else self.robots.breaking
            walked = self._move(robot, gait, WATCHED, 1 + shift)
            now = felt_over_time(walked, self.anatomy)[1]
            seen = watch(now, predicted, known, self.channels)
            if seen.alarm:
                break
        before = shift * WATCHED
        alarm, end = None, len(now)
        if seen.alarm:
            end = round(seen.alarm.time / SAMPLE)
            late = {k: getattr(seen.alarm, k) + before for k in ("time", "since")}
            alarm = {**asdict(seen.alarm), **late}
        angles = now[max(0, end - 10) : end, 3 : 3 + self.anatomy.size].mean(axis=0)
        return {
            "alarm": alarm,
            "angles": np.radians(angles),
            "time": seen.time + before,
            "sums": seen.sums,
            "threshold": seen.threshold,
        }

    def _doubt(self, run: HealRun) -> Doubt:
        """What is believed since the alarm, from all actions so far."""
        if self.doubt is None:
            gait = gait_of(run.phases["gait"])
            actions = probes(gait, self.anatomy.joints)
            guesses = catalogue(self.anatomy, run.phases["alarm"]["angles"])
            walk, whole = actions[-1], run.phases["whole"]["felt"]
            rng = np.random.default_rng([self.settings.seed, 21])
            known = likely(self.plants[0], walk, whole, rng)
            self.doubt = Doubt(self.plants[0], actions, guesses, known)
            for told in run.asked:
                self.doubt.recall(Told(told["probe"], told["why"], told["values"]))
        return self.doubt

    def _ask(self, doubt: Doubt) -> Phase | None:
        """One action, chosen to tell the hypotheses apart; None if none would."""
        k = len(doubt.told)
        self.progress("ask", f"choosing action {k + 1}", 0.0)
        chosen = doubt.choose(np.random.default_rng([self.settings.seed, 20, k]))
        if chosen is None:
            return None
        probe, left = chosen
        action = doubt.probes[probe]
        self.progress("ask", action.says, 0.5)
        walked = self.robots.broken.move(action.commands, trial=100 + k)
        doubt.observe(probe, action.says, felt_over_time(walked, self.anatomy)[1])
        return {"probe": probe, "why": action.says, "expected": left,
                "values": doubt.told[-1].felt,
                "believed": _believed(doubt)}  # fmt: skip

    def _verdict(self, run: HealRun, doubt: Doubt) -> Phase:
        """What happened."""
        if run.phases["alarm"]["alarm"] is None:
            return {"believed": [_document(INTACT, 1.0)]}
        self.progress("verdict", "finding how much", 0.0)
        doubt.polish()
        return {"believed": _believed(doubt)}

    def _healed(self, done: Mapping[str, Phase]) -> Phase:
        """A new gait for what the robot is now believed to be."""
        old, believed = gait_of(done["gait"]), done["verdict"]["believed"]
        likely = [b for b in believed[:_KEPT] if b["probability"] >= _LIKELY]
        if likely[0]["kind"] in _STILL:
            return {"gait": gait_document(old), "kept": True}
        plants, weights = [], []
        for b in likely:
            for plant, weight in zip(self.plants, self.weights, strict=True):
                plants.append(damaged(plant, damage_of(b)))
                weights.append(b["probability"] * weight)
        gait = self._better("healed", plants, weights, old)
        kept = bool(np.array_equal(gait.genes, old.genes))
        return {"gait": gait_document(gait), "kept": kept}

    def _better(
        self, name: str, plants: Sequence[Plant], weights: Sequence[float], old: Gait
    ) -> Gait:
        """The better of a new gait and the old one, as the broken robot walks them."""
        new, again = self._rivals(name, plants, weights, old)
        if new.predicted <= again.predicted:
            return again
        way = []
        for trial, gait in ((150, new), (151, old)):
            self.progress(name, "trying it against the old one", 1.0)
            path = position(self._move(self.robots.broken, gait, SECONDS, trial))
            way.append(self._distance(path))
        return new if way[0] >= way[1] else again

    def _rivals(
        self, name: str, plants: Sequence[Plant], weights: Sequence[float], old: Gait
    ) -> tuple[Gait, Gait]:
        """A new gait and the old one, each with what is predicted of it."""
        seed = self.settings.seed + 1
        new = self._synthesize(name, plants, weights, seed, old)
        return new, judge(plants, old, weights=weights, seed=seed)

    def _walked(self, done: Mapping[str, Phase]) -> Phase:
        """The old and the new gait on the broken robot."""
        found: dict[str, Any] = {}
        for trial, name in ((200, "gait"), (201, "healed")):
            self.progress("walked", f"{name} on the broken robot", 0.5 * (trial - 200))
            gait = gait_of(done[name])
            path = self._path(self._move(self.robots.broken, gait, SECONDS, trial))
            what = {"gait": "damaged", "healed": "healed"}[name]
            found |= {f"{what}_{k}": v for k, v in path.items()}
            found[what] = self._distance(path["position"])
        return found

    def _known(self, done: Mapping[str, Phase]) -> Phase:
        """For the report alone: a gait for the true damaged body, walked."""
        robot, old = self.robots.broken, gait_of(done["gait"])
        if robot.truth is None:
            return {"distance": None}
        plant = damaged(rated(robot.truth), *self.settings.damage)
        rivals = self._rivals("known", [plant], [1.0], old)
        gait = max(rivals, key=lambda gait: gait.predicted)
        path = position(self._move(robot, gait, SECONDS, 202))
        return {"gait": gait_document(gait), "distance": self._distance(path)}


def _believed(doubt: Doubt) -> list[dict[str, Any]]:
    """The likeliest hypotheses, most likely first, as a phase keeps them."""
    return [_document(damage, chance) for damage, chance in doubt.verdict()[:_SHOWN]]


def _document(damage: Damage, chance: float) -> dict[str, Any]:
    """A hypothesis as a phase keeps it."""
    extra = {"azimuth": damage.azimuth, "probability": round(chance, 6)}
    return {**damage.document, **extra}


def damage_of(believed: Mapping[str, Any]) -> Damage:
    """The damage of a hypothesis that a phase keeps."""
    return Damage(**{k: v for k, v in believed.items() if k != "probability"})
