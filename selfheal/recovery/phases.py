"""The phases of a heal: what is known so far in, the next phase out."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from ..body.body import Bodies, Floats
from ..damage.apply import apply_damages, list_gone_targets
from ..damage.kinds import INTACT, Damage
from ..engine.plant import build_rated_plant
from ..engine.walk import SAMPLE, compute_channels, list_channels, simulate_walks
from ..errors import InputError
from ..gait.pattern import SECONDS
from ..gait.synthesis import (
    ONE_GAIT,
    THREE_GAITS,
    Gait,
    GaitTask,
    LikelyPlants,
    evaluate_gait,
    measure_distance,
    project_on_heading,
    synthesize_gaits,
)
from ..recording import Recording
from ..robot.base import Walker
from ..robot.read_channels import read_channels, read_orientation, read_position
from .hypotheses import list_damages
from .monitor import learn_baseline, watch_walk
from .phased_run import Document, Phase, Progress
from .plausible_plants import find_plausible_plants
from .probes import list_probes
from .record import HealRun, HealSettings, read_gait, serialize_gait
from .reidentify import DamagePosterior

LEARNING_TIME = 30.0  # [s] of walking whole from which the monitor learns; chosen
WATCHING_TIME = 40.0  # [s] of each walk that is watched; chosen
_MOST_WALKS = 3  # such walks until it is given up that something is wrong; chosen
# hypotheses that the new gait has to suit; chosen
_MOST_HYPOTHESES, _LEAST_PROBABILITY = 4, 0.05
ROWS = round(SECONDS / SAMPLE)
# Of the tenth percentile of the distance that is predicted, a robot that goes less has
# another body than the gait was made for; chosen
_FAR_ENOUGH = 0.5
_MOST_SHOWN = 6  # hypotheses in the result


@dataclass(frozen=True)
class RobotStates:
    """The robot before, while and after it breaks.

    Attributes:
        intact: as it is while it learns how it walks.
        watched: as it is from the start of each walk that is watched.
        damaged: as it is after the alarm.
    """

    intact: Walker
    watched: Sequence[Walker]
    damaged: Walker


def make_robot_states(robot: Walker, settings: HealSettings) -> RobotStates:
    """The robot before, while and after the damage of some settings."""
    damaged = robot.struck(settings.damage)
    breaking = robot.struck(settings.damage, settings.onset)
    return RobotStates(robot, (breaking, *[damaged] * (_MOST_WALKS - 1)), damaged)


@dataclass(frozen=True)
class Past:
    """What was before a heal that is not a robot's first.

    Attributes:
        believed: damages that were found.
        time: when the watched walks begin [s].
        trials: number of trials so far, at least.
        first: the gait of the whole robot; None in a heal that stands alone.
    """

    believed: Sequence[Damage] = ()
    time: float = 0.0
    trials: int = 0
    first: Gait | None = None


class HealPhases:
    """One heal in progress: what its file does not hold."""

    def __init__(
        self,
        robots: RobotStates,
        models: Bodies,
        weights: Floats,
        settings: HealSettings,
        progress: Progress,
        past: Past,
    ) -> None:
        """See `heal.heal_robot` for the arguments."""
        self.robots, self.settings, self.progress = robots, settings, progress
        self.past, self.model = past, models[[0]]
        self.task = GaitTask(settings.gait, settings.heading, settings.seed)
        rated = [build_rated_plant(models[[k]]) for k in range(len(models))]
        self.plants = [apply_damages(plant, *past.believed) for plant in rated]
        self.weights = weights
        self.anatomy = models.anatomy
        self.channels = list_channels(self.anatomy)
        self.posterior: DamagePosterior | None = None

    def run_next(self, run: HealRun) -> tuple[str, Phase] | None:
        """The name of the next phase and what came of it; None at the end."""
        done = run.phases
        steps = {
            "gait": self._make_first_gait,
            "whole": self._walk_intact,
            "alarm": self._watch_for_alarm,
            "verdict": self._conclude_damage,
            "healed": self._make_healed_gait,
            "walked": self._walk_both_gaits,
            "first": self._walk_first_gait,
            "known": self._walk_informed_gait,
        }
        del steps["first" if self.past.first is None else "known"]
        name = next((name for name in steps if name not in done), None)
        if name is None:
            return None
        if name == "verdict" and done["alarm"]["alarm"]:
            doubt = self._restore_posterior(run)
            taken = None if doubt.is_done else self._take_action(doubt)
            if taken:
                return f"ask-{len(doubt.taken):02d}", taken
        return name, steps[name](run)

    def _make_first_gait(self, run: HealRun) -> Phase:
        """A gait for the whole robot."""
        likely = LikelyPlants(self.plants, self.weights)
        report = partial(self.progress, "gait")
        (gait,) = synthesize_gaits(likely, self.task, ONE_GAIT, progress=report)
        return {"gait": serialize_gait(gait)}

    def _walk_robot(
        self, robot: Walker, gait: Gait, seconds: float, trial: int
    ) -> Recording:
        """A gait on the robot: its recording."""
        commands = gait.commands(self.anatomy.size, seconds)
        return robot.move(commands, trial=self.past.trials + trial)

    def _extract_path(self, recording: Recording) -> dict[str, Floats]:
        """Where the torso was: position (S, 3) [m], orientation (S, 4), and joints."""
        channels = read_channels(recording, self.anatomy)[1]
        angles = channels[:, 3 : 3 + self.anatomy.size]
        return {
            "position": read_position(recording),
            "orientation": read_orientation(recording),
            "angles": np.radians(angles),
        }

    def _measure_distance(self, path: Floats) -> float:
        """Distance along the heading after `SECONDS` [m]."""
        last = path[ROWS - 1]
        return float(project_on_heading(last, self.settings.heading)[0])

    def _walk_intact(self, run: HealRun) -> Phase:
        """It walks, and the monitor learns how it walks while whole."""
        gait = read_gait(run.phases["gait"])
        self.progress("whole", "walking", 0.0)
        walked = self._walk_robot(self.robots.intact, gait, LEARNING_TIME, 0)
        path = self._extract_path(walked)
        distance = self._measure_distance(path["position"])
        if not self.past.believed and distance < _FAR_ENOUGH * gait.low:
            raise InputError(
                f"robot {self.anatomy.name!r} went {distance:.2f} m in 10 s where its "
                f"self-model predicts {gait.predicted:.2f} m ({gait.low:.2f} to "
                f"{gait.high:.2f}): it has another body, so that no damage could be "
                "told; would fit: a run of identify with more cycles, or more sensors"
            )
        channels = read_channels(walked, self.anatomy)[1]
        return {**path, "distance": distance, "felt": channels}

    def _predict_channels(self, gait: Gait, seconds: float) -> Floats:
        """(S, C) channels that the self-model predicts of a gait."""
        commands = gait.commands(self.anatomy.size, seconds)[None]
        walks = simulate_walks(self.plants[:1], commands)
        return compute_channels(walks, self.plants[:1])[0]

    def _watch_for_alarm(self, run: HealRun) -> Phase:
        """It walks on, breaks at some time, and notices."""
        gait = read_gait(run.phases["gait"])
        predicted = self._predict_channels(gait, WATCHING_TIME)
        measured = run.phases["whole"]["felt"]
        shown = predicted[: len(measured)]
        known = learn_baseline(measured, shown, gait.cycle, self.channels)
        distances: list[float] = []
        for shift, robot in enumerate(self.robots.watched):
            share = shift / len(self.robots.watched)
            self.progress("alarm", "walking and watching", share)
            walked = self._walk_robot(robot, gait, WATCHING_TIME, 1 + shift)
            now = read_channels(walked, self.anatomy)[1]
            seen = watch_walk(now, predicted, known, self.channels)
            end = round(seen.alarm.time / SAMPLE) if seen.alarm else len(now)
            path = read_position(walked)[:end], read_orientation(walked)[:end]
            distances.append(measure_distance(*path, self.settings.heading))
            if seen.alarm:
                break
        before, alarm = self.past.time + shift * WATCHING_TIME, None
        if seen.alarm:
            alarm = asdict(seen.alarm)
            alarm |= {k: round(alarm[k] + before, 3) for k in ("time", "since")}
        angles = now[max(0, end - 10) : end, 3 : 3 + self.anatomy.size].mean(axis=0)
        return {
            "alarm": alarm,
            "ways": distances,
            "angles": np.radians(angles),
            "time": seen.time + before,
            "sums": seen.sums,
            "threshold": seen.threshold,
        }

    def _restore_posterior(self, run: HealRun) -> DamagePosterior:
        """What is believed since the alarm, from all actions so far."""
        if self.posterior is None:
            gait = read_gait(run.phases["gait"])
            actions = list_probes(gait, self.anatomy.joints)
            gone = list_gone_targets(self.model, self.past.believed)
            guesses = list_damages(self.anatomy, run.phases["alarm"]["angles"], gone)
            walk, whole = actions[-1], run.phases["whole"]["felt"]
            rng = np.random.default_rng([self.settings.seed, 21])
            known = find_plausible_plants(self.plants[0], walk, whole, rng)
            self.posterior = DamagePosterior(self.plants[0], actions, guesses, known)
            for taken in run.actions:
                self.posterior.record_values(taken["probe"], taken["values"])
        return self.posterior

    def _take_action(self, doubt: DamagePosterior) -> Phase | None:
        """One action, chosen to tell the hypotheses apart; None if none would."""
        k = len(doubt.taken)
        # how many more it takes nobody knows
        self.progress("ask", f"choosing action {k + 1}", k / (k + 2))
        chosen = doubt.choose_probe(np.random.default_rng([self.settings.seed, 20, k]))
        if chosen is None:
            return None
        probe, left = chosen
        action = doubt.probes[probe]
        self.progress("ask", action.description, (k + 1) / (k + 3))
        trial = self.past.trials + 100 + k
        walked = self.robots.damaged.move(action.commands, trial=trial)
        doubt.observe(probe, read_channels(walked, self.anatomy)[1])
        return {
            "probe": probe,
            "why": action.description,
            "expected": left,
            "values": doubt.taken[probe],
            "believed": _list_beliefs(doubt),
        }

    def _conclude_damage(self, run: HealRun) -> Phase:
        """What happened."""
        if run.phases["alarm"]["alarm"] is None:
            return {"believed": [_format_hypothesis(INTACT, 1.0)]}
        doubt = self._restore_posterior(run)
        self.progress("verdict", "finding how much", 0.0)
        doubt.refine_values()
        return {"believed": _list_beliefs(doubt)}

    def _make_healed_gait(self, run: HealRun) -> Phase:
        """A new gait for what the robot is now believed to be."""
        old = read_gait(run.phases["gait"])
        believed = run.phases["verdict"]["believed"]
        most = believed[:_MOST_HYPOTHESES]
        likely = [b for b in most if b["probability"] >= _LEAST_PROBABILITY]
        if likely[0]["kind"] == "none":  # it is what the old gait was made for
            return {"gait": serialize_gait(old), "kept": True}
        plants, weights = [], []
        for b in likely:
            plants += [apply_damages(plant, read_damage(b)) for plant in self.plants]
            weights += [b["probability"] * weight for weight in self.weights]
        gait = self.try_gaits("healed", LikelyPlants(plants, weights), old)
        kept = bool(np.array_equal(gait.genes, old.genes))
        return {"gait": serialize_gait(gait), "kept": kept}

    def try_gaits(self, name: str, likely: LikelyPlants, old: Gait) -> Gait:
        """Of new gaits and the old one that which gets the broken robot farthest."""
        task = replace(self.task, seed=self.task.seed + 1)
        report = partial(self.progress, name)
        new = synthesize_gaits(likely, task, THREE_GAITS, start=old, progress=report)
        rivals = [*new, evaluate_gait(likely, old, task.seed)]
        distances = []
        for k, gait in enumerate(rivals):
            self.progress(name, f"walking gait {k + 1} of {len(rivals)}", 1.0)
            distances.append(self._walk_damaged(gait, 150 + k)["distance"])
        return rivals[int(np.argmax(np.nan_to_num(distances, nan=-np.inf)))]

    def _walk_damaged(self, gait: Gait, trial: int) -> Document:
        """A gait on the broken robot: its path, and how far it came."""
        walked = self._walk_robot(self.robots.damaged, gait, SECONDS, trial)
        path = self._extract_path(walked)
        return {**path, "distance": self._measure_distance(path["position"])}

    def _walk_both_gaits(self, run: HealRun) -> Phase:
        """The old and the new gait on the broken robot."""
        found: Document = {}
        both = {"damaged": "gait", "healed": "healed"}
        for k, (what, name) in enumerate(both.items()):
            self.progress("walked", f"{name} on the broken robot", 0.5 * k)
            walk = self._walk_damaged(read_gait(run.phases[name]), 200 + k)
            found[what] = walk.pop("distance")
            found |= {f"{what}_{key}": values for key, values in walk.items()}
        return found

    def _walk_first_gait(self, run: HealRun) -> Phase:
        """For the report alone: the whole robot's gait on what the robot is now."""
        assert self.past.first is not None
        return self._walk_damaged(self.past.first, 203)

    def _walk_informed_gait(self, run: HealRun) -> Phase:
        """For the report alone: what is found knowing the true damaged body, walked."""
        truth = self.robots.damaged.truth
        if truth is None:
            return {"distance": None}
        plant = apply_damages(build_rated_plant(truth), *self.settings.damage)
        old = read_gait(run.phases["gait"])
        gait = self.try_gaits("known", LikelyPlants([plant]), old)
        walk = self._walk_damaged(gait, 202)
        return {"gait": serialize_gait(gait), "distance": walk["distance"]}


def _list_beliefs(doubt: DamagePosterior) -> list[Document]:
    """The likeliest hypotheses, most likely first, as a phase keeps them."""
    return [
        _format_hypothesis(damage, chance)
        for damage, chance in doubt.rank_damages()[:_MOST_SHOWN]
    ]


def _format_hypothesis(damage: Damage, chance: float) -> Document:
    """A hypothesis as a phase keeps it."""
    extra = {"azimuth": damage.azimuth, "probability": round(chance, 6)}
    return {**damage.document, **extra}


def describe_belief(believed: Document) -> str:
    """A hypothesis with its probability, in words."""
    return f"{read_damage(believed)} ({100 * believed['probability']:.0f} %)"


def read_damage(believed: Document) -> Damage:
    """The damage of a hypothesis that a phase keeps."""
    return Damage(**{k: v for k, v in believed.items() if k != "probability"})
