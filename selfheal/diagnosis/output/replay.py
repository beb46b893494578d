"""A replay of a diagnosis: takes commands and initial states, gives the signals.

What patched.xml says, MuJoCo simulates. What it cannot say becomes terms again, which
the diagnosis' own simulator applies.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError, RecordingError
from ...recording import (
    Episode,
    ModelNames,
    Recording,
    check_against_model,
    list_model_names,
)
from ...recording.data import Floats
from ..data.episodes import build_channels
from ..data.robot_summary import RobotSummary, summarize_bodies, summarize_joints
from ..data.segments import cut_segments
from ..effects import find_effect
from ..effects.base import Term
from ..effects.declaration import Parameter
from ..effects.nominal import build_nominal_terms
from ..effects.places import AddedJointPlace
from ..selection.search_record import Progress
from ..simulation.build import (
    StateReconstruction,
    sample_with_base,
    summarize_actuators,
)
from ..simulation.checks import find_divergence
from ..simulation.model_variants import ModelCompiler
from ..simulation.simulator import Simulator
from .schema import Document, Finding
from .storage import read_document

if TYPE_CHECKING:
    from mujoco import MjModel


def replay_recording(
    folder: str | os.PathLike[str],
    recording: Recording,
    *,
    model: str | os.PathLike[str] | None = None,
    progress: Progress = lambda what, share: None,
) -> Recording:
    """The recording with every predictable signal filled in, open loop.

    Args:
        recording: commands and initial states, or readings that tell where an episode
            starts; its signals are predicted.
        model: another version of the robot's model; None: the patched one.
        progress: called with a message and the share (0 to 1) of the steps simulated.

    Raises:
        InputError: the folder holds no diagnosis.
        ModelError: MuJoCo cannot load the model.
        RecordingError: nothing tells where an episode starts, or it speaks of what the
            model lacks.
    """
    document = read_document(folder)
    path = os.fspath(model if model is not None else Path(folder) / "patched.xml")
    compiler = ModelCompiler(path)
    patched = model is None and not document.get("unpatched")
    terms, values = _build_terms(document, compiler, patched)
    added = _find_added_joints(document, compiler.nominal) if patched else []
    check_against_model(recording, _list_names(compiler, len(added)))
    episodes = dict[str, Episode]()
    seconds = {name: float(np.ptp(e.time)) for name, e in recording.episodes.items()}
    over, whole = 0.0, max(sum(seconds.values()), 1e-9)
    for name in recording.episodes:
        progress(f"replaying {name}", over / whole)
        episodes[name] = _replay_episode(
            compiler, recording, name, terms, values, added
        )
        over += seconds[name]
    return replace(recording, episodes=episodes)


def _build_terms(
    document: Document, compiler: ModelCompiler, patched: bool
) -> tuple[list[Term], Floats]:
    """The terms that a diagnosis adds to a model, and all their values (P).

    Args:
        compiler: of the model that is replayed.
        patched: whether that is patched.xml, which has the native findings.
    """
    terms: list[Term] = []
    values: list[Floats] = []
    if not patched:
        for term, factor in _restore_refit(document, compiler):
            terms.append(term)
            values.append(np.array([factor]))
    for finding in document["findings"]:
        term = restore_term(finding, compiler, patched)
        (place,) = term.places
        if patched and finding.get("native") and term.effect.is_whole_in_text(place):
            continue
        terms.append(term)
        values.append(_read_values(finding))
    return terms, np.concatenate([*values, np.zeros(0)])


def _restore_refit(
    document: Document, compiler: ModelCompiler
) -> Iterator[tuple[Term, float]]:
    """Terms of the re-fitted values that this model states too, and their factors."""
    nominal_terms = {
        t.targets[0]: t for t in build_nominal_terms(summarize_unrecorded(compiler))
    }
    for entry in document["refit"]:
        if entry["parameter"] in nominal_terms and entry["given"]:
            yield nominal_terms[entry["parameter"]], entry["value"] / entry["given"]


def _read_values(finding: Finding) -> Floats:
    """Values (p) of a finding's parameters, vectors by their components."""
    values = [np.atleast_1d(np.array(p["value"], float)) for p in finding["parameters"]]
    return np.concatenate([*values, np.zeros(0)])


