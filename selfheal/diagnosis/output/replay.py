"""A diagnosed model replayed: takes commands and initial states, gives the signals."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, RecordingError
from ...recording import Episode, ModelNames, Recording, check_against_model, names_of
from ...recording.data import Floats
from ..data.episodes import build_channels, sample_episode
from ..data.robot_summary import RobotSummary, summarize_bodies, summarize_joints
from ..data.segments import cut_segments
from ..effects import find_effect
from ..effects.base import Parameter, Term
from ..effects.nominal import build_nominal_terms
from ..effects.places import Place
from ..simulation.build import (
    StateReconstruction,
    reorder_commands,
    summarize_actuators,
)
from ..simulation.checks import find_divergence
from ..simulation.model_variants import ModelCompiler
from ..simulation.simulator import Simulator
from .storage import read_document


def replay_recording(
    folder: str | os.PathLike[str],
    recording: Recording,
    *,
    model: str | os.PathLike[str] | None = None,
) -> Recording:
    """The recording with every predictable signal filled in, open loop.

    Args:
        folder: of a diagnosis.
        recording: commands and initial states; signals of NaN say what is asked for.
        model: another version of the robot's model; None: the patched one.

    Raises:
        InputError: the folder holds no diagnosis.
        ModelError: MuJoCo cannot load the model.
        RecordingError: an episode has no qpos0, or speaks of what the model lacks.
    """
    document = read_document(folder)
    path = os.fspath(model if model is not None else Path(folder) / "patched.xml")
    compiler = ModelCompiler(path)
    patched = model is None and not document.get("unpatched")
    terms, values = _build_terms(document, compiler, patched)
    added = _find_added_joints(document, compiler.nominal) if patched else []
    check_against_model(recording, _list_names(compiler, len(added)))
    episodes = {
        name: _replay_episode(compiler, recording, name, terms, values, added)
        for name in recording.episodes
    }
    return replace(recording, episodes=episodes)


def _build_terms(
    document: Mapping[str, Any], compiler: ModelCompiler, patched: bool
) -> tuple[list[Term], Floats]:
    """What is true beyond the model, and its values in a row."""
    terms: list[Term] = []
    values: list[Floats] = []
    if not patched:
        for term, factor in _restore_refit(document, compiler):
            terms.append(term)
            values.append(np.array([factor]))
    for finding in document["findings"]:
        term = restore_term(finding, compiler, patched)
        if patched and _is_in_patch(finding):
            continue
        terms.append(term)
        values.append(_read_values(finding))
    return terms, np.concatenate([*values, np.zeros(0)])


def _is_in_patch(finding: Mapping[str, Any]) -> bool:
    """Whether a patched model says all of a finding without help."""
    helped = (
        finding.get("measured") == "link"
        or find_effect(finding["effect"]).native_is_stepwise
    )
    return bool(finding.get("native") and not helped)


def _restore_refit(document, compiler: ModelCompiler) -> Iterator[tuple[Term, float]]:
    """What the diagnosis fitted anew, as factors of what this model states."""
    nominal_terms = {
        t.targets[0]: t for t in build_nominal_terms(summarize_unrecorded(compiler))
    }
    for entry in document["refit"]:
        if entry["parameter"] in nominal_terms and entry["given"]:
            yield nominal_terms[entry["parameter"]], entry["value"] / entry["given"]


def _read_values(finding: Mapping[str, Any]) -> Floats:
    return np.concatenate([
        np.atleast_1d(np.array(p["value"], float)) for p in finding["parameters"]
    ] + [np.zeros(0)])  # fmt: skip


def restore_term(
    finding: Mapping[str, Any], compiler: ModelCompiler, patched: bool
) -> Term:
    """A finding as a term of a model.

    Raises:
        InputError: the model does not have what the finding is about.
    """
    effect = find_effect(finding["effect"])
    place = effect.find_place(compiler.nominal, finding)
    if patched:
        place["there"] = True
        if "suffix" in place:
            _check_added_joint(compiler, place)
    parameters = tuple(
        Parameter(str(i), "", 0.0, -np.inf, np.inf, 1.0)
        for i in range(len(_read_values(finding)))
    )
    return Term(effect, (finding["target"],), (place,), parameters, ())


def _check_added_joint(compiler: ModelCompiler, place: Place) -> None:
    """Refuse a patched model without the joint that a finding says is in it."""
    joint, model = place["joint"], compiler.nominal
    name = f"{model.joint(joint).name}{place['suffix']}"
    if name not in [model.joint(j).name for j in range(model.njnt)]:
        raise InputError(
            f"{compiler.path} has no joint {name!r}, which the diagnosis says is in "
            "it; would fit: the patched.xml that was written with it"
        )


def summarize_unrecorded(compiler: ModelCompiler) -> RobotSummary:
    """A robot of which nothing was recorded."""
    model = compiler.nominal
    joints = summarize_joints(
        model, np.ones(model.nv), lambda j: (1.0, 1.0, -1.0, 1.0), set()
    )
    simulator = Simulator(compiler, (), (), float(model.opt.timestep))
    actuators = summarize_actuators(simulator, StateReconstruction(simulator), joints)
    return RobotSummary(
        model, simulator.timestep, (), joints, actuators, summarize_bodies(model), True
    )


def _replay_episode(
    compiler: ModelCompiler,
    recording: Recording,
    name: str,
    terms: Sequence[Term],
    values: Floats,
    added: Sequence[int],
) -> Episode:
    """One episode, filled in; `added` joints are not in its state."""
    episode = recording.episodes[name]
    if episode.qpos0 is None:
        raise RecordingError(
            f"{recording.file}, episode {name!r}: it has no qpos0; a replay needs the "
            "state that it starts from"
        )
    model = compiler.nominal
    begun = reorder_commands(_extend_state(episode, model, added), model)
    one = replace(recording, episodes={name: begun})
    signals = build_channels([one], empty=True)
    step = float(model.opt.timestep)
    simulator = Simulator(
        compiler, signals, (sample_episode(name, begun, signals, step),), step
    )
    segments = cut_segments(simulator.episodes, None, empty=True)
    predicted = simulator.simulate(terms, values[None], segments)[0]
    if not np.isfinite(predicted).all():
        _, _, lost = find_divergence(simulator, segments, terms, values)
        raise RecordingError(
            f"{recording.file}, episode {name!r}: the model diverges at {lost:.4g} s"
        )
    filled = dict(episode.signals)
    for c in signals:
        old = episode.signals[c.name]
        filled[c.name] = replace(
            old, values=predicted[:, c.columns].reshape(old.values.shape)
        )
    return replace(episode, signals=filled)


def _find_added_joints(document: Mapping[str, Any], model) -> list[int]:
    """Joints that a patch added to a model, each with one degree of freedom."""
    names = {
        finding["target"].partition(":")[2] + suffix
        for finding in document["findings"]
        if (suffix := getattr(find_effect(finding["effect"]), "suffix", ""))
    }
    return [j for j in range(model.njnt) if model.joint(j).name in names]


def _list_names(compiler: ModelCompiler, added: int) -> ModelNames:
    """What a recording may say of the model, to which a patch added joints."""
    names = names_of(compiler.nominal)
    return replace(names, nq=names.nq - added, nv=names.nv - added)


def _extend_state(episode: Episode, model, added: Sequence[int]) -> Episode:
    """The episode with a place in its state for joints that a patch added.

    They start at 0, and so does every velocity where none is given.
    """
    qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
    qpos[np.delete(np.arange(model.nq), model.jnt_qposadr[added])] = episode.qpos0
    if episode.qvel0 is not None:
        qvel[np.delete(np.arange(model.nv), model.jnt_dofadr[added])] = episode.qvel0
    return replace(episode, qpos0=qpos, qvel0=qvel)
