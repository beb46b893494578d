"""Robots on which every effect has a place, and what their simulations predict."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np

from selfheal.diagnosis.data.segments import Segments
from selfheal.diagnosis.effects import find_effect, load_catalogue
from selfheal.diagnosis.effects.base import Term
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.output.build_result import build_patch
from selfheal.diagnosis.output.document import list_parameters
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.simulation import score
from selfheal.recording import Recording
from tests.support.recorded_robots import ROBOTS, Bench, Robot, bench

NAMES = tuple(load_catalogue())


@dataclass(frozen=True)
class EffectBench(Bench):
    """A recorded robot, the segments of its replay, and what its model predicts.

    Attributes:
        segments: of a replay.
        plain: (N, C) predictions of the model as given.
    """

    segments: Segments
    plain: np.ndarray


def make_effect_bench(robot: Robot, folder: Path) -> EffectBench:
    """The robot, recorded, its model in a folder."""
    b = bench(robot, folder, episodes=2, seconds=0.8, seed=4)
    segments = score.cut_replay_segments(b.simulator)
    plain = b.simulator.simulate((), np.zeros((1, 0)), segments)[0]
    return EffectBench(**vars(b), segments=segments, plain=plain)


def make_pendulum(folder: Path, **changes: str) -> EffectBench:
    """A pendulum whose model has some words changed."""
    xml = ROBOTS["pendulum"].xml
    for old, new in changes.items():
        assert old in xml
        xml = xml.replace(old, new)
    return make_effect_bench(replace(ROBOTS["pendulum"], xml=xml), folder)


def pick_terms(
    benches: Mapping[str, EffectBench], name: str, ends: Sequence[int] = (0, -1)
) -> Iterator[tuple[EffectBench, Term]]:
    """Some places of an effect on each robot: the first and the last, or one."""
    for b in benches.values():
        found = find_effect(name).propose_terms(b.robot)
        chosen = {range(len(found))[end] for end in ends if found}
        yield from ((b, found[i]) for i in sorted(chosen))


def find_elbow_term(b: EffectBench, name: str, **note: object) -> Term:
    """An effect's term at the arm's second joint, or its actuator."""
    wanted = ("joint:elbow",), ("actuator:elbow_servo",)
    return next(
        t for t in find_effect(name).propose_terms(b.robot)
        if t.targets in wanted and note.items() <= t.finding_fields.items()
    )  # fmt: skip


def absent_values(term: Term) -> np.ndarray:
    """Values (P) at which the effect is not there."""
    return np.array([p.nominal for p in term.parameters], float)


def present_values(term: Term) -> np.ndarray:
    """Initial values (P) of a search; a step from them where the effect is absent."""
    start = np.array(term.initial_values[0], float)
    return start + term.scale * (start.size and np.allclose(start, absent_values(term)))


def draw_factors(nominal: Iterable[Term]) -> np.ndarray:
    """Factors (P) of the model's own numbers, within their bounds."""
    nominal = tuple(nominal)
    rng = np.random.default_rng(2)
    reach = np.array([t.parameters[0].high - 1 for t in nominal])
    return 1 + 0.6 * reach * rng.uniform(-1, 1, len(nominal))


def predict(b: EffectBench, *pairs: tuple[Term, float | Iterable[float]]) -> np.ndarray:
    """Predictions (N, C) with terms of these values."""
    values = np.concatenate([np.atleast_1d(v) for _, v in pairs])
    return b.simulator.simulate([t for t, _ in pairs], values[None], b.segments)[0]


def largest_change(b: EffectBench, terms: Iterable[Term], values) -> float:
    """Largest change of any prediction, of the signals' own spread."""
    values = np.asarray(values, float)[None]
    predicted = b.simulator.simulate(terms, values, b.segments)[0]
    change = np.abs(predicted - b.plain)
    return max(
        change[:, c.columns].max() / c.spread
        for c in b.simulator.channels
        if c.is_scored
    )


def write_patch_text(b: EffectBench, terms: tuple[Term, ...], values) -> str:
    """The text of a patch with terms of these values."""
    case = SimpleNamespace(
        compiler=b.simulator.compiler, training=b.simulator, robot=b.robot
    )
    return build_patch(case, terms, values)[0]


def compile_patched(
    b: EffectBench, terms: Iterable[Term], values: Iterable[float]
) -> mujoco.MjModel:
    """The compiled patch with terms of these values."""
    text = write_patch_text(b, tuple(terms), np.array(values))
    return mujoco.MjModel.from_xml_string(text)


def make_document(nominal, factors, effects, values) -> dict:
    """A diagnosis that changes the model's numbers and names effects.

    Args:
        nominal: terms of the model's own numbers.
        values: of each of them.
    """
    findings = [
        {"effect": term.effect.name, "target": target, **term.finding_fields,
         "native": term.effect.is_native,
         "parameters": list_parameters(term, of_term, 0 * of_term)}
        for term, of_term in zip(effects, values, strict=True)
        for target in term.targets
    ]  # fmt: skip
    refit = [
        {"parameter": t.targets[0], "given": t.effect.value,
         "value": t.effect.value * float(f)}
        for t, f in zip(nominal, factors, strict=True)
    ]  # fmt: skip
    return {"format": "selfheal-diagnosis", "version": 1, "findings": findings,
            "refit": refit}  # fmt: skip


def write_diagnosis(folder: Path, text: str, document: dict) -> None:
    """A folder with the patched model and the document."""
    folder.mkdir()
    (folder / "patched.xml").write_text(text)
    (folder / "diagnosis.json").write_text(json.dumps(document))


def compare_replay(b: EffectBench, replay: Recording, predicted: np.ndarray) -> float:
    """Largest difference of a replay to a prediction, of the effect's own size."""
    worst = 0.0
    for c in b.simulator.channels:
        read = np.concatenate([
            e.signals[c.name].values.reshape(-1, c.width)
            for e in replay.episodes.values()
        ])  # fmt: skip
        size = np.abs(predicted - b.plain)[:, c.columns].max()
        apart = np.abs(read - predicted[:, c.columns]).max()
        worst = max(worst, apart / max(size, 1e-3 * c.spread))
    return worst


def check_replay(b: EffectBench, effects, folder: Path, limit: float) -> None:
    """Assert that a patch with these effects and its replay predict as they do.

    Args:
        limit: largest difference, of the effect's own size.
    """
    nominal = tuple(build_nominal_terms(b.robot))
    factors, present = draw_factors(nominal), [present_values(t) for t in effects]
    terms, values = (*nominal, *effects), np.concatenate([factors, *present])
    predicted = b.simulator.simulate(terms, values[None], b.segments)[0]
    assert np.isfinite(predicted).all()
    text = write_patch_text(b, terms, values)
    write_diagnosis(folder, text, make_document(nominal, factors, effects, present))
    for model in (None, b.path):
        replay = replay_recording(folder, b.recording, model=model)
        apart = compare_replay(b, replay, predicted)
        assert apart < limit, (
            effects[0].label,
            effects[0].finding_fields,
            model,
            apart,
        )