def restore_term(finding: Finding, compiler: ModelCompiler, patched: bool) -> Term:
    """A finding as a term of a model.

    Args:
        finding: of diagnosis.json, as `check_entries` let it pass.
        compiler: of the model that is replayed.
        patched: whether that is patched.xml.

    Raises:
        InputError: the model does not have what the finding is about.
    """
    effect = find_effect(finding["effect"])
    place = effect.find_place(compiler.nominal, finding)
    if patched:
        place = replace(place, is_patched=True)
        if isinstance(place, AddedJointPlace):
            _check_added_joint(compiler, place.added_name)
    parameters = tuple(
        Parameter(str(i), "", 0.0, -np.inf, np.inf, 1.0)
        for i in range(len(_read_values(finding)))
    )
    return Term(effect, (finding["target"],), (place,), parameters, ())


def _check_added_joint(compiler: ModelCompiler, name: str) -> None:
    """Refuse a patched model without the joint that a finding says is in it."""
    model = compiler.nominal
    if name not in [model.joint(j).name for j in range(model.njnt)]:
        raise InputError(
            f"{compiler.path} has no joint {name!r}, which the diagnosis says is in "
            "it; would fit: the patched.xml that was written with it"
        )


def summarize_unrecorded(compiler: ModelCompiler) -> RobotSummary:
    """The robot of a model, as a summary without any recording gives it."""
    model = compiler.nominal
    joints = summarize_joints(
        model, np.ones(model.nv), lambda j: (1.0, 1.0, *2 * (-1.0, 1.0)), set()
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
    """An episode with the signals as a model predicts them.

    Args:
        compiler: of the model that is replayed.
        terms: that a diagnosis adds to the model.
        values: (P) of all their parameters.
        added: ids of joints that a patch added, which the episode's state lacks.

    Raises:
        RecordingError: nothing tells where the episode starts, or the model diverges.
    """
    episode, model = recording.episodes[name], compiler.nominal
    one = replace(recording, episodes={name: episode})
    if episode.qpos0 is None and not build_channels([one]):
        raise RecordingError(
            f"{recording.file}, episode {name!r}: it has no qpos0 and no reading that "
            "tells where it starts; would fit: either of them"
        )
    signals = build_channels([one], empty=True)
    begun = _extend_state(episode, model, added)
    sampled = sample_with_base(name, begun, signals, model)
    simulator = Simulator(compiler, signals, (sampled,), float(model.opt.timestep))
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


def _find_added_joints(document: Document, model: "MjModel") -> list[int]:
    """Ids of the joints that a patch added to a model, hinges and slides."""
    places = [
        find_effect(finding["effect"]).find_place(model, finding)
        for finding in document["findings"]
    ]
    names = {p.added_name for p in places if isinstance(p, AddedJointPlace)}
    return [j for j in range(model.njnt) if model.joint(j).name in names]


def _list_names(compiler: ModelCompiler, added: int) -> ModelNames:
    """Names and sizes of a model that a recording may have, without added joints."""
    names = list_model_names(compiler.nominal)
    return replace(names, nq=names.nq - added, nv=names.nv - added)


def _extend_state(episode: Episode, model: "MjModel", added: Sequence[int]) -> Episode:
    """The episode with its given state, if any, in which added joints start at 0."""

    def extend(given: Floats | None, size: int, places: np.ndarray) -> Floats | None:
        """A state of `size` numbers, of which those of added joints are not given."""
        if given is None:
            return None
        whole = np.zeros(size)
        whole[np.delete(np.arange(size), places[added])] = given
        return whole

    return replace(
        episode,
        qpos0=extend(episode.qpos0, model.nq, model.jnt_qposadr),
        qvel0=extend(episode.qvel0, model.nv, model.jnt_dofadr),
    )
