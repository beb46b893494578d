"""What a diagnosis says: the contract's document, and what a page draws beside it."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...mjcf.edit import Edit, apply_edits
from ...recording import Recording, opened
from ...recording.data import Floats
from .storage import check_folder, write_diagnosis


@dataclass(frozen=True, eq=False)
class Trace:
    """One signal in one stretch of a held-out episode, read and predicted.

    Attributes:
        episode: its name; empty where each of several was read once.
        signal: name; of a vector signal one column ("cube_position[2]").
        unit: of all values.
        time: (T) [s], or the number of the episode where each was read once.
        read: (T) NaN where missing.
        given, refit, patched: (T) by the model as given, re-fitted, with the findings.
    """

    episode: str
    signal: str
    unit: str
    time: Floats
    read: Floats
    given: Floats
    refit: Floats
    patched: Floats


@dataclass(frozen=True, eq=False)
class Localization:
    """Where the re-fitted model is wrong.

    Attributes:
        signals: (S) names.
        regimes: (R) of the contract.
        share: (S, R) of the squared error that lies there; NaN where never seen.
        p_value: (S, R) that it is no more than elsewhere, corrected for the grid.
    """

    signals: tuple[str, ...]
    regimes: tuple[str, ...]
    share: Floats
    p_value: Floats


@dataclass(frozen=True)
class SignalFit:
    """Normalized error of one signal on held-out episodes, with 90 % intervals.

    Attributes:
        name: of the signal.
        scored: whether it counts in the contract's score.
        given, refit, patched: (value, low, high) over episodes.
        floor: the noise's.
    """

    name: str
    scored: bool
    given: tuple[float, float, float]
    refit: tuple[float, float, float]
    patched: tuple[float, float, float]
    floor: float


@dataclass(frozen=True)
class Candidate:
    """An effect that was tried first.

    Attributes:
        effect: its name.
        target: where.
        left: share of the squared error that it leaves, before anything else is named.
        named: whether it is among the findings.
    """

    effect: str
    target: str
    left: float
    named: bool


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The answer.

    Attributes:
        model: the file that was diagnosed.
        document: diagnosis.json, contract section 2.
        edits: of the model's text, that make it patched.xml.
        patched: text of patched.xml, as it would stand beside the model.
        diff: of the given model's text to the patched one's.
        traces: the worst stretches, worst first.
        located: where the error lies.
        signals: held-out errors, one a signal.
        candidates: what was tried first, best first.
        remarks: sentences a user should read (never excited, not pinned down, ...).
        seconds: that it took.
        simulations: how many windows were simulated.
        page: report.html; empty where none was drawn.
        more_than_noise: whether the findings leave of short pieces more than noise.
    """

    model: str
    document: Mapping[str, Any]
    edits: Sequence[Edit]
    patched: str
    diff: str
    traces: tuple[Trace, ...]
    located: Localization
    signals: tuple[SignalFit, ...]
    candidates: tuple[Candidate, ...]
    remarks: tuple[str, ...]
    seconds: float
    simulations: int
    page: str = ""
    more_than_noise: bool = False

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write diagnosis.json, patched.xml and report.html, all or nothing.

        Args:
            folder: made where it is missing; meshes and textures still lead from it to
                where they are.
            force: whether an earlier diagnosis there is replaced.

        Raises:
            InputError: the folder cannot be written or would be lost, or the model's
                file has changed since it was diagnosed.
        """
        folder = check_folder(folder, force).resolve()
        given = Path(self.model)
        if apply_edits(given, self.edits, given.resolve().parent) != self.patched:
            raise InputError(
                f"{given} is no longer the model that was diagnosed; diagnose it again"
            )
        patched = apply_edits(given, self.edits, folder)
        write_diagnosis(folder, self.document, patched, self.page)

    def simulate(
        self,
        recording: Recording | str | os.PathLike[str],
        *,
        model: str | os.PathLike[str] | None = None,
    ) -> Recording:
        """What the robot does by this diagnosis, as `selfheal replay` predicts it.

        Args:
            recording: or its path: commands, initial states, and the signals that are
                asked for; their readings do not matter and may all be NaN.
            model: another version of the robot's model to apply the findings to.

        Returns:
            The recording with every signal that a model predicts filled in, open loop.

        Raises:
            RecordingError: an episode has no qpos0, does not fit the model, or makes
                it diverge.
            InputError: the model lacks what a finding is about.
        """
        from .replay import replay_recording

        recording = opened(recording)
        with tempfile.TemporaryDirectory() as room:
            folder = Path(room) / "diagnosis"
            self.save(folder)
            return replay_recording(folder, recording, model=model)
